//! Tests the lists of classes against brute force in f64: distances of the same bits, ties by row.

use std::ops::Range;

use calib_core::{RowIndex, Seed, Segments, Silent, States, TransitionIndex, Transitions};
use calib_files::ScratchPlace;
use calib_knn::{Blocks, Exclusion, IndexKind, NeighborLists, Queries, Sources};
use proptest::prelude::*;

/// How the classes of transitions follow from their states.
#[derive(Clone, Copy, Debug)]
enum Policy {
    Random,
    /// The class depends on the first column, so most parts of the space have one class.
    OfState,
    /// All but one transition in forty have class 0.
    Rare,
    /// One transition has class 1, and all others have class 0.
    Once,
}

#[derive(Clone, Debug)]
struct Shape {
    rows: usize,
    columns: usize,
    /// Number of different values of a column. Few values make many ties.
    grid: u32,
    /// Whether half of the rows are one state.
    standstill: bool,
    policy: Policy,
    members: usize,
    k: usize,
    theiler: u32,
    seed: u64,
}

const CLASSES: usize = 4;
/// Maximum number of queries that are compared with brute force.
const MOST_CHECKED: usize = 700;

struct Case {
    states: States,
    transitions: Transitions,
    blocks: Blocks,
    classes: Vec<u16>,
    k: usize,
    exclusion: Exclusion,
}

impl Shape {
    fn case(&self) -> Case {
        let mut rng = Seed::new(self.seed).rng();
        let mut lengths = Vec::new();
        let mut rest = self.rows;
        while rest > 0 {
            let length = (1 + rng.below(60)).min(rest);
            lengths.push(length);
            rest -= length;
        }
        let mut values: Vec<f32> = (0..self.rows * self.columns)
            .map(|_| rng.below(self.grid as usize) as f32 / self.grid as f32)
            .collect();
        if self.standstill {
            let half = self.rows / 2 * self.columns;
            values[..half].fill(0.5);
        }
        let states = States::new(values, self.rows, self.columns).expect("finite");
        let transitions = Transitions::new(Segments::from_lengths(lengths).expect("valid"));
        let last = CLASSES - 2;
        let classes = (0..transitions.len()).map(|number| {
            let source = transitions.source(TransitionIndex::new(number));
            let class = match self.policy {
                Policy::Random => rng.below(CLASSES - 1),
                Policy::OfState => (states.row(source.get())[0] * last as f32) as usize,
                Policy::Rare => usize::from(rng.below(40) == 0),
                Policy::Once => usize::from(number == transitions.len() / 3),
            };
            class as u16
        });
        let classes = classes.collect();
        let blocks = Blocks::new(&transitions, self.members.min(transitions.len())).expect("valid");
        let exclusion = Exclusion { theiler: self.theiler, ..Exclusion::default() };
        Case { states, transitions, blocks, classes, k: self.k, exclusion }
    }
}

/// What one query must find.
struct Wanted {
    class: usize,
    member: usize,
    count: usize,
}

impl Case {
    /// Returns all candidates from the nearest to the farthest, with the distances that tables store.
    fn ranked(&self, from: &[f32], forbidden: &Range<u32>) -> Vec<(u32, f32)> {
        let mut all: Vec<(f64, u32)> = Vec::new();
        for transition in 0..self.transitions.len() as u32 {
            if forbidden.contains(&transition) {
                continue;
            }
            let row = self.transitions.sources()[transition as usize] as usize;
            let mut squared = 0.0;
            for (&a, &b) in from.iter().zip(self.states.row(row)) {
                let difference = f64::from(a) - f64::from(b);
                squared += difference * difference;
            }
            all.push((squared, transition));
        }
        all.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        all.into_iter().map(|(squared, t)| (t, squared.sqrt() as f32)).collect()
    }

    /// Checks that a search finds what is wanted of each query, and nothing else.
    fn check(
        &self,
        kind: IndexKind,
        queries: &Queries<'_>,
        k: usize,
        from: impl Fn(usize) -> (Vec<f32>, Range<u32>),
        wanted: impl Fn(usize) -> Vec<Wanted>,
    ) {
        let sources = self.sources();
        let members = self.blocks.members();
        let place = ScratchPlace::Memory;
        let planned = sources.index(kind, queries, k, &place, &Silent).expect("not interrupted");
        let mut found = NeighborLists::new(queries.len(), CLASSES * members, k);
        planned
            .index
            .search(queries, &planned.order, &mut found, &Silent)
            .expect("not interrupted");
        let some = planned.order.iter().enumerate().step_by(queries.len().div_ceil(MOST_CHECKED));
        for (at, &query) in some {
            let (state, forbidden) = from(query as usize);
            let ranked = self.ranked(&state, &forbidden);
            let mut expected = vec![Vec::new(); CLASSES * members];
            for Wanted { class, member, count, .. } in wanted(query as usize) {
                let own = ranked.iter().filter(|(t, _)| {
                    usize::from(self.classes[*t as usize]) == class
                        && self.blocks.contains(member, TransitionIndex(*t))
                });
                expected[class * members + member] = own.take(count).copied().collect();
            }
            for (number, expected) in expected.iter_mut().enumerate() {
                expected.resize(k, (u32::MAX, f32::INFINITY));
                let (neighbors, distances) = found.list(at, number);
                let got: Vec<(u32, f32)> =
                    neighbors.iter().copied().zip(distances.iter().copied()).collect();
                assert_eq!(&got, expected, "{kind:?}: query {query}, list {number}");
            }
        }
    }

    fn sources(&self) -> Sources<'_> {
        let sources = Sources::new(&self.states, &self.transitions, &self.blocks).expect("valid");
        sources.by_class(&self.classes, CLASSES)
    }

    fn all_classes(&self, has: impl Fn(usize) -> bool) -> Vec<Wanted> {
        let members = (0..self.blocks.members()).filter(|&member| has(member));
        let wanted = members.flat_map(|member| {
            (0..CLASSES).map(move |class| Wanted { class, member, count: self.k })
        });
        wanted.collect()
    }

    fn next_states(&self, kind: IndexKind) {
        let sources = self.sources();
        let queries = Queries::next_states(&sources, self.exclusion).with_nearest_outside_block();
        self.check(
            kind,
            &queries,
            self.k,
            |query| {
                let row = self.transitions.next(TransitionIndex::new(query));
                let forbidden = self.exclusion.forbidden(&self.transitions, row);
                (self.states.row(row.get()).to_vec(), forbidden)
            },
            |query| {
                let query = TransitionIndex::new(query);
                let mut wanted = self.all_classes(|member| self.blocks.contains(member, query));
                let own = self.transitions.starting_at(self.transitions.next(query));
                wanted.extend(own.map(|own| Wanted {
                    class: usize::from(self.classes[own.get()]),
                    member: self.blocks.block_of(own),
                    count: 1,
                }));
                wanted
            },
        );
    }

    fn sources_outside_their_block(&self, kind: IndexKind) {
        let sources = self.sources();
        for member in 0..self.blocks.members() {
            let own: Vec<TransitionIndex> = self.blocks.own(member).map(TransitionIndex).collect();
            let rows: Vec<RowIndex> = own.iter().map(|&t| self.transitions.source(t)).collect();
            let queries = Queries::rows(&sources, &rows, member, Exclusion::default());
            self.check(
                kind,
                &queries,
                1,
                |query| (self.states.row(rows[query].get()).to_vec(), 0..0),
                |query| {
                    let class = usize::from(self.classes[own[query].get()]);
                    vec![Wanted { class, member, count: 1 }]
                },
            );
        }
    }

    fn other_states(&self, kind: IndexKind) {
        let sources = self.sources();
        let columns = self.states.columns();
        let far = [vec![0.3; columns], vec![1e4; columns], vec![-2e30; columns]].concat();
        let states = States::new(far, 3, columns).expect("finite");
        let queries = Queries::external(&sources, &states, None).expect("as many columns");
        self.check(
            kind,
            &queries,
            self.k,
            |query| (states.row(query).to_vec(), 0..0),
            |_| self.all_classes(|_| true),
        );
    }
}

fn policy() -> impl Strategy<Value = Policy> {
    prop_oneof![Just(Policy::Random), Just(Policy::OfState), Just(Policy::Rare), Just(Policy::Once)]
}

fn shape() -> impl Strategy<Value = Shape> {
    let columns = prop_oneof![Just(1_usize), Just(2), Just(6), Just(20), Just(40)];
    let grid = prop_oneof![Just(2_u32), Just(7), Just(100_000)];
    let log = (20_usize..700, columns, grid, any::<bool>(), policy(), any::<u64>());
    let lists = (2_usize..8, 1_usize..6, prop_oneof![Just(0_u32), Just(3)]);
    (log, lists).prop_map(|(log, lists)| {
        let (rows, columns, grid, standstill, policy, seed) = log;
        let (members, k, theiler) = lists;
        Shape { rows, columns, grid, standstill, policy, members, k, theiler, seed }
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    #[test]
    fn one_search_finds_the_lists_of_every_class(shape in shape()) {
        let case = shape.case();
        for kind in [IndexKind::Join, IndexKind::Scan, IndexKind::Auto] {
            case.next_states(kind);
            case.sources_outside_their_block(kind);
            case.other_states(kind);
        }
    }
}

/// Returns a log of 600 rows in two columns, in which each class has its own part of the space.
fn divided() -> Shape {
    Shape {
        rows: 600,
        columns: 2,
        grid: 1000,
        standstill: false,
        policy: Policy::OfState,
        members: 5,
        k: 3,
        theiler: 0,
        seed: 4,
    }
}

#[test]
fn many_leaves_are_searched_as_few() {
    for (policy, columns) in [(Policy::OfState, 2), (Policy::Random, 4), (Policy::Rare, 20)] {
        let case = Shape { rows: 6000, policy, columns, ..divided() }.case();
        case.next_states(IndexKind::Join);
        case.other_states(IndexKind::Join);
    }
}

#[test]
fn blocks_of_one_transition_are_left_out() {
    let case = Shape { rows: 60, members: usize::MAX, ..divided() }.case();
    assert_eq!(case.blocks.members(), case.transitions.len());
    case.next_states(IndexKind::Join);
}

#[test]
fn a_standstill_in_one_block_does_not_fill_the_lists_of_its_member() {
    // One member lacks most rows of the standstill, which all others have.
    for policy in [Policy::Random, Policy::Rare] {
        let case = Shape { standstill: true, members: 2, policy, ..divided() }.case();
        case.next_states(IndexKind::Join);
        case.next_states(IndexKind::Scan);
        case.sources_outside_their_block(IndexKind::Join);
    }
}
