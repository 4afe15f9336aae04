//! One of several models and deployments, judged.

use calib_base::{StepError, log::context::RunContext};
use calib_core::Monitor;
use calib_model_steps::rollouts::{
    comparison::{self, Comparison, Pair},
    figures::FirstRollouts,
    one_step::OneStepModel,
    rollout::{self, RolloutManifest},
};
use calib_report::Report;
use calib_study::Job;

use crate::verdict::{evaluate::judge, judged::Judged, report};

/// A model in a deployment, with all results about it.
pub(crate) struct JudgedModel {
    pub(crate) model: Option<String>,
    pub(crate) deployment: Option<String>,
    pub(crate) judged: Judged,
    pub(crate) report: Report,
    pub(crate) rollouts: Option<RolloutManifest>,
    /// Distances of its rollouts from the recorded log.
    pub(crate) pairs: Vec<Pair>,
    pub(crate) one_step: Option<OneStepModel>,
    pub(crate) starts: Vec<FirstRollouts>,
}

impl JudgedModel {
    pub(crate) fn new(
        job: &Job,
        context: &RunContext,
        monitor: &dyn Monitor,
    ) -> Result<Self, StepError> {
        let judged = judge(job, context, monitor)?;
        let paths = job.layout();
        let manifest = &judged.manifest;
        let report = report::assemble(&judged)?;
        let rollouts = rollout::finished(job, manifest.model.as_deref())?;
        let model = job.model().map(str::to_owned);
        let deployment = job.deployment().map(str::to_owned);
        let mut starts = match &rollouts {
            Some(rollouts) => report::rollout_figures(paths, rollouts)?.1,
            None => Vec::new(),
        };
        for own in &mut starts {
            let known = report.recorded.iter().find(|figure| figure.sensor == own.sensor);
            own.unit = known.and_then(|figure| figure.unit.clone());
        }
        let compared = rollouts.as_ref().and_then(|made| made.comparison.as_ref());
        let pairs = match compared {
            Some(_) => comparison::read(job)?,
            None => Vec::new(),
        };
        let one_step = match &rollouts {
            Some(rollouts) => OneStepModel::read(job.model_name(), job, &rollouts.model)?,
            None => None,
        };
        Ok(Self { model, deployment, judged, report, rollouts, pairs, one_step, starts })
    }

    pub(crate) fn comparison(&self) -> Option<&Comparison> {
        self.rollouts.as_ref()?.comparison.as_ref()
    }

    /// Returns the name of its model.
    pub(crate) fn model_name(&self) -> &str {
        self.judged.job.model_name()
    }

    /// Returns the name of its deployment. Empty if there is only one.
    pub(crate) fn deployment_name(&self) -> &str {
        self.deployment.as_deref().unwrap_or_default()
    }

    /// Returns the name of a sensor with its deployment.
    pub(crate) fn in_deployment(&self, sensor: &str) -> String {
        match &self.deployment {
            Some(deployment) => format!("{sensor} ({deployment})"),
            None => sensor.to_owned(),
        }
    }
}

/// Groups the parts by deployment, in the order in which deployments first appear.
pub(crate) fn by_deployment(parts: &[JudgedModel]) -> Vec<Vec<&JudgedModel>> {
    let mut groups: Vec<Vec<&JudgedModel>> = Vec::new();
    for part in parts {
        match groups.iter_mut().find(|group| group[0].deployment == part.deployment) {
            Some(group) => group.push(part),
            None => groups.push(vec![part]),
        }
    }
    groups
}
