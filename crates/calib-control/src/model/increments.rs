//! Models that add the recorded change of a neighbour to the state, instead of moving to its recorded
//! next state.

use calib_core::{Monitor, Rng, States, TransitionIndex};
use calib_knn::{Blocks, Sources};

use super::draw::{Draw, MOST_LIVE, Nearest, squared};
use super::{
    ActionModel, ActionModelKind, Coverage, Ensemble, ModelEnvironment, Rules, Step, Target,
    radius::Outside,
};
use crate::{ControlError, Decisions, Environment, Outcome};

/// The most transitions that decide which columns keep their offset. More change little.
const MOST_COMPARED: usize = 4_000;

/// The data that a rollout by recorded changes needs beside the model of the same log.
///
/// A step from state s draws one of the k transitions with the action whose sources `s_j` are nearest in
/// the scaled states. It leads to s plus the recorded change, `s + (s'_j − s_j)`, cut to the range of the
/// log. This is the locally incremental analog operator of Lguensat et al. (2017). Reward and ending are
/// those of the transition.
///
/// A smooth column keeps its offset from the neighbour from one step to the next, and a noisy one forgets
/// it. So increments move a column only where they predict better than the recorded next value, over the log
/// and the nearest neighbours in other blocks. Other columns take the recorded next value, as in
/// [`ActionModel`]. A share of the offset between all and nothing, fitted by least squares, chose worse: an
/// error of 3 % in it forgets the offset within some thirty steps.
///
/// Such a rollout leaves recorded rows, but never the range of a column.
#[derive(Clone, Debug)]
pub struct Increments {
    /// Whether each column keeps its offset from the neighbour.
    keeps: Vec<bool>,
    /// Least and largest recorded value of each column.
    extremes: [Vec<f32>; 2],
    /// One group per action, or a single group of all transitions if actions are continuous.
    groups: Vec<ActionSources>,
    /// Radius of coverage, as in the model, but measured in the scaled states.
    radius: f32,
}

/// The sources of a group of transitions, contiguous in memory.
#[derive(Clone, Debug)]
struct ActionSources {
    /// Shape `[transitions, columns]`.
    points: Vec<f32>,
    columns: usize,
    /// Numbers of the transitions, ascending.
    transitions: Vec<u32>,
}

impl ActionSources {
    fn new(points: &States, transitions: Vec<u32>, log: &Decisions) -> Self {
        let sources = log.transitions().sources();
        let rows = transitions.iter().map(|&number| points.row(sources[number as usize] as usize));
        Self { points: rows.flatten().copied().collect(), columns: points.columns(), transitions }
    }

    /// Offers the transitions of `member` to `found`, which keeps those nearest to `here`.
    fn search(&self, here: &[f32], blocks: &Blocks, member: usize, found: &mut Nearest) {
        let dropped = blocks.dropped(member);
        let from = self.transitions.partition_point(|&number| number < dropped.start);
        let to = self.transitions.partition_point(|&number| number < dropped.end);
        for range in [0..from, to..self.transitions.len()] {
            let points = self.points[range.start * self.columns..range.end * self.columns]
                .chunks_exact(self.columns);
            for (point, &transition) in points.zip(&self.transitions[range]) {
                found.offer(transition, squared(point, here));
            }
        }
    }
}

impl Increments {
    /// Decides by the log of `model` which columns increments move. `coverage` is the value in the
    /// model's configuration.
    ///
    /// # Errors
    /// If the monitor interrupts.
    pub fn new(
        model: &ActionModel,
        coverage: f64,
        monitor: &dyn Monitor,
    ) -> Result<Self, ControlError> {
        let log = model.log();
        let states = log.states();
        let (groups, radius) = match log.settings() {
            None => {
                let sources = Sources::new(states, log.transitions(), model.blocks())?;
                let radius = Outside::all(sources, Some(log), monitor)?.radius(coverage)?;
                let groups = (0..log.levels())
                    .map(|action| ActionSources::new(states, log.with_action(action), log));
                (groups.collect(), radius)
            }
            Some(settings) => {
                let taken = settings.taken(states, model.action_weight)?;
                let sources = Sources::new(&taken, log.transitions(), model.blocks())?;
                let all: Vec<u32> = (0..log.len() as u32).collect();
                let radius = Outside::all(sources, None, monitor)?.radius(coverage)?;
                (vec![ActionSources::new(&taken, all, log)], radius)
            }
        };
        let mut increments = Self {
            keeps: vec![false; states.columns()],
            extremes: states.extremes(),
            groups,
            radius,
        };
        increments.keeps = increments.compared(model);
        Ok(increments)
    }

    /// Returns for each column whether increments move it; otherwise it takes the recorded next value.
    pub fn keeps(&self) -> &[bool] {
        &self.keeps
    }

    /// Returns for each column whether increments predict better, over transitions and their nearest
    /// neighbours in other blocks.
    fn compared(&self, model: &ActionModel) -> Vec<bool> {
        let log = model.log();
        let blocks = model.blocks();
        let count = log.len().min(MOST_COMPARED);
        let columns = self.keeps.len();
        let mut gains = vec![0.0_f64; columns];
        let mut query = Vec::new();
        for number in 0..count {
            let transition = TransitionIndex::new(number * log.len() / count);
            let [source, next] = log.ends(transition);
            let action = usize::from(log.actions()[transition.get()]);
            let member = blocks.block_of(transition);
            let mut found = Nearest::new(1);
            let target = Target::Level(action);
            self.nearest((model, member), source, target, &mut query, &mut found);
            let (&[nearest], _) = found.lists() else { continue };
            let [other, other_next] = log.ends(TransitionIndex(nearest));
            for column in 0..columns {
                let offset = f64::from(source[column] - other[column]);
                let missed = f64::from(next[column] - other_next[column]);
                gains[column] += missed.powi(2) - (missed - offset).powi(2);
            }
        }
        gains.into_iter().map(|gain| gain > 0.0).collect()
    }

    /// Finds the transitions of `member` that are nearest to `target` in `state`. `query` is a buffer.
    fn nearest(
        &self,
        (model, member): (&ActionModel, usize),
        state: &[f32],
        target: Target<'_>,
        query: &mut Vec<f32>,
        found: &mut Nearest,
    ) {
        let blocks = model.blocks();
        let set = match (target, model.log().settings()) {
            (Target::Level(action), None) => {
                return self.groups[action].search(state, blocks, member, found);
            }
            (Target::Level(action), Some(settings)) => settings.of_level(action),
            (Target::Set(set), _) => set,
        };
        query.clear();
        query.extend_from_slice(state);
        let weight = model.action_weight;
        query.extend(set.iter().map(|&set| (weight * f64::from(set)) as f32));
        self.groups[0].search(query, blocks, member, found);
    }

    /// Takes a step in an ensemble member of the model. `state` becomes the next state, unless the episode
    /// ends because the log does not cover the step. `query` is a buffer.
    ///
    /// # Panics
    /// If there is no such member or action, or settings are given although actions are not continuous.
    pub fn step(
        &self,
        (model, member): (&ActionModel, usize),
        target: Target<'_>,
        rules: Rules,
        query: &mut Vec<f32>,
        rng: &mut Rng,
        state: &mut [f32],
    ) -> Step {
        let mut found = Nearest::new(model.k().min(MOST_LIVE));
        self.nearest((model, member), state, target, query, &mut found);
        let (neighbors, distances) = found.lists();
        let draw = Draw { neighbors, distances, radius: self.radius, rules };
        let step = model.drawn(&draw, rng);
        if let Some(drawn) = step.drawn {
            let [source, next] = model.log().ends(drawn);
            let [lowest, highest] = &self.extremes;
            for (column, value) in state.iter_mut().enumerate() {
                let offset = if self.keeps[column] { *value - source[column] } else { 0.0 };
                *value = (next[column] + offset).clamp(lowest[column], highest[column]);
            }
        }
        step
    }
}

/// The ensemble members of a model, whose rollouts add recorded changes.
#[derive(Clone, Copy, Debug)]
pub struct IncrementModel<'m> {
    model: &'m ActionModel,
    increments: &'m Increments,
}

impl<'m> IncrementModel<'m> {
    /// Returns the model. `increments` must be those of `model`.
    pub fn new(model: &'m ActionModel, increments: &'m Increments) -> Self {
        Self { model, increments }
    }
}

impl Ensemble for IncrementModel<'_> {
    type Rollout<'a>
        = IncrementRollout<'a>
    where
        Self: 'a;

    fn kind(&self) -> ActionModelKind {
        ActionModelKind::Increments
    }

    fn members(&self) -> usize {
        self.model.members()
    }

    fn rollout(&self, member: usize) -> IncrementRollout<'_> {
        assert!(member < self.members(), "a member of the ensemble");
        IncrementRollout {
            model: self.model,
            increments: self.increments,
            member,
            query: Vec::new(),
            coverage: Coverage::default(),
        }
    }
}

/// An agent's rollout by recorded changes, in one ensemble member of a model.
#[derive(Clone, Debug)]
pub struct IncrementRollout<'a> {
    model: &'a ActionModel,
    increments: &'a Increments,
    member: usize,
    query: Vec<f32>,
    coverage: Coverage,
}

impl ModelEnvironment for IncrementRollout<'_> {
    fn coverage(&self) -> Coverage {
        self.coverage
    }
}

impl Environment for IncrementRollout<'_> {
    fn actions(&self) -> usize {
        self.model.log().levels()
    }

    fn columns(&self) -> usize {
        self.model.log().states().columns()
    }

    fn start(&mut self, rng: &mut Rng, state: &mut [f32]) {
        let starts = self.model.starts();
        state.copy_from_slice(starts.row(rng.below(starts.rows())));
    }

    fn step(&mut self, action: usize, rng: &mut Rng, state: &mut [f32]) -> Outcome {
        let member = (self.model, self.member);
        let rules = self.model.rules();
        let target = Target::Level(action);
        let step = self.increments.step(member, target, rules, &mut self.query, rng, state);
        self.coverage.count(step.covered);
        Outcome { reward: step.reward, ending: step.ending }
    }
}

#[cfg(test)]
mod tests;
