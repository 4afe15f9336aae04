//! Tests a sweep whose runs libtorch trains side by side.

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
    sync::atomic::{AtomicU64, Ordering},
};

use calib_agent::{Accelerator, AgentConfig, Part};
use calib_core::{Monitor, RowIndex, RowStream, Seed, Segments, Silent, States};
use calib_files::Fingerprint;
use calib_sweep::{
    Candidate, Environment, EnvironmentId, Plan, PlanOptions, RunStream, Span, SweepConfig,
    SweepError, Unit, UnitResult, UnitStore, candidates,
};
use calib_torch::{DeviceChoice, Populations, device};

/// Streams of waves and noise, different in each run.
struct Waves {
    id: EnvironmentId,
    runs: usize,
}

impl Environment for Waves {
    fn id(&self) -> EnvironmentId {
        self.id
    }

    fn runs(&self) -> usize {
        self.runs
    }

    fn inputs(&self, run: usize) -> Fingerprint {
        Fingerprint::of(run.to_string().as_bytes())
    }

    fn stream(&self, run: usize) -> Result<RunStream, SweepError> {
        let rows = span().states();
        let mut rng = Seed::new(3).child(&self.id.to_string()).number(run as u64).rng();
        let mut values = Vec::with_capacity(2 * rows);
        for row in 0..rows {
            for phase in [0.0, 1.0] {
                let wave = (row as f64 * 0.3 + phase).sin();
                values.push((0.5 + 0.4 * wave + 0.03 * rng.normal()) as f32);
            }
        }
        let states = States::new(values, rows, 2).expect("finite");
        let whole = Segments::from_lengths([rows]).expect("one");
        Ok(RunStream::complete(RowStream::replay(states, &whole), RowIndex::new(run)))
    }
}

fn span() -> Span {
    Span::new(200, [0.8])
}

fn environments() -> [Waves; 4] {
    [
        Waves { id: EnvironmentId::Member(0), runs: 3 },
        Waves { id: EnvironmentId::Member(1), runs: 3 },
        Waves { id: EnvironmentId::Online, runs: 2 },
        Waves { id: EnvironmentId::LogReplay, runs: 2 },
    ]
}

fn values() -> Vec<Candidate> {
    let agent =
        AgentConfig { hidden_units: 16, gamma: 0.8, batch_size: 8, ..AgentConfig::default() };
    let grid = [1e-5, 1e-3, 1e-2].map(serde_json::Value::from).to_vec();
    let grid = BTreeMap::from([("learning_rate".to_owned(), grid.into())]);
    let config = SweepConfig { grid, ..SweepConfig::default() };
    candidates(&config, &agent, Seed::new(1)).expect("valid")
}

/// An accelerator for a small machine, on a GPU if there is one: three runs side by side.
#[derive(Debug)]
struct Small(Populations);

impl Accelerator for Small {
    fn class(&self) -> &str {
        self.0.class()
    }

    fn memory(&self) -> u64 {
        400_000
    }

    fn networks(
        &self,
        networks: &calib_agent::Networks<'_>,
    ) -> Result<Box<dyn calib_agent::Lockstep>, calib_agent::AgentError> {
        self.0.networks(networks)
    }
}

fn small() -> Small {
    Small(Populations::new(device(DeviceChoice::Auto).expect("always something")))
}

fn with_plan<T>(accelerator: Option<&dyn Accelerator>, then: impl FnOnce(Plan<'_>) -> T) -> T {
    let candidates = values();
    let environments = environments();
    let environments =
        environments.iter().map(|environment| environment as &dyn Environment).collect();
    let seed = Seed::new(4);
    let options = PlanOptions { part: Part::WholeRun, span: span(), curve_points: 5, seed };
    let sensors = vec![("A".to_owned(), 0), ("B".to_owned(), 1)];
    then(Plan::new(&candidates, environments, sensors, options).with_accelerator(accelerator))
}

fn rmses(results: &[UnitResult]) -> Vec<f64> {
    let rows = results.iter().flat_map(|result| &result.rows);
    rows.map(|row| row.scores.of(Part::WholeRun).expect("scored").rmse).collect()
}

#[test]
fn a_sweep_side_by_side_is_the_native_one() {
    let directory = tempfile::tempdir().expect("a directory");
    let [native_store, torch_store] =
        ["native", "torch"].map(|name| UnitStore::new(directory.path().join(name)));
    let native = with_plan(None, |plan| plan.run(&native_store, &Silent).expect("runs"));
    let small = small();
    let torch = with_plan(Some(&small), |plan| plan.run(&torch_store, &Silent).expect("runs"));
    assert_eq!(native.len(), 20);
    for (native, torch) in native.iter().zip(&torch) {
        assert_eq!((&native.unit, native.seed), (&torch.unit, torch.seed));
        assert_ne!(native.key, torch.key, "another class of arithmetic");
    }
    for (native, torch) in rmses(&native).into_iter().zip(rmses(&torch)) {
        assert!((native - torch).abs() < 1e-5 * native, "{native} and {torch}");
    }
    // Each accelerator finds only its own results.
    let found =
        |accelerator| with_plan(accelerator, |plan| plan.stored(&torch_store).whole().len());
    assert_eq!((found(None), found(Some(&small))), (0, 20));
}

/// Returns all files below a folder, in order.
fn files(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).expect("a folder").flatten() {
        let path = entry.path();
        if path.is_dir() { found.extend(files(&path)) } else { found.push(path) }
    }
    found.sort();
    found
}

/// A monitor that interrupts after some calls.
struct Impatient {
    looks: AtomicU64,
    patience: u64,
}

impl Monitor for Impatient {
    fn begin(&self, _: &str, _: u64) {}

    fn advance(&self, _: u64) {}

    fn interrupted(&self) -> bool {
        self.looks.fetch_add(1, Ordering::Relaxed) > self.patience
    }
}

#[test]
fn an_interrupted_sweep_is_to_the_byte_what_it_would_have_been() {
    let directory = tempfile::tempdir().expect("a directory");
    let small = small();
    let whole = UnitStore::new(directory.path().join("whole"));
    let expected = with_plan(Some(&small), |plan| plan.run(&whole, &Silent).expect("runs"));
    let mut stopped = 0;
    for patience in [3, 12, 20, 30] {
        let store = UnitStore::new(directory.path().join(patience.to_string()));
        let impatient = Impatient { looks: AtomicU64::new(0), patience };
        let ended = with_plan(Some(&small), |plan| plan.run(&store, &impatient));
        let some = with_plan(Some(&small), |plan| plan.stored(&store).whole().len());
        if matches!(ended, Err(SweepError::Cancelled(_))) && some > 0 {
            stopped += 1;
        }
        let went_on = with_plan(Some(&small), |plan| plan.run(&store, &Silent).expect("runs"));
        assert_eq!(went_on, expected, "stopped after {patience} looks, with {some} units");
    }
    assert!(stopped > 1, "in the middle, {stopped} times");
    // Whichever results are missing, computing them again gives the same.
    for third in 0..3 {
        for (number, file) in files(&directory.path().join("whole")).iter().enumerate() {
            if number % 3 == third {
                fs::remove_file(file).expect("ours");
            }
        }
        let again = with_plan(Some(&small), |plan| plan.run(&whole, &Silent).expect("runs"));
        assert_eq!(again, expected, "with a third of the units gone");
    }
}

/// Returns every unit, and the number of settings for which it has a row.
fn rows_of_units(results: &[UnitResult]) -> Vec<(Unit, usize)> {
    results.iter().map(|result| (result.unit.clone(), result.rows.len())).collect()
}

#[test]
fn a_race_is_run_side_by_side() {
    let directory = tempfile::tempdir().expect("a directory");
    let run = |accelerator: Option<&dyn Accelerator>, name: &str| {
        let store = UnitStore::new(directory.path().join(name));
        with_plan(accelerator, |plan| plan.race().run(&store, &Silent).expect("runs"))
    };
    let native = run(None, "native");
    let torch = run(Some(&small()), "torch");
    assert_eq!(rows_of_units(&native), rows_of_units(&torch), "the same values are dropped");
    assert!(native.iter().any(|result| result.rows.len() < 3), "some are");
}
