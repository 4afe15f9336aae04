//! Tests every search structure: tables against brute force in f64.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use calib_core::{Monitor, RowIndex, Segments, Silent, States, TransitionIndex, Transitions};
use calib_knn::{Blocks, Exclusion, IndexKind, KnnError, NeighborTable, SelfMatch, build_tables};
use proptest::prelude::*;

const KINDS: [IndexKind; 4] =
    [IndexKind::KdTree, IndexKind::Join, IndexKind::Scan, IndexKind::Auto];

/// The list of each transition: squared distances and transitions. `None` for transitions outside the
/// member.
type Lists = Vec<Option<Vec<(f64, u32)>>>;

#[derive(Clone, Debug)]
struct Case {
    lengths: Vec<usize>,
    columns: usize,
    values: Vec<f32>,
    members: usize,
    k: usize,
    exclusion: Exclusion,
}

/// Returns the rows that a transition leads from and to.
fn ends(transitions: &Transitions, i: usize) -> [RowIndex; 2] {
    let i = TransitionIndex::new(i);
    [transitions.source(i), transitions.next(i)]
}

impl Case {
    fn states(&self) -> States {
        let rows = self.lengths.iter().sum();
        States::new(self.values[..rows * self.columns].to_vec(), rows, self.columns).expect("valid")
    }

    fn transitions(&self) -> Transitions {
        Transitions::new(Segments::from_lengths(self.lengths.iter().copied()).expect("valid"))
    }

    /// Returns the lists of `member` by the definition, without the crate's own search code.
    fn expected(&self, member: usize) -> Result<Lists, usize> {
        let states = self.states();
        let all = self.transitions();
        let count = all.len();
        let block = member * count / self.members..(member + 1) * count / self.members;
        let rows: Vec<RowIndex> = block.flat_map(|i| ends(&all, i)).collect();
        let inside: Vec<bool> =
            (0..count).map(|i| !ends(&all, i).iter().any(|row| rows.contains(row))).collect();
        let mut fewest = usize::MAX;
        let lists = (0..count)
            .map(|i| {
                inside[i].then(|| {
                    let [_, query] = ends(&all, i);
                    let mut list: Vec<(f64, u32)> = (0..count)
                        .filter(|&j| inside[j] && !self.forbids(&all, query, ends(&all, j)[0]))
                        .map(|j| {
                            let [source, _] = ends(&all, j);
                            let pairs =
                                states.row(query.get()).iter().zip(states.row(source.get()));
                            let mut squared = 0.0;
                            for (&a, &b) in pairs {
                                squared += (f64::from(a) - f64::from(b)).powi(2);
                            }
                            (squared, j as u32)
                        })
                        .collect();
                    fewest = fewest.min(list.len());
                    list.sort_by(|a, b| a.partial_cmp(b).expect("finite"));
                    list.truncate(self.k);
                    list
                })
            })
            .collect();
        let fewest = if fewest == usize::MAX { 0 } else { fewest };
        if fewest < self.k { Err(fewest) } else { Ok(lists) }
    }

    fn forbids(&self, transitions: &Transitions, query: RowIndex, source: RowIndex) -> bool {
        let segments = transitions.segments();
        let near = self.exclusion.theiler > 0
            && segments.position_of(query.get()) == segments.position_of(source.get())
            && query.0.abs_diff(source.0) <= self.exclusion.theiler;
        near || (self.exclusion.self_match == SelfMatch::Excluded && query == source)
    }

    fn build(
        &self,
        kind: IndexKind,
        monitor: &dyn Monitor,
    ) -> Result<Vec<NeighborTable>, KnnError> {
        let states = self.states();
        let transitions = self.transitions();
        let blocks = Blocks::new(&transitions, self.members)?;
        build_tables(&states, &transitions, &blocks, self.k, self.exclusion, kind, monitor)
    }

    fn check(&self) -> Result<(), TestCaseError> {
        let expected: Result<Vec<_>, usize> = (0..self.members).map(|m| self.expected(m)).collect();
        for kind in KINDS {
            match (&expected, self.build(kind, &Silent)) {
                (Ok(members), Ok(tables)) => {
                    for (expected, table) in members.iter().zip(&tables) {
                        compare(expected, table, self.k)?;
                    }
                }
                (Err(fewest), Err(KnnError::TooFewCandidates { candidates, k, .. })) => {
                    prop_assert_eq!((*fewest, self.k), (candidates, k));
                }
                (Ok(_), Err(KnnError::Dimensions { columns, max })) => {
                    let tree = kind == IndexKind::KdTree;
                    prop_assert!(tree && columns > max && columns == self.columns);
                }
                (expected, got) => {
                    prop_assert!(false, "{kind:?}: expected {expected:?}, got {got:?}");
                }
            }
        }
        Ok(())
    }
}

fn compare(
    expected: &[Option<Vec<(f64, u32)>>],
    table: &NeighborTable,
    k: usize,
) -> Result<(), TestCaseError> {
    prop_assert_eq!((table.len(), table.k()), (expected.len(), k));
    let rows = table.neighbors().chunks(k).zip(table.distances().chunks(k));
    for (row, (expected, (neighbors, distances))) in expected.iter().zip(rows).enumerate() {
        let filler = vec![(f64::INFINITY, u32::MAX); k];
        let expected = expected.as_ref().unwrap_or(&filler);
        let got: Vec<(f32, u32)> =
            distances.iter().copied().zip(neighbors.iter().copied()).collect();
        let expected: Vec<(f32, u32)> =
            expected.iter().map(|&(s, j)| (s.sqrt() as f32, j)).collect();
        prop_assert_eq!(got, expected, "row {}", row);
    }
    Ok(())
}

/// Generates difficult values: continuous, coarsely quantised, copies of few rows, and tiny steps on an
/// offset.
fn values(rows: usize, columns: usize) -> impl Strategy<Value = Vec<f32>> {
    let count = rows * columns;
    let quantised = proptest::collection::vec((0_u8..3).prop_map(f32::from), count);
    let copies =
        proptest::collection::vec(-1.0_f32..1.0, 3 * columns).prop_flat_map(move |patterns| {
            proptest::collection::vec(0_usize..3, rows).prop_map(move |choice| {
                choice
                    .iter()
                    .flat_map(|&c| patterns[c * columns..(c + 1) * columns].to_vec())
                    .collect()
            })
        });
    let offset =
        proptest::collection::vec((0_u8..4).prop_map(|v| 1000.0 + f32::from(v) * 6.1e-5), count);
    let constant = proptest::collection::vec(-1.0_f32..1.0, count).prop_map(move |mut values| {
        for (position, value) in values.iter_mut().enumerate() {
            if position % columns != 0 {
                *value = 0.25;
            }
        }
        values
    });
    let walk = proptest::collection::vec(-0.01_f32..0.01, count).prop_map(move |mut values| {
        for position in columns..count {
            values[position] += values[position - columns];
        }
        values
    });
    let extreme = (proptest::collection::vec(-1.0_f32..1.0, count), -40_i32..38).prop_map(
        |(mut values, exponent)| {
            for value in &mut values {
                *value = (f64::from(*value) * 10_f64.powi(exponent)) as f32;
            }
            values
        },
    );
    // Rows of very different magnitude are adjacent: a sensor that breaks at the end of an episode.
    let mixed = (
        proptest::collection::vec(-1.0_f32..1.0, count),
        proptest::collection::vec(prop_oneof![3 => Just(0), 1 => -40_i32..38], rows),
    );
    let mixed = mixed.prop_map(move |(mut values, exponents)| {
        for (row, exponent) in values.chunks_exact_mut(columns).zip(exponents) {
            for value in row {
                *value = (f64::from(*value) * 10_f64.powi(exponent)) as f32;
            }
        }
        values
    });
    prop_oneof![
        proptest::collection::vec(-1.0_f32..1.0, count),
        quantised,
        copies,
        offset,
        constant,
        walk,
        extreme,
        mixed
    ]
}

fn case(columns: impl Strategy<Value = usize>, longest: usize) -> impl Strategy<Value = Case> {
    let shape = (proptest::collection::vec(1..longest, 1..7), columns);
    let shape = shape.prop_filter("enough transitions", |(lengths, _)| {
        lengths.iter().sum::<usize>() - lengths.len() >= 6
    });
    shape.prop_flat_map(|(lengths, columns)| {
        let rows = lengths.iter().sum();
        let theiler = prop_oneof![3 => Just(0_u32), 2 => 1_u32..5, 1 => 5_u32..40];
        (values(rows, columns), 2_usize..7, 1_usize..8, any::<bool>(), theiler).prop_map(
            move |(values, members, k, exclude, theiler)| Case {
                lengths: lengths.clone(),
                columns,
                values,
                members,
                k,
                exclusion: Exclusion {
                    self_match: if exclude { SelfMatch::Excluded } else { SelfMatch::Allowed },
                    theiler,
                },
            },
        )
    })
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(250) })]

    #[test]
    fn few_columns(case in case(1_usize..9, 30)) {
        case.check()?;
    }

    #[test]
    fn many_columns(case in case(9_usize..41, 20)) {
        case.check()?;
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(24) })]

    #[test]
    fn many_rows(case in case(1_usize..24, 260)) {
        case.check()?;
    }
}

fn sawtooth(rows: usize, columns: usize) -> Case {
    Case {
        lengths: vec![rows / 3, rows - rows / 3],
        columns,
        values: (0..rows * columns)
            .map(|i| ((i * 7919 + i / columns) % 1013) as f32 / 1013.0)
            .collect(),
        members: 4,
        k: 3,
        exclusion: Exclusion { self_match: SelfMatch::Allowed, theiler: 2 },
    }
}

#[test]
fn threads_do_not_change_a_byte() {
    for columns in [3, 33] {
        let case = sawtooth(2500, columns);
        let kinds = if columns > 8 { &KINDS[1..] } else { &KINDS[..] };
        let mut seen: Vec<(Vec<u32>, Vec<u32>)> = Vec::new();
        for &kind in kinds {
            for threads in [1, 4] {
                let pool =
                    rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
                let tables = pool.install(|| case.build(kind, &Silent)).expect("built");
                let neighbors = tables.iter().flat_map(|t| t.neighbors().to_vec()).collect();
                let distances =
                    tables.iter().flat_map(|t| t.distances().to_vec()).map(f32::to_bits).collect();
                seen.push((neighbors, distances));
            }
        }
        assert!(seen.windows(2).all(|pair| pair[0] == pair[1]));
    }
}

/// A monitor that counts progress, and interrupts beyond a limit.
struct Counting {
    /// Whether building the index counts, or only the search.
    all: bool,
    counts: AtomicBool,
    progress: AtomicU64,
    most: u64,
}

impl Counting {
    fn new(all: bool, most: u64) -> Self {
        Self { all, counts: false.into(), progress: 0.into(), most }
    }
}

impl Monitor for Counting {
    fn begin(&self, task: &str, total: u64) {
        let is_search = task == "neighbour tables";
        assert!(match task {
            "neighbour index" => [31_992, 15_996, 7998].contains(&total),
            _ => is_search && total == 7998,
        });
        self.counts.store(self.all || is_search, Ordering::Relaxed);
    }

    fn advance(&self, units: u64) {
        if self.counts.load(Ordering::Relaxed) {
            self.progress.fetch_add(units, Ordering::Relaxed);
        }
    }

    fn interrupted(&self) -> bool {
        self.progress.load(Ordering::Relaxed) > self.most
    }
}

#[test]
fn work_ends_when_the_user_asks() {
    let case = sawtooth(8000, 4);
    for kind in KINDS {
        let monitor = Counting::new(true, 0);
        let stopped = case.build(kind, &monitor);
        assert!(matches!(stopped, Err(KnnError::Cancelled(_))));
        assert!(monitor.progress.into_inner() < 31_992);
    }
}

/// Returns the number of tables and the progress of a build on one thread, which ends after this much progress.
fn build_alone(case: &Case, kind: IndexKind, most: u64) -> (Result<usize, KnnError>, u64) {
    let monitor = Counting::new(false, most);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a pool");
    let built = pool.install(|| case.build(kind, &monitor));
    (built.map(|tables| tables.len()), monitor.progress.into_inner())
}

#[test]
fn progress_reaches_its_end_and_a_scan_ends_inside_a_block() {
    let case = sawtooth(8000, 4);
    for kind in KINDS {
        let (built, progress) = build_alone(&case, kind, u64::MAX);
        assert_eq!((built.expect("not interrupted"), progress), (4, 7998), "{kind:?}");
    }
    // A block has 1024 queries.
    let (stopped, progress) = build_alone(&case, IndexKind::Scan, 0);
    assert!(matches!(stopped, Err(KnnError::Cancelled(_))));
    assert!((1..512).contains(&progress), "{progress}");
}

#[test]
fn impossible_requests_are_refused_with_numbers() {
    let case = sawtooth(30, 2);
    let few =
        Case { k: 30, ..case.clone() }.build(IndexKind::Auto, &Silent).expect_err("30 neighbours");
    let text = few.to_string();
    assert!(text.contains("fewer than `neighbors` = 30"), "{text}");
    let none = Case { k: 0, ..case.clone() }.build(IndexKind::Auto, &Silent);
    assert!(matches!(none, Err(KnnError::NoNeighbors)));
    let transitions = case.transitions();
    let blocks = Blocks::new(&transitions, 4).expect("valid");
    let states = States::new(vec![0.0; 58], 29, 2).expect("valid");
    let rows =
        build_tables(&states, &transitions, &blocks, 1, case.exclusion, IndexKind::Auto, &Silent);
    assert!(matches!(rows, Err(KnnError::Rows { states: 29, segments: 30 })));
}
