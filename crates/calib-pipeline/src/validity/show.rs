//! Prints the results of `validity`, or its plan.

use std::time::Duration;

use calib_agent::Part;
use calib_base::{
    StepError,
    outcome::{Outcome, Told},
    output::{Printer, counted, duration, percent, results, table},
};
use calib_report::Table;
use calib_validity::{CAP, FEWEST_PLANTS, Validity};

use super::{
    answer::{JudgedStudies, Score, SharedPlants, ValidityAnswer},
    claims::findings,
    plan::{PlannedPlant, PlantState, ValidityPlan},
    tables,
    task::Task,
};

impl Told<()> for ValidityAnswer {
    fn outcome(&self) -> Outcome {
        match self {
            Self::Judged(judged) => judged.outcome(),
            Self::Shared(shared) => shared.outcome(),
        }
    }

    fn tell(&self, subject: &(), printer: &Printer) -> Result<(), StepError> {
        match self {
            Self::Judged(judged) => judged.tell(subject, printer),
            Self::Shared(shared) => shared.tell(subject, printer),
        }
    }
}

impl Told<()> for JudgedStudies {
    fn tell(&self, _of: &(), printer: &Printer) -> Result<(), StepError> {
        if printer.is_json() {
            return printer.json(&self.summary());
        }
        show(self, printer)?;
        printer.result(&format!("report: {}", self.report.display()))
    }
}

impl Told<()> for SharedPlants {
    fn outcome(&self) -> Outcome {
        if self.left_out.is_empty() { Outcome::Done } else { Outcome::Negative }
    }

    fn tell(&self, _of: &(), printer: &Printer) -> Result<(), StepError> {
        let Self { share, plants, left_out } = self;
        printer.result(&format!(
            "share {share}: {} of {} run; when all shares are, the same command without --share judges them",
            plants - left_out.len(),
            counted(*plants, "plant"),
        ))
    }
}

impl Told<()> for ValidityPlan {
    fn tell(&self, _of: &(), printer: &Printer) -> Result<(), StepError> {
        let header = ["plant", "optimiser", "agent", "gamma", "steps", "batch", "models"];
        let rows: Vec<Vec<String>> = self.plants.iter().map(planned).collect();
        printer.lines(&table(&header, &rows))?;
        let all = self.plants.len();
        let left = self.left().len() as u32;
        let swept = self.swept();
        let estimate = if swept > 0 && left > 0 {
            let left = Duration::from_secs_f64(self.swept_secs / swept as f64) * left;
            format!(
                "; about {} if their sweeps take as long as those that are done",
                duration(left)
            )
        } else {
            String::new()
        };
        printer.result(&format!("{left} of {all} plants are to be run{estimate}"))?;
        printer.say(&format!("dry run: would write {}", self.directory.display()));
        Ok(())
    }
}

/// Returns a plant with its task and state.
fn planned(PlannedPlant { plant, task, state }: &PlannedPlant) -> Vec<String> {
    let Task { optimiser, gamma, steps, batch_size, agent } = task;
    let state = match state {
        PlantState::LeftOut(reason) => format!("left out: {reason}"),
        PlantState::Left(left) => format!("{left} to be run"),
        PlantState::Swept => "swept".to_owned(),
    };
    let names = [plant.clone(), (*optimiser).to_owned(), agent.clone()];
    let numbers = [gamma.to_string(), steps.to_string(), batch_size.to_string()];
    names.into_iter().chain(numbers).chain([state]).collect()
}

fn show(judged: &JudgedStudies, printer: &Printer) -> Result<(), StepError> {
    printer.result(&subtitle(judged))?;
    for (number, score) in judged.scores.iter().enumerate() {
        printer.result("")?;
        printer.result(&of_score(score))?;
        for table in tables::of_score(&score.validity) {
            print(&table, printer)?;
        }
        if number == 0 {
            printer.result("")?;
            for finding in findings(&score.validity) {
                printer.result(&finding)?;
            }
        }
    }
    printer.result("")?;
    for note in notes(judged) {
        printer.result(&note)?;
    }
    Ok(())
}

fn print(shown: &Table, printer: &Printer) -> Result<(), StepError> {
    printer.result("")?;
    printer.result(&shown.title)?;
    printer.lines(&results(shown))
}

/// Returns a line on the judged plants.
pub(super) fn subtitle(judged: &JudgedStudies) -> String {
    let validity = judged.validity();
    let drawn = judged.protocol.as_ref().map_or_else(String::new, |protocol| {
        format!("{}, plants and tasks drawn with the seed {}: ", protocol.file, protocol.seed)
    });
    format!(
        "{drawn}{} of {}, {} of the grid; intervals over plants",
        counted(validity.pairs, "plant–sensor pair"),
        counted(validity.plants.len(), "plant"),
        counted(validity.values.len(), "setting"),
    )
}

/// Returns a line that describes a score.
pub(super) fn of_score(Score { part, validity }: &Score) -> String {
    let scored = match part {
        Part::WholeRun => "By the errors of all steps",
        Part::AfterFirstQuarter => "By the errors after the first quarter",
        Part::FinalQuarter => "By the errors of the final quarter",
    };
    format!(
        "{scored}: {} of {}",
        counted(validity.pairs, "pair"),
        counted(validity.plants.len(), "plant")
    )
}

/// Returns notes: what is left out, and warnings.
pub(super) fn notes(judged: &JudgedStudies) -> Vec<String> {
    let validity = judged.validity();
    let mut notes: Vec<String> = Vec::new();
    if !judged.left_out.is_empty() {
        let each = judged.left_out.iter().map(|plant| format!("{}: {}", plant.plant, plant.reason));
        let all = judged.left_out.len() + judged.plants.len();
        let each = each.collect::<Vec<_>>().join("; ");
        notes.push(format!("{} of {all} plants are left out ({each})", judged.left_out.len()));
    }
    notes.extend(judged.missing.iter().cloned());
    notes.extend(
        validity
            .left_out
            .iter()
            .map(|pair| format!("{pair} is left out: every setting diverged on held-out data; add smaller learning rates to its sweep.grid")),
    );
    if validity.not_learnt > 0 {
        notes.push(format!(
            "in {} of {} pairs even the best setting predicts no better than the mean return, so the choice matters little there",
            validity.not_learnt, validity.pairs
        ));
    }
    notes.extend(capped(validity));
    if validity.plants.len() < FEWEST_PLANTS {
        notes.push(format!("intervals over plants need at least {FEWEST_PLANTS} of them"));
    }
    notes
}

/// Returns a note on the number of regrets that are capped.
fn capped(validity: &Validity) -> Option<String> {
    let each: Vec<String> = validity
        .methods
        .iter()
        .filter(|method| method.capped > 0)
        .map(|method| format!("{} of {}", method.capped, method.method))
        .collect();
    (!each.is_empty()).then(|| {
        format!(
            "regrets above {} count as that, also of choices that diverged: {}",
            percent(CAP),
            each.join(", ")
        )
    })
}
