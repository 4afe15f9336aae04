use calib_core::Rng;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{ActionModel, At, Covered, ModelEnvironment, Target};
use crate::{Drift, Environment, Outcome};

/// Coverage of the steps of a rollout by recorded transitions.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Coverage {
    /// Number of steps.
    pub steps: u64,
    /// Steps with an action that occurs in no transition of the ensemble member.
    pub missing: u64,
    /// Steps whose nearest transition with the action is beyond the radius.
    pub far: u64,
}

impl Coverage {
    /// Returns the share of the steps that the log does not cover; 0
    /// without steps.
    pub fn uncovered(&self) -> f64 {
        (self.missing + self.far) as f64 / self.steps.max(1) as f64
    }

    /// Returns the sum of both.
    #[must_use]
    pub fn and(self, other: Self) -> Self {
        Self {
            steps: self.steps + other.steps,
            missing: self.missing + other.missing,
            far: self.far + other.far,
        }
    }

    /// Counts a step.
    pub(crate) fn count(&mut self, covered: Covered) {
        self.steps += 1;
        self.missing += u64::from(covered == Covered::Missing);
        self.far += u64::from(covered == Covered::Far);
    }
}

/// An agent's rollout in one ensemble member of a model.
#[derive(Clone, Debug)]
pub struct Walk<'a> {
    model: &'a ActionModel,
    member: usize,
    at: At,
    coverage: Coverage,
    /// Sum of the jumps of the present episode, `[columns]`.
    displacement: Vec<f32>,
    /// Whether the episode has a step.
    is_begun: bool,
    /// Drift of the episodes before it.
    drift: Drift,
}

impl<'a> Walk<'a> {
    pub(super) fn new(model: &'a ActionModel, member: usize) -> Self {
        Self {
            model,
            member,
            at: At::Start(0),
            coverage: Coverage::default(),
            displacement: vec![0.0; model.log.states().columns()],
            is_begun: false,
            drift: Drift::default(),
        }
    }
}

impl ModelEnvironment for Walk<'_> {
    fn coverage(&self) -> Coverage {
        self.coverage
    }

    fn drift(&self) -> Drift {
        let mut drift = self.drift.clone();
        if drift.episodes == 0 && self.is_begun {
            drift.count(&self.displacement);
        }
        drift
    }

    fn place(&self) -> Option<At> {
        Some(self.at)
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
        if self.is_begun {
            self.drift.count(&self.displacement);
            self.displacement.fill(0.0);
            self.is_begun = false;
        }
        let start = rng.below(self.model.starts().rows());
        self.at = At::Start(start as u32);
        state.copy_from_slice(self.model.observed(self.at));
    }

    fn step(&mut self, action: usize, rng: &mut Rng, state: &mut [f32]) -> Outcome {
        let rules = self.model.rules;
        let step = self.model.step(self.member, self.at, Target::Level(action), rules, rng);
        self.coverage.count(step.covered);
        self.is_begun = true;
        if let Some(drawn) = step.drawn {
            self.model.add_displacement(self.at, drawn, &mut self.displacement);
            self.at = At::After(drawn.0);
            state.copy_from_slice(self.model.observed(self.at));
        }
        Outcome { reward: step.reward, ending: step.ending }
    }
}
