//! Sweeps that were begun for a study, and how the study has changed since.

use calib_base::{StepError, artefact, output::count, stale::StoredArtefact};
use calib_study::{Difference, Job, Scope, StepKind};
use calib_sweep_steps::sweep::{SweepManifest, planned::PlannedSweep};

use super::{
    ranking::{Ranking, rankings},
    show::in_brackets,
    standing::StepStanding,
};

/// The sweep of one model and deployment, finished or not.
pub(super) struct BegunSweep {
    part: Job,
    planned: PlannedSweep,
    /// The settings for each sensor, ranked by the stored runs.
    pub(super) rankings: Vec<Ranking>,
}

impl BegunSweep {
    /// Returns the sweeps of a study, in order.
    ///
    /// # Errors
    /// Returns an error if the study cannot be divided into its models and deployments, or settings cannot be ranked.
    pub(super) fn all_of(job: &Job) -> Result<Vec<Self>, StepError> {
        let mut begun = Vec::new();
        for part in job.parts(Scope::Deployment)? {
            let directory = part.layout().sweep();
            let Some(planned) = PlannedSweep::read(&directory) else { continue };
            let names = (part.model(), part.deployment());
            let rankings = rankings(&planned, &planned.stored_in(&directory), names)?;
            begun.push(Self { part, planned, rankings });
        }
        Ok(begun)
    }

    /// Whether `step` makes this sweep.
    pub(super) fn is_of(&self, step: &StepStanding) -> bool {
        step.step == StepKind::Sweep.label()
            && (step.model.as_deref(), step.deployment.as_deref()) == self.names()
    }

    /// Returns the model and the deployment.
    fn names(&self) -> (Option<&str>, Option<&str>) {
        (self.part.model(), self.part.deployment())
    }

    /// Returns a message on the keys that changed since, and on what to run.
    fn stale_reason(&self) -> Option<String> {
        let directory = &self.part.layout().sweep();
        let study = self.planned.study()?;
        StoredArtefact { step: StepKind::Sweep, study, directory }.stale_reason(&self.part)
    }

    /// Returns why the sweep is to do: changed keys, missing files, or missing runs. `None` if this is not known, for
    /// example with another log.
    pub(super) fn why_to_do(&self) -> Option<String> {
        self.stale_reason().or_else(|| self.lacks_files()).or_else(|| self.unfinished())
    }

    /// Returns a message on how many runs exist, if some are missing.
    fn unfinished(&self) -> Option<String> {
        let [made, all]: [usize; 2] =
            [0, 1].map(|which| self.rankings.iter().map(|ranking| ranking.runs[which]).sum());
        (made < all).then(|| {
            let (model, deployment) = self.names();
            let part = in_brackets(model, deployment);
            format!("sweep{part}: {} of {} training runs are made", count(made), count(all))
        })
    }

    /// Returns a message if files of the finished sweep are missing.
    fn lacks_files(&self) -> Option<String> {
        let directory = self.part.layout().sweep();
        let made = artefact::read::<SweepManifest>(&directory)?;
        let is_whole = made.has_files(&directory) && made.missing_runs(&directory).is_empty();
        (!is_whole).then(|| {
            format!(
                "files are missing from {}: `calib check` names them, and `{}` makes them again",
                directory.display(),
                self.part.run_command()
            )
        })
    }

    /// Returns the keys that changed since the sweep began.
    pub(super) fn differences(&self) -> Vec<Difference> {
        let made = self.planned.study();
        made.map_or_else(Vec::new, |made| self.part.study().differences(StepKind::Sweep, made))
    }

    /// Whether the stored runs for a sensor match the current study. They do not depend on the discount factor of
    /// another sensor, nor on the other sensors in the list.
    pub(super) fn has_runs_for(&self, sensor: &str, differences: &[Difference]) -> bool {
        let sensors = &self.part.study().sweep.sensors;
        let is_listed = sensors.is_empty() || sensors.iter().any(|listed| listed == sensor);
        let mut keys = differences.iter().map(|difference| difference.key.as_str());
        is_listed
            && keys.all(|key| {
                let other = key.strip_prefix("agent.gammas.").is_some_and(|other| other != sensor);
                other || key == "sweep.sensors"
            })
    }
}
