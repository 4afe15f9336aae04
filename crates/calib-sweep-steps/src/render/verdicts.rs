use calib_base::{
    StepError,
    outcome::{Outcome, Told},
    output::Printer,
};
use calib_model_steps::rollouts::comparison;
use calib_study::{Job, StepKind};

use crate::{
    sweep::simple,
    verdict::{
        compare::Compared,
        deployed,
        evaluate::{self, Judgement},
        evaluation::Evaluation,
        judged::{SensorChoice, Summary},
    },
};

impl Told for Evaluation {
    fn outcome(&self) -> Outcome {
        match self {
            Self::Judged(judged) => judged.outcome(),
            Self::Compared(compared) => compared.outcome(),
        }
    }

    fn tell(&self, job: &Job, printer: &Printer) -> Result<(), StepError> {
        match self {
            Self::Judged(judged) => judged.tell(job, printer),
            Self::Compared(compared) => compared.tell(job, printer),
        }
    }
}

impl Told for Judgement {
    fn outcome(&self) -> Outcome {
        evaluate::outcome_of(&self.summary)
    }

    fn tell(&self, job: &Job, printer: &Printer) -> Result<(), StepError> {
        show_judgement(self, printer)?;
        if printer.is_json() {
            return Ok(());
        }
        if !printer.is_explaining() {
            printer.say(&format!("reasons: {} --why", job.command(StepKind::Evaluate)));
        }
        if self.summary.choices.iter().any(SensorChoice::is_simple) {
            printer.say(&format!(
                "the simple predictors: {}, which calib_rl.agents.SimplePredictor opens in Python",
                job.layout().sweep().join(simple::FILE).display()
            ));
        }
        Ok(())
    }
}

/// Prints the verdicts, the notes and the path of the report.
///
/// # Errors
/// Returns an error if they cannot be printed.
pub fn show_judgement(judged: &Judgement, printer: &Printer) -> Result<(), StepError> {
    let summary = &judged.summary;
    if printer.is_json() {
        return printer.json(summary);
    }
    show_predicted(summary, printer)?;
    show_advice(summary, printer)?;
    show_notes(&[&summary.caveats[..], &summary.notes].concat(), printer)?;
    match &judged.report {
        Some(report) => printer.result(&format!("report: {}", report.display())),
        None => Ok(()),
    }
}

impl Told for Compared {
    fn outcome(&self) -> Outcome {
        self.outcome
    }

    fn tell(&self, _job: &Job, printer: &Printer) -> Result<(), StepError> {
        let Self { summaries, places, choices, notes, report, .. } = self;
        if printer.is_json() {
            return printer.json(summaries);
        }
        if let Some(first) = places.first().and_then(|place| self.at(place)) {
            show_predicted(first, printer)?;
        }
        for place in places {
            printer.result(&format!("{}:", place.name))?;
            if let Some(summary) = self.at(place) {
                show_advice(summary, printer)?;
            }
        }
        printer.lines(choices)?;
        comparison::show_pairs(&summaries.comparisons.of_all_rollouts(), printer)?;
        deployed::show(&summaries.what_to_deploy, printer)?;
        show_notes(notes, printer)?;
        printer.result(&format!("report: {}", report.display()))
    }
}

/// Prints what agents predict.
fn show_predicted(summary: &Summary, printer: &Printer) -> Result<(), StepError> {
    summary.predicts.as_ref().map_or(Ok(()), |predicts| printer.result(predicts))
}

/// Prints the verdict on each sensor: what to deploy and what that means, or all reasons.
fn show_advice(summary: &Summary, printer: &Printer) -> Result<(), StepError> {
    for (lines, plain) in summary.advice.iter().zip(&summary.plain) {
        let Some((headline, reasons)) = lines.split_first() else { continue };
        printer.result(headline)?;
        printer.result(&format!("    {plain}"))?;
        if printer.is_explaining() {
            for line in reasons {
                printer.result(&format!("    {line}"))?;
            }
        }
    }
    Ok(())
}

/// Prints what the reader must know before relying on the verdicts.
fn show_notes(notes: &[String], printer: &Printer) -> Result<(), StepError> {
    for note in notes {
        printer.result(&format!("note: {note}"))?;
    }
    Ok(())
}
