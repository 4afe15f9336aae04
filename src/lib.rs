//! calib: which hyperparameters to deploy, from a plant's logs alone.
//!
//! This crate is the command line: what may be typed (`cli`), what it asks of the pipeline (`commands`), and what is
//! read of it (`output`). What is computed, and in which order, is in `calib-pipeline`.

mod cli;
mod commands;
mod exit;
mod faults;
mod output;
#[cfg(unix)]
mod signals;

use std::{
    borrow::Cow,
    ffi::OsString,
    io::{self, Write as _},
    panic,
    process::ExitCode,
    sync::Arc,
};

use calib_pipeline::{Observer, Printer};
use clap::Parser as _;

pub use cli::Cli;
pub use commands::json_schemas;
pub use exit::ExitStatus;

/// Run the command line `args` and return the status to exit with.
pub fn run(args: impl IntoIterator<Item = OsString>) -> ExitCode {
    ExitCode::from(exit_code(args))
}

/// As [`run`]: the status as a number.
pub fn exit_code(args: impl IntoIterator<Item = OsString>) -> u8 {
    let cli = match Cli::try_parse_from(args) {
        Ok(cli) => cli,
        Err(error) => {
            // Help and version are results; everything else is a usage error, which clap numbers 2.
            let plain = error.render().to_string();
            // An argument may hold what a terminal obeys: then all of it is printed without clap's colours.
            match output::harmless(&plain, output::Lines::Several) {
                Cow::Owned(safe) => drop(io::stderr().write_all(safe.as_bytes())),
                Cow::Borrowed(_) => drop(error.print()),
            }
            return error.exit_code() as u8;
        }
    };
    let terminal = output::Terminal::new(cli.global.color);
    let journal = match output::Journal::open(
        terminal,
        output::Verbosity::of(&cli.global),
        cli.global.log.as_deref(),
    ) {
        Ok(journal) => Arc::new(journal),
        Err(error) => return exit::report(&error, &terminal) as u8,
    };
    // What is not to be shown is not shown by the journal: a file of it keeps all.
    let printer = Printer::new(Arc::clone(&journal) as Arc<dyn Observer>);
    #[cfg(unix)]
    signals::tell_of_lost_pages();
    hush_readers();
    let outcome = panic::catch_unwind(panic::AssertUnwindSafe(|| {
        faults::arm()?;
        let printer = commands::explaining(&printer, cli.global.verbose);
        commands::run(cli, &printer)
    }));
    let status = match outcome {
        Ok(Ok(outcome)) => outcome.into(),
        Ok(Err(error)) => exit::report(&error, &*journal),
        Err(_) => {
            printer
                .error("this is a bug in calib: please report the message above and the command");
            ExitStatus::Internal
        }
    };
    status as u8
}

/// The Parquet reader's panics on damaged files are errors of the file, and told as such.
fn hush_readers() {
    let usual = panic::take_hook();
    panic::set_hook(Box::new(move |panic| {
        if !calib_data::is_reading_parquet() {
            usual(panic);
        }
    }));
}
