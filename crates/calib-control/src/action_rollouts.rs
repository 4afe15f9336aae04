//! Many rollouts through a model at once, for an environment of many agents, or of one agent in many places.

use std::sync::Arc;

use calib_core::{Rng, Seed};
use serde::{Deserialize, Serialize};

use crate::{
    ActionModel, At, Coverage, Covered, Drift, Ending, Increments, NetworkModel, NetworkWorkplace,
    Outcome, Rules, Step, Target,
};

/// The way in which a rollout takes a step.
#[derive(Clone, Debug, Default)]
pub enum StepModel {
    /// It moves to the recorded next state of a neighbour.
    #[default]
    Recorded,
    /// It adds the recorded change of a neighbour.
    Increments(Arc<Increments>),
    /// It moves to the prediction of a network; actions are levels.
    Network(Arc<NetworkModel>, Box<NetworkWorkplace>),
}

impl StepModel {
    /// Returns steps by these networks.
    pub fn by_network(networks: Arc<NetworkModel>) -> Self {
        let place = Box::new(networks.workplace());
        Self::Network(networks, place)
    }
}

/// Rollouts through ensemble members of a model, each with its own random numbers.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct ActionRollouts {
    /// The key is older than the name of the field, and pickled environments have it.
    #[serde(rename = "walks")]
    rollouts: Vec<ActionRollout>,
    columns: usize,
    /// Sum of the jumps in the present episode, from the rollout's state to the source of the drawn transition, `[rollouts, columns]`.
    displacements: Vec<f32>,
    /// The same sums over finished episodes.
    drift: Drift,
    /// The states of rollouts that leave recorded rows, `[rollouts, columns]`; empty for other rollouts.
    #[serde(default)]
    states: Vec<f32>,
    #[serde(skip)]
    step_model: StepModel,
}

/// One rollout.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct ActionRollout {
    /// The ensemble member.
    pub member: usize,
    /// The place of the rollout.
    pub at: At,
    /// Steps of the present episode.
    pub steps: u64,
    /// Whether the episode is over. The next step then begins another one.
    pub over: bool,
    /// Coverage of its steps so far.
    pub coverage: Coverage,
    rng: Rng,
}

/// The result of a rollout's last step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RolloutStep {
    /// The reward; 0 if an episode began.
    pub reward: f64,
    /// Whether the episode ended in a terminal.
    pub terminated: bool,
    /// Whether the episode was cut at the timeout.
    pub truncated: bool,
    /// Distance from the rollout's state to the source of the transition, in the model's metric.
    pub distance: f32,
    /// Whether the log covers the step.
    pub covered: bool,
}

impl RolloutStep {
    /// The result of a step that began an episode.
    pub const BEGAN: Self =
        Self { reward: 0.0, terminated: false, truncated: false, distance: 0.0, covered: true };
}

fn draws(seed: u64) -> Rng {
    Seed::new(seed).child("environment").rng()
}

impl ActionRollouts {
    /// Returns rollouts through these ensemble members of `model`, without an episode yet. Rollout i has the seed i.
    pub fn new(model: &ActionModel, members: &[usize]) -> Self {
        let columns = model.log().states().columns();
        let rollouts: Vec<ActionRollout> = members
            .iter()
            .enumerate()
            .map(|(number, &member)| ActionRollout {
                member,
                at: At::Start(0),
                steps: 0,
                over: true,
                coverage: Coverage::default(),
                rng: draws(number as u64),
            })
            .collect();
        let displacements = vec![0.0; rollouts.len() * columns];
        let drift = Drift::default();
        let states = Vec::new();
        Self { rollouts, columns, displacements, drift, states, step_model: StepModel::Recorded }
    }

    /// Returns the same rollouts with the steps of `step_model`, which must belong to the same model.
    #[must_use]
    pub fn with_step_model(self, step_model: StepModel) -> Self {
        let states = match step_model {
            StepModel::Recorded => Vec::new(),
            StepModel::Increments(_) | StepModel::Network(..) => {
                vec![0.0; self.displacements.len()]
            }
        };
        Self { states, step_model, ..self }
    }

    /// Returns the observation of rollout `number`.
    ///
    /// # Panics
    /// If there is no such rollout.
    pub fn observed<'a>(&'a self, model: &'a ActionModel, number: usize) -> &'a [f32] {
        if self.states.is_empty() {
            return model.observed(self.rollouts[number].at);
        }
        &self.states[number * self.columns..][..self.columns]
    }

    /// Returns the rollouts.
    pub fn all(&self) -> &[ActionRollout] {
        &self.rollouts
    }

    /// Returns the sum of the jumps in each present episode, from the rollout's state to the source of the drawn transition,
    /// `[rollouts, columns]`.
    pub fn displacements(&self) -> &[f32] {
        &self.displacements
    }

    /// Returns the coverage of all steps so far.
    pub fn coverage(&self) -> Coverage {
        self.rollouts.iter().fold(Coverage::default(), |all, rollout| all.and(rollout.coverage))
    }

    /// Returns how far jumps moved the finished episodes, or the unfinished ones if no episode is finished.
    pub fn drift(&self) -> Drift {
        let mut drift = self.drift.clone();
        if drift.episodes == 0 {
            let each = self.rollouts.iter().zip(self.displacements.chunks(self.columns.max(1)));
            each.filter(|(rollout, _)| rollout.steps > 0).for_each(|(_, moved)| drift.count(moved));
        }
        drift
    }

    /// Seeds the random numbers of rollout `number`.
    ///
    /// # Panics
    /// If there is no such rollout.
    pub fn seed(&mut self, number: usize, seed: u64) {
        self.rollouts[number].rng = draws(seed);
    }

    /// Returns these stored rollouts with the steps of `like`, or `None` if they cannot be rollouts through the
    /// same ensemble members of `model`.
    pub fn restored(self, model: &ActionModel, like: &Self) -> Option<Self> {
        self.fits(model, like).then(|| Self { step_model: like.step_model.clone(), ..self })
    }

    fn fits(&self, model: &ActionModel, like: &Self) -> bool {
        self.columns == like.columns
            && self.displacements.len() == like.displacements.len()
            && self.states.len() == like.states.len()
            && self.states.iter().all(|value| value.is_finite())
            && self.members().eq(like.members())
            && self.rollouts.iter().all(|rollout| match rollout.at {
                At::Start(start) => (start as usize) < model.starts().rows(),
                At::After(transition) => (transition as usize) < model.log().len(),
            })
    }

    /// Returns the ensemble member of each rollout.
    fn members(&self) -> impl Iterator<Item = usize> {
        self.rollouts.iter().map(|rollout| rollout.member)
    }

    /// Begins an episode of rollout `number`.
    ///
    /// # Panics
    /// If there is no such rollout.
    pub fn begin(&mut self, model: &ActionModel, number: usize) -> RolloutStep {
        let rollout = &mut self.rollouts[number];
        rollout.at = At::Start(rollout.rng.below(model.starts().rows()) as u32);
        (rollout.steps, rollout.over) = (0, false);
        let of_rollout = number * self.columns..(number + 1) * self.columns;
        self.displacements[of_rollout.clone()].fill(0.0);
        if !self.states.is_empty() {
            self.states[of_rollout].copy_from_slice(model.observed(rollout.at));
        }
        RolloutStep::BEGAN
    }

    /// Takes a step of rollout `number`. Its episode is cut after `timeout` steps. If its episode is over, the step begins another one.
    ///
    /// # Panics
    /// If there is no such rollout or action, or a network is given settings.
    pub fn step(
        &mut self,
        model: &ActionModel,
        number: usize,
        target: Target<'_>,
        rules: Rules,
        timeout: u64,
    ) -> RolloutStep {
        if self.rollouts[number].over {
            return self.begin(model, number);
        }
        let of_rollout = number * self.columns..(number + 1) * self.columns;
        let rollout = &mut self.rollouts[number];
        let Step { drawn, reward, ending, covered, distance } = match &mut self.step_model {
            StepModel::Recorded => {
                model.step(rollout.member, rollout.at, target, rules, &mut rollout.rng)
            }
            StepModel::Increments(increments) => {
                let state = &mut self.states[of_rollout.clone()];
                let member = (model, rollout.member);
                increments.step(member, target, rules, &mut Vec::new(), &mut rollout.rng, state)
            }
            StepModel::Network(networks, place) => {
                let Target::Level(action) = target else { panic!("a network knows levels alone") };
                let state = &mut self.states[of_rollout.clone()];
                let outcome = networks.step(rollout.member, action, place, state);
                let drawn = None;
                let covered = Covered::Near;
                let distance = 0.0;
                let Outcome { reward, ending } = outcome;
                Step { drawn, reward, ending, covered, distance }
            }
        };
        rollout.coverage.count(covered);
        if let Some(drawn) = drawn {
            if self.states.is_empty() {
                let displacement = &mut self.displacements[of_rollout.clone()];
                model.add_displacement(rollout.at, drawn, displacement);
            }
            rollout.at = At::After(drawn.0);
        }
        rollout.steps += 1;
        let terminated = ending == Ending::Terminal;
        let truncated = !terminated && timeout > 0 && rollout.steps >= timeout;
        rollout.over = terminated || truncated;
        if rollout.over {
            self.drift.count(&self.displacements[of_rollout]);
        }
        RolloutStep { reward, terminated, truncated, distance, covered: covered == Covered::Near }
    }
}

#[cfg(test)]
mod tests {
    use calib_core::{Segments, Silent, States};

    use super::*;
    use crate::{
        ActionModelConfig, Columns, Decisions, Ensemble as _, Environment as _, IncrementModel,
        Levels, ModelEnvironment as _, NetworkConfig, Pessimism, model::tests::built,
        open_action_model, write_action_model,
    };

    const CONFIG: ActionModelConfig = ActionModelConfig {
        neighbors: 3,
        members: 3,
        pessimism: Pessimism::Nearest,
        ..ActionModelConfig::DEFAULT
    };

    /// Returns the model of a tank whose level rises by the value that is set, in episodes of twenty rows.
    fn model(levels: Option<usize>) -> ActionModel {
        let mut rng = Seed::new(3).rng();
        let rows = 600;
        let mut level = 0.5_f64;
        let mut valve = Vec::new();
        let mut values = Vec::new();
        for _ in 0..rows {
            values.push(level as f32);
            let set = (rng.unit() * 4.0).floor() / 4.0;
            valve.push(set);
            level = (level + (set - 0.375) * 0.2).clamp(0.0, 1.0);
        }
        let (levels, settings) = match levels {
            None => (Levels::new(&[valve], 8).expect("four"), None),
            Some(levels) => {
                let (levels, settings) = Levels::of_range(&[valve], levels, 8).expect("levels");
                (levels, Some(settings))
            }
        };
        let endings: Vec<Ending> =
            values.iter().map(|&value| Ending::terminal_if(value > 0.95)).collect();
        let rewards: Vec<f32> = values.iter().map(|value| -(value - 0.6).abs()).collect();
        let columns = Columns { actions: &levels.of_rows, rewards: &rewards, endings: &endings };
        let states = States::new(values, rows, 1).expect("valid");
        let segments = Segments::from_lengths(vec![20; rows / 20]).expect("valid");
        let mut log =
            Decisions::new(states, &segments, columns, levels.values.len()).expect("a log");
        if let Some(settings) = settings {
            log = log.with_settings(settings).expect("as many");
        }
        built(log, 9, &CONFIG, -7.0)
    }

    #[test]
    fn a_rollout_among_others_is_as_alone() {
        let model = model(None);
        let mut rollouts = ActionRollouts::new(&model, &[1, 2]);
        rollouts.seed(0, 5);
        let mut rollout = model.rollout(1);
        let mut rng = draws(5);
        let mut state = [0.0];
        rollouts.begin(&model, 0);
        rollout.start(&mut rng, &mut state);
        for number in 0..500 {
            let action = number % 4;
            let went = rollouts.step(&model, 0, Target::Level(action), model.rules(), 30);
            let outcome = rollout.step(action, &mut rng, &mut state);
            assert_eq!(
                (went.reward, went.terminated),
                (outcome.reward, outcome.ending == Ending::Terminal)
            );
            assert_eq!(model.observed(rollouts.all()[0].at), state);
            if went.terminated || went.truncated {
                rollouts.begin(&model, 0);
                rollout.start(&mut rng, &mut state);
            }
        }
        assert_eq!(rollouts.all()[0].coverage, rollout.coverage());
        assert_eq!(rollouts.drift(), rollout.drift());
        assert!(rollout.drift().episodes > 10, "{:?}", rollout.drift());
        assert!(rollouts.all()[1].over, "the other one has not begun");
    }

    #[test]
    fn rollouts_by_increments_are_as_alone_and_are_restored() {
        let model = model(None);
        let increments = Arc::new(Increments::new(&model, 0.95, &Silent).expect("made"));
        let ensemble = IncrementModel::new(&model, &increments);
        let step_model = StepModel::Increments(Arc::clone(&increments));
        let unmoved = ActionRollouts::new(&model, &[1, 2]).with_step_model(step_model);
        let mut rollouts = unmoved.clone();
        rollouts.seed(0, 5);
        let mut rollout = ensemble.rollout(1);
        let mut rng = draws(5);
        let mut state = [0.0];
        rollouts.begin(&model, 0);
        rollout.start(&mut rng, &mut state);
        for number in 0..300 {
            let action = number % 4;
            let went = rollouts.step(&model, 0, Target::Level(action), model.rules(), 30);
            let outcome = rollout.step(action, &mut rng, &mut state);
            assert_eq!(went.reward, outcome.reward);
            assert_eq!(rollouts.observed(&model, 0), state);
            if went.terminated || went.truncated {
                rollouts.begin(&model, 0);
                rollout.start(&mut rng, &mut state);
            }
            if number == 150 {
                let stored = serde_json::to_string(&rollouts).expect("stored");
                let read: ActionRollouts = serde_json::from_str(&stored).expect("read");
                let recorded = ActionRollouts::new(&model, &[1, 2]);
                assert!(read.clone().restored(&model, &recorded).is_none());
                rollouts = read.restored(&model, &unmoved).expect("rollouts like these");
            }
        }
        assert_eq!(rollouts.all()[0].coverage, rollout.coverage());
        assert!(rollouts.drift().means().iter().all(|&moved| moved == [0.0, 0.0]), "no jumps");
    }

    #[test]
    fn rollouts_by_networks_are_as_alone() {
        let model = model(None);
        let config = NetworkConfig { members: 3, updates: 200, ..NetworkConfig::default() };
        let starts = model.starts().clone();
        let networks = NetworkModel::train(model.log(), starts, &config, Seed::new(4), &Silent)
            .expect("learned");
        let networks = Arc::new(networks);
        let step_model = StepModel::by_network(Arc::clone(&networks));
        let mut rollouts = ActionRollouts::new(&model, &[1, 2]).with_step_model(step_model);
        rollouts.seed(1, 5);
        let mut rollout = networks.rollout(2);
        let mut rng = draws(5);
        let mut state = [0.0];
        rollouts.begin(&model, 1);
        rollout.start(&mut rng, &mut state);
        for number in 0..20 {
            let went = rollouts.step(&model, 1, Target::Level(number % 4), model.rules(), 0);
            assert_eq!(went.reward, rollout.step(number % 4, &mut rng, &mut state).reward);
            assert_eq!(rollouts.observed(&model, 1), state);
            if went.terminated {
                break;
            }
        }
        assert_eq!(rollouts.all()[1].coverage, rollout.coverage());
    }

    #[test]
    fn jumps_and_transitions_together_are_the_way() {
        let model = model(None);
        let mut rollouts = ActionRollouts::new(&model, &[0]);
        rollouts.begin(&model, 0);
        let first = model.observed(rollouts.all()[0].at)[0];
        let mut moved = 0.0;
        loop {
            let went = rollouts.step(&model, 0, Target::Level(1), model.rules(), 12);
            let At::After(drawn) = rollouts.all()[0].at else { panic!("it went on") };
            let row = model.led_to(drawn).get();
            moved += model.log().states().row(row)[0] - model.log().states().row(row - 1)[0];
            if went.terminated || went.truncated {
                break;
            }
        }
        let last = model.observed(rollouts.all()[0].at)[0];
        assert!((first + moved + rollouts.displacements()[0] - last).abs() < 1e-5);
    }

    #[test]
    fn what_was_set_is_searched_for_as_the_tables_were() {
        let model = model(Some(4));
        let rules = model.rules();
        let mut rngs = [draws(1), draws(1)];
        for member in 0..3 {
            for number in 0..model.log().len() {
                let inside =
                    model.blocks().contains(member, calib_core::TransitionIndex::new(number));
                for level in (0..4).filter(|_| inside) {
                    let at = At::After(number as u32);
                    let set = model.log().settings().expect("set").of_level(level).to_vec();
                    let found = model.step(member, at, Target::Level(level), rules, &mut rngs[0]);
                    let live = model.step(member, at, Target::Set(&set), rules, &mut rngs[1]);
                    assert_eq!(found.drawn, live.drawn, "{member} {number} {level}");
                    assert!((found.distance - live.distance).abs() < 1e-6);
                }
            }
        }
    }

    /// Takes 900 steps of three rollouts. Returns their results and places, and the rollouts.
    fn way(model: &ActionModel) -> (Vec<(RolloutStep, At)>, ActionRollouts) {
        let mut rollouts = ActionRollouts::new(model, &[0, 1, 2]);
        let mut seen = Vec::new();
        for number in 0..900 {
            let target = Target::Level(number % 4);
            let went = rollouts.step(model, number % 3, target, model.rules(), 30);
            seen.push((went, rollouts.all()[number % 3].at));
        }
        (seen, rollouts)
    }

    #[test]
    fn a_model_that_was_stored_is_the_same() {
        for levels in [None, Some(4)] {
            let model = model(levels);
            let directory = tempfile::tempdir().expect("a folder");
            let (names, record) =
                write_action_model(directory.path(), &model, &CONFIG).expect("written");
            assert!(names.iter().all(|name| directory.path().join(name).exists()));
            let opened = open_action_model(directory.path(), &record).expect("opened");
            let (first, _) = way(&model);
            let (second, rollouts) = way(&opened);
            assert_eq!(first, second);
            let again = rollouts.clone().restored(&model, &ActionRollouts::new(&model, &[0, 1, 2]));
            assert!(again.is_some());
            assert!(rollouts.restored(&model, &ActionRollouts::new(&model, &[0, 1])).is_none());
            let short = vec![0.0_f32; 10];
            calib_files::write_npy(&directory.path().join("rewards.npy"), &short, 10, 1)
                .expect("written");
            let told = open_action_model(directory.path(), &record).expect_err("damaged");
            assert!(told.to_string().contains("rewards.npy"), "{told}");
        }
    }
}
