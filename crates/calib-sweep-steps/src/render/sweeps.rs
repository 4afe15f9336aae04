use calib_base::{
    StepError,
    outcome::Told,
    output::{Printer, counted, duration, table},
};
use calib_study::{Job, StepKind};

use crate::sweep::{Swept, plan::SweepPlan};

impl Told for SweepPlan {
    fn tell(&self, _job: &Job, printer: &Printer) -> Result<(), StepError> {
        if printer.is_json() {
            return printer.json(self);
        }
        let mut rows = Vec::new();
        for candidate in &self.candidates {
            let note = if candidate.is_default { "the default" } else { "" };
            rows.push(vec![candidate.label(), candidate.index.to_string(), note.to_owned()]);
        }
        printer.lines(&table(&["setting", "number", ""], &rows))
    }
}

impl Told for Swept {
    fn tell(&self, job: &Job, printer: &Printer) -> Result<(), StepError> {
        if printer.is_json() {
            printer.json(&self.manifest)?;
        } else {
            let did = match self.ran {
                0 if self.rewrote => {
                    "training runs are up to date, their tables are written again".to_owned()
                }
                0 => "up to date".to_owned(),
                _ => format!(
                    "{} made in {}",
                    counted(self.ran_runs, "training run"),
                    duration(self.took)
                ),
            };
            let runs = self.directory.join("runs.parquet");
            printer.result(&format!("{did}; results in {}", runs.display()))?;
        }
        printer.next(&job.next_commands(StepKind::Sweep));
        Ok(())
    }
}
