use calib_base::{
    StepError,
    outcome::{Outcome, Told},
    output::{Printer, duration},
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
            let verb = freshness.verb();
            let place = directory.display();
            let time = duration(*took);
            printer.result(&format!("{verb} {place} in {time}"))?;
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
