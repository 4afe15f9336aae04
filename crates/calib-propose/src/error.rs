/// Why no study can be proposed.
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
    /// A sensor that was asked for cannot be predicted.
    #[error("--sensor {name}: {why}, so it cannot be predicted")]
    OfNoUse {
        /// The sensor.
        name: String,
        /// Why not.
        why: String,
    },
    /// Sensors that were asked for are not there at the same time.
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
        "the reward is {reward} in every step{beside}, so no action is worth more than another; name another column with --reward, or the \
         column that says where episodes end with --terminal"
    )]
    NothingToGain {
        /// The reward.
        reward: f32,
        /// What is said of terminals.
        beside: &'static str,
    },
    /// Columns of actions have too many combinations, however few levels they have.
    #[error(
        "{columns} columns of actions have {combinations} combinations of two levels each, and a study has {most_actions} actions at most: name \
         fewer with --action, or raise control.most_actions with --set"
    )]
    TooManyActions {
        /// Columns of actions.
        columns: usize,
        /// Combinations of two levels of each.
        combinations: usize,
        /// The most actions.
        most_actions: usize,
    },
    /// There is too little.
    #[error(
        "the log has {rows} rows that could be used, and a study wants {least} at least; {}",
        if *have_own_times {
            "its tags have times of their own: put them on one clock with data.resample, data.period_secs and data.max_age_secs"
        } else {
            "export a longer stretch, or at a shorter period"
        }
    )]
    TooShort {
        /// Usable rows.
        rows: usize,
        /// The fewest.
        least: usize,
        /// Whether most rows have a value of only one of several tags.
        have_own_times: bool,
    },
}
