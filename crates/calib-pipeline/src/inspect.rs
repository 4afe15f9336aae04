//! Inspection of a log, and of the data that preprocessing would keep.

use calib_base::{Context as _, StepError, left_alone::text_left_alone, memory, output::Printer};
use calib_data::{Contradictions, DataConfig, DataError, PartProfile, PreprocessConfig, Profile};
use calib_study::Job;
use schemars::JsonSchema;
use serde::Serialize;

use crate::control::{self, InspectedActions};

/// Result of inspecting a log.
#[derive(Debug, Serialize, JsonSchema)]
pub struct Inspection {
    /// Rows, channels, gaps and problems of the log, and the resulting states.
    #[serde(flatten)]
    pub profile: Profile,
    /// Actions and rewards of the log, if the study has `[control]`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub control: Option<InspectedActions>,
    /// How rows that contradict each other are treated.
    #[serde(skip)]
    contradictions: Contradictions,
}

impl Inspection {
    /// Inspects the log of `data`. For a study with `[control]` it also describes the actions and rewards.
    /// Nothing is written.
    ///
    /// # Errors
    /// Returns an error if the log cannot be read, or does not fit into memory.
    pub fn of(
        data: &DataConfig,
        preprocess: &PreprocessConfig,
        job: Option<&Job>,
        printer: &Printer,
    ) -> Result<Self, StepError> {
        printer.say(&format!("inspect: reading {}", data.path.0.join(", ")));
        text_left_alone(data, printer)?;
        memory::check_log(data)?;
        let profile = calib_data::inspect(data, preprocess, &printer.progress())?;
        let control = match job {
            Some(job) => control::inspect(job, printer)?,
            None => None,
        };
        Ok(Self { profile, control, contradictions: data.contradictions })
    }

    /// Returns the error with which a study of the log would be refused, if any.
    pub fn refusal(&self) -> Option<DataError> {
        let found = &self.profile.contradictions;
        let is_refused = found.count > 0 && self.contradictions.refuses();
        is_refused.then(|| DataError::Contradictions {
            count: found.count,
            examples: found.examples.clone(),
            cause: found.cause.clone(),
        })
    }

    /// Whether at least one channel and one transition are left to build from.
    pub fn has_states(&self) -> bool {
        self.profile.train.transitions > 0 && self.profile.kept().next().is_some()
    }
}

/// Returns the data that each of the named `deployments` holds out of a log. Deployments without held-out data
/// are left out.
///
/// # Errors
/// Returns an error if the log lacks the data that one of them holds out.
pub fn inspect_deployments(
    deployments: Vec<(String, DataConfig)>,
    preprocess: &PreprocessConfig,
    printer: &Printer,
) -> Result<Vec<(String, PartProfile)>, StepError> {
    let mut found = Vec::new();
    for (name, data) in deployments {
        let profile = calib_data::inspect(&data, preprocess, &printer.progress())
            .with_context(|| format!("[deployments.{name}]"))?;
        found.extend(profile.held_out.map(|held_out| (name, held_out)));
    }
    Ok(found)
}
