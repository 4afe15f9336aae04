//! Tests the removal of traps against global rounds over brute force.

mod naive;

use std::collections::{BTreeMap, BTreeSet};

use calib_core::{Seed, Segments, Silent, States, TransitionIndex, Transitions};
use calib_knn::{
    Built, IndexKind, KnnError, KnnModel, ModelConfig, Weights, WeightsKind, Workplace,
    closed_classes, verify,
};
use naive::{Drawn, Expected};
use proptest::prelude::*;

#[derive(Clone, Debug)]
struct Case {
    lengths: Vec<usize>,
    values: Vec<f32>,
    config: ModelConfig,
}

/// Returns as many of the sizes as a build reports.
fn told(sizes: &[usize]) -> Vec<usize> {
    sizes[..sizes.len().min(10)].to_vec()
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

    fn check(&self) -> Result<(), TestCaseError> {
        let states = self.states();
        let transitions = self.transitions();
        let expected: Result<Vec<Expected>, KnnError> = (0..self.config.members)
            .map(|member| Expected::of(&states, &transitions, &self.config, member))
            .collect();
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
        // Rows at a standstill.
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

/// Checks that the reported figures agree with the tables.
fn check_what_is_told(
    model: &KnnModel,
    built: &Built,
    weights: Weights,
) -> Result<(), TestCaseError> {
    for (number, found) in built.recurrence.iter().enumerate() {
        let sizes = Drawn::by(model, number, weights).sizes();
        prop_assert_eq!(&found.after.largest, &told(&sizes), "member {}", number);
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
        // Distances in components differ from those that steps use to draw neighbours.
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
    // Each tooth begins a little below the previous one, and rises to where that one began. So a rollout climbs one tooth
    // at a time.
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
        // Only standstill rows are left out, so nothing of the plant is lost but a dead end.
        assert!(found.lost < 20, "member {number}: {found:?}");
        assert_eq!(model.left_out(number).len(), found.left_out);
    }
}
