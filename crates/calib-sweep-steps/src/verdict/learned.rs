//! The training data of a sensor's agents: the states of the model, or of the replayed log without one.

use calib_base::{
    Context as _, StepError, artefact, ensure,
    log::profile_file::{self, PROFILE},
};
use calib_core::{Period, Timestamp};
use calib_data::Profile;
use calib_model_steps::model::model_files::{self, ModelManifest};
use calib_study::{Job, StepKind};

use crate::sweep::{LearnedStates, SweepManifest};

/// Returns the profile of the data.
pub(crate) fn profile(job: &Job) -> Result<Profile, StepError> {
    let paths = job.layout();
    if job.study().has_model() {
        model_files::read_profile(&paths.model())
    } else {
        profile_file::read(&paths.sweep(), &job.command(StepKind::Sweep))
    }
}

/// The data, and the parts of it that were kept.
pub(crate) struct Learned {
    pub(crate) profile: Profile,
    /// The manifest of the model. `None` for a study without one.
    pub(crate) model: Option<ModelManifest>,
    pub(crate) rows: usize,
    pub(crate) segments: usize,
    pub(crate) period: Period,
    /// Times of the first and the last state, if they are known.
    times: Option<[Timestamp; 2]>,
}

impl Learned {
    /// Returns the training data of a finished sweep.
    ///
    /// # Errors
    /// Returns an error if the model is missing, or the profile is damaged.
    pub(crate) fn of(job: &Job, sweep: &SweepManifest) -> Result<Self, StepError> {
        if job.study().has_model() { Self::of_model(job) } else { Self::of_log(job, sweep) }
    }

    fn of_model(job: &Job) -> Result<Self, StepError> {
        let directory = job.layout().model();
        let build = job.command(StepKind::BuildModel);
        let model: ModelManifest = artefact::require(&directory, &build)?;
        if !model_files::has_profile(&model, &directory) {
            return Err(StepError::Stale(format!(
                "profile.json of the model in {} is not what was written; run `{build}` to make it again",
                directory.display()
            )));
        }
        Ok(Self {
            profile: profile(job)?,
            rows: model.rows,
            segments: model.segments,
            period: model.period,
            times: model.times,
            model: Some(model),
        })
    }

    fn of_log(job: &Job, sweep: &SweepManifest) -> Result<Self, StepError> {
        let directory = job.layout().sweep();
        let again = job.command(StepKind::Sweep);
        ensure!(
            profile_file::is_whole(&directory, sweep.files.get(PROFILE)),
            "{PROFILE} of the sweep in {} is not what was written; run `{again} --force` to make it again",
            directory.display()
        );
        let LearnedStates { rows, segments, times } =
            sweep.learned.context("the sweep does not say what it learned from")?;
        let profile = profile(job)?;
        let period = sweep.period;
        Ok(Self { profile, model: None, rows, segments, period, times })
    }

    /// Returns the times of the first and the last state. Agents may be pre-trained on the rest of the training
    /// range.
    pub(crate) fn times(&self) -> [Timestamp; 2] {
        let train = &self.profile.train;
        self.times.unwrap_or([train.start, train.end])
    }
}
