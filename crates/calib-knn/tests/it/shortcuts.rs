//! Tests approximate tables: what they leave out, and what is reported about them.

use calib_core::{Seed, Segments, Silent, States, Transitions};
use calib_knn::{IndexKind, KnnError, KnnModel, ModelConfig, PrototypeKind, recall};

const ROWS: usize = 4000;

fn data() -> (States, Transitions) {
    let mut rng = Seed::new(3).rng();
    let mut state = [0.0_f64; 8];
    let mut values = Vec::new();
    for _ in 0..ROWS {
        for value in &mut state {
            *value = 0.9 * *value + 0.3 * rng.normal();
            values.push(*value as f32);
        }
    }
    let states = States::new(values, ROWS, 8).expect("finite");
    (states, Transitions::new(Segments::from_lengths([1500, ROWS - 1500]).expect("valid")))
}

fn try_build(config: ModelConfig) -> Result<KnnModel, KnnError> {
    let (states, transitions) = data();
    KnnModel::build(states, transitions, &config, &Silent)
}

fn build(config: ModelConfig) -> KnnModel {
    try_build(config).expect("built")
}

fn squared(a: &[f32], b: &[f32]) -> f64 {
    a.iter().zip(b).map(|(&a, &b)| (f64::from(a) - f64::from(b)).powi(2)).sum()
}

#[test]
fn exact_tables_recall_everything() {
    let found =
        recall(&build(ModelConfig::default()), 40, Seed::new(1), &Silent).expect("not interrupted");
    assert_eq!((found.rows, found.recall), (200, 1.0));
    assert!((found.distance_ratio - 1.0).abs() < 1e-12);
}

#[test]
fn a_budget_of_leaves_trades_recall_for_time() {
    let exact = build(ModelConfig { theiler: 5, ..ModelConfig::default() });
    let mut last = 0.0;
    for leaf_budget in [1, 4, 1000] {
        let config = ModelConfig { leaf_budget, theiler: 5, ..ModelConfig::default() };
        let model = build(config);
        let found = recall(&model, 100, Seed::new(1), &Silent).expect("not interrupted");
        assert!(found.recall >= last && found.distance_ratio >= 1.0, "{found:?}");
        last = found.recall;
        for member in 0..5 {
            let rows = (0..model.member(member).len()).map(|at| model.member(member).nth(at));
            let mut neighbors = rows.flat_map(|row| model.member(member).neighbors(row).0);
            assert!(neighbors.all(|&j| j != u32::MAX), "every list is full");
            let pairs = model.table(member).distances().iter().zip(exact.table(member).distances());
            assert!(pairs.into_iter().all(|(approximate, exact)| approximate >= exact));
        }
        if leaf_budget == 1 {
            assert!(found.recall < 0.999 && found.recall > 0.3, "{found:?}");
        }
        if leaf_budget == 1000 {
            assert_eq!(model.table(2).neighbors(), exact.table(2).neighbors());
        }
    }
    // Only the join supports a leaf budget.
    let few = ModelConfig { leaf_budget: 1, index: IndexKind::Scan, ..ModelConfig::default() };
    assert!(few.check().is_err());
}

#[test]
fn prototypes_are_the_only_neighbours() {
    let (states, transitions) = data();
    let mut tables = Vec::new();
    for index in [IndexKind::Join, IndexKind::Scan, IndexKind::KdTree, IndexKind::Auto] {
        let config = ModelConfig { prototypes: 7, theiler: 9, index, ..ModelConfig::default() };
        let model = build(config);
        tables.push(model.table(3).neighbors().to_vec());
        let member = model.member(3);
        for position in (0..member.len()).step_by(311) {
            let query = member.nth(position);
            let row = transitions.next(query);
            let forbidden = config.exclusion().forbidden(&transitions, row);
            let mut expected: Vec<(f64, u32)> = (0..member.len())
                .map(|position| member.nth(position))
                .filter(|j| j.0 % 7 == 0 && !forbidden.contains(&j.0))
                .map(|j| {
                    let source = transitions.source(j);
                    (squared(states.row(row.get()), states.row(source.get())), j.0)
                })
                .collect();
            expected.sort_by(|a, b| a.partial_cmp(b).expect("finite"));
            let expected: Vec<u32> = expected[..3].iter().map(|pair| pair.1).collect();
            assert_eq!(member.neighbors(query).0, expected, "{index:?}");
        }
        let found = recall(&model, 60, Seed::new(2), &Silent).expect("not interrupted");
        assert!(found.recall < 0.9 && found.distance_ratio > 1.0, "{found:?}");
    }
    assert!(tables.windows(2).all(|pair| pair[0] == pair[1]));
    let too_few = ModelConfig { prototypes: 2000, ..ModelConfig::default() };
    let error = try_build(too_few).expect_err("two of them");
    assert!(error.to_string().contains("possible neighbours"), "{error}");
}

/// All search structures. The data must have few enough columns for the k-d tree.
const ALL: [IndexKind; 4] = [IndexKind::Join, IndexKind::Scan, IndexKind::KdTree, IndexKind::Auto];

fn same_by_all(config: ModelConfig) -> KnnModel {
    let mut models = ALL.map(|index| build(ModelConfig { index, ..config })).into_iter();
    let first = models.next().expect("four models");
    for other in models {
        for member in 0..5 {
            let a = first.table(member);
            let b = other.table(member);
            assert_eq!((a.neighbors(), a.distances()), (b.neighbors(), b.distances()));
        }
    }
    first
}

#[test]
fn covering_prototypes_are_few_and_miss_nothing_rare() {
    let config = ModelConfig { prototypes: 7, theiler: 9, ..ModelConfig::default() };
    let covering = ModelConfig { prototype_kind: PrototypeKind::KCentre, ..config };
    let model = same_by_all(covering);
    let mut neighbors: Vec<u32> = (0..5)
        .flat_map(|m| model.table(m).neighbors().to_vec())
        .filter(|&j| j != u32::MAX)
        .collect();
    neighbors.sort_unstable();
    neighbors.dedup();
    assert!((400..=ROWS.div_ceil(7) + 40).contains(&neighbors.len()), "{}", neighbors.len());
    let found = recall(&model, 60, Seed::new(2), &Silent).expect("not interrupted");
    assert!(found.recall < 0.9 && found.distance_ratio > 1.0, "{found:?}");

    // An event that occurred twice, on days that are not multiples of seven.
    let (states, transitions) = data();
    let mut values = states.as_slice().to_vec();
    for row in [1002, 3001] {
        values[8 * row..8 * row + 8].fill(50.0 + row as f32 / 1e4);
    }
    let states = States::new(values, ROWS, 8).expect("finite");
    let [every_seventh, covering] = [config, covering].map(|config| {
        let config = ModelConfig { theiler: 0, ..config };
        let model = KnnModel::build(states.clone(), transitions.clone(), &config, &Silent);
        let model = model.expect("built");
        let ends_in_3001 = transitions.ending_in(calib_core::RowIndex(3001)).expect("recorded");
        let member = (0..5).find(|&m| {
            let other = transitions.starting_at(calib_core::RowIndex(1002)).expect("recorded");
            model.member(m).contains(ends_in_3001) && model.member(m).contains(other)
        });
        model.member(member.expect("three of five")).neighbors(ends_in_3001).1[0]
    });
    assert!(every_seventh > 50.0, "every seventh row leaves both out");
    assert!(covering < 5.0, "what covers the states has one of them");
}

#[test]
fn components_find_neighbours_whose_distances_are_true() {
    let mut last = 0.0;
    for components in [2, 5, 7] {
        let config = ModelConfig { components, theiler: 3, ..ModelConfig::default() };
        let model = same_by_all(config);
        let (states, transitions) = data();
        for member in 0..5 {
            let member = model.member(member);
            for query in (0..member.len()).step_by(97).map(|at| member.nth(at)) {
                let (neighbors, distances) = member.neighbors(query);
                assert!(distances.is_sorted());
                for (&j, &distance) in neighbors.iter().zip(distances) {
                    let source = transitions.source(calib_core::TransitionIndex(j));
                    let next = transitions.next(query);
                    let squared = squared(states.row(next.get()), states.row(source.get()));
                    assert_eq!(distance, squared.sqrt() as f32);
                }
            }
        }
        let found = recall(&model, 60, Seed::new(2), &Silent).expect("not interrupted");
        assert!(found.recall > last && found.recall < 1.0, "{components}: {found:?}");
        last = found.recall;
    }
    assert!(last > 0.4, "seven of eight: {last}");
    let all = ModelConfig { components: 8, ..ModelConfig::default() };
    let error = try_build(all).expect_err("all columns");
    assert!(error.to_string().contains("fewer than the 8 columns"), "{error}");
}
