//! Prediction errors of a network, which rollouts can add as noise.
//!
//! A network that is trained on squared errors predicts conditional means. When means are fed back, rollouts become
//! constant where the plant does not. Adding recorded residuals to each prediction keeps the variance of one step.

use std::{
    collections::BTreeMap,
    ops::{Range, RangeInclusive},
};

use calib_core::{Rng, RowIndex, Segments, Silent, States};
use calib_files::{Tensor, Tensors};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{Dynamics, DynamicsError, Transitioning, predict};

/// Version of rollouts with noise. Raise it whenever the same inputs give other bytes, so that results of different
/// versions are never mixed.
pub const NOISE_VERSION: u32 = 2;
/// Mean number of steps in a block.
const BLOCK: f64 = 36.0;

/// The noise that rollouts add to predictions.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Noise {
    /// No noise (the paper): rollouts of conditional means.
    #[default]
    None,
    /// At each step, the residual of a random validation transition, with all columns together.
    Residual,
    /// Residuals in the order in which they were recorded, in blocks of 36 steps on average.
    Block,
}

/// The recorded next states minus the predicted ones, over the validation part.
#[derive(Clone, Debug, PartialEq)]
pub struct Residuals {
    columns: usize,
    /// The residuals, `[row, column]`.
    values: Vec<f32>,
    /// Ranges of rows that follow each other in time.
    pieces: Vec<Range<usize>>,
}

impl Residuals {
    /// Computes the residuals of the model's predictions for each validation transition, from the recorded state before
    /// it.
    ///
    /// # Errors
    /// If the model cannot be run, or a prediction is not finite.
    pub fn of(model: &dyn Dynamics, data: &Transitioning<'_>) -> Result<Self, DynamicsError> {
        let states = data.states();
        let transitions = data.transitions();
        let sources: Vec<RowIndex> = transitions.sources()[data.validation()]
            .iter()
            .map(|&source| RowIndex(source))
            .collect();
        let segments = transitions.segments();
        let predictions = predict(model, states, segments, &sources, 1, &Silent)?;
        let mut values = Vec::with_capacity(sources.len() * data.columns());
        for (source, prediction) in sources.iter().zip(&predictions) {
            if prediction.steps() == 0 {
                let reason = "a prediction of a recorded state is not finite".to_owned();
                return Err(DynamicsError::Weights { reason });
            }
            let recorded = states.row(source.get() + 1).iter();
            values.extend(recorded.zip(prediction.state(1)).map(|(next, own)| next - own));
        }
        let mut pieces = Vec::new();
        let mut first = 0;
        for run in sources.chunk_by(|now, then| then.get() == now.get() + 1) {
            pieces.push(first..first + run.len());
            first += run.len();
        }
        Ok(Self { columns: data.columns(), values, pieces })
    }

    /// Returns the number of transitions with residuals.
    pub fn rows(&self) -> usize {
        self.values.len() / self.columns
    }

    fn row(&self, row: usize) -> &[f32] {
        &self.values[row * self.columns..][..self.columns]
    }

    /// Returns the residuals as tensors: `residuals` `[rows, columns]`, with the pieces in the metadata.
    pub fn to_tensors(&self) -> Tensors {
        let ends: Vec<usize> = self.pieces.iter().map(|piece| piece.end).collect();
        Tensors {
            tensors: vec![Tensor {
                name: "residuals".to_owned(),
                shape: vec![self.rows(), self.columns],
                values: self.values.clone(),
            }],
            metadata: BTreeMap::from([("ends".to_owned(), serde_json::json!(ends).to_string())]),
        }
    }

    /// Reads the tensors of [`to_tensors`](Self::to_tensors).
    ///
    /// # Errors
    /// If they are not residuals of `columns` values.
    pub fn from_tensors(tensors: &Tensors, columns: usize) -> Result<Self, DynamicsError> {
        let tensor = tensors.get("residuals").ok_or_else(not_residuals)?;
        let ends = tensors.metadata.get("ends").ok_or_else(not_residuals)?;
        let ends: Vec<usize> = serde_json::from_str(ends).map_err(|_| not_residuals())?;
        let mut pieces = Vec::with_capacity(ends.len());
        let mut start = 0;
        for end in ends {
            pieces.push(start..end);
            start = end;
        }
        let is_whole = pieces.iter().all(|piece| !piece.is_empty());
        if tensor.shape != [start, columns] || start == 0 || !is_whole {
            return Err(not_residuals());
        }
        Ok(Self { columns, values: tensor.values.clone(), pieces })
    }
}

fn not_residuals() -> DynamicsError {
    DynamicsError::Weights { reason: "they are no residuals of it".to_owned() }
}

/// The noise that rollouts of a network add to its predictions, and the range of the log, to which they cut the sums.
///
/// Without the cut a network that is a little unstable drifts away from the states that it was trained on, and its rollouts
/// diverge.
#[derive(Debug)]
pub struct ResidualNoise {
    kind: Noise,
    residuals: Residuals,
    /// The lowest and the highest recorded value of each column.
    recorded: Vec<RangeInclusive<f32>>,
}

impl ResidualNoise {
    /// Returns the noise of a network that was trained on `states`.
    ///
    /// # Panics
    /// If the residuals have another number of columns.
    pub fn new(kind: Noise, residuals: Residuals, states: &States) -> Self {
        assert_eq!(residuals.columns, states.columns(), "residuals of these states");
        let mut recorded = vec![f32::INFINITY..=f32::NEG_INFINITY; states.columns()];
        for row in states.as_slice().chunks_exact(states.columns()) {
            for (range, value) in recorded.iter_mut().zip(row) {
                *range = range.start().min(*value)..=range.end().max(*value);
            }
        }
        Self { kind, residuals, recorded }
    }

    /// Returns the noise of one rollout.
    pub(crate) fn source(&self, rng: Rng) -> NoiseSource<'_> {
        NoiseSource { noise: self, rng, next: 0..0 }
    }
}

/// The noise of one rollout.
pub(crate) struct NoiseSource<'a> {
    noise: &'a ResidualNoise,
    rng: Rng,
    /// The next row of a block, and the end of its piece.
    next: Range<usize>,
}

impl NoiseSource<'_> {
    /// Adds the next residual to a predicted state, and cuts the sum to the range of the log.
    pub(crate) fn add_to(&mut self, predicted: &mut [f32]) {
        let ResidualNoise { kind, residuals, recorded } = self.noise;
        let row = match kind {
            Noise::None => return,
            Noise::Residual => self.rng.below(residuals.rows()),
            Noise::Block => self.next_of_block(),
        };
        for ((value, residual), range) in predicted.iter_mut().zip(residuals.row(row)).zip(recorded)
        {
            *value = (*value + residual).clamp(*range.start(), *range.end());
        }
    }

    fn next_of_block(&mut self) -> usize {
        let residuals = &self.noise.residuals;
        if self.next.is_empty() || self.rng.unit() < 1.0 / BLOCK {
            let row = self.rng.below(residuals.rows());
            let piece = residuals.pieces.partition_point(|piece| piece.end <= row);
            self.next = row..residuals.pieces[piece].end;
        }
        let row = self.next.start;
        self.next.start += 1;
        row
    }
}

/// The inputs of rollouts: a model, recorded states and noise.
#[derive(Clone, Copy, Debug)]
pub struct Rollouts<'a> {
    /// The model that predicts.
    pub model: &'a dyn Dynamics,
    /// The states from which rollouts start.
    pub states: &'a States,
    /// The segments of the states.
    pub segments: &'a Segments,
    /// The noise that is added to predictions, if any.
    pub noise: Option<&'a ResidualNoise>,
}

#[cfg(test)]
mod tests {
    use calib_core::{Seed, Transitions};
    use calib_nn::Mlp;

    use super::*;
    use crate::{FeedForward, Start};

    /// Returns the plant x' = x / 2 + noise, and its exact model.
    fn plant(rows: usize) -> (States, Transitions, FeedForward) {
        let mut rng = Seed::new(3).rng();
        let mut values = vec![0.0_f32];
        for row in 1..rows {
            values.push(0.5 * values[row - 1] + rng.normal() as f32);
        }
        let states = States::new(values, rows, 1).expect("finite");
        let segments = Segments::from_lengths([rows / 2, rows - rows / 2]).expect("valid");
        let network = Mlp::from_parameters(&[1, 1], &[0.5, 0.0]).expect("two parameters");
        (states, Transitions::new(segments), FeedForward::new(network).expect("square"))
    }

    fn spread(values: impl Iterator<Item = f32>) -> f64 {
        let values: Vec<f64> = values.map(f64::from).collect();
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        let squares: f64 = values.iter().map(|x| (x - mean).powi(2)).sum();
        (squares / values.len() as f64).sqrt()
    }

    #[test]
    fn rollouts_with_residuals_move_as_much_as_the_record() {
        let (states, transitions, model) = plant(4000);
        let data = Transitioning::new(&states, &transitions, 0.8).expect("enough");
        let residuals = Residuals::of(&model, &data).expect("finite");
        assert_eq!((residuals.rows(), residuals.pieces.len()), (3198, 2));
        let back = Residuals::from_tensors(&residuals.to_tensors(), 1).expect("ours");
        assert_eq!(back, residuals);
        let roll = |kind: Noise, seed: u64| {
            let noise = ResidualNoise::new(kind, residuals.clone(), &states);
            let rollouts = Rollouts {
                model: &model,
                states: &states,
                segments: transitions.segments(),
                noise: Some(&noise),
            };
            let start = Start { row: RowIndex::new(7), seed: Seed::new(seed) };
            rollouts.predict(&[start], 3000, &Silent).expect("it runs").remove(0)
        };
        let recorded = spread(states.as_slice().iter().copied());
        assert!(spread(roll(Noise::None, 1).column(0).skip(100)) < 1e-6, "it stands still");
        for noise in [Noise::Residual, Noise::Block] {
            let rolled = roll(noise, 1);
            assert!((spread(rolled.column(0)) / recorded - 1.0).abs() < 0.1, "{noise:?}");
            assert_eq!(rolled, roll(noise, 1));
            assert_ne!(rolled, roll(noise, 2));
        }
    }

    #[test]
    fn blocks_follow_the_record_and_end_with_it() {
        let values: Vec<f32> = (0..200_u8).map(f32::from).collect();
        let states = States::new(values.clone(), 200, 1).expect("finite");
        let residuals = Residuals { columns: 1, values, pieces: vec![0..50, 50..200] };
        let noise = ResidualNoise::new(Noise::Block, residuals, &states);
        let mut source = noise.source(Seed::new(5).rng());
        let mut drawn = Vec::new();
        for _ in 0..20_000 {
            let mut state = [0.0];
            source.add_to(&mut state);
            drawn.push(state[0]);
        }
        let share = drawn.windows(2).filter(|pair: &&[f32]| pair[1] == pair[0] + 1.0).count()
            as f64
            / 19_999.0;
        assert!((0.94..0.99).contains(&share), "{share}");
        assert!(!drawn.windows(2).any(|pair| pair[0] == 49.0 && pair[1] == 50.0), "a gap");
    }

    #[test]
    fn rollouts_of_an_unstable_network_stay_in_the_range_of_the_log() {
        let (states, transitions, _) = plant(400);
        let network = Mlp::from_parameters(&[1, 1], &[1.5, 0.0]).expect("two parameters");
        let model = FeedForward::new(network).expect("square");
        let data = Transitioning::new(&states, &transitions, 0.5).expect("enough");
        let residuals = Residuals::of(&model, &data).expect("finite");
        let noise = ResidualNoise::new(Noise::Residual, residuals, &states);
        let [diverged, rolled] = [None, Some(&noise)].map(|noise| {
            let segments = transitions.segments();
            let rollouts = Rollouts { model: &model, states: &states, segments, noise };
            let start = Start { row: RowIndex::new(9), seed: Seed::new(1) };
            rollouts.predict(&[start], 1000, &Silent).expect("it runs").remove(0)
        });
        assert!(diverged.steps() < 1000, "it diverges");
        let highest = states.as_slice().iter().copied().fold(f32::MIN, f32::max);
        let lowest = states.as_slice().iter().copied().fold(f32::MAX, f32::min);
        assert_eq!(rolled.steps(), 1000);
        assert!(rolled.column(0).all(|value| (lowest..=highest).contains(&value)));
    }
}
