//! Agents that act: from a log of decisions to a verdict. Also writes logs of tasks whose true
//! values are known.

mod advice;
mod agents;
mod beside_returns;
mod conduct;
mod cost;
mod counting;
mod described;
mod evaluation;
mod figures;
mod files;
mod held_out;
mod held_out_period;
mod inspect;
mod log;
mod log_warnings;
mod model;
mod page;
mod plan;
mod ranking;
mod rare;
mod reward_words;
mod run;
mod section;
mod show;
mod simulate;
mod units;
mod work_left;

pub use advice::{Advice, PYTHON, Reason, Vocabulary};
pub use agents::ActingAgent;
pub use evaluation::ControlEvaluation;
pub(crate) use evaluation::ControlSummary;
pub(crate) use files::VerdictStanding;
pub use inspect::InspectedActions;
pub(crate) use inspect::inspect;
pub(crate) use log::{ActionLog, read as read_log};
pub(crate) use model::build;
pub use model::{ControlColumn, ControlModel, ControlNames, unstored_networks};
pub use plan::ControlPlan;
pub(crate) use plan::expected_secs;
pub(crate) use ranking::{ControlRanking, ranking};
pub(crate) use rare::hardly_taken;
pub(crate) use run::run;
pub(crate) use show::{FAILED, held};
pub(crate) use simulate::simulate;
pub use simulate::{SimulateTask, SimulatedTask};
