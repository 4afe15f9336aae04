//! What to put into a study of a log that nobody has looked at yet: pure functions from measurements to choices, each with its
//! reason in words.
//!
//! - [`Scope`]: which part of the log, and which channels of it.
//! - [`Angle`]: which channels are angles.
//! - [`Cut`]: the training range and what is held out, by rows.
//! - [`Cleaning`]: what counts as a gap, and how far values are carried.
//! - [`spacing_by_log`]: from one state to the next; [`spacings`] are those among which trial models decide where these choose.
//! - [`Sensors`]: which to predict.
//! - [`horizon`]: how far ahead.
//! - [`choose_agent`]: what learns, by what was tried.
//! - [`ProposedModel`]: whether the study has a model, by what was asked for.
//! - [`Size`]: how long and how often, to end within a time.
//! - [`Draft`]: the study file with a comment for each of these; [`with_given`] what the user said beside it.
//! - [`ProposedControl`], [`action_levels`], [`control_steps`]: the same for agents that act, on a log whose [`DecisionColumns`] are named;
//!   [`ControlDraft`] is their study file.
//!
//! The measurements are a [`Sketch`](calib_data::Sketch) of the log, and times that the caller took. The numbers of the rules
//! are our choices, if nothing else is said.
//!
//! ```
//! use calib_propose::Horizon;
//!
//! // Ten minutes ahead, with states half a minute apart.
//! let horizon = Horizon::new(600.0, 30.0);
//! assert_eq!((horizon.states.round(), horizon.gamma), (20.0, 0.95));
//! ```

mod agent;
mod angles;
mod cleaning;
mod control;
mod control_draft;
mod cut;
mod decision_columns;
mod draft;
mod error;
mod given;
mod horizon;
mod lines;
mod log_draft;
mod model;
mod scope;
mod sensors;
mod size;
mod spacing;
mod written;

pub use agent::{ProposedAgent, Trial, choose_agent};
pub use angles::Angle;
pub use cleaning::{Cleaning, Clock, many_left_out};
pub use control::{
    GivenControl, ProposedControl, action_levels, actions_are_continuous, control_steps,
};
pub use control_draft::ControlDraft;
pub use cut::{Cut, HELD_OUT, mean_step_secs};
pub use decision_columns::DecisionColumns;
pub use draft::{Asked, Draft};
pub use error::ProposeError;
pub use given::with_given;
pub use horizon::{Horizon, horizon};
pub use log_draft::{LogDraft, exclusions};
pub use model::ProposedModel;
pub use scope::{Lacking, LeftOut, LeftOutReason, Scope};
pub use sensors::Sensors;
pub use size::{Costs, MOST_RUNS, Size};
pub use spacing::{spacing_by_log, spacings};

#[cfg(test)]
mod testing;
