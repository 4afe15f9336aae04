//! Tables of several models and deployments, beside each other.

use std::path::PathBuf;

use calib_report::{DataProfile, Table};

use super::{
    collapse,
    compare::Part,
    comparison::{self, Comparison},
    evaluate::Judged,
    one_step::{self, OneStep},
    report,
    starts::follow_from_deployment,
};

/// Distances of rollouts, start states, collapse and representations; `deployments` are all parts, by deployment.
pub(super) fn tables(deployments: &[Vec<&Part>]) -> Vec<Table> {
    let mut tables = Vec::new();
    // Deployments that share all rollouts have one table.
    let mut groups: Vec<(Vec<PathBuf>, &Vec<&Part>)> = Vec::new();
    for group in deployments {
        let directories: Vec<PathBuf> =
            group.iter().map(|part| part.judged.paths.rollout()).collect();
        if groups.iter().all(|(of, _)| *of != directories) {
            groups.push((directories, group));
        }
    }
    let several = groups.len() > 1;
    for (_, group) in &groups {
        let all = group
            .iter()
            .filter_map(|part| Some((part.model_name().to_owned(), part.comparison()?)));
        let all: Vec<(String, &Comparison)> = all.collect();
        let mut own = one_step_table(group);
        own.extend(warping_tables(all.iter().map(|(name, of)| (name.as_str(), *of))));
        if several {
            let deployment = group[0].deployment_name();
            for table in &mut own {
                table.title = format!("{} ({deployment})", table.title);
            }
        }
        tables.extend(own);
    }
    if several {
        let all = pooled(deployments);
        let mut own = warping_tables(all.iter().map(|(name, of)| (name.as_str(), of)));
        for table in &mut own {
            table.title = format!("{} (all deployments)", table.title);
        }
        tables.extend(own);
    }
    let mut shown: Vec<PathBuf> = Vec::new();
    for (_, group) in &groups {
        for part in *group {
            let Some(rollouts) = &part.rollouts else { continue };
            let directory = part.judged.paths.rollout();
            if shown.contains(&directory) {
                continue;
            }
            shown.push(directory);
            let name = if several && follow_from_deployment(&part.judged.study) {
                part.in_deployment(part.model_name())
            } else {
                part.model_name().to_owned()
            };
            tables.extend(report::starts_table(&name, rollouts));
            tables.extend(collapse::report_table(&name, &rollouts.collapse));
        }
    }
    for part in &deployments[0] {
        let own = report::representation_table(&part.judged.study, &part.judged.paths);
        tables.extend(own.into_iter().map(|mut table| {
            if let Some(name) = &part.model {
                table.title = format!("{} of {name}", table.title);
            }
            table
        }));
    }
    tables
}

/// One-step errors of the models, side by side.
fn one_step_table(group: &[&Part]) -> Vec<Table> {
    let own = |part: &&Part| {
        let Judged { study, paths, manifest, .. } = &part.judged;
        part.rollouts.as_ref()?;
        Some((part.model_name().to_owned(), one_step::read(study, paths, &manifest.model)?))
    };
    let all: Vec<(String, OneStep)> = group.iter().filter_map(own).collect();
    let all: Vec<(&str, &OneStep)> = all.iter().map(|(name, of)| (name.as_str(), of)).collect();
    one_step::report_table(&all).into_iter().collect()
}

fn warping_tables<'a>(models: impl Iterator<Item = (&'a str, &'a Comparison)>) -> Vec<Table> {
    comparison::report_tables(&models.collect::<Vec<_>>())
}

/// The rollouts of each model in all deployments; those that deployments share count once.
fn pooled(deployments: &[Vec<&Part>]) -> Vec<(String, Comparison)> {
    let mut models: Vec<(String, Vec<PathBuf>, Vec<Comparison>)> = Vec::new();
    for part in deployments.iter().flatten() {
        let (Some(own), directory) = (part.comparison(), part.judged.paths.rollout()) else {
            continue;
        };
        match models.iter_mut().find(|(name, ..)| name == part.model_name()) {
            Some((_, seen, _)) if seen.contains(&directory) => {}
            Some((_, seen, all)) => {
                seen.push(directory);
                all.push(own.clone());
            }
            None => {
                models.push((part.model_name().to_owned(), vec![directory], vec![own.clone()]));
            }
        }
    }
    let pooled = models.into_iter().map(|(name, _, all)| Some((name, comparison::pool(&all)?)));
    pooled.flatten().collect()
}

/// What to know before relying on any of it; what is said of all models of a deployment is said once.
pub(super) fn warnings(parts: &[Part]) -> Vec<String> {
    let mut all = Vec::new();
    for part in parts {
        for warning in &part.report.warnings {
            let mut beside = parts.iter().filter(|other| other.deployment == part.deployment);
            let of_all = beside.all(|other| other.report.warnings.contains(warning));
            let model = part.model.as_ref().filter(|_| !of_all);
            let place: Vec<&str> =
                model.into_iter().chain(&part.deployment).map(String::as_str).collect();
            let told = match place.as_slice() {
                [] => warning.clone(),
                place => format!("{}: {warning}", place.join(", ")),
            };
            if !all.contains(&told) {
                all.push(told);
            }
        }
    }
    all
}

/// The data that the models of one deployment were built from: that of the model that saw most, with what each saw where
/// they differ; and fingerprints.
pub(super) fn data_of_models(group: &[&Part]) -> (Option<DataProfile>, String) {
    let most = group.iter().filter_map(|part| part.report.data.as_ref()).max_by_key(|of| of.rows);
    let mut data = most.cloned();
    let same = |part: &&&Part| {
        part.report.reproduction.fingerprint == group[0].report.reproduction.fingerprint
    };
    if group.iter().all(|part| same(&part)) {
        return (data, group[0].report.reproduction.fingerprint.clone());
    }
    let mut fingerprints = Vec::new();
    for part in group {
        let name = part.model_name();
        fingerprints.push(format!("{name}: {}", part.report.reproduction.fingerprint));
        if let (Some(whole), Some(own)) = (&mut data, &part.report.data) {
            let states =
                format!("{}, {} to {}", calib_report::count(own.rows), own.first, own.last);
            whole.facts.push((format!("{name}: states"), states));
        }
    }
    (data, fingerprints.join("; "))
}
