//! Comparison of every two models of a study, in each deployment and over all of them.

use std::path::PathBuf;

use calib_base::StepError;
use calib_model_steps::rollouts::{
    comparison::{self, ComparedModel, Comparison, Pair, PairedModels},
    one_step::{self, OneStepModel, PairedErrors},
};
use schemars::JsonSchema;
use serde::Serialize;

use crate::verdict::judged_model::JudgedModel;

/// Comparisons of models, in `summary.json` of several models.
#[derive(Debug, Default, Serialize, JsonSchema)]
pub(crate) struct Comparisons {
    /// Distances between rollouts and recorded trajectories, paired by start state.
    rollouts: Vec<In<PairedModels>>,
    /// One-step prediction errors, paired by transition.
    one_step: Vec<In<PairedErrors>>,
}

impl Comparisons {
    /// Returns the comparisons of rollouts. With several deployments, those over all deployments
    /// together.
    pub(crate) fn of_all_rollouts(&self) -> Vec<&PairedModels> {
        let most = self.rollouts.iter().map(|group| group.deployments.len()).max();
        let widest = self.rollouts.iter().filter(|group| Some(group.deployments.len()) == most);
        widest.map(|group| &group.compared).collect()
    }
}

/// A comparison of two models, with the deployments that it applies to.
#[derive(Debug, Serialize, JsonSchema)]
pub(crate) struct In<T> {
    /// Deployments that share the comparison; empty for a study without deployments.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    deployments: Vec<String>,
    #[serde(flatten)]
    compared: T,
}

/// The parts of deployments that share all rollouts, which are compared once.
pub(crate) struct SharedRollouts<'a> {
    pub(crate) parts: &'a [&'a JudgedModel],
    /// Their deployments.
    deployments: Vec<String>,
}

/// Returns the groups of all parts, by deployment.
pub(crate) fn groups<'a>(deployments: &'a [Vec<&'a JudgedModel>]) -> Vec<SharedRollouts<'a>> {
    let mut groups: Vec<(Vec<PathBuf>, SharedRollouts<'a>)> = Vec::new();
    for parts in deployments {
        let directories: Vec<PathBuf> =
            parts.iter().map(|part| part.judged.paths().rollout()).collect();
        let name = parts[0].deployment.clone();
        if let Some((_, group)) = groups.iter_mut().find(|(others, _)| *others == directories) {
            group.deployments.extend(name);
        } else {
            let deployments = name.into_iter().collect();
            groups.push((directories, SharedRollouts { parts, deployments }));
        }
    }
    groups.into_iter().map(|(_, group)| group).collect()
}

impl<'a> SharedRollouts<'a> {
    /// Returns its models whose rollouts were compared.
    pub(crate) fn compared(&self) -> Vec<ComparedModel<'a>> {
        self.parts
            .iter()
            .filter_map(|part| {
                let members = part.rollouts.as_ref()?.members.len();
                let name = part.model_name();
                Some(ComparedModel::new(name, members, part.comparison()?, &part.pairs))
            })
            .collect()
    }

    /// Returns its models whose one-step errors are known.
    pub(crate) fn predicting(&self) -> Vec<&OneStepModel> {
        self.parts.iter().filter_map(|part| part.one_step.as_ref()).collect()
    }
}

/// The rollouts of a model in all deployments.
pub(crate) struct Pooled {
    name: String,
    members: usize,
    comparison: Comparison,
    pairs: Vec<Pair>,
}

impl Pooled {
    pub(crate) fn compared(&self) -> ComparedModel<'_> {
        ComparedModel::new(&self.name, self.members, &self.comparison, &self.pairs)
    }
}

/// Returns the rollouts of each model in all deployments. Rollouts that deployments share count
/// once.
pub(crate) fn pooled(deployments: &[Vec<&JudgedModel>]) -> Result<Vec<Pooled>, StepError> {
    let mut models: Vec<Vec<&JudgedModel>> = Vec::new();
    for part in deployments.iter().flatten().filter(|part| part.comparison().is_some()) {
        let directory = part.judged.paths().rollout();
        match models.iter_mut().find(|parts| parts[0].model_name() == part.model_name()) {
            Some(parts)
                if parts.iter().any(|other| other.judged.paths().rollout() == directory) => {}
            Some(parts) => parts.push(part),
            None => models.push(vec![part]),
        }
    }
    let mut all = Vec::new();
    for parts in models {
        let compared = parts.iter().filter_map(|part| Some((part.comparison()?, &*part.pairs)));
        let Some((comparison, pairs)) = comparison::pool(&compared.collect::<Vec<_>>())? else {
            continue;
        };
        let members = parts[0].rollouts.as_ref().map_or(0, |rollouts| rollouts.members.len());
        all.push(Pooled { name: parts[0].model_name().to_owned(), members, comparison, pairs });
    }
    Ok(all)
}

fn within<T>(deployments: &[String], compared: Vec<T>) -> impl Iterator<Item = In<T>> {
    compared.into_iter().map(|compared| In { deployments: deployments.to_vec(), compared })
}

/// Compares every two models in every group. With several groups, also in all deployments together.
pub(crate) fn comparisons(deployments: &[Vec<&JudgedModel>]) -> Result<Comparisons, StepError> {
    let mut all = Comparisons::default();
    let groups = groups(deployments);
    for group in &groups {
        all.rollouts.extend(within(&group.deployments, comparison::all_pairs(&group.compared())?));
        all.one_step.extend(within(&group.deployments, one_step::all_pairs(&group.predicting())?));
    }
    if groups.len() > 1 {
        let pooled = pooled(deployments)?;
        let models: Vec<ComparedModel<'_>> = pooled.iter().map(Pooled::compared).collect();
        let names: Vec<String> =
            groups.iter().flat_map(|group| group.deployments.clone()).collect();
        all.rollouts.extend(within(&names, comparison::all_pairs(&models)?));
    }
    Ok(all)
}
