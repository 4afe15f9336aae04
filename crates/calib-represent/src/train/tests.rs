use std::sync::atomic::{AtomicUsize, Ordering};

use calib_core::Silent;

use super::*;

/// A monitor that interrupts after a number of updates.
struct After(AtomicUsize);

impl Monitor for After {
    fn begin(&self, _task: &str, _total: u64) {}

    fn advance(&self, units: u64) {
        let left = self.0.load(Ordering::Relaxed);
        self.0.store(left.saturating_sub(units as usize), Ordering::Relaxed);
    }

    fn interrupted(&self) -> bool {
        self.0.load(Ordering::Relaxed) == 0
    }
}

/// Returns a noisy circle in four columns.
fn data() -> (States, Segments) {
    let mut rng = Seed::new(8).rng();
    let mut values = Vec::new();
    for row in 0..600 {
        let angle = f64::from(row) * 0.05;
        for value in [angle.cos(), angle.sin(), (2.0 * angle).cos(), 0.0] {
            values.push((value + 0.1 * rng.normal()) as f32);
        }
    }
    (
        States::new(values, 600, 4).expect("finite"),
        Segments::from_lengths([350, 250]).expect("valid"),
    )
}

fn config() -> LaplacianConfig {
    LaplacianConfig {
        dimension: 6,
        hidden_units: 24,
        learning_rate: 3e-3,
        batch_size: 32,
        steps: 230,
        ..LaplacianConfig::default()
    }
}

#[test]
fn an_interrupted_training_goes_on_to_the_same_bytes() {
    let (states, segments) = data();
    let split = Split::in_time(&segments).expect("long enough");
    let task = Task { states: &states, segments: &segments, split: &split, seed: Seed::new(4) };
    let whole = train(&config(), task, None, &Silent).expect("trains");
    assert_eq!(whole.points.len(), 20);
    assert_eq!(whole.points.last().expect("has points").step, 230);

    let directory = tempfile::tempdir().expect("a directory");
    let path = directory.path().join("checkpoint.safetensors");
    let [checkpoint, with_another_key] =
        ["a", "b"].map(|key| CheckpointFile::new(path.clone(), key.to_owned()));
    for updates in [1, 40, 37] {
        let monitor = After(AtomicUsize::new(updates + 77));
        // Earlier progress is kept, so every call advances further.
        let error = train(&config(), task, Some(&checkpoint), &monitor);
        assert!(matches!(error, Err(RepresentError::Cancelled(_))) || updates == 37, "{error:?}");
    }
    let parts = train(&config(), task, Some(&checkpoint), &Silent).expect("goes on");
    assert!(parts == whole, "{:?} and {:?}", parts.points, whole.points);
    // With another key, training starts again.
    let anew = train(&config(), task, Some(&with_another_key), &Silent);
    assert!(anew.expect("trains") == whole);
    checkpoint.remove().expect("removed");
    checkpoint.remove().expect("nothing to remove");
    std::fs::write(&path, "text").expect("written");
    assert!(train(&config(), task, Some(&checkpoint), &Silent).expect("begins anew") == whole);
}

#[test]
fn learning_raises_the_scores_and_lowers_the_loss() {
    let (states, segments) = data();
    let split = Split::in_time(&segments).expect("long enough");
    let task = Task { states: &states, segments: &segments, split: &split, seed: Seed::new(4) };
    let trained = train(&LaplacianConfig { steps: 800, ..config() }, task, None, &Silent);
    let trained = trained.expect("trains");
    let first = trained.points[0];
    let last = trained.points[trained.points.len() - 1];
    assert!(last.loss < first.loss, "{first:?} {last:?}");
    assert!(last.scores.dynamics_awareness > 0.5, "{last:?}");
    assert!(last.scores.uniqueness > 0.95 && last.scores.live_dimensions > 2, "{last:?}");
    assert_eq!(trained.divergence, None);
}

#[test]
fn a_training_that_diverges_ends_early_with_its_reason() {
    let (states, segments) = data();
    let split = Split::in_time(&segments).expect("long enough");
    let task = Task { states: &states, segments: &segments, split: &split, seed: Seed::new(4) };
    let wild = LaplacianConfig { learning_rate: 1e3, steps: 100_000, ..config() };
    let trained = train(&wild, task, None, &Silent).expect("ends");
    let reason = trained.divergence.expect("diverges").to_string();
    assert!(reason.contains("step"), "{reason}");
    assert!(trained.points.is_empty());
}
