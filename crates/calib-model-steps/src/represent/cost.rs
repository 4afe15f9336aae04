//! Estimates the cost of training the representations of a study beforehand: some updates of each are made and timed.

use std::time::Duration;

use calib_base::{
    StepError, clock::Stopwatch, cost::StepCost, disk_room, log::context::RunContext, memory,
    options::Device,
};
use calib_core::{Monitor, Seed, Segments};
use calib_data::Dataset;
use calib_represent::{
    CURVE_POINTS, LaplacianConfig, RepresentationKind, SCORED_PAIRS, Split, Training, encode, score,
};
use calib_study::{Job, StepKind, Study};

use super::{
    grid,
    manifest::RepresentationManifest,
    material::{Material, seed},
};

/// Minimum time for the updates of a candidate.
const TIMED: Duration = Duration::from_millis(50);
/// Time limit for timing all candidates. The first is timed however long that takes.
const ALL_CANDIDATES: Duration = Duration::from_millis(1_200);
/// Maximum number of products of weights and states of a batch in a timed update: some tens of milliseconds.
const MOST_WORK: usize = 200_000_000;
/// A step size with which no training diverges while it is timed.
const SMALL_LEARNING_RATE: f64 = 1e-6;

/// The cost of making a representation that does not exist yet.
#[derive(Clone, Debug)]
pub struct RepresentationCost {
    /// Seconds of each remaining training, on one thread.
    pub trainings: Vec<f64>,
    /// Seconds for scoring all candidates after training, on all threads.
    pub scoring: f64,
    /// Upper bound on memory, bytes.
    pub memory: u64,
    /// Bytes of its files.
    pub disk: u64,
}

impl RepresentationCost {
    /// Returns the cost of making the representation of a study, if these candidates remain to be trained. Nothing is
    /// written.
    ///
    /// # Errors
    /// If there are no two successive states, no candidate can be trained, or the monitor interrupts.
    pub(super) fn measure(
        study: &Study,
        material: Material<'_>,
        left: &[LaplacianConfig],
        monitor: &dyn Monitor,
    ) -> Result<Self, StepError> {
        let split = Split::in_time(material.segments)?;
        let timing = CandidateTiming { material, split: &split, seed: seed(study) };
        let candidates = study.representation.candidates();
        let costs = timing.all(&candidates, monitor)?;
        let timed = candidates.iter().zip(&costs);
        let trainings = timed.filter(|(candidate, _)| left.contains(candidate));
        Ok(Self {
            trainings: trainings.map(|(_, cost)| cost.training).collect(),
            scoring: costs.iter().map(|cost| cost.scoring).sum(),
            memory: needed_bytes(study, material),
            disk: disk_bytes(&candidates, material),
        })
    }

    /// Returns the cost of the step.
    pub(super) fn of_step(&self) -> StepCost {
        // Scoring takes all threads.
        let scoring = self.scoring * rayon::current_num_threads() as f64;
        let processor_secs = self.trainings.iter().sum::<f64>() + scoring;
        StepCost { processor_secs, memory: self.memory, disk: self.disk }
    }
}

/// Reports the expected cost of the representations, unless they are there. The time of an imported one, and of another
/// arithmetic, is not known.
pub(super) fn expect(
    job: &Job,
    device: Option<Device>,
    dataset: &Dataset,
    key: &str,
    context: &RunContext,
) -> Result<(), StepError> {
    let study = job.study();
    let directory = job.layout().representation();
    let redoes = job.policy().redoes();
    let is_there = !redoes && RepresentationManifest::find(&directory, key).is_some();
    let is_trained_here = takes_disk(job) && device.is_none();
    if is_there || !is_trained_here {
        return Ok(());
    }
    let material = Material::of(dataset);
    let needed = needed_bytes(study, material);
    if !memory::fits(needed) {
        return Ok(());
    }
    let left = if redoes {
        study.representation.candidates()
    } else {
        grid::left(study, material, &directory)?
    };
    let progress = context.silent().progress();
    let cost = RepresentationCost::measure(study, material, &left, &progress)?.of_step();
    context.tell_cost(StepKind::Represent, job, cost);
    Ok(())
}

/// The time of a candidate, in seconds.
#[derive(Clone, Copy, Debug, PartialEq)]
struct CandidateCost {
    /// Training with its learning curve, on one thread.
    training: f64,
    /// Encoding and scoring all states, on all threads.
    scoring: f64,
}

impl CandidateCost {
    /// Returns the cost of a candidate that computes `factor` times as much.
    fn times(self, factor: f64) -> Self {
        Self { training: factor * self.training, scoring: factor * self.scoring }
    }
}

/// A candidate that was timed.
struct TimedCandidate {
    config: LaplacianConfig,
    cost: CandidateCost,
}

/// The data on which candidates are timed.
struct CandidateTiming<'a> {
    material: Material<'a>,
    split: &'a Split,
    seed: Seed,
}

impl CandidateTiming<'_> {
    /// Returns the cost of each candidate. Candidates that differ only in settings that do not affect time are timed
    /// once. After the time limit, costs are scaled from the candidate that was timed last, by the number of weights.
    fn all(
        &self,
        candidates: &[LaplacianConfig],
        monitor: &dyn Monitor,
    ) -> Result<Vec<CandidateCost>, StepError> {
        let columns = self.material.states.columns();
        let clock = Stopwatch::start();
        let mut timed: Vec<TimedCandidate> = Vec::new();
        let mut costs = Vec::with_capacity(candidates.len());
        for candidate in candidates {
            monitor.check()?;
            let config = timed_like(candidate);
            let known = timed.iter().find(|other| other.config == config).map(|other| other.cost);
            let by_weights = timed.last().filter(|_| clock.elapsed() >= ALL_CANDIDATES);
            let by_weights = by_weights.map(|other| {
                let weights = parameters(&config, columns) as f64;
                other.cost.times(weights / parameters(&other.config, columns) as f64)
            });
            let cost = if let Some(cost) = known.or(by_weights) {
                cost
            } else {
                let cost = self.candidate(&config)?;
                timed.push(TimedCandidate { config, cost });
                cost
            };
            costs.push(cost);
        }
        Ok(costs)
    }

    fn candidate(&self, config: &LaplacianConfig) -> Result<CandidateCost, StepError> {
        let Material { states, segments, .. } = self.material;
        let TimeableCandidate { config: timed, times } = timeable(config, states.columns());
        let clock = Stopwatch::start();
        let mut training = Training::new(&timed, states, segments, self.split, self.seed)?;
        let beginning = clock.elapsed().as_secs_f64();
        let update = times * update_secs(&mut training);
        // As many states as are scored for a point of the learning curve.
        let validation = &self.split.validation;
        let rows = validation.len().min(2 * SCORED_PAIRS);
        let few = states.slice(validation.start..validation.start + rows);
        let clock = Stopwatch::start();
        let psi = encode(training.encoder(), &few)?;
        let encoding = clock.elapsed().as_secs_f64();
        let clock = Stopwatch::start();
        score(&few, &psi, &Segments::from_lengths([rows])?, &(0..rows), self.seed);
        let scoring = clock.elapsed().as_secs_f64();
        // A training encodes on its own thread; at the end all threads encode.
        let point = encoding * rayon::current_num_threads() as f64 + scoring;
        let points = config.steps.min(CURVE_POINTS) as f64;
        let rows = rows as f64;
        Ok(CandidateCost {
            training: beginning + config.steps as f64 * update + points * point,
            scoring: (encoding * states.rows() as f64 + scoring * validation.len() as f64) / rows,
        })
    }
}

/// Returns a candidate that takes as long as this one, whatever both learn.
fn timed_like(candidate: &LaplacianConfig) -> LaplacianConfig {
    let LaplacianConfig { loss, kappa, .. } = LaplacianConfig::default();
    LaplacianConfig { loss, kappa, learning_rate: SMALL_LEARNING_RATE, ..*candidate }
}

/// A reduced candidate, some of whose updates can be timed.
struct TimeableCandidate {
    config: LaplacianConfig,
    /// Ratio of the time of an update of the full candidate to that of the reduced one.
    times: f64,
}

/// Returns the same candidate, with smaller batches if an update would take too long.
fn timeable(config: &LaplacianConfig, columns: usize) -> TimeableCandidate {
    // A batch has u, v and x, with at least two states each.
    let batch = (MOST_WORK / (3 * parameters(config, columns))).max(2).min(config.batch_size);
    let times = config.batch_size as f64 / batch as f64;
    TimeableCandidate { config: LaplacianConfig { batch_size: batch, ..*config }, times }
}

/// Returns the number of weights of the encoder for states with `columns` columns.
fn parameters(config: &LaplacianConfig, columns: usize) -> usize {
    config.sizes(columns).windows(2).map(|layer| layer[1] * (layer[0] + 1)).sum()
}

/// Returns the seconds per update, from more and more updates until they take long enough.
fn update_secs(training: &mut Training) -> f64 {
    // The first one fills the caches.
    training.step();
    let mut updates = 1_u32;
    loop {
        let clock = Stopwatch::start();
        for _ in 0..updates {
            training.step();
        }
        let took = clock.elapsed();
        if took >= TIMED {
            return took.as_secs_f64() / f64::from(updates);
        }
        updates *= 2;
    }
}

/// Returns the memory of training: the states, the representation of all of them, and the encoders that are trained at
/// a time.
pub(super) fn needed_bytes(study: &Study, material: Material<'_>) -> u64 {
    let (rows, columns) = material.shape();
    let candidates = study.representation.candidates();
    let at_once = rayon::current_num_threads().min(candidates.len()) as u64;
    // A batch has u, v and x.
    let encoders = candidates.iter().map(|candidate| {
        let states = candidate.batch_size.saturating_mul(3);
        calib_nn::training_bytes(&candidate.sizes(columns), states)
    });
    let largest = encoders.max().unwrap_or(0);
    let states = (rows * (2 * columns + widest(&candidates)) * 4) as u64;
    states.saturating_add(largest.saturating_mul(at_once))
}

/// Returns the bytes that the representations of a study still take on the disk. For an imported one they are not
/// known.
pub fn disk_left(job: &Job, dataset: &Dataset) -> u64 {
    if !takes_disk(job) {
        return 0;
    }
    let needed = disk_bytes(&job.study().representation.candidates(), Material::of(dataset));
    disk_room::left(needed, &job.layout().representation())
}

/// Whether a representation is trained. Others take no disk.
pub fn takes_disk(job: &Job) -> bool {
    matches!(job.study().representation.kind, RepresentationKind::Laplacian)
}

/// Refuses representations that do not fit on the disk.
pub(super) fn require_room(job: &Job, dataset: &Dataset) -> Result<(), StepError> {
    disk_room::require(
        disk_left(job, dataset),
        "the representations",
        &job.layout().representation(),
        "choose a folder on another disk with --output, or lower representation.dimension",
    )
}

/// Returns an upper bound on the bytes of the encoders of all candidates, and of the chosen one with its representation
/// of all states.
fn disk_bytes(candidates: &[LaplacianConfig], material: Material<'_>) -> u64 {
    let (rows, columns) = material.shape();
    let encoders = candidates.iter().map(|candidate| parameters(candidate, columns));
    let largest = encoders.clone().max().unwrap_or(0);
    4 * (encoders.sum::<usize>() + largest + rows * widest(candidates)) as u64
}

/// Returns the dimensions of the widest representation.
fn widest(candidates: &[LaplacianConfig]) -> usize {
    candidates.iter().map(|candidate| candidate.dimension).max().unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use calib_core::{Silent, States};
    use calib_files::Fingerprint;
    use calib_represent::{OneOrMore, RepresentationConfig};

    use super::*;

    #[test]
    fn batches_that_nobody_waits_for_are_cut() {
        let config = LaplacianConfig::default();
        let TimeableCandidate { config: timed, times } = timeable(&config, 4);
        assert_eq!((timed, times), (config, 1.0));
        let huge = LaplacianConfig { hidden_units: 16_384, ..config };
        let TimeableCandidate { config: timed, times } = timeable(&huge, 4);
        assert_eq!((timed.batch_size, times), (2, 128.0));
    }

    /// A grid of two step sizes and two widths, of which the two wider encoders remain.
    #[test]
    fn candidates_that_take_as_long_are_timed_once() {
        let study = Study {
            representation: RepresentationConfig {
                dimension: 3.into(),
                hidden_layers: 1,
                hidden_units: OneOrMore(vec![4, 8]),
                learning_rate: OneOrMore(vec![1e-3, 3e-3]),
                batch_size: 8,
                steps: 1_000,
                ..RepresentationConfig::default()
            },
            ..Study::default()
        };
        let values = (0..400_u16).map(|row| (f32::from(row) * 0.05).sin()).collect();
        let states = States::new(values, 200, 2).expect("valid");
        let segments = Segments::from_lengths([200]).expect("valid");
        let fingerprint = Fingerprint::of(b"states");
        let material = Material { states: &states, segments: &segments, fingerprint: &fingerprint };
        let candidates = study.representation.candidates();
        let left = &candidates[2..];
        let cost = RepresentationCost::measure(&study, material, left, &Silent).expect("trainable");
        assert_eq!(cost.trainings.len(), 2);
        assert_eq!(cost.trainings[0], cost.trainings[1], "they differ in the step size");
        assert!(cost.trainings[0] > 0.0 && cost.scoring > 0.0, "{cost:?}");
        let step = cost.of_step();
        assert!(step.processor_secs > cost.trainings.iter().sum::<f64>(), "{step:?}");
        assert_eq!((step.memory, step.disk), (cost.memory, cost.disk));
        // 2 · 4 + 4 + 4 · 3 + 3 = 27 weights, and 2 · 8 + 8 + 8 · 3 + 3 = 51; ψ of 200 states.
        assert_eq!(cost.disk, 4 * (2 * 27 + 2 * 51 + 51 + 200 * 3));
        assert!(cost.memory > 4 * 200 * (2 * 2 + 3), "{cost:?}");
    }
}
