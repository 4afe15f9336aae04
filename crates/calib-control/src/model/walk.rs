use calib_core::{Rng, TransitionIndex};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{ActionModel, Pessimism, Walked};
use crate::{Ending, Environment, Outcome};

/// What the steps of a walk rested on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Coverage {
    /// Steps in all.
    pub steps: u64,
    /// Steps with an action that the member has no transition with.
    pub missing: u64,
    /// Steps whose nearest transition with the action is beyond the radius.
    pub far: u64,
}

impl Coverage {
    /// Share of the steps that the log does not cover; 0 of no steps.
    pub fn uncovered(&self) -> f64 {
        (self.missing + self.far) as f64 / self.steps.max(1) as f64
    }

    /// Both together.
    #[must_use]
    pub fn and(self, other: Self) -> Self {
        Self {
            steps: self.steps + other.steps,
            missing: self.missing + other.missing,
            far: self.far + other.far,
        }
    }
}

/// An agent's walk in one member of a model.
#[derive(Clone, Debug)]
pub struct Walk<'a> {
    model: &'a ActionModel,
    member: usize,
    at: At,
    coverage: Coverage,
}

#[derive(Clone, Copy, Debug)]
enum At {
    /// The start of this number.
    Start(usize),
    /// The next state of a transition.
    After(TransitionIndex),
}

impl<'a> Walk<'a> {
    pub(super) fn new(model: &'a ActionModel, member: usize) -> Self {
        Self { model, member, at: At::Start(0), coverage: Coverage::default() }
    }
}

impl Walked for Walk<'_> {
    fn coverage(&self) -> Coverage {
        self.coverage
    }
}

impl Environment for Walk<'_> {
    fn actions(&self) -> usize {
        self.model.log.levels()
    }

    fn columns(&self) -> usize {
        self.model.log.states().columns()
    }

    fn start(&mut self, rng: &mut Rng, state: &mut [f32]) {
        let start = rng.below(self.model.starts.rows());
        self.at = At::Start(start);
        state.copy_from_slice(self.model.starts.row(start));
    }

    fn step(&mut self, action: usize, rng: &mut Rng, state: &mut [f32]) -> Outcome {
        let model = self.model;
        let (neighbors, distances) = match self.at {
            At::Start(start) => model.start_tables[self.member].of(start, action),
            At::After(transition) => model.tables[self.member].of(transition.get(), action),
        };
        self.coverage.steps += 1;
        let far = distances.first().is_some_and(|&nearest| nearest > model.radius);
        self.coverage.far += u64::from(far);
        if neighbors.is_empty() || (far && model.pessimism == Pessimism::MinimumReturn) {
            self.coverage.missing += u64::from(neighbors.is_empty());
            return Outcome { reward: model.worst_return, ending: Ending::Terminal };
        }
        let drawn = neighbors[model.weights.draw(distances, rng)];
        let transition = TransitionIndex(drawn);
        self.at = At::After(transition);
        let next = model.log.transitions().next(transition);
        state.copy_from_slice(model.log.states().row(next.get()));
        let reward = f64::from(model.log.rewards()[transition.get()]);
        Outcome { reward, ending: model.log.endings()[transition.get()] }
    }
}
