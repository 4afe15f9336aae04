use calib_base::{
    StepError,
    outcome::{Outcome, Told},
    output::Printer,
};
use calib_study::{Job, StepKind};

use crate::represent::{self, NONE_QUALIFIES, Representations};

impl Told for Representations {
    fn outcome(&self) -> Outcome {
        if self.chosen().is_some() { Outcome::Done } else { Outcome::Negative }
    }

    fn tell(&self, job: &Job, printer: &Printer) -> Result<(), StepError> {
        let Self { manifest, directory, freshness, took } = self;
        if printer.is_json() {
            printer.json(manifest)?;
        } else {
            printer.result(&freshness.line(directory, *took))?;
            represent::show(manifest, printer)?;
        }
        if self.chosen().is_some() {
            printer.next(&job.next_commands(StepKind::Represent));
        } else {
            printer.warn(NONE_QUALIFIES);
        }
        Ok(())
    }
}
