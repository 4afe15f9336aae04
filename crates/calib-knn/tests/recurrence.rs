//! Models without traps, against global rounds over brute force.

use std::collections::{BTreeMap, BTreeSet};

use calib_core::{RowIndex, Seed, Segments, Silent, States, TransitionIndex, Transitions};
use calib_knn::{
    Blocks, Built, Exclusion, IndexKind, KnnError, KnnModel, ModelConfig, Weights, WeightsKind,
    Workplace, closed_classes, verify,
};
use proptest::prelude::*;

#[derive(Clone, Debug)]
struct Case {
    lengths: Vec<usize>,
    values: Vec<f32>,
    config: ModelConfig,
}

/// What the definition says of one member.
#[derive(Debug, PartialEq)]
struct Expected {
    /// Lists of the member's transitions.
    rows: BTreeMap<u32, Vec<u32>>,
    left_out: BTreeSet<u32>,
    exits: BTreeMap<u32, BTreeSet<u32>>,
    /// Sizes of the closed classes before and after, the largest first.
    before: Vec<usize>,
    after: Vec<usize>,
}

/// One member by the definition, without any of the crate's searches.
struct Naive<'a> {
    states: &'a States,
    transitions: &'a Transitions,
    exclusion: Exclusion,
    inside: Vec<u32>,
    config: &'a ModelConfig,
    left_out: BTreeSet<u32>,
    exits: BTreeMap<u32, BTreeSet<u32>>,
}

fn sizes(classes: &[BTreeSet<u32>]) -> Vec<usize> {
    classes.iter().map(BTreeSet::len).collect()
}

/// As many of the sizes as a build tells.
fn told(sizes: &[usize]) -> Vec<usize> {
    sizes[..sizes.len().min(10)].to_vec()
}

impl Naive<'_> {
    fn distance(&self, a: RowIndex, b: RowIndex) -> f64 {
        let pairs = self.states.row(a.get()).iter().zip(self.states.row(b.get()));
        pairs.map(|(&a, &b)| (f64::from(a) - f64::from(b)).powi(2)).sum()
    }

    /// What `row` may find, nearest first, without what is also `barred`.
    fn list(&self, row: RowIndex, exclusion: Exclusion, barred: &BTreeSet<u32>) -> Vec<(f64, u32)> {
        let forbidden = exclusion.forbidden(self.transitions, row);
        let mut list: Vec<(f64, u32)> = (self.inside.iter().copied())
            .filter(|j| !forbidden.contains(j) && !self.left_out.contains(j) && !barred.contains(j))
            .filter(|j| j.is_multiple_of(self.config.prototypes))
            .map(|j| (self.distance(row, self.transitions.source(TransitionIndex(j))), j))
            .collect();
        list.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        list
    }

    fn next(&self, node: u32) -> RowIndex {
        self.transitions.next(TransitionIndex(node))
    }

    /// The row of the table, or how many candidates there are if these are too few.
    fn row(&self, node: u32) -> Result<Vec<(f64, u32)>, usize> {
        let none = BTreeSet::new();
        let barred = self.exits.get(&node).unwrap_or(&none);
        let mut list = self.list(self.next(node), self.exclusion, barred);
        if list.len() < self.config.neighbors {
            return Err(list.len());
        }
        list.truncate(self.config.neighbors);
        Ok(list)
    }

    fn table(&self) -> Result<BTreeMap<u32, Vec<(f64, u32)>>, usize> {
        self.inside.iter().map(|&node| Ok((node, self.row(node)?))).collect()
    }

    /// What each transition leads to, by any number of steps, itself included.
    fn reached(&self, table: &BTreeMap<u32, Vec<(f64, u32)>>) -> BTreeMap<u32, BTreeSet<u32>> {
        let weights = self.config.weights().expect("valid");
        let edges: BTreeMap<u32, Vec<u32>> = (table.iter())
            .map(|(&node, row)| {
                let distances: Vec<f32> = row.iter().map(|&(s, _)| s.sqrt() as f32).collect();
                let drawn = row.iter().zip(weights.probabilities(&distances));
                (node, drawn.filter(|(_, p)| *p > 0.0).map(|(&(_, to), _)| to).collect())
            })
            .collect();
        self.inside
            .iter()
            .map(|&start| {
                let mut known = BTreeSet::from([start]);
                let mut open = vec![start];
                while let Some(node) = open.pop() {
                    open.extend(edges[&node].iter().copied().filter(|&to| known.insert(to)));
                }
                (start, known)
            })
            .collect()
    }

    /// Closed classes: sets that are reached from each of their transitions, and reach nothing else.
    fn closed(&self, table: &BTreeMap<u32, Vec<(f64, u32)>>) -> Vec<BTreeSet<u32>> {
        let reached = self.reached(table);
        let mut classes: Vec<BTreeSet<u32>> = Vec::new();
        for (&start, known) in &reached {
            let first = known.first() == Some(&start);
            if first && known.iter().all(|node| reached[node] == *known) {
                classes.push(known.clone());
            }
        }
        classes.sort_by_key(|class| std::cmp::Reverse(class.len()));
        classes
    }

    /// How many of these are not followed by the same state.
    fn lost<'t>(&self, nodes: impl IntoIterator<Item = &'t u32>) -> usize {
        nodes.into_iter().filter(|node| !self.is_still(**node)).count()
    }

    /// Whether `node` leads to the state that it starts from, and a candidate follows.
    fn is_still(&self, node: u32) -> bool {
        let source = self.transitions.source(TransitionIndex(node));
        let next = self.next(node);
        self.distance(source, next) == 0.0
            && self.transitions.starting_at(next).is_some_and(|next| {
                self.inside.contains(&next.0) && next.0.is_multiple_of(self.config.prototypes)
            })
    }

    fn expected(mut self) -> Result<Expected, KnnError> {
        let candidates =
            self.inside.iter().filter(|j| j.is_multiple_of(self.config.prototypes)).count();
        let is_trap = |class: &BTreeSet<u32>| 10 * class.len() < candidates;
        let first = self.table().map_err(|candidates| KnnError::TooFewCandidates {
            member: 9,
            candidates,
            k: 0,
        })?;
        let before = self.closed(&first);
        // All traps at once, again and again.
        let returns = 100 * self.loops(&first) >= candidates;
        let outcome = loop {
            if !returns {
                break None;
            }
            let Ok(table) = self.table() else { break None };
            let traps: Vec<_> = self.closed(&table).into_iter().filter(is_trap).collect();
            if traps.is_empty() {
                break Some(table);
            }
            self.left_out.extend(traps.into_iter().flatten());
        };
        let table = match outcome {
            Some(table) if self.lost(&self.left_out) <= candidates / 10 => table,
            _ => self.led_out(candidates, &is_trap).unwrap_or_else(|| {
                self.left_out.clear();
                self.exits.clear();
                first
            }),
        };
        let after = self.closed(&table);
        let rows = (table.into_iter())
            .map(|(node, row)| (node, row.into_iter().map(|(_, to)| to).collect()))
            .collect();
        Ok(Expected {
            rows,
            before: sizes(&before),
            after: sizes(&after),
            left_out: self.left_out,
            exits: self.exits,
        })
    }

    /// Transitions of the largest component that one of sixteen probes lies in.
    fn loops(&self, table: &BTreeMap<u32, Vec<(f64, u32)>>) -> usize {
        let reached = self.reached(table);
        let shares =
            [8, 4, 12, 2, 10, 6, 14, 1, 9, 5, 13, 3, 11, 7, 15].map(|n| f64::from(n) / 16.0);
        let shares = shares.into_iter().chain([1.0 / 32.0]);
        shares
            .map(|share: f64| {
                let probe = table[&self.inside[(share * self.inside.len() as f64) as usize]][0].1;
                reached[&probe].iter().filter(|&to| reached[to].contains(&probe)).count()
            })
            .max()
            .expect("some")
    }

    /// The other way: standstills are left out, and what remains has exits; nothing if that does not help.
    fn led_out(
        &mut self,
        candidates: usize,
        is_trap: &impl Fn(&BTreeSet<u32>) -> bool,
    ) -> Option<BTreeMap<u32, Vec<(f64, u32)>>> {
        self.left_out.clear();
        loop {
            let classes = self.closed(&self.table().ok()?).into_iter();
            let free: Vec<_> =
                classes.filter(|class| is_trap(class) && self.lost(class) == 0).collect();
            if free.is_empty() {
                break;
            }
            self.left_out.extend(free.into_iter().flatten());
        }
        for _ in 0..=(candidates / (16 * self.config.neighbors)).clamp(16, 1000) {
            let table = self.table().ok()?;
            // Any one of them: the order does not matter.
            match self.closed(&table).into_iter().rfind(is_trap) {
                Some(trap) => self.lead_out(&trap).ok()?,
                None => return Some(table),
            }
        }
        None
    }

    fn lead_out(&mut self, class: &BTreeSet<u32>) -> Result<(), usize> {
        let mut among: Vec<u32> = class
            .iter()
            .filter(|node| {
                let next = self.transitions.starting_at(self.next(**node));
                next.is_none_or(|next| {
                    !self.inside.contains(&next.0)
                        || self.left_out.contains(&next.0)
                        || !next.0.is_multiple_of(self.config.prototypes)
                })
            })
            .copied()
            .collect();
        if among.is_empty() {
            among = class.iter().copied().collect();
        }
        let best = among
            .into_iter()
            .filter_map(|node: u32| {
                let barred = self.exits.get(&node).into_iter().flatten().chain(class).copied();
                let list = self.list(self.next(node), self.exclusion, &barred.collect());
                list.first().map(|&(squared, _)| (squared.sqrt() as f32, node))
            })
            .reduce(|a, b| if b < a { b } else { a });
        let (_, node) = best.ok_or(0_usize)?;
        self.exits.entry(node).or_default().extend(class);
        self.row(node).map(|_| ())
    }
}

impl Case {
    fn states(&self) -> States {
        let rows = self.lengths.iter().sum();
        let columns = self.values.len() / rows;
        States::new(self.values.clone(), rows, columns).expect("finite")
    }

    fn transitions(&self) -> Transitions {
        Transitions::new(Segments::from_lengths(self.lengths.iter().copied()).expect("valid"))
    }

    fn expected(&self, member: usize) -> Result<Expected, KnnError> {
        let states = self.states();
        let transitions = self.transitions();
        let blocks = Blocks::new(&transitions, self.config.members)?;
        let naive = Naive {
            states: &states,
            transitions: &transitions,
            exclusion: self.config.exclusion(),
            inside: blocks.transitions_of(member).map(|node| node.0).collect(),
            config: &self.config,
            left_out: BTreeSet::new(),
            exits: BTreeMap::new(),
        };
        naive.expected()
    }

    fn check(&self) -> Result<(), TestCaseError> {
        let expected: Result<Vec<Expected>, KnnError> =
            (0..self.config.members).map(|member| self.expected(member)).collect();
        for index in [IndexKind::Scan, IndexKind::Join, IndexKind::KdTree, IndexKind::Auto] {
            let config = ModelConfig { index, ..self.config };
            let place = Workplace::default();
            let built =
                KnnModel::build_in(self.states(), self.transitions(), &config, &place, &Silent);
            match (&expected, built) {
                (Ok(expected), Ok((model, built))) => {
                    for (member, expected) in expected.iter().enumerate() {
                        let found = &built.recurrence[member];
                        prop_assert_eq!(&found.before.largest, &told(&expected.before));
                        prop_assert_eq!(found.before.count, expected.before.len());
                        prop_assert_eq!(&found.after.largest, &told(&expected.after));
                        prop_assert!(found.after.traps == 0 || found.after == found.before);
                        let left_out: BTreeSet<u32> =
                            model.left_out(member).runs().flatten().collect();
                        prop_assert_eq!(&left_out, &expected.left_out);
                        let exits: BTreeMap<u32, BTreeSet<u32>> = (model.left_out(member).exits())
                            .map(|(row, runs)| (row, runs.iter().cloned().flatten().collect()))
                            .collect();
                        prop_assert_eq!(&exits, &expected.exits);
                        for (&node, row) in &expected.rows {
                            let (neighbors, _) =
                                model.member(member).neighbors(TransitionIndex(node));
                            prop_assert_eq!(
                                neighbors,
                                &row[..],
                                "row {} of member {}",
                                node,
                                member
                            );
                        }
                    }
                    if config.prototypes == 1 {
                        let verified = verify(&model, 10_000, Seed::new(1), &Silent);
                        prop_assert!(verified.expect("not interrupted").agrees());
                    }
                }
                (
                    Err(KnnError::TooFewCandidates { .. }),
                    Err(KnnError::TooFewCandidates { .. }),
                ) => {}
                (expected, got) => {
                    prop_assert!(false, "{:?}: expected {:?}, got {:?}", index, expected, got);
                }
            }
        }
        Ok(())
    }
}

fn case() -> impl Strategy<Value = Case> {
    let shape = (proptest::collection::vec(1_usize..40, 1..6), 1_usize..4);
    let shape = shape.prop_filter("enough transitions", |(lengths, _)| {
        lengths.iter().sum::<usize>() - lengths.len() >= 12
    });
    shape.prop_flat_map(|(lengths, columns)| {
        let rows: usize = lengths.iter().sum();
        let count = rows * columns;
        let quantised = proptest::collection::vec((0_u8..3).prop_map(f32::from), count);
        let walk = proptest::collection::vec(-1.0_f32..1.0, count).prop_map(move |mut values| {
            for position in columns..count {
                values[position] += values[position - columns];
            }
            values
        });
        // Rows that stand still for a while.
        let still = (
            proptest::collection::vec(-1.0_f32..1.0, count),
            proptest::collection::vec(0_u8..4, rows),
        );
        let still = still.prop_map(move |(mut values, moves)| {
            for (row, &moves) in moves.iter().enumerate().skip(1) {
                if moves > 0 {
                    values.copy_within((row - 1) * columns..row * columns, row * columns);
                }
            }
            values
        });
        let ramp = Just((0..count).map(|position| (position / columns) as f32).collect());
        let values = prop_oneof![3 => quantised, 3 => walk, 3 => still, 1 => ramp];
        let weights = prop_oneof![
            3 => Just(WeightsKind::Linear),
            1 => Just(WeightsKind::Uniform),
            1 => Just(WeightsKind::Inverse),
            1 => Just(WeightsKind::Rank)
        ];
        let exclusion = prop_oneof![
            4 => Just((false, 0_u32)),
            2 => Just((true, 0)),
            2 => (1_u32..6).prop_map(|theiler| (false, theiler))
        ];
        let settings = (2_usize..4, 1_usize..5, prop_oneof![4 => Just(1_u32), 1 => 2_u32..4]);
        (values, weights, exclusion, settings).prop_map(
            move |(values, weights, (exclude_self, theiler), settings)| {
                let (members, neighbors, prototypes) = settings;
                let config = ModelConfig {
                    members,
                    neighbors,
                    prototypes,
                    weights,
                    exclude_self,
                    theiler,
                    ..ModelConfig::default()
                };
                Case { lengths: lengths.clone(), values, config }
            },
        )
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn tables_are_those_of_global_rounds(case in case()) {
        case.check()?;
    }
}

/// Sizes of the closed classes of the tables, the largest first: what is reached from each transition that is reached from one.
fn closed_by_definition(model: &KnnModel, member: usize, weights: Weights) -> Vec<usize> {
    let member = model.member(member);
    let len = model.transitions().len();
    let nodes: Vec<usize> =
        (0..member.len()).map(|position| member.nth(position).0 as usize).collect();
    let mut edges = vec![Vec::new(); len];
    for &node in &nodes {
        let (neighbors, distances) = member.neighbors(TransitionIndex(node as u32));
        let drawn = neighbors.iter().zip(weights.probabilities(distances));
        edges[node] = drawn.filter(|(_, p)| *p > 0.0).map(|(&to, _)| to as usize).collect();
    }
    let closure = |start: usize| {
        let mut known = vec![false; len];
        let mut reached = vec![start];
        known[start] = true;
        let mut next = 0;
        while let Some(&node) = reached.get(next) {
            reached
                .extend(edges[node].iter().filter(|&&to| !std::mem::replace(&mut known[to], true)));
            next += 1;
        }
        reached
    };
    let mut counts = vec![0; len];
    for &node in &nodes {
        counts[node] = closure(node).len();
    }
    let mut classes: Vec<usize> = (nodes.iter())
        .map(|&node| (node, closure(node)))
        .filter(|(node, reached)| {
            reached.iter().all(|to| to >= node && counts[*to] == reached.len())
        })
        .map(|(_, reached)| reached.len())
        .collect();
    classes.sort_unstable_by_key(|&size| std::cmp::Reverse(size));
    classes
}

/// What is told of the tables is what they have.
fn check_what_is_told(
    model: &KnnModel,
    built: &Built,
    weights: Weights,
) -> Result<(), TestCaseError> {
    for (number, found) in built.recurrence.iter().enumerate() {
        let sizes = closed_by_definition(model, number, weights);
        prop_assert_eq!(&found.after.largest, &sizes[..sizes.len().min(10)], "member {}", number);
        prop_assert_eq!(found.after.count, sizes.len());
        prop_assert_eq!(found.after.transitions, sizes.iter().sum::<usize>());
        let traps = sizes.iter().filter(|&&size| 10 * size < found.candidates).count();
        prop_assert_eq!(found.after.traps, traps);
        let again = closed_classes(model, number, weights, found.candidates, &Silent);
        prop_assert_eq!(&again.expect("not interrupted").0, &found.after);
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn what_is_told_is_what_the_tables_have(case in case(), components in 0_usize..3) {
        // Distances in components are not those that neighbours are drawn by.
        let columns = case.values.len() / case.lengths.iter().sum::<usize>();
        let config = ModelConfig { components: components.min(columns - 1), ..case.config };
        let place = Workplace::default();
        let built = KnnModel::build_in(case.states(), case.transitions(), &config, &place, &Silent);
        if let Ok((model, built)) = built {
            check_what_is_told(&model, &built, config.weights().expect("valid"))?;
        }
    }
}

#[test]
fn a_log_that_comes_back_by_small_steps_has_a_closed_class() {
    // Each tooth begins a little below the one before, and rises to where that one began: a walk climbs one tooth a tooth.
    const TEETH: usize = 300;
    const ROWS: usize = 30;
    let mut rng = Seed::new(3).rng();
    let values = (0..TEETH * ROWS)
        .map(|row| {
            let tooth = (row / ROWS) as f64;
            let rise = (row % ROWS) as f64 / ROWS as f64;
            (rise - tooth + 1e-4 * rng.normal()) as f32
        })
        .collect();
    let states = States::new(values, TEETH * ROWS, 1).expect("finite");
    let segments = Segments::from_lengths([TEETH * ROWS]).expect("valid");
    let config = ModelConfig { members: 2, ..ModelConfig::default() };
    let transitions = Transitions::new(segments);
    let place = Workplace::default();
    let built = KnnModel::build_in(states, transitions, &config, &place, &Silent);
    let (model, built) = built.expect("built");
    let weights = config.weights().expect("valid");
    check_what_is_told(&model, &built, weights).unwrap_or_else(|error| panic!("{error}"));
    for found in &built.recurrence {
        assert_eq!((found.after.count, found.after.traps), (1, 0), "{found:?}");
        assert!(100 * found.after.transitions > 99 * found.candidates, "{found:?}");
    }
}

fn model_of(values: Vec<f32>, lengths: &[usize]) -> Result<(KnnModel, Built), KnnError> {
    let states = States::new(values, lengths.iter().sum(), 1).expect("finite");
    let segments = Segments::from_lengths(lengths.iter().copied()).expect("valid");
    let config = ModelConfig::default();
    let place = Workplace::default();
    KnnModel::build_in(states, Transitions::new(segments), &config, &place, &Silent)
}

#[test]
fn a_log_that_never_returns_stays_as_it_was_found() {
    let counter = (0..3000_u16).map(f32::from).collect();
    for values in [counter, vec![1.5; 3000]] {
        let (model, built) = model_of(values, &[3000]).expect("built all the same");
        for (number, found) in built.recurrence.iter().enumerate() {
            assert!(found.after.traps > 0 && found.after == found.before, "{found:?}");
            assert!(model.left_out(number).is_empty());
        }
        let verified = verify(&model, 50, Seed::new(1), &Silent).expect("not interrupted");
        assert!(verified.agrees());
    }
}

#[test]
fn a_long_standstill_is_left_in_a_few_searches() {
    const ROWS: usize = 120_000;
    const STILL: std::ops::Range<usize> = 10_000..110_000;
    let values: Vec<f32> = (0..ROWS)
        .map(|row| {
            let row = if STILL.contains(&row) { STILL.start } else { row };
            (std::f32::consts::TAU * row as f32 / 977.3).sin()
        })
        .collect();
    let (model, built) = model_of(values, &[ROWS]).expect("the plant goes on afterwards");
    for (number, found) in built.recurrence.iter().enumerate() {
        assert_eq!((found.after.traps, found.exits), (0, 0), "member {number}: {found:?}");
        // What is left out stands still: nothing of the plant is lost but a dead end.
        assert!(found.lost < 20, "member {number}: {found:?}");
        assert_eq!(model.left_out(number).len(), found.left_out);
    }
}
