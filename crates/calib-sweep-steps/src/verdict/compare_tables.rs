//! Tables of several models and deployments, side by side.

use std::path::PathBuf;

use calib_base::StepError;
use calib_model_steps::rollouts::{
    collapse,
    comparison::{self, ComparedModel},
    one_step,
};
use calib_report::{DataProfile, Table};

use crate::verdict::{
    compare_pairs::{Pooled, groups, pooled},
    judged_model::JudgedModel,
    report,
};

/// Returns tables of rollout distances, start states, frozen rollouts and representations. `deployments` are all parts,
/// by deployment.
pub(crate) fn tables(deployments: &[Vec<&JudgedModel>]) -> Result<Vec<Table>, StepError> {
    let mut tables = Vec::new();
    // Deployments that share all rollouts have one table.
    let groups = groups(deployments);
    let several = groups.len() > 1;
    for group in &groups {
        let mut own = one_step::report_tables(&group.predicting())?;
        own.extend(comparison::report_tables(&group.compared())?);
        if several {
            add_place(&mut own, group.parts[0].deployment_name());
        }
        tables.extend(own);
    }
    if several {
        let pooled = pooled(deployments)?;
        let models: Vec<ComparedModel<'_>> = pooled.iter().map(Pooled::compared).collect();
        let mut own = comparison::report_tables(&models)?;
        add_place(&mut own, "all deployments");
        tables.extend(own);
    }
    let mut shown: Vec<PathBuf> = Vec::new();
    for group in &groups {
        for part in group.parts {
            let Some(rollouts) = &part.rollouts else { continue };
            let directory = part.judged.paths().rollout();
            if shown.contains(&directory) {
                continue;
            }
            shown.push(directory);
            let name = if several && part.judged.study().starts_follow_from_deployment() {
                part.in_deployment(part.model_name())
            } else {
                part.model_name().to_owned()
            };
            tables.extend(report::starts_table(&name, rollouts));
            tables.extend(collapse::report_table(&name, &rollouts.collapse));
        }
    }
    for part in &deployments[0] {
        let own = report::representation_table(part.judged.study(), part.judged.paths());
        tables.extend(own.into_iter().map(|mut table| {
            if let Some(name) = &part.model {
                table.title = format!("{} of {name}", table.title);
            }
            table
        }));
    }
    Ok(tables)
}

/// Adds the place that tables are of to their titles.
fn add_place(tables: &mut [Table], place: &str) {
    for table in tables {
        table.title = format!("{} ({place})", table.title);
    }
}

/// Returns the warnings of all parts, each once. A warning that does not hold everywhere names the parts.
pub(crate) fn warnings(parts: &[JudgedModel]) -> Vec<String> {
    let mut all: Vec<&String> = Vec::new();
    for warning in parts.iter().flat_map(|part| &part.report.warnings) {
        if !all.contains(&warning) {
            all.push(warning);
        }
    }
    all.into_iter()
        .map(|warning| {
            match places(parts, |part: &&JudgedModel| part.report.warnings.contains(warning))
                .as_str()
            {
                "" => warning.clone(),
                places => format!("{places}: {warning}"),
            }
        })
        .collect()
}

/// Returns the names of the parts for which `holds` is true. Empty if these are all parts. Uses deployments or models
/// alone if the condition depends only on them.
fn places(parts: &[JudgedModel], holds: impl Fn(&&JudgedModel) -> bool) -> String {
    if parts.iter().all(|part| holds(&part)) {
        return String::new();
    }
    for name in
        [|part: &JudgedModel| part.deployment.clone(), |part: &JudgedModel| part.model.clone()]
    {
        let mut pairs = parts.iter().flat_map(|one| parts.iter().map(move |other| (one, other)));
        let differ =
            pairs.any(|(one, other)| name(one) == name(other) && holds(&one) != holds(&other));
        if !differ {
            let mut names: Vec<String> = Vec::new();
            for name in parts.iter().filter(&holds).filter_map(name) {
                if !names.contains(&name) {
                    names.push(name);
                }
            }
            return names.join(", ");
        }
    }
    parts
        .iter()
        .filter(&holds)
        .map(|part| {
            let names: Vec<&str> =
                part.model.iter().chain(&part.deployment).map(String::as_str).collect();
            names.join(" in ")
        })
        .collect::<Vec<_>>()
        .join("; ")
}

/// Returns the data that the models of one deployment were built from, and their fingerprints. The data is that of the
/// model with the most rows, with the states of each model if they differ.
pub(crate) fn data_of_models(group: &[&JudgedModel]) -> (Option<DataProfile>, String) {
    let most =
        group.iter().filter_map(|part| part.report.data.as_ref()).max_by_key(|data| data.rows);
    let mut data = most.cloned();
    let first = &group[0].report.reproduction.fingerprint;
    if group.iter().all(|part| part.report.reproduction.fingerprint == *first) {
        return (data, first.clone());
    }
    let mut fingerprints = Vec::new();
    for part in group {
        let name = part.model_name();
        fingerprints.push(format!("{name}: {}", part.report.reproduction.fingerprint));
        if let (Some(whole), Some(own)) = (&mut data, &part.report.data) {
            let states = format!("{}, {} to {}", calib_core::count(own.rows), own.first, own.last);
            whole.facts.push((format!("{name}: states"), states));
        }
    }
    (data, fingerprints.join("; "))
}
