//! The return of a log's behaviour.

use calib_stats::{Interval, ratio_of_sums};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{ControlError, Decisions, Ending};

/// Return of the recorded behaviour, counted in the same way as the returns of agents.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct RecordedReturn {
    /// Mean return per episode: Σ rewards / Σ recorded shares of an episode. It may lie outside the range of all whole episodes, if
    /// terminals end most of them and gaps cut others short.
    pub mean: f64,
    /// 95 % interval of the mean, over recorded episodes; none for a single episode.
    pub interval: Option<Interval>,
    /// Number of episodes. An episode of which only a share was recorded counts as that share.
    pub episodes: f64,
    /// Highest return of a whole episode; none if the log has no whole episode.
    pub best: Option<f64>,
    /// Lowest return of a whole episode; none if the log has no whole episode.
    pub worst: Option<f64>,
}

/// A recorded episode, or part of one.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Piece {
    /// Sum of the rewards.
    reward: f64,
    /// Its length as a share of an episode.
    share: f64,
}

impl Decisions {
    /// Returns the return of the behaviour in episodes of at most `timeout` steps.
    ///
    /// Recorded episodes are cut after every `timeout` steps, as those of agents are. A piece is whole if it has `timeout` steps, or if it
    /// begins an episode and ends in a terminal. Other pieces count by their share of `timeout` steps, as the unfinished episode of an
    /// agent does ([`AgentRun::mean_return`](crate::AgentRun::mean_return)). These are the rest of an episode after a cut, and episodes
    /// that a gap, a row without an action or the end of the log cut short. As whole episodes they would make the behaviour look better
    /// than it was where rewards are negative, and worse where they are positive.
    ///
    /// # Errors
    /// If a reward is NaN.
    pub fn recorded_return(&self, timeout: usize) -> Result<RecordedReturn, ControlError> {
        let pieces = self.pieces(timeout.max(1));
        let rewards: Vec<f64> = pieces.iter().map(|piece| piece.reward).collect();
        let shares: Vec<f64> = pieces.iter().map(|piece| piece.share).collect();
        let estimate = ratio_of_sums(&rewards, &shares)?;
        let whole = pieces.iter().filter(|piece| piece.share == 1.0).map(|piece| piece.reward);
        Ok(RecordedReturn {
            mean: estimate.value,
            interval: estimate.interval,
            episodes: shares.iter().sum(),
            best: whole.clone().reduce(f64::max),
            worst: whole.reduce(f64::min),
        })
    }

    /// Returns the standard deviation of the discounted return from each recorded step on, in units of reward. A return extends to
    /// the end of its episode, or to the step at which an agent's episode would be cut. Agents have to tell apart returns of this
    /// size, so it is the unit of proposed temperatures and first values. `None` if all returns are equal.
    ///
    /// If no recorded episode ends in a terminal, rewards count less their mean. A reward that every step has does not depend on
    /// actions, and makes returns differ by the steps that remain before a cut. With terminals, actions decide how many steps there are.
    pub fn return_spread(&self, gamma: f64, timeout: usize) -> Option<f64> {
        let every_step = if self.terminals() == 0 { self.mean_reward() } else { 0.0 };
        let mut returns = Vec::with_capacity(self.len());
        for steps in self.episodes() {
            for part in self.rewards()[steps].chunks(timeout.max(1)) {
                let mut rest = 0.0;
                for &reward in part.iter().rev() {
                    rest = (f64::from(reward) - every_step) + gamma * rest;
                    returns.push(rest);
                }
            }
        }
        let mean = returns.iter().sum::<f64>() / returns.len() as f64;
        let squares: f64 = returns.iter().map(|value| (value - mean).powi(2)).sum();
        let spread = (squares / returns.len() as f64).sqrt();
        (spread.is_finite() && spread > 0.0).then_some(spread)
    }

    /// Returns the mean reward of a recorded step. If all rewards are equal, it is exactly that reward.
    pub fn mean_reward(&self) -> f64 {
        let first = f64::from(self.rewards()[0]);
        let beyond: f64 = self.rewards().iter().map(|&reward| f64::from(reward) - first).sum();
        first + beyond / self.len() as f64
    }

    fn pieces(&self, timeout: usize) -> Vec<Piece> {
        let mut pieces = Vec::new();
        for steps in self.episodes() {
            let ended = self.endings()[steps.end - 1] == Ending::Terminal;
            let rewards = &self.rewards()[steps];
            for part in rewards.chunks(timeout) {
                let is_whole = part.len() == timeout || (ended && part.len() == rewards.len());
                let share = if is_whole { 1.0 } else { part.len() as f64 / timeout as f64 };
                pieces.push(Piece { reward: part.iter().copied().map(f64::from).sum(), share });
            }
        }
        pieces
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use calib_core::{Segments, States};

    use super::*;
    use crate::Columns;

    /// Returns a log of episodes with rewards of −1. Each has a number of steps, and an ending.
    pub(crate) fn log(episodes: &[(usize, Ending)]) -> Decisions {
        log_of(episodes, |_| -1.0)
    }

    /// Returns a log of episodes with a number of steps and an ending, and with the reward of each step of an episode.
    fn log_of(episodes: &[(usize, Ending)], reward: impl Fn(usize) -> f32) -> Decisions {
        let mut actions = Vec::new();
        let mut rewards = Vec::new();
        let mut endings = Vec::new();
        for &(steps, ending) in episodes {
            actions.extend((0..steps).map(|step| Some((step % 2) as u16)));
            actions.push(None);
            rewards.push(f32::NAN);
            rewards.extend((0..steps).map(&reward));
            endings.extend(vec![Ending::Continues; steps]);
            endings.push(ending);
        }
        let rows = actions.len();
        let states = States::new((0..rows).map(|row| row as f32).collect(), rows, 1);
        let segments =
            Segments::from_lengths(episodes.iter().map(|episode| episode.0 + 1)).expect("valid");
        let columns = Columns { actions: &actions, rewards: &rewards, endings: &endings };
        Decisions::new(states.expect("valid"), &segments, columns, 2).expect("valid")
    }

    fn mean(episodes: &[(usize, Ending)], timeout: usize) -> f64 {
        log(episodes).recorded_return(timeout).expect("numbers").mean
    }

    const ON: Ending = Ending::Continues;
    const END: Ending = Ending::Terminal;

    fn assert_near(got: f64, expected: f64) {
        assert!((got - expected).abs() < 1e-9, "{got}");
    }

    #[test]
    fn what_is_left_after_a_cut_is_no_whole_episode() {
        // An episode has 150 steps and is cut after 100. An agent's next episode would start from a start state.
        assert_near(mean(&[(150, ON); 4], 100), -100.0);
        assert_near(mean(&[(150, END); 4], 100), -100.0);
        // The end of the log cuts the last episode after a fifth.
        assert_near(mean(&[(100, ON), (100, ON), (20, ON)], 100), -100.0);
        // Terminals end whole episodes, however short.
        let recorded =
            log(&[(40, END), (60, END), (25, ON)]).recorded_return(100).expect("numbers");
        assert_near(recorded.mean, -125.0 / 2.25);
        assert_near(recorded.episodes, 2.25);
        assert_eq!((recorded.best, recorded.worst), (Some(-40.0), Some(-60.0)));
        // Parts count with the rewards of their steps, and are small shares of an episode, although terminals end episodes early.
        let recorded =
            log(&[(10, END), (12, END), (8, ON), (8, ON)]).recorded_return(100).expect("numbers");
        assert_near(recorded.mean, -38.0 / 2.16);
        assert!(recorded.worst.is_some_and(|worst| recorded.mean < worst), "{recorded:?}");
        // Less than one episode is not reported as one.
        let recorded = log(&[(25, ON)]).recorded_return(100).expect("numbers");
        assert_near(recorded.mean, -100.0);
        assert_eq!((recorded.best, recorded.worst, recorded.interval), (None, None, None));
    }

    #[test]
    fn the_spread_is_that_of_returns_from_each_step_on() {
        // Returns are -1, -2, -3 without discount, which gives a variance of 2/3.
        let spread = log(&[(3, END)]).return_spread(1.0, 100).expect("unlike");
        assert_near(spread, (2.0_f64 / 3.0).sqrt());
        // Cut after two steps, returns are -2, -1, -1.
        let spread = log(&[(3, END)]).return_spread(1.0, 2).expect("unlike");
        assert_near(spread, (2.0_f64 / 9.0).sqrt());
        // With a discount of 0 every step has the same return.
        assert_eq!(log(&[(3, END)]).return_spread(0.0, 100), None);
        // Returns are -1, -1.5.
        assert_near(log(&[(2, END)]).return_spread(0.5, 100).expect("unlike"), 0.25);
    }

    /// Returns the spread of returns in an episode whose rewards alternate around `offset`.
    fn spread(ending: Ending, offset: f32) -> f64 {
        let log = log_of(&[(100, ending)], |step: usize| {
            offset + if step.is_multiple_of(2) { 1.0 } else { -1.0 }
        });
        log.return_spread(1.0, 50).expect("unlike")
    }

    #[test]
    fn what_every_step_gets_is_in_the_spread_only_if_actions_can_end_episodes() {
        // Returns alternate between 0 and -1.
        assert_near(spread(ON, 0.0), 0.5);
        assert_near(spread(ON, 100.0), 0.5);
        assert!(spread(END, 100.0) > 1000.0, "what ends an episode loses 100 a step");
        let constant = log_of(&[(7, ON), (3, ON)], |_| 0.1);
        assert_eq!(constant.return_spread(0.9, 5), None, "no action changes anything");
    }

    #[test]
    fn the_interval_is_that_of_the_quotient_of_sums() {
        let recorded =
            log(&[(40, END), (60, END), (25, ON)]).recorded_return(100).expect("numbers");
        let own = ratio_of_sums(&[-40.0, -60.0, -25.0], &[1.0, 1.0, 0.25]).expect("three");
        assert_eq!(recorded.interval, own.interval);
    }
}
