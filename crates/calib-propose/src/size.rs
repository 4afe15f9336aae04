use calib_sweep::{Span, Windows};

use crate::{Horizon, ProposedAgent, ProposedModel};

/// Share of the given time that calib plans to use, because the machine may have other work.
pub(crate) const PLANNED: f64 = 0.85;
/// Most runs of one kind: further runs hardly narrow an interval.
pub const MOST_RUNS: usize = 30;
/// Most steps of a run when agents are compared.
const COMPARED_STEPS: usize = 2_000;
/// Relative cost of a network with half as many units.
const SMALLER: f64 = 0.6;
/// Length of the held-out period, in windows, for four windows side by side. It includes the states at the end of each window
/// that have no whole return.
const WINDOWS: f64 = 4.5;
/// Length of the held-out period, in windows, for two windows, where four would be too short.
const FEW_WINDOWS: f64 = 2.25;
/// Proposed `sweep.online_windows`, the default.
pub const MOST_WINDOWS: usize = 8;
/// Fewest effective horizons per window if there are four: docs/how-much-log.md has the reason.
const LEAST_HORIZONS: f64 = 50.0;
/// Fewest steps of a run.
pub(crate) const LEAST_STEPS: usize = 200;

/// Size of a sweep: the length and number of training runs, and the number of settings.
#[derive(Clone, Debug, PartialEq)]
pub struct Size {
    /// `sweep.steps`.
    pub steps: usize,
    /// The agent.
    pub agent: ProposedAgent,
    /// The model in which agents are also trained, if any.
    pub model: ProposedModel,
    /// Learning rates per decade: 1, 2 or 3.
    pub per_decade: usize,
    /// `agent.hidden_units` of each of the two layers, for a network.
    pub hidden_units: usize,
    /// Number of the proposed sensors that are used.
    pub sensors: usize,
    /// `sweep.online_runs`.
    pub online_runs: usize,
    /// `sweep.member_runs`; 0 without a model.
    pub member_runs: usize,
    /// `sweep.log_replay_runs`.
    pub log_replay_runs: usize,
}

/// Measured costs in seconds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Costs {
    /// Time that does not depend on the size of the sweep: reading, the model and its rollouts if there is one, and the report.
    pub fixed_secs: f64,
    /// Time of one step of one agent, over all threads together. A network has 2 x 64 hidden units.
    pub agent_step_secs: f64,
    /// Time to fit the starting point of the agents for one run of log replay, over all threads together. It is fitted on the
    /// rest of the log.
    pub replay_run_secs: f64,
}

impl Size {
    /// Returns the most steps of a run for which four windows fit in the held-out period. Returns the most for two windows if a
    /// window of four would have fewer than fifty horizons of `horizon_states` states.
    pub fn most_steps(held_out_states: usize, horizon_states: f64) -> usize {
        let states = held_out_states as f64;
        let of_four = states / WINDOWS;
        let has_four = of_four >= (LEAST_HORIZONS * horizon_states).max(LEAST_STEPS as f64);
        let steps = if has_four { of_four } else { states / FEW_WINDOWS };
        (steps as usize).max(LEAST_STEPS.min(held_out_states.saturating_sub(2)))
    }

    /// Returns the held-out states for four windows of fifty such horizons each.
    pub fn states_of_four_windows(horizon_states: f64) -> f64 {
        WINDOWS * (LEAST_HORIZONS * horizon_states).max(LEAST_STEPS as f64)
    }

    /// Returns the longest horizon, in states, of which each of four windows has fifty. `None` if even four windows of the shortest
    /// runs do not fit in `held_out_states`.
    pub fn longest_horizon_of_four_windows(held_out_states: usize) -> Option<f64> {
        let steps = held_out_states as f64 / WINDOWS;
        (steps >= LEAST_STEPS as f64).then_some(steps / LEAST_HORIZONS)
    }

    /// Returns the size for measuring costs: one run of each kind.
    pub fn trial(agent: ProposedAgent, model: ProposedModel, steps: usize, sensors: usize) -> Self {
        Self {
            agent,
            model,
            steps,
            sensors,
            per_decade: 2,
            hidden_units: 64,
            online_runs: 1,
            member_runs: model.runs(1),
            log_replay_runs: 1,
        }
    }

    /// Returns the size for comparing agents before one is proposed.
    pub fn comparison(
        agent: ProposedAgent,
        model: ProposedModel,
        steps: usize,
        sensors: usize,
    ) -> Self {
        Self {
            per_decade: 1,
            hidden_units: 32,
            online_runs: 4,
            log_replay_runs: 4,
            ..Self::trial(agent, model, steps.min(COMPARED_STEPS), sensors)
        }
    }

    /// Returns the smallest meaningful size, for runs of at most `most_steps` and for `sensors` sensors.
    pub fn smallest(
        agent: ProposedAgent,
        model: ProposedModel,
        most_steps: usize,
        sensors: usize,
    ) -> Self {
        let [smallest, ..] = Self::levels(agent, model, most_steps, sensors);
        smallest
    }

    /// Returns the sizes from the smallest meaningful one to that of the paper.
    fn levels(
        agent: ProposedAgent,
        model: ProposedModel,
        most_steps: usize,
        most_sensors: usize,
    ) -> [Self; 7] {
        let level =
            |steps: usize, per_decade, hidden_units, sensors: usize, runs: [usize; 3]| Self {
                agent,
                model,
                steps: steps.min(most_steps).max(LEAST_STEPS.min(most_steps)),
                per_decade,
                hidden_units,
                sensors: sensors.min(most_sensors),
                online_runs: runs[0],
                member_runs: model.runs(runs[1]),
                log_replay_runs: runs[2],
            };
        [
            level(600, 1, 32, 1, [4, 1, 4]),
            level(1_000, 1, 32, 2, [4, 1, 4]),
            level(1_500, 2, 32, 3, [4, 1, 4]),
            level(2_000, 2, 64, 3, [8, 1, 8]),
            level(3_000, 2, 64, 3, [8, 2, 8]),
            level(6_000, 2, 64, 3, [8, 2, 8]),
            level(10_000, 3, 64, 3, [16, 4, 16]),
        ]
    }

    /// Returns the largest size that ends in `within_secs`, for runs of at most `most_steps` and for `sensors` sensors. Returns the
    /// smallest size if none ends in time.
    pub fn within(
        agent: ProposedAgent,
        model: ProposedModel,
        within_secs: f64,
        costs: Costs,
        most_steps: usize,
        sensors: usize,
    ) -> Self {
        let planned = PLANNED * within_secs;
        let [smallest, larger @ ..] = Self::levels(agent, model, most_steps, sensors);
        let fitting = larger.into_iter().rfind(|level| level.secs(costs) <= planned);
        let largest = fitting.unwrap_or(smallest);
        let swept = largest.secs(costs) - costs.fixed_secs;
        let stretch = ((planned - costs.fixed_secs) / swept).max(1.0);
        Self {
            online_runs: stretched(largest.online_runs, stretch),
            member_runs: stretched(largest.member_runs, stretch),
            log_replay_runs: stretched(largest.log_replay_runs, stretch),
            ..largest
        }
        .filled(planned, costs)
    }

    /// Adds runs in the remaining time: one of each kind in turn, as long as the sweep ends in `planned_secs`.
    fn filled(mut self, planned_secs: f64, costs: Costs) -> Self {
        let kinds: [fn(&mut Self) -> &mut usize; 3] = [
            |size| &mut size.member_runs,
            |size| &mut size.online_runs,
            |size| &mut size.log_replay_runs,
        ];
        loop {
            let before = self.clone();
            for runs in kinds {
                let mut more = self.clone();
                if *runs(&mut more) == 0 {
                    continue;
                }
                *runs(&mut more) += 1;
                if *runs(&mut more) <= MOST_RUNS && more.secs(costs) <= planned_secs {
                    self = more;
                }
            }
            if self == before {
                return self;
            }
        }
    }

    /// Returns the learning rates of the study: 0, which keeps the agent's starting point, and round numbers.
    pub fn learning_rates(&self) -> Vec<String> {
        let digits: &[u8] = match self.per_decade {
            0 | 1 => &[1],
            2 => &[1, 3],
            _ => &[1, 2, 5],
        };
        // SwiftTD adapts its step sizes and bounds them, so these are only their initial values.
        let [first, last]: [i32; 2] = match self.agent {
            ProposedAgent::Linear => [-5, -1],
            ProposedAgent::Network => [-6, -2],
        };
        let decades =
            (first..last).flat_map(|decade| digits.iter().map(move |digit| (digit, decade)));
        let rates = decades.chain([(&1, last)]).map(|(digit, decade)| format!("{digit}e{decade}"));
        ["0".to_owned()].into_iter().chain(rates).collect()
    }

    /// Returns the number of learning rates.
    pub fn values(&self) -> usize {
        self.learning_rates().len()
    }

    /// Counts the windows of a sweep of this size with this horizon, for held-out states without a gap.
    pub fn windows(&self, held_out_states: usize, horizon: Horizon) -> usize {
        let span = Span::new(self.steps, [horizon.gamma]);
        Windows::side_by_side(held_out_states, span, MOST_WINDOWS.min(self.online_runs))
    }

    /// Returns the number of steps of all agents together.
    pub fn agent_steps(&self) -> f64 {
        let in_model = self.model.members() * self.member_runs;
        let runs = self.online_runs + in_model + self.log_replay_runs;
        (runs * self.steps * self.values() * self.sensors) as f64
    }

    /// Estimates the duration in seconds.
    pub fn secs(&self, costs: Costs) -> f64 {
        let is_smaller = self.agent == ProposedAgent::Network && self.hidden_units < 64;
        let smaller = if is_smaller { SMALLER } else { 1.0 };
        let fitted = self.log_replay_runs as f64 * costs.replay_run_secs;
        costs.fixed_secs + fitted + self.agent_steps() * costs.agent_step_secs * smaller
    }
}

/// Returns `stretch` times as many runs, but not more than calib proposes at most.
fn stretched(runs: usize, stretch: f64) -> usize {
    ((runs as f64 * stretch) as usize).clamp(runs, MOST_RUNS)
}

#[cfg(test)]
mod tests {
    use super::*;

    const COSTS: Costs = Costs { fixed_secs: 20.0, agent_step_secs: 20e-6, replay_run_secs: 0.0 };
    const NETWORK: ProposedAgent = ProposedAgent::Network;
    const ENSEMBLE: ProposedModel = ProposedModel::Ensemble;

    /// Counts the steps of all runs on the log.
    fn replayed(size: &Size) -> usize {
        size.log_replay_runs * size.steps * size.sensors
    }

    #[test]
    fn the_time_of_a_model_goes_to_more_runs() {
        let mut before = 0.0;
        for within in [60.0, 120.0, 300.0, 600.0] {
            let [with, without] = [ENSEMBLE, ProposedModel::None]
                .map(|model| Size::within(NETWORK, model, within, COSTS, 10_000, 3));
            assert_eq!(without.member_runs, 0);
            let secs = without.secs(COSTS);
            assert!(secs <= PLANNED * within && secs >= before, "{within}: {secs} {without:?}");
            assert!(replayed(&without) > replayed(&with), "{within}: {without:?}, {with:?}");
            before = secs;
        }
    }

    #[test]
    fn more_time_is_used_for_more_and_never_exceeded() {
        let mut before = 0.0;
        for within in [60.0, 120.0, 300.0, 600.0, 1_800.0] {
            let size = Size::within(NETWORK, ENSEMBLE, within, COSTS, 10_000, 3);
            let secs = size.secs(COSTS);
            assert!(secs <= PLANNED * within && secs >= before, "{within}: {secs} {size:?}");
            assert!(secs >= 0.7 * within.min(600.0), "{within}: {secs} {size:?}");
            before = secs;
        }
    }

    #[test]
    fn what_a_run_on_the_log_costs_whatever_its_steps_is_planned_with() {
        let costs = Costs { replay_run_secs: 3.0, ..COSTS };
        let size = Size::within(NETWORK, ProposedModel::None, 300.0, costs, 10_000, 3);
        let cheap = Size::within(NETWORK, ProposedModel::None, 300.0, COSTS, 10_000, 3);
        assert!(size.secs(costs) <= PLANNED * 300.0, "{size:?}");
        assert!(cheap.secs(costs) > size.secs(costs), "{size:?}, {cheap:?}");
    }

    /// Returns the most steps of a run for 100, 1000, 5000 and 15 000 held-out states.
    fn most_steps(horizon: f64) -> [usize; 4] {
        [100, 1_000, 5_000, 15_000].map(|states| Size::most_steps(states, horizon))
    }

    #[test]
    fn several_windows_fit() {
        assert_eq!(
            most_steps(5.0),
            [98, 444, 1_111, 3_333],
            "four wherever a window has fifty horizons"
        );
        assert_eq!(most_steps(4.0), [98, 222, 1_111, 3_333]);
        assert_eq!(
            most_steps(30.0),
            [98, 444, 2_222, 3_333],
            "two, because four would have 37 horizons"
        );
    }

    #[test]
    fn windows_are_counted_with_the_states_that_complete_their_returns() {
        let size = Size::within(NETWORK, ENSEMBLE, 600.0, COSTS, 444, 1);
        assert_eq!(size.steps, 444);
        // Returns of a horizon of 5 states need 21 more states, those of 100 states 459.
        let windows = [5.0, 100.0].map(|states| size.windows(1_000, Horizon::new(states, 1.0)));
        assert_eq!(windows, [2, 1]);
        assert_eq!(size.windows(100, Horizon::new(5.0, 1.0)), 1);
        let few = Size { online_runs: 3, ..size };
        assert_eq!(few.windows(10_000, Horizon::new(5.0, 1.0)), 3, "no more than runs");
    }

    #[test]
    fn short_logs_and_slow_machines_get_what_there_is() {
        let short = Size::within(NETWORK, ENSEMBLE, 600.0, COSTS, 250, 1);
        assert_eq!((short.steps, short.sensors), (250, 1));
        let slow = Size::within(NETWORK, ENSEMBLE, 1.0, COSTS, 10_000, 3);
        assert_eq!((slow.values(), slow.online_runs), (6, 4), "the smallest");
        assert_eq!(slow, Size::smallest(NETWORK, ENSEMBLE, 10_000, 3));
        assert_eq!(short.steps, Size::smallest(NETWORK, ENSEMBLE, 250, 1).steps);
        assert_eq!(slow.learning_rates(), ["0", "1e-6", "1e-5", "1e-4", "1e-3", "1e-2"]);
        let finest = Size::within(ProposedAgent::Linear, ENSEMBLE, 1e6, COSTS, 10_000, 3);
        assert_eq!(
            (finest.values(), &finest.learning_rates()[1..5]),
            (14, &["1e-5", "2e-5", "5e-5", "1e-4"].map(str::to_owned)[..])
        );
    }
}
