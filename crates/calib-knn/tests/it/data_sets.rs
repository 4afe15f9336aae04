//! Tests every search structure on every kind of data that plants produce: random rows agree with brute force
//! in f64.

use calib_core::{Period, Rng, Seed, Segments, Silent, States, Transitions};
use calib_files::ScratchPlace;
use calib_knn::{IndexKind, KnnModel, ModelConfig, Workplace, verify};
use calib_plant::{Fate, Plant, PlantOptions};

/// Number of rows of most data sets.
const ROWS: usize = 1800;

fn filled(columns: usize, mut value: impl FnMut(usize, usize) -> f32) -> States {
    let cells = (0..ROWS * columns).map(|cell| value(cell / columns, cell % columns));
    States::new(cells.collect(), ROWS, columns).expect("finite")
}

fn rng(name: &str) -> Rng {
    Seed::new(4).child(name).rng()
}

/// Returns the live channels of the simulated plant, scaled. Missing values repeat the last one.
fn plant() -> States {
    let period = Period::from_secs(60.0).expect("positive");
    let options = PlantOptions { channels: 480, period, days: 3.0, ..PlantOptions::default() };
    let plant = Plant::new(options).expect("valid");
    let alive: Vec<usize> = (0..plant.schema().len())
        .filter(|&channel| plant.schema()[channel].fate == Fate::Alive)
        .collect();
    let days: Vec<_> = plant.collect();
    let mut columns = Vec::new();
    for &channel in &alive {
        let values: Vec<f32> =
            days.iter().flat_map(|day| day.columns[channel].iter().copied()).collect();
        let finite = values.iter().copied().filter(|value| value.is_finite());
        let low = finite.clone().fold(f32::MAX, f32::min);
        let high = finite.fold(f32::MIN, f32::max);
        let mut last = 0.0;
        let scaled = values.iter().map(|&value| {
            if value.is_finite() {
                last = (value - low) / (high - low).max(1e-6);
            }
            last
        });
        columns.push(scaled.take(ROWS).collect::<Vec<f32>>());
    }
    assert_eq!(columns.len(), 142);
    filled(142, |row, column| columns[column][row])
}

/// Returns a random walk of some factors that many sensors measure.
fn walk(columns: usize, noise: f64) -> States {
    let mut rng = rng("walk");
    let loadings: Vec<f64> = (0..4 * columns).map(|_| rng.normal()).collect();
    let mut factors = [0.0_f64; 4];
    filled(columns, |_, column| {
        if column == 0 {
            for factor in &mut factors {
                *factor = 0.97 * *factor + 0.2 * rng.normal();
            }
        }
        let mixed: f64 = (0..4).map(|f| factors[f] * loadings[f * columns + column]).sum();
        (mixed + noise * rng.normal()) as f32
    })
}

fn changed(states: &States, mut change: impl FnMut(usize, &mut [f32], &[f32])) -> States {
    let mut values = states.as_slice().to_vec();
    for (row, state) in values.chunks_exact_mut(states.columns()).enumerate() {
        change(row, state, states.as_slice());
    }
    States::new(values, states.rows(), states.columns()).expect("finite")
}

/// Compares some rows of every member with brute force.
fn check(name: &str, states: &States, lengths: &[usize], configs: &[ModelConfig]) {
    check_rows(25, name, states, lengths, configs);
}

fn check_rows(
    rows: usize,
    name: &str,
    states: &States,
    lengths: &[usize],
    configs: &[ModelConfig],
) {
    let kinds = [IndexKind::Auto, IndexKind::Join, IndexKind::Scan, IndexKind::KdTree];
    for kind in kinds.into_iter().filter(|kind| kind.supports(states.columns())) {
        for config in configs {
            let config = ModelConfig { index: kind, ..*config };
            let segments = Segments::from_lengths(lengths.iter().copied()).expect("valid");
            let transitions = Transitions::new(segments);
            let model = KnnModel::build(states.clone(), transitions, &config, &Silent)
                .unwrap_or_else(|error| panic!("{name}, {config:?}: {error}"));
            let verification =
                verify(&model, rows, Seed::new(7), &Silent).expect("not interrupted");
            assert!(verification.agrees(), "{name}, {config:?}: {verification:?}");
        }
    }
}

fn exclusions() -> [ModelConfig; 3] {
    let plain = ModelConfig::default();
    [plain, ModelConfig { exclude_self: true, ..plain }, ModelConfig { theiler: 30, ..plain }]
}

#[test]
fn the_simulated_plant() {
    check("plant", &plant(), &[700, ROWS - 700], &exclusions());
}

#[test]
fn nothing_that_could_be_ruled_out() {
    let mut rng = rng("gaussian");
    check("gaussian", &filled(142, |_, _| rng.normal() as f32), &[ROWS], &exclusions());
}

#[test]
fn quantised_sensors_with_a_third_of_exact_copies() {
    let coarse =
        changed(&walk(20, 0.0), |_, state, _| state.iter_mut().for_each(|v| *v = v.round()));
    let mut rng = rng("copies");
    let copied = changed(&coarse, |row, state, all| {
        if row > 0 && rng.unit() < 0.3 {
            let other = rng.below(row);
            state.copy_from_slice(&all[other * 20..][..20]);
        }
    });
    check("copies", &copied, &[900, 3, ROWS - 903], &exclusions());
}

#[test]
fn dimensions_that_never_change() {
    let few = changed(&walk(40, 0.01), |_, state, _| state[3..].fill(0.25));
    check("constant dimensions", &few, &[ROWS], &exclusions());
    let none = filled(5, |_, _| 1.5);
    check("all constant", &none, &[ROWS], &exclusions());
}

#[test]
fn periods_in_which_the_plant_stands_still() {
    let stuck = changed(&walk(30, 0.02), |row, state, all| {
        // Two standstills, one of them across a block boundary, and a sensor that freezes now and then.
        let from = if (300..700).contains(&row) { 300 } else { row };
        let from = if (1000..1600).contains(&row) { 300 } else { from };
        state.copy_from_slice(&all[from * 30..][..30]);
        state[7] = all[row / 50 * 50 * 30 + 7];
    });
    check("standstill", &stuck, &[ROWS], &exclusions());
    let wider = ModelConfig { theiler: 350, ..ModelConfig::default() };
    check("standstill", &stuck, &[ROWS], &[wider]);
}

#[test]
fn outliers_near_and_far() {
    for scale in [10.0, 1e6, 1e18, 1e30] {
        let far = changed(&walk(16, 0.02), |row, state, _| {
            if row % 211 == 5 {
                state[row % 16] = scale * (1.0 + row as f32);
            }
        });
        check_rows(ROWS, "outliers", &far, &[ROWS], &exclusions()[..2]);
    }
}

#[test]
fn a_few_spikes_are_kept_apart() {
    for columns in [12, 60] {
        // Spikes occur alone and in runs, also as last rows of segments, which are queries but not sources.
        let spiky = changed(&walk(columns, 0.02), |row, state, _| {
            let spike = match row {
                300 | 1799 => 1e9,
                640..=655 => 1e6 + row as f32,
                699 => 1e25,
                _ => return,
            };
            state[row % columns] = spike;
        });
        check_rows(ROWS, "spikes", &spiky, &[700, ROWS - 700], &exclusions());
    }
}

#[test]
fn more_far_states_than_are_kept_apart() {
    // For a tenth of the time the plant is in another region, with its own directions of variation.
    let elsewhere = walk(60, 0.02);
    let shifted = changed(&walk(60, 0.001), |row, state, _| {
        if row % 200 < 20 {
            for (value, other) in state.iter_mut().zip(elsewhere.row((row * 7) % ROWS)) {
                *value = 300.0 + 9.0 * other;
            }
        }
    });
    check_rows(ROWS, "elsewhere", &shifted, &[700, ROWS - 700], &exclusions()[..1]);
}

#[test]
fn a_segment_that_ends_far_away() {
    for far in [1e9, 1e25, 1e30, f32::MAX] {
        let states = changed(&walk(12, 0.02), |row, state, _| {
            if row == 699 {
                state.fill(far);
            }
        });
        check_rows(ROWS, "far end", &states, &[700, ROWS - 700], &exclusions());
    }
}

#[test]
fn states_without_columns() {
    let transitions = Transitions::new(Segments::from_lengths([60, 40]).expect("valid"));
    let states = States::new(Vec::new(), 100, 0).expect("valid");
    for index in [IndexKind::Auto, IndexKind::Join, IndexKind::Scan] {
        let config = ModelConfig { index, ..ModelConfig::default() };
        let model = KnnModel::build(states.clone(), transitions.clone(), &config, &Silent);
        let verification = verify(&model.expect("built"), 25, Seed::new(7), &Silent);
        assert!(verification.expect("not interrupted").agrees());
    }
}

#[test]
fn members_of_a_few_rows() {
    let config = ModelConfig { members: 3, neighbors: 2, ..ModelConfig::default() };
    let few = States::new((0..26_u8).map(f32::from).collect(), 13, 2).expect("finite");
    check("tiny", &few, &[6, 7], &[config]);
}

#[test]
fn nearly_as_many_neighbours_as_a_member_has() {
    let states = walk(12, 0.1);
    let few = States::new(states.as_slice()[..240 * 12].to_vec(), 240, 12).expect("finite");
    let segments = Segments::from_lengths([240]).expect("valid");
    let blocks = calib_knn::Blocks::new(&Transitions::new(segments), 4).expect("valid");
    let least = (0..4).map(|member| blocks.member_len(member)).min().expect("four members");
    let configs = [least - 20, least].map(|neighbors| ModelConfig {
        members: 4,
        neighbors,
        ..ModelConfig::default()
    });
    check("k near the member's size", &few, &[240], &configs);
}

#[test]
fn an_embedding_like_a_laplacian_one() {
    // Bounded smooth functions of few coordinates, some of them constant.
    let factors = walk(3, 0.0);
    let mut rng = rng("embedding");
    let waves: Vec<f32> = (0..4 * 64).map(|_| rng.normal() as f32).collect();
    let embedded = filled(64, |row, column| {
        let wave = &waves[4 * column..][..4];
        let phase: f32 = factors.row(row).iter().zip(wave).map(|(x, w)| x * w).sum();
        if column % 8 == 7 { 0.0 } else { (phase + wave[3]).sin() * 0.3 }
    });
    check("embedding", &embedded, &[1000, ROWS - 1000], &exclusions());
}

#[test]
fn work_on_disk_changes_nothing() {
    let states = walk(40, 0.05);
    let directory = tempfile::tempdir().expect("a directory");
    let workplace = Workplace {
        scratch: ScratchPlace::Disk(directory.path().to_owned()),
        ..Workplace::default()
    };
    let transitions = Transitions::new(Segments::from_lengths([ROWS]).expect("valid"));
    let config = ModelConfig::default();
    let memory =
        KnnModel::build(states.clone(), transitions.clone(), &config, &Silent).expect("built");
    let (disk, choice) =
        KnnModel::build_in(states, transitions, &config, &workplace, &Silent).expect("built");
    assert_eq!(choice.choice.kind, IndexKind::Join);
    for member in 0..5 {
        assert_eq!(memory.table(member).neighbors(), disk.table(member).neighbors());
        assert_eq!(memory.table(member).distances(), disk.table(member).distances());
    }
}
