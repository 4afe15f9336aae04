//! calib: which hyperparameters to deploy, from a plant's logs alone.
//!
//! This crate is the command line: it reads a study, calls the workspace's crates in the order
//! in which data flows, and writes what they return. The way is
//! log files → frames → states → neighbour tables → streams → runs → ranks → verdict → report;
//! each file in `commands` shows its part of it on one screen.

mod cli;
mod clock;
mod commands;
mod exit;
mod faults;
mod memory;
mod output;
#[cfg(unix)]
mod signals;

use std::{
    borrow::Cow,
    ffi::OsString,
    io::{self, Write as _},
    panic,
    process::ExitCode,
};

use clap::Parser as _;

pub use cli::Cli;
pub use exit::ExitStatus;

/// Run the command line `args` and return the status to exit with.
pub fn run(args: impl IntoIterator<Item = OsString>) -> ExitCode {
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
            return ExitCode::from(error.exit_code() as u8);
        }
    };
    let printer = output::Printer::new(&cli.global);
    #[cfg(unix)]
    signals::tell_of_lost_pages();
    let outcome = panic::catch_unwind(panic::AssertUnwindSafe(|| {
        faults::arm()?;
        commands::run(cli, &printer)
    }));
    let status = match outcome {
        Ok(Ok(status)) => status,
        Ok(Err(error)) => exit::report(&error, &printer),
        Err(_) => {
            printer
                .error("this is a bug in calib: please report the message above and the command");
            ExitStatus::Internal
        }
    };
    ExitCode::from(status as u8)
}
