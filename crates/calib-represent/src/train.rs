use std::fmt;

use calib_core::{Monitor, Seed, Segments, States};
use calib_files::CheckpointFile;
use calib_nn::Mlp;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{
    LaplacianConfig, Point, RepresentError, Scores, Split, Stepper, Training,
    checkpoint::{self, Progress},
    encoder::encode_here,
    score,
    split::successive,
};

/// Maximum number of points of the learning curve, and of checkpoints.
pub const CURVE_POINTS: usize = 20;

/// Maximum number of pairs of successive validation states on which a point of the learning curve is scored.
pub const SCORED_PAIRS: usize = 2_000;

/// Training counts as diverging when the loss exceeds this many times a reference: the larger of the first loss
/// and the natural scale of the loss.
const EXPLOSION: f64 = 1e4;

/// Why a training stopped early.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", tag = "reason")]
pub enum Divergence {
    /// The loss, or ψ of a validation state, was NaN or infinite.
    NotFinite {
        /// Number of the update, from 1.
        step: usize,
    },
    /// The loss grew far beyond the values of a training that converges.
    Exploded {
        /// Number of the update, from 1.
        step: usize,
        /// The loss.
        loss: f64,
    },
}

impl fmt::Display for Divergence {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotFinite { step } => write!(f, "not finite at step {step}"),
            Self::Exploded { step, loss } => write!(f, "loss of {loss:.3e} at step {step}"),
        }
    }
}

/// The inputs of training.
#[derive(Clone, Copy, Debug)]
pub struct Task<'a> {
    /// Normalised states.
    pub states: &'a States,
    /// The segments of the states.
    pub segments: &'a Segments,
    /// The states for training and for scoring.
    pub split: &'a Split,
    /// The root seed of all random numbers.
    pub seed: Seed,
}

/// The result of training.
#[derive(Clone, Debug, PartialEq)]
pub struct Trained {
    /// The encoder. It is unusable if training diverged.
    pub encoder: Mlp,
    /// The learning curve.
    pub points: Vec<Point>,
    /// The reason why training ended early, if it did.
    pub divergence: Option<Divergence>,
}

/// Trains an encoder to the end, or until it diverges.
///
/// Updates are reported to `monitor`, whose task the caller begins with `config.steps` units. With a checkpoint,
/// the state is stored at every point of the learning curve and at an interruption. The next call resumes from
/// there. The result has the same bytes as without an interruption.
///
/// # Errors
/// As [`Training::new`]; an unusable checkpoint; [`RepresentError::Cancelled`].
pub fn train(
    config: &LaplacianConfig,
    task: Task<'_>,
    checkpoint: Option<&CheckpointFile>,
    monitor: &dyn Monitor,
) -> Result<Trained, RepresentError> {
    let Task { states, segments, split, seed } = task;
    let mut training = Training::new(config, states, segments, split, seed)?;
    train_with(&mut training, config, task, checkpoint, monitor)
}

/// Trains as [`train`], with updates by `training`.
///
/// # Errors
/// As [`train`], and those of `training`.
pub fn train_with(
    training: &mut dyn Stepper,
    config: &LaplacianConfig,
    task: Task<'_>,
    checkpoint: Option<&CheckpointFile>,
    monitor: &dyn Monitor,
) -> Result<Trained, RepresentError> {
    let Task { states, segments, split, seed } = task;
    let restored = checkpoint.map(|checkpoint| checkpoint::read(checkpoint, training));
    let mut progress = restored.transpose()?.flatten().unwrap_or_default();
    monitor.advance(training.done() as u64);
    let sample = Sample::new(states, segments, split);
    let every = config.steps.div_ceil(CURVE_POINTS);
    let mut divergence = None;
    while training.done() < config.steps && divergence.is_none() {
        if let Err(cancelled) = monitor.check() {
            keep(checkpoint, training, &progress)?;
            return Err(cancelled.into());
        }
        let loss = training.step()?;
        monitor.advance(1);
        let step = training.done();
        let first = *progress.first_loss.get_or_insert(loss);
        divergence = diverged(config, step, loss, first);
        progress.sum += loss;
        progress.count += 1;
        if divergence.is_none() && (step.is_multiple_of(every) || step == config.steps) {
            match sample.score(&training.encoder()?, seed) {
                Some(scores) => {
                    let loss = progress.sum / progress.count as f64;
                    progress.points.push(Point { step, loss, scores });
                    (progress.sum, progress.count) = (0.0, 0);
                    keep(checkpoint, training, &progress)?;
                }
                None => divergence = Some(Divergence::NotFinite { step }),
            }
        }
    }
    let rest = config.steps - training.done();
    monitor.advance(rest as u64);
    Ok(Trained { encoder: training.encoder()?, points: progress.points, divergence })
}

/// Writes the checkpoint, if there is a file for it.
fn keep(
    checkpoint: Option<&CheckpointFile>,
    training: &dyn Stepper,
    progress: &Progress,
) -> Result<(), RepresentError> {
    match checkpoint {
        Some(checkpoint) => checkpoint::write(checkpoint, training, progress),
        None => Ok(()),
    }
}

fn diverged(config: &LaplacianConfig, step: usize, loss: f64, first: f64) -> Option<Divergence> {
    if !loss.is_finite() {
        return Some(Divergence::NotFinite { step });
    }
    // The natural scale: how much the repulsion lowers the loss when every dimension has its full second moment
    // l/q.
    let (quartic, quadratic) = config.loss.repulsion();
    let scale = config.dimension as f64 * quadratic * quadratic / quartic;
    (loss > EXPLOSION * first.abs().max(scale)).then_some(Divergence::Exploded { step, loss })
}

/// Evenly spaced pairs of successive validation states, each pair in its own segment.
struct Sample {
    states: States,
    segments: Segments,
}

impl Sample {
    fn new(states: &States, segments: &Segments, split: &Split) -> Self {
        let all: Vec<usize> = successive(segments, &split.validation).collect();
        let count = all.len().min(SCORED_PAIRS);
        let mut values = Vec::with_capacity(2 * count * states.columns());
        for place in 0..count {
            let row = all[place * all.len() / count];
            values.extend_from_slice(states.row(row));
            values.extend_from_slice(states.row(row + 1));
        }
        Self {
            states: States::new(values, 2 * count, states.columns())
                .unwrap_or_else(|_| unreachable!("rows of valid states")),
            segments: Segments::from_lengths(vec![2; count])
                .unwrap_or_else(|_| unreachable!("no segment is empty")),
        }
    }

    /// Returns the scores, or `None` if ψ is not finite.
    fn score(&self, encoder: &Mlp, seed: Seed) -> Option<Scores> {
        let psi = encode_here(encoder, &self.states).ok()?;
        Some(score(&self.states, &psi, &self.segments, &(0..self.states.rows()), seed))
    }
}

#[cfg(test)]
mod tests;
