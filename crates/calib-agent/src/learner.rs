use calib_core::Stream;
use calib_nn::Moments;

use crate::{AgentConfig, AgentError, ValueFunction};

/// One agent of a run: how it learns, what it predicts, and where it starts.
#[derive(Clone, Copy, Debug)]
pub struct Learner<'a> {
    /// Hyperparameters.
    pub config: &'a AgentConfig,
    /// The state column whose discounted sum is predicted.
    pub cumulant: usize,
    /// The value function to start from. `None` draws initial parameters from the run's seed.
    pub start: Option<&'a Checkpoint>,
    /// Predictions to which the value function is added: one for each state of the run's stream. The value function
    /// then starts as 0, unless there is a checkpoint.
    pub baseline: Option<&'a [f32]>,
}

/// A trained value function, as a starting point for other training.
#[derive(Clone, Debug, PartialEq)]
pub struct Checkpoint {
    /// Weights and biases, layer by layer in the order of [`calib_nn::Mlp`]. A linear value function is a network
    /// without hidden layers.
    pub parameters: Vec<f32>,
    /// Adam's moments, to continue with. With `None` they start from zero.
    pub moments: Option<Moments>,
}

/// Returns the layer sizes of an agent's value function with `width` inputs ([`AgentConfig::seen_width`]): input
/// first, the single output last.
pub fn layer_sizes(config: &AgentConfig, width: usize) -> Vec<usize> {
    let hidden = match config.value_function {
        ValueFunction::Mlp => vec![config.hidden_units; config.hidden_layers],
        ValueFunction::Linear => vec![],
    };
    [vec![width], hidden, vec![1]].concat()
}

/// Returns the number of weights and biases of that value function.
pub fn parameter_count(config: &AgentConfig, width: usize) -> usize {
    layer_sizes(config, width).windows(2).map(|pair| (pair[0] + 1) * pair[1]).sum()
}

impl<'a> Learner<'a> {
    /// Returns a learner without checkpoint and baseline.
    pub const fn new(config: &'a AgentConfig, cumulant: usize) -> Self {
        Self { config, cumulant, start: None, baseline: None }
    }

    /// Checks the hyperparameters, and that checkpoint and baseline fit them and the stream.
    pub(crate) fn check(&self, stream: &dyn Stream) -> Result<(), AgentError> {
        self.config.check()?;
        let width = stream.width();
        if let Some(baseline) = self.baseline
            && baseline.len() != stream.len()
        {
            return Err(AgentError::Baseline { got: baseline.len(), expected: stream.len() });
        }
        let Some(start) = self.start else { return Ok(()) };
        let expected = parameter_count(self.config, self.config.seen_width(width));
        let moments = start.moments.as_ref().map_or(expected, |moments| moments.mean.len());
        match [start.parameters.len(), moments].into_iter().find(|&got| got != expected) {
            Some(got) => Err(AgentError::Checkpoint { got, expected }),
            None => Ok(()),
        }
    }

    /// Whether both learn from the same cumulants.
    fn has_cumulant_of(&self, other: &Self) -> bool {
        self.cumulant == other.cumulant && self.baseline_address() == other.baseline_address()
    }

    /// Returns the memory address of its baseline, if it has one.
    fn baseline_address(&self) -> Option<*const f32> {
        self.baseline.map(<[f32]>::as_ptr)
    }

    /// Returns the cumulant on arriving at each state. That of the first state of a piece is never used.
    fn cumulants(&self, stream: &dyn Stream) -> Vec<f32> {
        let gamma = self.config.gamma as f32;
        let received = (0..stream.len()).map(|t| stream.state(t)[self.cumulant]);
        match self.baseline {
            None => received.collect(),
            Some(baseline) => received
                .enumerate()
                .map(|(t, value)| value + gamma * baseline[t] - baseline[t.saturating_sub(1)])
                .collect(),
        }
    }

    /// Whether updates can change the parameters.
    pub(crate) fn learns(&self) -> bool {
        self.config.learning_rate > 0.0
    }

    /// Returns the cost of an update, in multiplications of the matrix products: forward for s and s', backward for
    /// the weights and for the layer before. An update counts as at least a million, which small agents spend on
    /// gathering and bookkeeping.
    pub fn work_per_update(&self, width: usize) -> u64 {
        let parameters = parameter_count(self.config, self.config.seen_width(width)) as u64;
        let transitions = self.config.transitions_per_update() as u64;
        parameters.saturating_mul(transitions).saturating_mul(4).max(1_000_000)
    }

    /// Returns the cost of a step; see [`work_per_update`](Self::work_per_update).
    pub fn work_per_step(&self, width: usize) -> u64 {
        self.work_per_update(width).saturating_mul(self.config.updates_per_step as u64)
    }
}

/// The cumulants whose discounted sums value functions learn: the predicted sensor, minus what the baseline explains.
///
/// A value function u that is added to a baseline b has the TD error `(o' + γ b(s') − b(s)) + γ u(s') − u(s)`. The
/// cumulant is the term in brackets.
#[derive(Clone, Debug)]
pub(crate) struct Cumulants {
    /// The distinct cumulants, each with its value on arriving at each state of the stream.
    pub(crate) series: Vec<Vec<f32>>,
    /// The index in `series` of each learner's cumulant.
    pub(crate) series_of: Vec<usize>,
}

impl Cumulants {
    pub(crate) fn new(learners: &[Learner<'_>], stream: &dyn Stream) -> Self {
        let mut known: Vec<&Learner<'_>> = vec![];
        let mut series = vec![];
        let mut series_of = Vec::with_capacity(learners.len());
        for learner in learners {
            let place = known
                .iter()
                .position(|other| other.has_cumulant_of(learner))
                .unwrap_or_else(|| {
                    known.push(learner);
                    series.push(learner.cumulants(stream));
                    series.len() - 1
                });
            series_of.push(place);
        }
        Self { series, series_of }
    }
}
