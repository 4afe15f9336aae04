use calib_base::{
    StepError,
    outcome::{Outcome, Told},
    output::{Printer, count},
};
use calib_model::ModelFamily;
use calib_study::{Job, StepKind};
use calib_sweep::Rule;

use crate::model::{
    build_check::recall_line,
    build_plan::BuildPlan,
    built_model::BuiltModel,
    jumps,
    model_files::{MemberSummary, ModelManifest},
    recurrence,
};

impl Told for BuildPlan {
    fn tell(&self, _job: &Job, printer: &Printer) -> Result<(), StepError> {
        if printer.is_json() { printer.json(self) } else { Ok(()) }
    }
}

impl Told for BuiltModel {
    fn outcome(&self) -> Outcome {
        self.verified
    }

    fn tell(&self, job: &Job, printer: &Printer) -> Result<(), StepError> {
        let Self { manifest, directory, freshness, took, .. } = self;
        if printer.is_json() {
            printer.json(manifest)?;
        } else {
            printer.result(&freshness.line(directory, *took))?;
            if let Some(recall) = &manifest.recall {
                let line = recall_line(recall, manifest.study.model.neighbors);
                printer.result(&format!("  {line}"))?;
            }
            for (number, member) in manifest.members.iter().enumerate() {
                show_member(number, member, manifest, printer)?;
            }
            if manifest.study.model.kind.family() == ModelFamily::Neighbors {
                // If log replay decides, problems of a model affect only its rollouts.
                let decides = job.study().evaluate.rule != Rule::LogReplay;
                for warning in self.warnings() {
                    if decides { printer.warn(&warning) } else { printer.detail(&warning) }
                }
            }
        }
        printer.next(&job.next_commands(StepKind::BuildModel));
        Ok(())
    }
}

fn show_member(
    number: usize,
    member: &MemberSummary,
    manifest: &ModelManifest,
    printer: &Printer,
) -> Result<(), StepError> {
    let how = match (manifest.study.model.kind.family(), &manifest.training) {
        (ModelFamily::Neighbors, _) => member.jumps.as_ref().map(jumps::line).unwrap_or_default(),
        (ModelFamily::Network, Some(training)) => training.to_string(),
        (ModelFamily::Network, None) => "imported".to_owned(),
        (ModelFamily::None, _) => String::new(),
    };
    let transitions = count(member.transitions);
    printer.result(&format!("  ensemble member {number}: {transitions} transitions; {how}"))?;
    let recurrences = member.recurrence.iter();
    for line in recurrences.flat_map(|found| recurrence::lines(found, member.transitions)) {
        printer.detail(&format!("    {line}"));
    }
    Ok(())
}
