/// Reason why no study can be proposed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ProposeError {
    /// No channel can be used.
    #[error(
        "no channel of the log can be used: {0}; `calib inspect` shows every channel, and data.include chooses some"
    )]
    NoChannel(String),
    /// No channel moves enough.
    #[error(
        "no channel moves throughout the log, so there is nothing to predict; name sensors with --sensor, or choose another part of the log \
         with data.path"
    )]
    NothingMoves,
    /// A sensor that the user named cannot be predicted.
    #[error("--sensor {name}: {why}, so it cannot be predicted")]
    OfNoUse {
        /// The sensor.
        name: String,
        /// The reason.
        why: String,
    },
    /// The sensors that the user named never have values at the same time.
    #[error(
        "--sensor: no stretch of the log has nine tenths of the values of {}; `calib inspect` shows what each misses: choose others, \
         or name a denser part of the log with data.path",
        names.join(" and ")
    )]
    NeverTogether {
        /// The sensors.
        names: Vec<String>,
    },
    /// The reward never differs.
    #[error(
        "the reward is {reward} in every step{beside}, so no action is worth more than another; give another reward, or name the column \
         that says where episodes end with --terminal"
    )]
    NothingToGain {
        /// The reward.
        reward: f32,
        /// Words about terminals, for the message.
        beside: &'static str,
    },
    /// Columns of actions have too many combinations, even with two levels each.
    #[error(
        "{columns} columns of actions have {combinations} combinations of two levels each, and a study has {most_actions} actions at most: name \
         fewer with --action, or raise control.most_actions with --set"
    )]
    TooManyActions {
        /// Number of columns of actions.
        columns: usize,
        /// Number of combinations with two levels per column.
        combinations: usize,
        /// Largest allowed number of actions.
        most_actions: usize,
    },
    /// The log is too short.
    #[error(
        "the log has {rows} rows that could be used, and a study wants {least} at least; {}",
        if *have_own_times {
            "its tags have times of their own: put them on one clock with data.resample, data.period_secs and data.max_age_secs"
        } else {
            "export a longer stretch, or at a shorter period"
        }
    )]
    TooShort {
        /// Number of usable rows.
        rows: usize,
        /// Fewest rows for a study.
        least: usize,
        /// Whether most rows have a value of only one of several tags.
        have_own_times: bool,
    },
}
