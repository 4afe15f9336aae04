use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Why the log does not support a choice.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", tag = "reason")]
pub enum Doubt {
    /// An action was never taken.
    ActionNeverTaken {
        /// Index of the action.
        action: usize,
    },
    /// Too many steps of the chosen setting are not covered by the log.
    Uncovered {
        /// Uncovered share of its steps.
        share: f64,
    },
    /// Too many decisions of a held-out period were made in states that the log does not cover.
    HeldOutUncovered {
        /// Name of the deployment; none for a period without a name.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        deployment: Option<String>,
        /// Share of its decisions whose state no recorded decision covers, whatever the actions.
        share: f64,
    },
    /// The log has too few terminals to learn what they depend on.
    FewTerminals {
        /// Number of terminals in the log.
        terminals: usize,
    },
    /// The ensemble members rank all settings equally.
    NotToldApart,
    /// The chosen setting may be no better than the default.
    NotBetterThanDefault,
    /// The chosen setting gets a lower return in the model than the recorded behaviour got.
    BelowRecorded {
        /// Its mean return per episode in the model.
        promised: f64,
        /// Mean return per episode of the recorded behaviour.
        recorded: f64,
    },
    /// The predicted mean return is higher than the return of every recorded episode.
    AboveRecorded {
        /// Mean return per episode of the chosen setting in the model.
        promised: f64,
        /// The highest return of a recorded episode.
        best: f64,
    },
    /// Episodes end in a terminal less than a tenth as often as in the log.
    RareTerminals {
        /// Terminals per step of the chosen setting in the model.
        in_model: f64,
        /// Terminals per step of the log.
        in_log: f64,
    },
    /// One constant action gets a higher return in the model than the chosen setting, though that could be chance.
    WorseThanConstant {
        /// Index of the action.
        action: usize,
        /// Mean return per episode of the action in the model.
        constant: f64,
        /// Mean return per episode of the chosen setting.
        promised: f64,
    },
    /// The chosen setting is not shown to be better than random actions: it may get no more in the model, or gets no more in the only
    /// ensemble member.
    NotBetterThanRandomActions {
        /// Mean return per episode of random actions in the model.
        random: f64,
        /// Mean return per episode of the chosen setting.
        promised: f64,
    },
    /// Jumps between recorded transitions displace the chosen setting's episodes in one direction, further than twice the recorded range.
    Displaced {
        /// Index of the column.
        column: usize,
        /// Mean over episodes of the sum of the jumps, in units of the states: 1 is the recorded range of a column.
        mean: f64,
        /// Standard error of that mean, over episodes.
        error: f64,
    },
    /// A single ensemble member gives no interval, so that the choice is not shown to be better than anything.
    OneMember,
    /// The chosen setting diverged in an ensemble member.
    Diverged,
    /// The default could not be compared, because its program or its agent failed.
    DefaultFailed,
}
