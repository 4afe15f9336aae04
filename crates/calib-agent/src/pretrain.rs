use calib_core::{Cancelled, Monitor, Seed, Stream};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::{
    AgentConfig, AgentError, Checkpoint, Learner, StateFile,
    checkpointer::ValueState,
    population::{can_share, values_of, work_per_step},
    traces::TracedStream,
    train::{check_cumulant, grouped},
    validation::{Epoch, Validation},
    values::{Batch, Learned, Values},
};

/// Length of pre-training, and the share of validation data.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PretrainSettings {
    /// Maximum number of passes over the training transitions.
    pub epochs: usize,
    /// Epochs without a better validation error after which an agent stops; 0 never stops early.
    pub patience: usize,
    /// Share of the transitions for validation, the last in time; in (0, 1).
    pub validation_fraction: f64,
}

/// The data, settings and seed of a pre-training.
#[derive(Clone, Copy)]
pub struct Pretraining<'a> {
    /// Recorded states. No transition crosses from one piece into the next.
    pub stream: &'a dyn Stream,
    /// Number of epochs and share of validation data.
    pub settings: PretrainSettings,
    /// Seed of initial parameters and of the order of transitions in each epoch.
    pub seed: Seed,
}

/// A pre-trained agent.
#[derive(Clone, Debug, PartialEq)]
pub struct Pretrained {
    /// The learned parameters: after the last epoch, or with early stopping after the best.
    pub checkpoint: Checkpoint,
    /// The epoch of the checkpoint.
    pub epoch: usize,
    /// All epochs that were run.
    pub curve: Vec<Epoch>,
}

/// An agent whose values became non-finite. Its parameters are discarded.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("pre-training diverged in epoch {epoch}; use a smaller learning rate")]
pub struct PretrainingDiverged {
    /// The epoch, from 1.
    pub epoch: usize,
}

/// The state of one agent between two epochs.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Course {
    curve: Vec<Epoch>,
    /// The epoch with the smallest validation error; 0 before the first.
    best: usize,
    stopped: bool,
    /// The epoch in which it diverged, which is not in the curve.
    #[serde(default)]
    diverged: Option<usize>,
}

/// Pre-trains `learners`, which differ in the sensor they predict, by TD(0) over shuffled transitions.
///
/// The transitions of the stream, in time order, are cut in two: the first 1 − `validation_fraction` are for
/// training, the rest for validation. An epoch is one pass over the training transitions in an order drawn for it,
/// in mini-batches of `batch_size` (the last one may be smaller). Each mini-batch gives one update, the
/// semi-gradient step of [`train`](crate::train). All learners see the same mini-batches in one pass over the data.
/// The result of an agent depends neither on the other agents nor on the number of threads.
///
/// With a `file`, the state is written there after each epoch that took long enough to be worth it. An interrupted
/// training then resumes and reaches the same result.
///
/// An agent that diverges stops there and takes no further time. The others continue.
///
/// # Errors
/// If hyperparameters or checkpoints do not fit, there are too few transitions, the state cannot be written, or the
/// monitor is interrupted. Divergence is an outcome of one agent, not an error.
///
/// # Panics
/// If the learners differ in other settings than their sensors and discount factors.
pub fn pretrain<'a>(
    training: Pretraining<'a>,
    learners: &[Learner<'a>],
    file: Option<&StateFile>,
    monitor: &dyn Monitor,
) -> Result<Vec<Result<Pretrained, PretrainingDiverged>>, AgentError> {
    let Pretraining { stream, settings, seed } = training;
    let Some(first) = learners.first() else { return Ok(vec![]) };
    if first.config.optimiser.has_traces() {
        return Err(AgentError::TracesInBatches);
    }
    for learner in learners {
        learner.check(stream)?;
        check_cumulant(stream, learner.cumulant)?;
        let alike = AgentConfig { gamma: first.config.gamma, ..learner.config.clone() };
        assert!(
            can_share(first.config, &alike),
            "learners differ in their sensors and discount factors only"
        );
    }
    let decays = &first.config.traces;
    let sensors = stream.width();
    let traced = (!decays.is_empty()).then(|| TracedStream::new(stream, decays));
    let stream = traced.as_ref().map_or(stream, |traced| traced as &dyn Stream);
    let training = Pretraining { stream, ..training };
    let transitions: Vec<usize> =
        stream.pieces().iter().flat_map(|piece| piece.start..piece.end.saturating_sub(1)).collect();
    let held_back = (transitions.len() as f64 * settings.validation_fraction).round() as usize;
    let cut = transitions.len() - held_back.max(1).min(transitions.len());
    let batch = first.config.batch_size;
    if cut < batch {
        return Err(AgentError::TooFewTransitions { got: transitions.len(), expected: batch });
    }
    let (train, validate) = transitions.split_at(cut);

    let mut run = PretrainRun::new(training, learners, validate);
    run.resume(file);
    let work = run.groups.len() as u64 * train.len() as u64;
    monitor.begin("pre-training", settings.epochs as u64 * work);
    monitor.advance(run.epochs as u64 * work);
    let mut unkept = 0;
    let work_per_epoch =
        work_per_step(learners, sensors).saturating_mul((train.len() / batch) as u64);
    while run.epochs < settings.epochs && run.courses.iter().any(|course| !course.stopped) {
        let order = shuffled(train, seed.child("epoch").number(run.epochs as u64));
        run.epoch(&order, batch, monitor)?;
        unkept = work_per_epoch.saturating_add(unkept);
        if let Some(file) = file
            && unkept >= WORK_BETWEEN_EPOCHS
        {
            run.keep(file)?;
            unkept = 0;
        }
    }
    Ok(run.finish())
}

/// Work after which the state is written to a file, in multiplications: some seconds.
const WORK_BETWEEN_EPOCHS: u64 = 500_000_000_000;

/// Learners that one thread trains.
struct LearnerGroup {
    values: Box<dyn Values>,
    /// Their positions among all learners.
    members: Vec<usize>,
}

struct PretrainRun<'a> {
    training: Pretraining<'a>,
    groups: Vec<LearnerGroup>,
    /// Validation data of each learner.
    validations: Vec<Validation<'a>>,
    courses: Vec<Course>,
    best: Vec<Option<Checkpoint>>,
    /// Completed epochs.
    epochs: usize,
}

impl<'a> PretrainRun<'a> {
    fn new(training: Pretraining<'a>, learners: &[Learner<'a>], validate: &[usize]) -> Self {
        let Pretraining { stream, seed, .. } = training;
        let of_group = learners.len().div_ceil(rayon::current_num_threads());
        Self {
            training,
            // Learners with one discount factor learn in lockstep.
            groups: grouped(learners, |a, b| a.gamma == b.gamma)
                .iter()
                .flat_map(|positions| positions.chunks(of_group))
                .map(|members: &[usize]| {
                    let learners: Vec<Learner<'_>> =
                        members.iter().map(|&position| learners[position]).collect();
                    let batch = learners[0].config.batch_size;
                    let values = values_of(&learners, stream, batch, seed);
                    LearnerGroup { values, members: members.to_vec() }
                })
                .collect(),
            validations: learners
                .iter()
                .map(|learner| Validation::new(stream, learner, validate))
                .collect(),
            courses: vec![Course::default(); learners.len()],
            best: vec![None; learners.len()],
            epochs: 0,
        }
    }

    /// Makes one pass over the training transitions in this order, then validates.
    fn epoch(
        &mut self,
        order: &[usize],
        batch: usize,
        monitor: &dyn Monitor,
    ) -> Result<(), AgentError> {
        let stream = self.training.stream;
        let number = self.epochs + 1;
        let courses = &self.courses;
        let validations = &self.validations;
        let epochs: Vec<Vec<(usize, Option<Epoch>)>> = self
            .groups
            .par_iter_mut()
            .map(|LearnerGroup { values, members }| {
                let live: Vec<usize> =
                    (0..members.len()).filter(|&agent| !courses[members[agent]].stopped).collect();
                let mut learned = vec![Learned::default(); live.len()];
                let mut losses = vec![0.0_f64; live.len()];
                for starts in order.chunks(batch) {
                    monitor.check()?;
                    if !live.is_empty() {
                        let batch = Batch { stream, starts, present: None };
                        values.learn(batch, &live, &mut learned);
                    }
                    for (loss, learned) in losses.iter_mut().zip(&learned) {
                        *loss += f64::from(learned.squared_errors);
                    }
                    monitor.advance(starts.len() as u64);
                }
                Ok(live
                    .iter()
                    .zip(losses)
                    .map(|(&agent, loss): (&usize, f64)| {
                        let learner = members[agent];
                        let training_loss = loss / order.len() as f64;
                        let epoch = validations[learner].epoch(
                            number,
                            training_loss,
                            stream,
                            |steps, out| {
                                values.predict_all(agent, stream, steps, out);
                            },
                        );
                        let losses = [training_loss, epoch.validation_loss, epoch.error()];
                        (learner, losses.iter().all(|loss| loss.is_finite()).then_some(epoch))
                    })
                    .collect())
            })
            .collect::<Result<_, Cancelled>>()?;
        for (learner, epoch) in epochs.into_iter().flatten() {
            if let Some(epoch) = epoch {
                self.settle(learner, epoch);
            } else {
                let course = &mut self.courses[learner];
                (course.stopped, course.diverged) = (true, Some(number));
            }
        }
        self.epochs = number;
        Ok(())
    }

    /// Records an epoch of a learner, keeps the best parameters, and stops a learner that no longer improves.
    fn settle(&mut self, learner: usize, epoch: Epoch) {
        let patience = self.training.settings.patience;
        let course = &mut self.courses[learner];
        let before =
            course.best.checked_sub(1).map_or(f64::INFINITY, |at| course.curve[at].error());
        course.curve.push(epoch);
        if epoch.error() < before {
            course.best = epoch.epoch;
            if patience > 0 {
                self.best[learner] = Some(self.state(learner).checkpoint);
            }
        } else if patience > 0 && epoch.epoch - course.best >= patience {
            course.stopped = true;
        }
    }

    fn state(&self, learner: usize) -> ValueState {
        self.groups
            .iter()
            .find_map(|group| {
                let agent = group.members.iter().position(|&member| member == learner)?;
                Some(group.values.state(agent))
            })
            .unwrap_or_else(|| unreachable!("every learner is in a group"))
    }

    /// Writes the state: learners by their position, followed by their best checkpoints.
    fn keep(&self, file: &StateFile) -> Result<(), AgentError> {
        let count = self.courses.len();
        let mut values: Vec<_> = (0..count).map(|learner| (learner, self.state(learner))).collect();
        let best = self.best.iter().enumerate();
        values.extend(
            best.filter_map(|(learner, best)| Some((count + learner, best.as_ref()?.into()))),
        );
        file.write(&(self.epochs, &self.courses), values)
            .map_err(|error| AgentError::Keep(error.to_string()))
    }

    fn resume(&mut self, file: Option<&StateFile>) {
        let count = self.courses.len();
        let kept = file.and_then(StateFile::read::<(usize, Vec<Course>)>);
        let Some(((epochs, courses), values)) = kept.filter(|((_, kept), _)| kept.len() == count)
        else {
            return;
        };
        (self.epochs, self.courses) = (epochs, courses);
        for (number, state) in values {
            if number >= count {
                self.best[number - count] = Some(state.checkpoint);
                continue;
            }
            for LearnerGroup { values, members } in &mut self.groups {
                if let Some(agent) = members.iter().position(|&member| member == number) {
                    values.restore(agent, &state);
                }
            }
        }
    }

    fn finish(mut self) -> Vec<Result<Pretrained, PretrainingDiverged>> {
        let last: Vec<Checkpoint> =
            (0..self.courses.len()).map(|learner| self.state(learner).checkpoint).collect();
        let courses = std::mem::take(&mut self.courses).into_iter();
        courses
            .zip(last)
            .zip(self.best)
            .map(|((course, last), best)| {
                if let Some(epoch) = course.diverged {
                    return Err(PretrainingDiverged { epoch });
                }
                let epoch = if best.is_some() { course.best } else { course.curve.len() };
                Ok(Pretrained { checkpoint: best.unwrap_or(last), epoch, curve: course.curve })
            })
            .collect()
    }
}

/// Returns `transitions` in an order drawn from `seed`.
fn shuffled(transitions: &[usize], seed: Seed) -> Vec<usize> {
    let mut order = transitions.to_vec();
    seed.rng().shuffle(&mut order);
    order
}

#[cfg(test)]
mod tests;
