use calib_base::{StepError, outcome::Told, output::Printer};
use calib_study::{Job, StepKind};

use crate::{
    model::jumps,
    rollouts::{
        collapse, comparison, one_step,
        rollout::{RolloutManifest, Rollouts},
    },
};

impl Told for Rollouts {
    fn tell(&self, job: &Job, printer: &Printer) -> Result<(), StepError> {
        let Self { manifest, one_step, directory, freshness, took } = self;
        if printer.is_json() {
            printer.json(manifest)?;
        } else {
            printer.result(&freshness.line(directory, *took))?;
            show(manifest, job, printer)?;
            if let Some(one_step) = one_step {
                one_step::show(one_step, printer)?;
            }
        }
        printer.next(&job.next_commands(StepKind::Rollout));
        Ok(())
    }
}

fn show(manifest: &RolloutManifest, job: &Job, printer: &Printer) -> Result<(), StepError> {
    for (number, member) in manifest.members.iter().enumerate() {
        let replaced = member.starts.text().map_or_else(String::new, |text| format!("; {text}"));
        let moves = member.jumps.as_ref().map_or_else(|| "predictions".to_owned(), jumps::line);
        printer.result(&format!("  ensemble member {number}: {moves}{replaced}"))?;
    }
    let members = manifest.members.iter();
    let members = members.map(|member| (member.jumps.as_ref(), member.transitions));
    let study = job.study();
    for warning in jumps::warnings(members, &study.model, study.sweep.steps) {
        printer.warn(&warning);
    }
    collapse::show(&manifest.collapse, printer)?;
    match &manifest.comparison {
        Some(comparison) => comparison::show(comparison, printer),
        None => Ok(()),
    }
}
