//! Proposals for a study of an unknown log: pure functions from measurements to choices, each with its reason in words.
//!
//! - [`Scope`]: the part of the log, and its channels.
//! - [`Angle`]: the channels that are angles.
//! - [`Cut`]: the training range and the held-out period, by rows.
//! - [`Cleaning`]: the gap tolerance and the fill limit.
//! - [`spacing_by_log`]: the distance between states. [`spacings`] lists the distances among which trial models decide.
//! - [`Sensors`]: the sensors to predict.
//! - [`horizon`]: the effective horizon of the predictions.
//! - [`choose_agent`]: the agent, chosen by trials.
//! - [`ProposedModel`]: whether the study has a model, by the keys that the user gave.
//! - [`Size`]: the length and number of training runs that fit in the given time.
//! - [`Draft`]: the study file with a comment for each choice; [`with_given`] adds the keys that the user gave.
//! - [`ProposedControl`], [`action_levels`], [`control_steps`]: the choices for acting agents, on a log with named
//!   [`DecisionColumns`]; [`ControlDraft`] is their study file.
//!
//! The measurements are a [`Sketch`](calib_data::Sketch) of the log, and times that the caller measured. The numbers in the rules
//! are our choices, unless a comment says otherwise.
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
mod axes;
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
    CONTROL_STEPS, GivenControl, ProposedControl, action_levels, actions_are_continuous,
    control_steps,
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
pub use size::{Costs, MOST_RUNS, MOST_WINDOWS, Size};
pub use spacing::{spacing_by_log, spacings};

#[cfg(test)]
mod testing;
