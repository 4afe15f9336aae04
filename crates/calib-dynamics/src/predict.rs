use std::{ops::Range, sync::Arc};

use calib_core::{Monitor, RowIndex, Seed, Segments, States, Stream};
use rayon::prelude::*;

use crate::{Dynamics, DynamicsError, LANES, Rollouts, noise::NoiseSource};

/// Steps between two checks for an interruption.
const STEPS_PER_LOOK: usize = 256;

/// A trajectory that a model predicts, starting from a recorded state.
///
/// State 0 is the start. Each further state is the model's prediction from the previous one. States are normalised, and
/// need not resemble any recorded state.
#[derive(Clone, Debug, PartialEq)]
pub struct Prediction {
    start: RowIndex,
    columns: usize,
    states: Vec<f32>,
    ended: Ended,
}

/// The end of a rollout.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ended {
    /// The rollout took all the requested steps.
    Complete,
    /// The rollout stopped before this step, because its state would contain a value that is not finite.
    NotFinite {
        /// Number of the missing step, counted from 1.
        step: usize,
        /// The first column that is not finite.
        column: usize,
    },
}

impl Prediction {
    /// Returns the recorded row of the start.
    pub fn start(&self) -> RowIndex {
        self.start
    }

    /// Returns the number of steps taken: the number of states without the start.
    pub fn steps(&self) -> usize {
        self.states.len() / self.columns - 1
    }

    /// Returns the number of values in a state.
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// Returns the state after `step` steps.
    pub fn state(&self, step: usize) -> &[f32] {
        &self.states[step * self.columns..][..self.columns]
    }

    /// Returns the values of one column, from the start on.
    pub fn column(&self, column: usize) -> impl Iterator<Item = f32> + '_ {
        self.states.iter().skip(column).step_by(self.columns).copied()
    }

    /// Returns how the rollout ended.
    pub fn ended(&self) -> Ended {
        self.ended
    }
}

/// A prediction as a stream for an agent, in one unbroken segment.
#[derive(Clone, Debug)]
pub struct PredictedStream {
    prediction: Arc<Prediction>,
    piece: Range<usize>,
}

impl PredictedStream {
    /// Creates the stream of a prediction.
    pub fn new(prediction: Arc<Prediction>) -> Self {
        let piece = 0..prediction.steps() + 1;
        Self { prediction, piece }
    }
}

impl Stream for PredictedStream {
    fn len(&self) -> usize {
        self.prediction.steps() + 1
    }

    fn width(&self) -> usize {
        self.prediction.columns
    }

    fn state(&self, t: usize) -> &[f32] {
        self.prediction.state(t)
    }

    fn pieces(&self) -> &[Range<usize>] {
        std::slice::from_ref(&self.piece)
    }
}

/// Rolls `model` out from each of the recorded `starts` for `steps` steps, feeding predictions back, without noise.
///
/// # Errors
/// As [`Rollouts::predict`].
///
/// # Panics
/// As [`Rollouts::predict`].
pub fn predict(
    model: &dyn Dynamics,
    states: &States,
    segments: &Segments,
    starts: &[RowIndex],
    steps: usize,
    monitor: &dyn Monitor,
) -> Result<Vec<Prediction>, DynamicsError> {
    let rollouts = Rollouts { model, states, segments, noise: None };
    let starts: Vec<Start> = starts.iter().map(|&row| Start { row, seed: Seed::new(0) }).collect();
    rollouts.predict(&starts, steps, monitor)
}

/// The start of a rollout, and the seed of its noise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Start {
    /// The recorded row.
    pub row: RowIndex,
    /// The seed of the noise, if there is any.
    pub seed: Seed,
}

impl Rollouts<'_> {
    /// Rolls the model out from each of `starts` for `steps` steps, feeding predictions back.
    ///
    /// A model with a hidden state first processes the recorded states before the start: as many as it needs and the
    /// segment has (our choice: the hidden state is then as in training). A rollout depends only on its own start, bit for
    /// bit. It does not depend on the other starts or on the number of threads. Progress counts steps.
    ///
    /// # Errors
    /// If the model does not fit the states or cannot be run, or the monitor is interrupted.
    ///
    /// # Panics
    /// If a start is not a row of the segments.
    pub fn predict(
        &self,
        starts: &[Start],
        steps: usize,
        monitor: &dyn Monitor,
    ) -> Result<Vec<Prediction>, DynamicsError> {
        let model = self.model.columns();
        let states = self.states.columns();
        if model != states {
            let reason = format!("the model has {model} columns, the states have {states}");
            return Err(DynamicsError::Weights { reason });
        }
        monitor.begin("rollouts", starts.len() as u64 * steps as u64);
        let lockstep: Result<Vec<Vec<Prediction>>, DynamicsError> = starts
            .par_chunks(LANES)
            .map(|starts| self.predict_in_lockstep(starts, steps, monitor))
            .collect();
        Ok(lockstep?.into_iter().flatten().collect())
    }

    /// Predicts as [`predict`](Self::predict), from at most [`LANES`] starts and only on the calling thread. The caller
    /// begins the task.
    ///
    /// # Errors
    /// If the model cannot be run, or the monitor is interrupted.
    ///
    /// # Panics
    /// If there are more starts, or one is not a row of the segments, or the model does not fit the states.
    pub fn predict_in_lockstep(
        &self,
        starts: &[Start],
        steps: usize,
        monitor: &dyn Monitor,
    ) -> Result<Vec<Prediction>, DynamicsError> {
        let Rollouts { model, states, segments, noise } = *self;
        let columns = states.columns();
        assert!(starts.len() <= LANES, "at most {LANES} rollouts step together");
        assert_eq!(model.columns(), columns, "the model is one of these states");
        let mut lanes = model.begin_rollouts()?;
        let mut current = vec![0.0; LANES * columns];
        let mut next = vec![0.0; LANES * columns];
        let mut noises: Vec<Option<NoiseSource<'_>>> = starts
            .iter()
            .map(|start| Some(noise?.source(start.seed.child("noise").rng())))
            .collect();
        let histories: Vec<usize> =
            starts.iter().map(|start| history(segments, start.row).min(model.history())).collect();
        for back in (1..=histories.iter().copied().max().unwrap_or(0)).rev() {
            for (lane, start) in starts.iter().enumerate() {
                if histories[lane] < back {
                    continue;
                }
                let row = states.row(start.row.get() - back);
                current[lane * columns..][..columns].copy_from_slice(row);
                if histories[lane] == back {
                    lanes.forget(lane);
                }
            }
            lanes.step(&current, &mut next)?;
        }
        let mut rollouts = Vec::with_capacity(starts.len());
        for (lane, start) in starts.iter().enumerate() {
            let row = states.row(start.row.get());
            current[lane * columns..][..columns].copy_from_slice(row);
            if histories[lane] == 0 {
                lanes.forget(lane);
            }
            let mut all = Vec::with_capacity((steps + 1) * columns);
            all.extend_from_slice(row);
            let start = start.row;
            let ended = Ended::Complete;
            rollouts.push(Prediction { start, columns, states: all, ended });
        }
        for step in 1..=steps {
            lanes.step(&current, &mut next)?;
            for (lane, rollout) in rollouts.iter_mut().enumerate() {
                let predicted = &mut next[lane * columns..][..columns];
                if rollout.ended != Ended::Complete {
                    predicted.fill(0.0);
                    continue;
                }
                if let Some(noise) = &mut noises[lane] {
                    noise.add_to(predicted);
                }
                if let Some(column) = predicted.iter().position(|value| !value.is_finite()) {
                    rollout.ended = Ended::NotFinite { step, column };
                    predicted.fill(0.0);
                } else {
                    rollout.states.extend_from_slice(predicted);
                }
            }
            std::mem::swap(&mut current, &mut next);
            // Unused lanes stay at zero.
            current[rollouts.len() * columns..].fill(0.0);
            if step % STEPS_PER_LOOK == 0 || step == steps {
                monitor.check()?;
                let done = (step - 1) % STEPS_PER_LOOK + 1;
                monitor.advance((done * rollouts.len()) as u64);
            }
        }
        Ok(rollouts)
    }
}

/// Returns the number of rows before the start in its segment.
fn history(segments: &Segments, start: RowIndex) -> usize {
    let position = segments.position_of(start.get()).expect("a start is a row of the data");
    start.get() - segments.as_slice()[position].start as usize
}

#[cfg(test)]
mod tests {
    use calib_core::Silent;
    use calib_nn::Mlp;

    use super::*;
    use crate::{FeedForward, Recurrent};

    fn states(rows: usize, columns: usize) -> States {
        let mut rng = Seed::new(5).rng();
        let values = (0..rows * columns).map(|_| rng.unit() as f32).collect();
        States::new(values, rows, columns).expect("finite")
    }

    fn recurrent(columns: usize, hidden: usize) -> Recurrent {
        Recurrent::random(columns, hidden, 2, 6, Seed::new(9))
    }

    #[test]
    fn together_and_alone_are_the_same_bits() {
        let rows = 90;
        let columns = 7;
        let states = states(rows, columns);
        let segments = Segments::from_lengths([40, 3, 47]).expect("valid");
        let starts: Vec<RowIndex> = (0..37).map(|r| RowIndex::new(r * 29 % rows)).collect();
        let network = Mlp::new(&[columns, 33, 65, columns], Seed::new(4));
        let models: [Box<dyn Dynamics>; 2] = [
            Box::new(FeedForward::new(network).expect("square")),
            Box::new(recurrent(columns, 19)),
        ];
        for model in models {
            let together =
                predict(&*model, &states, &segments, &starts, 25, &Silent).expect("it runs");
            for (start, expected) in starts.iter().zip(&together) {
                let alone = predict(&*model, &states, &segments, &[*start], 25, &Silent);
                assert_eq!(alone.expect("it runs")[0], *expected);
                assert_eq!(expected.state(0), states.row(start.get()));
                assert_eq!((expected.steps(), expected.ended()), (25, Ended::Complete));
            }
        }
    }

    #[test]
    fn the_hidden_state_is_filled_from_the_same_segment() {
        let states = states(30, 3);
        let model = recurrent(3, 8);
        let cases: [&[usize]; 3] = [&[30], &[14, 16], &[15, 15]];
        let [whole, six_rows, five_rows] = cases.map(|lengths| {
            let segments = Segments::from_lengths(lengths.iter().copied()).expect("valid");
            let starts = [RowIndex(20)];
            predict(&model, &states, &segments, &starts, 4, &Silent).expect("it runs").remove(0)
        });
        assert_eq!(whole, six_rows, "six rows back, no more");
        assert!(whole != five_rows, "five rows back");
        // The expected result, computed directly: the model runs over the recorded rows.
        let mut lanes = model.begin_rollouts().expect("it runs");
        let mut next = vec![0.0; LANES * 3];
        for row in 15..=20 {
            lanes.step(&states.row(row).repeat(LANES), &mut next).expect("a step");
        }
        assert_eq!(five_rows.state(1), &next[..3]);
    }

    #[test]
    fn what_is_not_finite_ends_a_rollout() {
        // x grows tenfold per step, and leaves the range of f32 after about 38 steps.
        let network = Mlp::from_parameters(&[1, 1], &[10.0, 0.0]).expect("two parameters");
        let model = FeedForward::new(network).expect("square");
        let states = States::new(vec![1.0, 0.0], 2, 1).expect("finite");
        let segments = Segments::from_lengths([2]).expect("valid");
        let starts = [RowIndex(0), RowIndex(1)];
        let rolled = predict(&model, &states, &segments, &starts, 50, &Silent).expect("it runs");
        assert_eq!(rolled[0].ended(), Ended::NotFinite { step: 39, column: 0 });
        assert_eq!(rolled[0].steps(), 38);
        assert_eq!((rolled[1].ended(), rolled[1].steps()), (Ended::Complete, 50));
        let stream = PredictedStream::new(Arc::new(rolled[0].clone()));
        assert_eq!((stream.len(), stream.pieces().len()), (39, 1));
        assert_eq!(stream.pieces()[0], 0..39);
        assert_eq!(stream.state(2), [100.0]);
        let wide = FeedForward::new(Mlp::new(&[2, 2], Seed::new(1))).expect("square");
        assert!(predict(&wide, &states, &segments, &starts, 1, &Silent).is_err());
    }
}
