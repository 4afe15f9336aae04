use std::sync::Arc;

use calib_agent::AgentError;
use calib_core::Cancelled;
use calib_files::FileError;
use calib_model::ModelError;
use calib_stats::StatsError;

use crate::{EnvironmentId, Unit};

/// Why a sweep cannot be planned, run or judged.
#[derive(Debug, thiserror::Error)]
pub enum SweepError {
    /// A grid without values.
    #[error("sweep.grid.{field} has no values; give a list such as [1e-5, 1e-4, 1e-3]")]
    EmptyField {
        /// The agent field.
        field: String,
    },
    /// The discount factor is swept.
    #[error(
        "sweep.grid.gamma: another gamma predicts another return, which varies more or less, so errors across its values do not compare and \
         none of them is better. Choose gamma for how far ahead you want to know, 1 / (1 - gamma) states; for two horizons make two studies, \
         such as with --set agent.gamma=0.9 --output near"
    )]
    GammaInGrid,
    /// No field to sweep.
    #[error(
        "sweep.grid is empty; name at least one agent field, such as learning_rate = [1e-4, 1e-3]"
    )]
    EmptyGrid,
    /// The same value twice in one field.
    #[error("sweep.grid.{field} has the value {value} twice; remove one")]
    RepeatedValue {
        /// The agent field.
        field: String,
        /// The value.
        value: String,
    },
    /// A field that no agent of the sweep uses.
    #[error(
        "sweep.grid.{field} decides nothing: it is for agents with {needed}; leave it out, or set that"
    )]
    UnusedField {
        /// The agent field.
        field: String,
        /// What uses it.
        needed: &'static str,
    },
    /// A result that is none of this sweep.
    #[error(
        "the result of {unit} is of value {candidate}, counted from 0, and the sweep has {candidates}"
    )]
    UnknownCandidate {
        /// Whose result.
        unit: Unit,
        /// Position of the value.
        candidate: usize,
        /// How many there are.
        candidates: usize,
    },
    /// A field that no agent has.
    #[error("sweep.grid.{field} is no key of {section}; there are: {known}")]
    UnknownField {
        /// What the study says.
        field: String,
        /// Where the fields stand.
        section: &'static str,
        /// The fields that there are.
        known: String,
    },
    /// A field where a program has no parameters.
    #[error(
        "sweep.grid.{field} varies a parameter, and [agent.parameters] has none; give {field} its default there"
    )]
    NoParameters {
        /// What the study says.
        field: String,
    },
    /// A range that holds no values.
    #[error("sweep.grid.{field} is not a range of values: {reason}")]
    Range {
        /// The agent field.
        field: String,
        /// What is wrong with it.
        reason: String,
    },
    /// More combinations than can be swept.
    #[error(
        "sweep.grid has {got} settings, more than {most}; sweep fewer, or set sweep.sampling to \"sobol\" and sweep.samples to how many to try"
    )]
    TooManyCandidates {
        /// Combinations of the grid.
        got: usize,
        /// The limit.
        most: usize,
    },
    /// A number of samples outside its range.
    #[error("sweep.samples must be from 1 to {most}, got {got}")]
    Samples {
        /// Samples asked for.
        got: usize,
        /// The limit.
        most: usize,
    },
    /// More fields than the sequence has dimensions.
    #[error(
        "sweep.sampling = \"sobol\" spreads samples over at most {most} fields, got {got} fields; use \"random\""
    )]
    TooManyFields {
        /// Swept fields.
        got: usize,
        /// The limit.
        most: usize,
    },
    /// Samples cannot all be different.
    #[error(
        "sweep.samples asks for {got} different settings, and only {there} were found; ask for fewer, or widen sweep.grid"
    )]
    TooFewPoints {
        /// Samples asked for.
        got: usize,
        /// Different ones found.
        there: usize,
    },
    /// A candidate is not a valid agent.
    #[error("sweep.grid: {candidate} is not a valid agent: {reason}")]
    Candidate {
        /// The candidate's label.
        candidate: String,
        /// What is wrong with it.
        reason: String,
    },
    /// No step is left to train on.
    #[error("a run of {steps} steps is too short to train on; raise sweep.steps or give more data")]
    TooShort {
        /// Steps of the stream.
        steps: usize,
    },
    /// Training failed in a unit.
    #[error("{unit}")]
    Agent {
        /// Where.
        unit: Unit,
        /// Why.
        source: AgentError,
    },
    /// Training runs side by side failed.
    #[error("training runs side by side")]
    Together(#[source] AgentError),
    /// The program of external agents failed.
    #[error("{unit}")]
    Program {
        /// Where.
        unit: Unit,
        /// Why.
        source: Box<dyn std::error::Error + Send + Sync>,
    },
    /// A model could not be rolled out.
    #[error(transparent)]
    Model(Arc<ModelError>),
    /// A unit's file could not be read or written.
    #[error(transparent)]
    File(#[from] FileError),
    /// Results that cannot be ranked.
    #[error(transparent)]
    Stats(#[from] StatsError),
    /// Units that a verdict needs have not been run.
    #[error(
        "{missing} of {planned} training runs have no result, such as {example}; run the sweep again to complete it"
    )]
    Incomplete {
        /// Units without a result.
        missing: usize,
        /// Units in the plan.
        planned: usize,
        /// One of them.
        example: Unit,
    },
    /// A run whose scored part has no step with a complete return.
    #[error(
        "{unit} has no step to score: gaps or gamma leave none; use longer runs (sweep.steps), or score the whole run"
    )]
    NothingScored {
        /// Which run.
        unit: Unit,
    },
    /// A stream of an environment that was described and not opened.
    #[error("{0} was not opened here")]
    Closed(EnvironmentId),
    /// The observer asked to stop.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}
