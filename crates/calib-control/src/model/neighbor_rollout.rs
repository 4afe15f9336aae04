use calib_core::Rng;

use super::{ActionModel, ActionModelKind, At, Coverage, Ensemble, ModelEnvironment, Target};
use crate::{Drift, Environment, Outcome};

/// An agent's rollout in one ensemble member of a model.
#[derive(Clone, Debug)]
pub struct NeighborRollout<'a> {
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

impl<'a> NeighborRollout<'a> {
    fn new(model: &'a ActionModel, member: usize) -> Self {
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

impl Ensemble for ActionModel {
    type Rollout<'a> = NeighborRollout<'a>;

    fn kind(&self) -> ActionModelKind {
        ActionModelKind::Neighbors
    }

    fn members(&self) -> usize {
        self.tables.len()
    }

    fn rollout(&self, member: usize) -> NeighborRollout<'_> {
        assert!(member < self.members(), "a member of the ensemble");
        NeighborRollout::new(self, member)
    }
}

impl ModelEnvironment for NeighborRollout<'_> {
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

impl Environment for NeighborRollout<'_> {
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
