//! One step in a model: from the state of a rollout, with an action, to the next state of a recorded transition.

use calib_core::{Rng, RowIndex, TransitionIndex};

use super::{ActionModel, At, Covered, Pessimism, Rules, Step, Target};
use crate::Ending;

/// The most neighbours that a step searches for.
pub(super) const MOST_LIVE: usize = 64;

/// The candidates of a step, and the rules for drawing one.
pub(super) struct Draw<'a> {
    /// Transitions, nearest first.
    pub(super) neighbors: &'a [u32],
    /// Their distances.
    pub(super) distances: &'a [f32],
    /// The distance up to which the log covers the step.
    pub(super) radius: f32,
    /// The rules for steps beyond the radius.
    pub(super) rules: Rules,
}

impl ActionModel {
    /// Takes a step in ensemble member `member` from `at`.
    ///
    /// # Panics
    /// If there is no such member or action, or settings are given although actions are not continuous.
    pub fn step(
        &self,
        member: usize,
        at: At,
        target: Target<'_>,
        rules: Rules,
        rng: &mut Rng,
    ) -> Step {
        let mut found;
        let (neighbors, distances) = match target {
            Target::Level(action) => {
                let (tables, row) = match at {
                    At::Start(start) => (&self.start_tables, start),
                    At::After(transition) => (&self.tables, transition),
                };
                tables[member].list(row as usize, action)
            }
            Target::Set(set) => {
                found = Nearest::new(self.k().min(MOST_LIVE));
                self.search(member, at, set, &mut found);
                found.lists()
            }
        };
        self.drawn(&Draw { neighbors, distances, radius: self.radius, rules }, rng)
    }

    pub(super) fn drawn(&self, draw: &Draw<'_>, rng: &mut Rng) -> Step {
        let Draw { neighbors, distances, radius, rules } = *draw;
        let nearest = distances.first().copied().unwrap_or(f32::INFINITY);
        let covered = if neighbors.is_empty() {
            Covered::Missing
        } else if nearest > radius {
            Covered::Far
        } else {
            Covered::Near
        };
        let ends_far = covered == Covered::Far && rules.pessimism == Pessimism::MinimumReturn;
        if covered == Covered::Missing || ends_far {
            let reward = rules.worst_return;
            let ending = Ending::Terminal;
            return Step { drawn: None, reward, ending, covered, distance: nearest };
        }
        let place = self.weights.draw(distances, rng);
        let transition = TransitionIndex(neighbors[place]);
        Step {
            drawn: Some(transition),
            reward: f64::from(self.log.rewards()[transition.get()]),
            ending: self.log.endings()[transition.get()],
            covered,
            distance: distances[place],
        }
    }

    /// Returns the observation at a place.
    pub fn observed(&self, at: At) -> &[f32] {
        match at {
            At::Start(start) => self.starts.observed.row(start as usize),
            At::After(transition) => self.log.states().row(self.led_to(transition).get()),
        }
    }

    /// Adds to each column of `sum` the jump of a step: the source of the drawn transition minus the state before.
    pub(crate) fn add_displacement(&self, at: At, drawn: TransitionIndex, sum: &mut [f32]) {
        let source = self.log.states().row(self.log.transitions().source(drawn).get());
        for ((sum, there), here) in sum.iter_mut().zip(source).zip(self.observed(at)) {
            *sum += there - here;
        }
    }

    /// Returns the row that a transition led to.
    pub fn led_to(&self, transition: u32) -> RowIndex {
        self.log.transitions().next(TransitionIndex(transition))
    }

    /// Finds the transitions of a member that are nearest to a place and to the settings, by a scan over all of them.
    fn search(&self, member: usize, at: At, set: &[f32], found: &mut Nearest) {
        let Some(settings) = self.log.settings() else {
            unreachable!("settings are only taken where actions are numbers");
        };
        let here = match at {
            At::Start(start) => self.starts.metric.row(start as usize),
            At::After(transition) => self.metric.row(self.led_to(transition).get()),
        };
        let weight = (self.action_weight * self.action_weight) as f32;
        let sources = self.log.transitions().sources();
        for transition in self.blocks.transitions_of(member) {
            let row = sources[transition.get()] as usize;
            let set = squared(set, settings.of_row(row));
            let distance = squared(here, self.metric.row(row)) + weight * set;
            found.offer(transition.0, distance);
        }
    }
}

/// Returns the squared distance between two points.
pub(super) fn squared(one: &[f32], other: &[f32]) -> f32 {
    one.iter().zip(other).map(|(one, other)| (one - other) * (one - other)).sum()
}

/// The nearest transitions so far, by squared distance and then by number.
pub(super) struct Nearest {
    wanted: usize,
    there: usize,
    transitions: [u32; MOST_LIVE],
    distances: [f32; MOST_LIVE],
}

impl Nearest {
    pub(super) fn new(wanted: usize) -> Self {
        Self {
            wanted,
            there: 0,
            transitions: [u32::MAX; MOST_LIVE],
            distances: [f32::INFINITY; MOST_LIVE],
        }
    }

    /// Offers a transition. They must come in ascending order, so that the first of equally near ones stays in front.
    pub(super) fn offer(&mut self, transition: u32, squared: f32) {
        if self.there == self.wanted && squared >= self.distances[self.there - 1] {
            return;
        }
        self.there = self.wanted.min(self.there + 1);
        let mut place = self.there - 1;
        while place > 0 && squared < self.distances[place - 1] {
            self.distances[place] = self.distances[place - 1];
            self.transitions[place] = self.transitions[place - 1];
            place -= 1;
        }
        self.distances[place] = squared;
        self.transitions[place] = transition;
    }

    /// Returns the numbers of the transitions, and their distances.
    pub(super) fn lists(&mut self) -> (&[u32], &[f32]) {
        let distances = &mut self.distances[..self.there];
        for squared in distances.iter_mut() {
            *squared = squared.sqrt();
        }
        (&self.transitions[..self.there], distances)
    }
}
