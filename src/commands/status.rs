//! `calib status`: once, repeatedly, or as a page.

use std::{
    io::{self, IsTerminal as _, Write as _},
    thread,
    time::Duration,
};

use calib_pipeline::{Outcome, Printer, StatusRequest, StepError};

use super::serve::Page;
use crate::{
    cli::{Address, StatusArgs, StudyArgs},
    output::is_asked_to_stop,
};

/// Interval between outputs of `--watch`.
const EVERY: Duration = Duration::from_secs(2);
/// Interval between checks whether to stop.
const STEP: Duration = Duration::from_millis(100);

/// Reports the status of a study, a result folder or a plan.
pub(super) fn run(args: StatusArgs, printer: &Printer) -> Result<Outcome, StepError> {
    let watch = args.watch;
    let serve = args.serve;
    let request = StatusRequest::from(args);
    let standing = calib_pipeline::status(&request, printer)?;
    if let Some(address) = serve {
        let page = Page::open(request, address, printer)?;
        printer.say("Ctrl-C ends it");
        while !is_asked_to_stop() {
            thread::sleep(STEP);
        }
        drop(page);
        return Ok(Outcome::Done);
    }
    standing.tell(printer)?;
    let mut is_running = standing.is_running();
    while watch && is_running && wait(EVERY) {
        let standing = calib_pipeline::status(&request, printer)?;
        if io::stdout().is_terminal() {
            // This moves the cursor to the top left corner and clears the screen.
            let _ = write!(io::stdout(), "\x1b[H\x1b[2J");
        } else {
            printer.result("")?;
        }
        standing.tell(printer)?;
        is_running = standing.is_running();
    }
    Ok(Outcome::Done)
}

/// Opens the page of a study that is about to run.
pub(super) fn page_of(
    study: &StudyArgs,
    address: Address,
    printer: &Printer,
) -> Result<Page, StepError> {
    let request = StatusRequest {
        path: study.study.clone(),
        set: study.set.clone(),
        profile: study.profile.clone(),
        output: study.output.clone(),
    };
    Page::open(request, address, printer)
}

/// Waits for `span`, and returns whether no request to stop came meanwhile.
fn wait(span: Duration) -> bool {
    let mut waited = Duration::ZERO;
    while waited < span && !is_asked_to_stop() {
        thread::sleep(STEP);
        waited += STEP;
    }
    !is_asked_to_stop()
}
