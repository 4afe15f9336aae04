use std::path::Path;

use calib_files::{Below, remove_temporaries, write_atomically};
use clap::CommandFactory as _;
use clap_complete::Shell;
use clap_mangen::Man;

use calib_pipeline::{Outcome, Printer};

use crate::cli::Cli;

/// Print a completion script.
pub(super) fn completions(shell: Shell, printer: &Printer) -> anyhow::Result<Outcome> {
    let mut script = Vec::new();
    clap_complete::generate(shell, &mut Cli::command(), "calib", &mut script);
    printer.lines(&String::from_utf8_lossy(&script))?;
    Ok(Outcome::Done)
}

/// Write one man page a command.
pub(super) fn man(directory: &Path, printer: &Printer) -> anyhow::Result<Outcome> {
    calib_files::create_directory(directory)?;
    remove_temporaries(directory, Below::Unknown)?;
    let mut calib = Cli::command().disable_help_subcommand(true);
    calib.build();
    pages(&calib, directory)?;
    printer.result(&format!("wrote man pages to {}", directory.display()))?;
    Ok(Outcome::Done)
}

/// The page of a command, and those of its commands.
fn pages(command: &clap::Command, directory: &Path) -> anyhow::Result<()> {
    for below in command.get_subcommands().filter(|below| !below.is_hide_set()) {
        pages(below, directory)?;
    }
    let page = Man::new(command.clone());
    Ok(write_atomically(&directory.join(page.get_filename()), |file| page.render(file))?)
}
