//! `calib status`: once, again and again, or as a page.

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

/// Between two looks of `--watch`.
const EVERY: Duration = Duration::from_secs(2);
/// Between two looks at whether to stop.
const STEP: Duration = Duration::from_millis(100);

/// Say how what is asked for stands.
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
            // Home, and everything below it gone.
            let _ = write!(io::stdout(), "\x1b[H\x1b[2J");
        } else {
            printer.result("")?;
        }
        standing.tell(printer)?;
        is_running = standing.is_running();
    }
    Ok(Outcome::Done)
}

/// The page of a study that is about to run.
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

/// Wait so long; whether nobody asked to stop meanwhile.
fn wait(span: Duration) -> bool {
    let mut waited = Duration::ZERO;
    while waited < span && !is_asked_to_stop() {
        thread::sleep(STEP);
        waited += STEP;
    }
    !is_asked_to_stop()
}
