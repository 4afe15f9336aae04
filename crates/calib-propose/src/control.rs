use calib_control::{
    AgentConfig, Algorithm, Decisions, FEW_STEPS, PAIRED_COLUMNS, ProposedSettings, StartRows,
};

use crate::{Costs, ProposeError, size::PLANNED};

/// Levels of each column of continuous actions, as in the tasks with a known answer. Our choice.
const LEVELS: usize = 7;
/// With fewer episodes than this, runs start at any row: so few first states would cover little of the plant. Our choice.
const FEW_EPISODES: usize = 10;
/// Longest episode in steps: a run of [`MOST_STEPS`] then has some fifteen episodes. Our choice.
const LONGEST_EPISODE: usize = 1_000;
const DAY_SECS: f64 = 86_400.0;
/// Returns are undiscounted if at least this share of the episodes ends in a terminal. Our choice.
const NEARLY_ALL: f64 = 0.9;
/// Discount factor where episodes need not end: that of the membrane plant.
const GAMMA: f64 = 0.99;
/// Effective horizon of [`GAMMA`], in steps.
const HORIZON: usize = 100;
/// Fewest steps of a run: with fewer, agents learn hardly anything (our choice). The most steps are those of the published
/// protocol (Wang et al. 2022).
const LEAST_STEPS: usize = 2_000;
const MOST_STEPS: usize = 15_000;
/// Fewest and most steps of a run that are proposed.
pub const CONTROL_STEPS: [usize; 2] = [LEAST_STEPS, MOST_STEPS];

/// Proposed settings of acting agents for a log of decisions.
#[derive(Clone, Debug, PartialEq)]
pub struct ProposedControl {
    /// `control.timeout` in steps, and its reason.
    pub timeout: (usize, String),
    /// `control.start` and its reason.
    pub start: (StartRows, String),
    /// `control.agent.gamma` and its reason.
    pub gamma: (f64, String),
    /// Learning algorithm of the agents.
    pub algorithm: Algorithm,
    /// Reason for `control.agent.pairs = false`; `None` if agents have pairs of columns, or the key was given.
    pub without_pairs: Option<String>,
    /// Standard deviation of the recorded returns, in units of reward.
    pub spread: f64,
    /// The settings that follow from the spread.
    pub settings: ProposedSettings,
}

/// Keys of acting agents that were given and are therefore not proposed.
#[derive(Clone, Copy, Debug, Default)]
pub struct GivenControl {
    /// `control.timeout`, in steps.
    pub timeout: Option<usize>,
    /// `control.agent.gamma`.
    pub gamma: Option<f64>,
    /// `control.agent.algorithm`; the default if it was not given.
    pub algorithm: Algorithm,
    /// `control.agent.pairs`.
    pub pairs: Option<bool>,
}

/// Summary of the episodes of a log.
struct RecordedEpisodes {
    count: usize,
    /// Length of the longest episode in steps.
    longest: usize,
    /// Number of episodes that end in a terminal.
    terminals: usize,
}

impl ProposedControl {
    /// Proposes settings for a log with a decision every `period_secs` seconds.
    ///
    /// # Errors
    /// If the reward never differs, so that no action can be better than another.
    pub fn for_log(
        log: &Decisions,
        period_secs: f64,
        given: GivenControl,
    ) -> Result<Self, ProposeError> {
        let episodes = RecordedEpisodes {
            count: log.starts().len(),
            longest: log.episodes().map(|steps| steps.len()).max().unwrap_or(0),
            terminals: log.terminals(),
        };
        let timeout = match given.timeout {
            Some(timeout) => (timeout, "as given".to_owned()),
            None => episodes.timeout(period_secs),
        };
        let gamma = match given.gamma {
            Some(gamma) => (gamma, "as given".to_owned()),
            None => episodes.gamma(timeout.0),
        };
        let beside =
            if episodes.terminals == 0 { ", and no episode ends in a terminal" } else { "" };
        let spread = log.return_spread(gamma.0, timeout.0);
        let spread =
            spread.ok_or(ProposeError::NothingToGain { reward: log.rewards()[0], beside })?;
        let columns = log.states().columns();
        let algorithm = given.algorithm;
        let is_open = given.pairs.is_none() && algorithm.uses("pairs");
        let without_pairs = (is_open && columns > PAIRED_COLUMNS).then(|| {
            let pairs = columns * (columns - 1) / 2;
            format!("{columns} columns have {pairs} pairs, which would take most of the time")
        });
        let pairs = given.pairs.unwrap_or(without_pairs.is_none());
        let agent = AgentConfig { algorithm, pairs, ..AgentConfig::default() };
        Ok(Self {
            start: episodes.start(),
            settings: ProposedSettings::for_spread(spread, &agent, columns),
            timeout,
            gamma,
            algorithm,
            without_pairs,
            spread,
        })
    }
}

impl RecordedEpisodes {
    fn timeout(&self, period_secs: f64) -> (usize, String) {
        let longest = self.longest;
        if self.terminals == 0 {
            let day = (DAY_SECS / period_secs).round().clamp(1.0, LONGEST_EPISODE as f64) as usize;
            let reason = if longest.max(HORIZON) >= day {
                format!("a day, or {LONGEST_EPISODE} steps where it has more")
            } else if longest >= HORIZON {
                "the steps of the longest piece of the log".to_owned()
            } else {
                format!("the effective horizon of gamma {GAMMA}")
            };
            (longest.max(HORIZON).min(day), format!("{reason}; {}", self.pieces()))
        } else if longest > LONGEST_EPISODE {
            let why = format!(
                "so that a run has several episodes; the longest recorded one has {longest} steps"
            );
            (LONGEST_EPISODE, why)
        } else {
            (longest, "the steps of the longest recorded episode".to_owned())
        }
    }

    fn start(&self) -> (StartRows, String) {
        let count = self.count;
        if self.terminals == 0 {
            (StartRows::Anywhere, self.pieces())
        } else if count < FEW_EPISODES {
            let why = format!("the log has too few first states of episodes, {count}");
            (StartRows::Anywhere, why)
        } else {
            (StartRows::Episodes, format!("in the first states of the {count} recorded episodes"))
        }
    }

    /// Describes the pieces of a log in which no terminal ends an episode.
    fn pieces(&self) -> String {
        match self.count {
            1 => "the log is one piece, which no terminal ends".to_owned(),
            many => format!(
                "the {many} pieces of the log are cut by gaps or missing values, not ended by terminals"
            ),
        }
    }

    fn gamma(&self, timeout: usize) -> (f64, String) {
        let Self { count, longest, terminals } = *self;
        if (terminals as f64) < NEARLY_ALL * count as f64 {
            (GAMMA, "an episode need not end, so about the next 100 steps count".to_owned())
        } else if longest > timeout {
            let why = format!(
                "episodes of up to {longest} steps are cut after {timeout}, so about the next 100 steps count"
            );
            (GAMMA, why)
        } else {
            let why = format!(
                "{terminals} of {count} episodes end in a terminal, so returns are not discounted"
            );
            (1.0, why)
        }
    }
}

/// Whether to treat the columns of actions as continuous. The log has `actions` combinations of values in `steps` steps.
/// They are continuous if each combination has too few steps, and levels would reduce their number.
/// `distinct` counts the distinct values per column; `None` stands for very many.
pub fn actions_are_continuous(distinct: &[Option<u32>], actions: usize, steps: usize) -> bool {
    steps < FEW_STEPS * actions
        && distinct.iter().any(|values| values.is_none_or(|values| values as usize > LEVELS))
}

/// Returns `control.levels`: the largest number, up to seven, for which the columns have at most `most_actions` combinations.
///
/// # Errors
/// If even two levels per column have more combinations.
pub fn action_levels(distinct: &[Option<u32>], most_actions: usize) -> Result<usize, ProposeError> {
    let fitting = (2..=LEVELS).rev().find(|&levels| combinations(distinct, levels) <= most_actions);
    fitting.ok_or_else(|| {
        let columns = distinct.len();
        let combinations = combinations(distinct, 2);
        ProposeError::TooManyActions { columns, combinations, most_actions }
    })
}

/// Returns the number of combinations of the values of all columns, with at most so many levels each.
fn combinations(distinct: &[Option<u32>], levels: usize) -> usize {
    let own = distinct.iter().map(|values| values.map_or(levels, |all| levels.min(all as usize)));
    own.fold(1_usize, usize::saturating_mul)
}

/// Returns `control.steps` for a study that must end in `within_secs` seconds, as a multiple of 100. Without `costs`: the fewest.
pub fn control_steps(within_secs: f64, costs: Option<Costs>) -> usize {
    let Some(costs) = costs else { return LEAST_STEPS };
    let affordable = (PLANNED * within_secs - costs.fixed_secs) / costs.agent_step_secs;
    let hundreds = (affordable / 100.0).floor() * 100.0;
    hundreds.clamp(LEAST_STEPS as f64, MOST_STEPS as f64) as usize
}

#[cfg(test)]
mod tests {
    use calib_control::{Columns, Ending};
    use calib_core::{Segments, States};

    use super::*;

    /// Returns `episodes` episodes with the given rewards, steps and endings.
    fn log(
        episodes: usize,
        steps: usize,
        ending: Ending,
        reward: impl Fn(usize) -> f32,
    ) -> Decisions {
        let rows = episodes * (steps + 1);
        let actions: Vec<Option<u16>> = (0..rows).map(|row| Some((row % 2) as u16)).collect();
        let rewards: Vec<f32> = (0..rows).map(reward).collect();
        let endings: Vec<Ending> = (0..rows)
            .map(|row| if row % (steps + 1) == steps { ending } else { Ending::Continues })
            .collect();
        let states = States::new((0..rows).map(|row| row as f32).collect(), rows, 1);
        let segments = Segments::from_lengths(vec![steps + 1; episodes]).expect("valid");
        let columns = Columns { actions: &actions, rewards: &rewards, endings: &endings };
        Decisions::new(states.expect("valid"), &segments, columns, 2).expect("valid")
    }

    fn proposed(log: &Decisions, period_secs: f64) -> Result<ProposedControl, ProposeError> {
        ProposedControl::for_log(log, period_secs, GivenControl::default())
    }

    #[test]
    fn what_is_given_is_not_chosen() {
        let given = GivenControl { timeout: Some(10), gamma: Some(0.5), ..GivenControl::default() };
        let log = log(20, 30, Ending::Terminal, |_| 1.0);
        let control = ProposedControl::for_log(&log, 1.0, given).expect("lengths differ");
        assert_eq!((control.timeout.0, control.gamma.0), (10, 0.5));
        assert_eq!(Some(control.spread), log.return_spread(0.5, 10), "in units of these returns");
    }

    #[test]
    fn settings_are_of_the_agent_that_is_given() {
        let log = log(20, 30, Ending::Terminal, |_| 1.0);
        let network =
            GivenControl { algorithm: Algorithm::DeepQLearning, ..GivenControl::default() };
        let control = ProposedControl::for_log(&log, 1.0, network).expect("lengths differ");
        assert_eq!(control.settings.step_sizes, [0.0001, 0.001, 0.01]);
        assert_eq!(control.algorithm, Algorithm::DeepQLearning);
    }

    #[test]
    fn episodes_that_end_are_not_discounted() {
        let control = proposed(&log(20, 30, Ending::Terminal, |_| 1.0), 1.0);
        let control = control.expect("lengths differ from each step on");
        assert_eq!((control.timeout.0, control.gamma.0), (30, 1.0));
        assert_eq!(control.start.0, StartRows::Episodes);
        // Returns of 1 to 30 occur equally often: their variance is (30² − 1) / 12.
        assert!((control.spread - (899.0_f64 / 12.0).sqrt()).abs() < 1e-9, "{control:?}");
        let settings = ProposedSettings::for_spread(control.spread, &AgentConfig::default(), 1);
        assert_eq!(control.settings, settings);
        assert_eq!(control.without_pairs, None);
    }

    #[test]
    fn episodes_that_are_cut_before_they_end_are_discounted() {
        let given = GivenControl { timeout: Some(29), ..GivenControl::default() };
        let log = log(20, 30, Ending::Terminal, |_| 1.0);
        let (gamma, why) =
            ProposedControl::for_log(&log, 1.0, given).expect("lengths differ").gamma;
        assert_eq!(gamma, 0.99);
        assert!(why.starts_with("episodes of up to 30 steps are cut after 29"), "{why}");
    }

    #[test]
    fn one_long_episode_begins_anywhere_and_is_cut_after_a_day() {
        let one = log(1, 5_000, Ending::Continues, |row| (row % 7) as f32);
        for (period_secs, timeout) in [(1.0, 1_000), (600.0, 144), (86_400.0, 1)] {
            let control = proposed(&one, period_secs).expect("rewards differ");
            assert_eq!((control.start.0, control.gamma.0), (StartRows::Anywhere, 0.99));
            assert!(control.timeout.1.contains("1000 steps"), "{control:?}");
            assert_eq!(control.timeout.0, timeout, "every {period_secs} s");
        }
    }

    #[test]
    fn pieces_that_gaps_cut_are_no_episodes() {
        let control = |pieces: usize, steps: usize, period_secs: f64| {
            let cut = log(pieces, steps, Ending::Continues, |row| (row % 7) as f32);
            let control = proposed(&cut, period_secs).expect("rewards differ");
            assert_eq!((control.start.0, control.gamma.0), (StartRows::Anywhere, 0.99));
            let why = format!("the {pieces} pieces of the log are cut by gaps or missing values");
            assert!(control.start.1.starts_with(&why), "{control:?}");
            assert!(control.timeout.1.contains(&why), "{control:?}");
            control.timeout
        };
        let (timeout, why) = control(57, 6, 60.0);
        assert_eq!(timeout, 100);
        assert!(why.starts_with("the effective horizon of gamma 0.99;"), "{why}");
        let (timeout, why) = control(20, 300, 60.0);
        assert_eq!(timeout, 300);
        assert!(why.starts_with("the steps of the longest piece of the log;"), "{why}");
        let (timeout, why) = control(2, 30, 3_600.0);
        assert_eq!(timeout, 24);
        assert!(why.starts_with("a day, or 1000 steps where it has more;"), "{why}");
    }

    #[test]
    fn a_horizon_is_that_of_the_discount() {
        assert_eq!((1.0 / (1.0 - GAMMA)).round(), HORIZON as f64);
    }

    #[test]
    fn a_reward_that_never_differs_is_refused() {
        let told = proposed(&log(20, 30, Ending::Continues, |_| 2.0), 1.0);
        let told = told.expect_err("nothing to gain").to_string();
        assert!(told.contains("2 in every step, and no episode ends"), "{told}");
        let told = proposed(&log(20, 30, Ending::Terminal, |_| 0.0), 1.0);
        let told = told.expect_err("nothing to gain").to_string();
        assert!(told.contains("0 in every step, so no action"), "{told}");
    }

    #[test]
    fn levels_are_as_many_as_combinations_allow() {
        assert_eq!(action_levels(&[None], 64), Ok(7));
        assert_eq!(action_levels(&[None, None], 64), Ok(7));
        assert_eq!(action_levels(&[None; 3], 64), Ok(4));
        assert_eq!(action_levels(&[None, Some(2), Some(4)], 64), Ok(7), "56 of its own values");
        assert!(action_levels(&[None; 7], 64).is_err(), "128 corners");
    }

    #[test]
    fn actions_with_few_steps_are_continuous_where_levels_help() {
        assert!(actions_are_continuous(&[Some(40)], 40, 1_000));
        assert!(!actions_are_continuous(&[Some(40)], 40, 2_000), "50 steps each");
        assert!(!actions_are_continuous(&[Some(7)], 7, 100), "levels would be its own values");
        assert!(actions_are_continuous(&[Some(2), None], 60, 1_000));
    }

    #[test]
    fn runs_are_as_long_as_time_allows() {
        let costs = Some(Costs { fixed_secs: 10.0, agent_step_secs: 0.01, replay_run_secs: 0.0 });
        assert_eq!(control_steps(100.0, costs), 7_500);
        assert_eq!(control_steps(5.0, costs), LEAST_STEPS, "no shorter ones say anything");
        assert_eq!(control_steps(1e6, costs), MOST_STEPS);
        assert_eq!(control_steps(1e6, None), LEAST_STEPS);
    }
}
