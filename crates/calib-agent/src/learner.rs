use calib_nn::Moments;

use crate::{AgentConfig, AgentError, ValueFunction};

/// One agent of a run: how it learns, what it predicts, and what it starts from.
#[derive(Clone, Copy, Debug)]
pub struct Learner<'a> {
    /// Its hyperparameters.
    pub config: &'a AgentConfig,
    /// The state column whose discounted sum it predicts.
    pub cumulant: usize,
    /// What it starts from; `None` draws initial parameters from the run's seed.
    pub start: Option<&'a Checkpoint>,
}

/// A value function as training left it, for other training to start from.
#[derive(Clone, Debug, PartialEq)]
pub struct Checkpoint {
    /// Weights and biases, layer by layer in the order of [`calib_nn::Mlp`]; a linear value function is
    /// a network without hidden layers.
    pub parameters: Vec<f32>,
    /// Adam's moments, to go on with; with `None` they start from zero.
    pub moments: Option<Moments>,
}

/// Sizes of the layers of an agent's value function that sees `width` values
/// ([`AgentConfig::seen_width`]), input first, the single
/// output last.
pub fn layer_sizes(config: &AgentConfig, width: usize) -> Vec<usize> {
    let hidden = match config.value_function {
        ValueFunction::Mlp => vec![config.hidden_units; config.hidden_layers],
        ValueFunction::Linear => vec![],
    };
    [vec![width], hidden, vec![1]].concat()
}

/// Number of weights and biases of that value function.
pub fn parameter_count(config: &AgentConfig, width: usize) -> usize {
    layer_sizes(config, width).windows(2).map(|pair| (pair[0] + 1) * pair[1]).sum()
}

impl Learner<'_> {
    /// Check the hyperparameters, and that the checkpoint fits them.
    pub(crate) fn check(&self, width: usize) -> Result<(), AgentError> {
        self.config.check()?;
        let Some(start) = self.start else { return Ok(()) };
        let expected = parameter_count(self.config, self.config.seen_width(width));
        let moments = start.moments.as_ref().map_or(expected, |moments| moments.mean.len());
        match [start.parameters.len(), moments].into_iter().find(|&got| got != expected) {
            Some(got) => Err(AgentError::Checkpoint { got, expected }),
            None => Ok(()),
        }
    }

    /// Whether updates can change its parameters.
    pub(crate) fn learns(&self) -> bool {
        self.config.learning_rate > 0.0
    }

    /// What an update costs, in multiplications of the matrix products: forward for s and s', backward for the
    /// weights and for the layer before. An update counts as at least a million, which small agents spend
    /// on gathering and bookkeeping.
    pub fn work_per_update(&self, width: usize) -> u64 {
        let parameters = parameter_count(self.config, self.config.seen_width(width)) as u64;
        let transitions = self.config.transitions_per_update() as u64;
        parameters.saturating_mul(transitions).saturating_mul(4).max(1_000_000)
    }

    /// What a step costs; see [`work_per_update`](Self::work_per_update).
    pub fn work_per_step(&self, width: usize) -> u64 {
        self.work_per_update(width).saturating_mul(self.config.updates_per_step as u64)
    }
}

/// The distinct columns that learners predict, and which of them each learner predicts.
#[derive(Clone, Debug)]
pub(crate) struct Cumulants {
    pub(crate) columns: Vec<usize>,
    pub(crate) of: Vec<usize>,
}

impl Cumulants {
    pub(crate) fn new(learners: &[Learner<'_>]) -> Self {
        let mut columns: Vec<usize> = vec![];
        let of = learners.iter().map(|learner| {
            let known = columns.iter().position(|&column| column == learner.cumulant);
            known.unwrap_or_else(|| {
                columns.push(learner.cumulant);
                columns.len() - 1
            })
        });
        let of = of.collect();
        Self { columns, of }
    }
}
