//! calib chooses the hyperparameters to deploy, from a plant's logs alone.
//!
//! This crate is the command line: its grammar (`cli`), its commands (`commands`) and its output (`output`). The
//! computations and their order are in `calib-pipeline`.

mod cli;
mod commands;
mod exit;
mod exit_status;
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
pub use exit_status::ExitStatus;

/// Runs the command line `args`, and returns the exit status.
pub fn run(args: impl IntoIterator<Item = OsString>) -> ExitCode {
    ExitCode::from(exit_code(args))
}

/// Runs the command line `args` as [`run`] does, and returns the status as a number.
pub fn exit_code(args: impl IntoIterator<Item = OsString>) -> u8 {
    let cli = match Cli::try_parse_from(args) {
        Ok(cli) => cli,
        Err(error) => {
            // Help and version are results. Everything else is a usage error, for which clap uses code 2.
            let plain = error.render().to_string();
            // An argument may contain control sequences for the terminal. Then the
            // whole text is printed without clap's colours.
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
    // The journal hides what the terminal must not show, and its file keeps everything.
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

/// Hides panics of the Parquet reader. On damaged files they are reported as errors of the file.
fn hush_readers() {
    let usual = panic::take_hook();
    panic::set_hook(Box::new(move |panic| {
        if !calib_data::is_reading_parquet() {
            usual(panic);
        }
    }));
}
