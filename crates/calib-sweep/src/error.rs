use std::sync::Arc;

use calib_agent::AgentError;
use calib_core::Cancelled;
use calib_files::FileError;
use calib_model::ModelError;
use calib_stats::StatsError;

use crate::{EnvironmentId, Unit};

/// An error in planning, running or judging a sweep.
#[derive(Debug, thiserror::Error)]
pub enum SweepError {
    /// A swept field without values.
    #[error("sweep.grid.{field} has no values; give a list such as [1e-5, 1e-4, 1e-3]")]
    EmptyField {
        /// The agent field.
        field: String,
    },
    /// Gamma among the swept fields.
    #[error(
        "sweep.grid.gamma: another gamma predicts another return, which varies more or less, so errors across its values do not compare and \
         none of them is better. Choose gamma for how far ahead you want to know, 1 / (1 - gamma) states; for two horizons make two studies, \
         such as with --set agent.gamma=0.9 --output near"
    )]
    GammaInGrid,
    /// A grid without fields.
    #[error(
        "sweep.grid is empty; name at least one agent field, such as learning_rate = [1e-4, 1e-3]"
    )]
    EmptyGrid,
    /// A repeated value in one field.
    #[error("sweep.grid.{field} has the value {value} twice; remove one")]
    RepeatedValue {
        /// The agent field.
        field: String,
        /// The repeated value.
        value: String,
    },
    /// A field that no agent of the sweep uses.
    #[error(
        "sweep.grid.{field} decides nothing: it is for agents with {needed}; leave it out, or set that"
    )]
    UnusedField {
        /// The agent field.
        field: String,
        /// The agents that use it.
        needed: &'static str,
    },
    /// A result that does not belong to this sweep.
    #[error(
        "the result of {unit} is of value {candidate}, counted from 0, and the sweep has {candidates}"
    )]
    UnknownCandidate {
        /// The unit of the result.
        unit: Unit,
        /// Position of its setting.
        candidate: usize,
        /// Number of settings.
        candidates: usize,
    },
    /// A field that no agent has.
    #[error("sweep.grid.{field} is no key of {section}; there are: {known}")]
    UnknownField {
        /// The field as the study writes it.
        field: String,
        /// The section that lists the fields.
        section: &'static str,
        /// The known fields.
        known: String,
    },
    /// A swept field for a program that has no parameters.
    #[error(
        "sweep.grid.{field} varies a parameter, and [agent.parameters] has none; give {field} its default there"
    )]
    NoParameters {
        /// The field as the study writes it.
        field: String,
    },
    /// A range that holds no values.
    #[error("sweep.grid.{field} is not a range of values: {reason}")]
    Range {
        /// The agent field.
        field: String,
        /// The reason.
        reason: String,
    },
    /// More combinations than can be swept.
    #[error(
        "sweep.grid has {got} settings, more than {most}; sweep fewer, or set sweep.sampling to \"sobol\" and sweep.samples to how many to try"
    )]
    TooManyCandidates {
        /// Combinations in the grid.
        got: usize,
        /// The limit.
        most: usize,
    },
    /// A number of samples outside its limits.
    #[error("sweep.samples must be from 1 to {most}, got {got}")]
    Samples {
        /// Samples asked for.
        got: usize,
        /// The limit.
        most: usize,
    },
    /// More fields than the Sobol sequence has dimensions.
    #[error(
        "sweep.sampling = \"sobol\" spreads samples over at most {most} fields, got {got} fields; use \"random\""
    )]
    TooManyFields {
        /// Swept fields.
        got: usize,
        /// The limit.
        most: usize,
    },
    /// Too few different settings for the requested samples.
    #[error(
        "sweep.samples asks for {got} different settings, and only {there} were found; ask for fewer, or widen sweep.grid"
    )]
    TooFewPoints {
        /// Samples asked for.
        got: usize,
        /// Different settings found.
        there: usize,
    },
    /// A setting that is not a valid agent.
    #[error("sweep.grid: {candidate} is not a valid agent: {reason}")]
    Candidate {
        /// The label of the setting.
        candidate: String,
        /// The reason.
        reason: String,
    },
    /// A stream without steps to train on.
    #[error("a run of {steps} steps is too short to train on; raise sweep.steps or give more data")]
    TooShort {
        /// Steps in the stream.
        steps: usize,
    },
    /// A failed training run.
    #[error("{unit}")]
    Agent {
        /// The unit.
        unit: Unit,
        /// The cause.
        source: AgentError,
    },
    /// A failure in training runs that were made side by side.
    #[error("training runs side by side")]
    Together(#[source] AgentError),
    /// A failure of the program of external agents.
    #[error("{unit}")]
    Program {
        /// The unit.
        unit: Unit,
        /// The cause.
        source: Box<dyn std::error::Error + Send + Sync>,
    },
    /// A model that could not be rolled out.
    #[error(transparent)]
    Model(Arc<ModelError>),
    /// A unit file that could not be read or written.
    #[error(transparent)]
    File(#[from] FileError),
    /// Results that cannot be ranked.
    #[error(transparent)]
    Stats(#[from] StatsError),
    /// Missing units that a verdict needs.
    #[error(
        "{missing} of {planned} runs (sensor, environment, run) have no result, such as {example}; run the sweep again to complete it"
    )]
    Incomplete {
        /// Units without a result.
        missing: usize,
        /// Units in the plan.
        planned: usize,
        /// An example.
        example: Unit,
    },
    /// A run whose scored part has no step with a complete return.
    #[error(
        "{unit} has no step to score: gaps or gamma leave none; use longer runs (sweep.steps), or score the whole run"
    )]
    NothingScored {
        /// The run.
        unit: Unit,
    },
    /// A request for a stream of an environment of which only the description is known.
    #[error("{0} was not opened here")]
    Closed(EnvironmentId),
    /// A stop that the observer asked for.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}
