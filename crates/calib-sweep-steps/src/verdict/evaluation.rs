//! The result of `evaluate`.

use calib_base::{StepError, log::context::RunContext, outcome::StepResult};
use calib_study::Job;
use calib_sweep::SensorVerdict;
use serde::{Serialize, Serializer};

use crate::{
    sweep::candidates::require_predicting,
    verdict::{
        compare::{self, Compared},
        evaluate::{self, Judgement},
    },
};

/// The verdicts on a study. As JSON it is the contents of `summary.json`.
#[derive(Debug)]
pub enum Evaluation {
    /// The study has one model and one deployment, or one of each was selected.
    Judged(Box<Judgement>),
    /// The study has several models or deployments.
    Compared(Box<Compared>),
}

/// Judges the finished sweeps of the `parts` of a job, and writes the reports. They warn about models that were
/// `left_out`.
///
/// # Errors
/// Returns an error if a sweep is not finished, not of this study or damaged, a report cannot be written, or the
/// observer asks to stop.
pub fn run(
    job: &Job,
    parts: &[Job],
    left_out: &[String],
    context: &RunContext,
) -> Result<StepResult<Evaluation>, StepError> {
    require_predicting(job.study())?;
    Ok(match parts {
        [only] if only.is_same_part(job) => {
            evaluate::run(job, context)?.map(|judged| Evaluation::Judged(Box::new(judged)))
        }
        parts => compare::run(job, parts, left_out, context)?
            .map(|compared| Evaluation::Compared(Box::new(compared))),
    })
}

impl Evaluation {
    /// Returns the verdict on each sensor, for all models and deployments in the order of judgement.
    pub fn verdicts(&self) -> Vec<&SensorVerdict> {
        match self {
            Self::Judged(judged) => judged.verdicts().iter().collect(),
            Self::Compared(compared) => {
                let summaries = compared.places.iter().filter_map(|place| compared.at(place));
                summaries.flat_map(|summary| &summary.verdicts).collect()
            }
        }
    }
}

impl Serialize for Evaluation {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Judged(judged) => judged.summary.serialize(serializer),
            Self::Compared(compared) => compared.summaries.serialize(serializer),
        }
    }
}
