use std::{fs, path::Path};

use calib_files::{Below, FileError, read_regular, remove_temporaries, write_atomically};
use clap::CommandFactory as _;
use clap_complete::Shell;
use clap_mangen::Man;

use calib_pipeline::{Outcome, Printer, StepError};

use crate::cli::Cli;

/// Prints a completion script.
pub(super) fn completions(shell: Shell, printer: &Printer) -> Result<Outcome, StepError> {
    let mut script = Vec::new();
    clap_complete::generate(shell, &mut Cli::command(), "calib", &mut script);
    printer.lines(&String::from_utf8_lossy(&script))?;
    Ok(Outcome::Done)
}

/// Writes one man page per command.
pub(super) fn man(directory: &Path, printer: &Printer) -> Result<Outcome, StepError> {
    calib_files::create_directory(directory)?;
    remove_temporaries(directory, Below::Unknown)?;
    let mut calib = Cli::command().disable_help_subcommand(true);
    calib.build();
    pages(&calib, directory)?;
    printer.result(&format!("wrote man pages to {}", directory.display()))?;
    Ok(Outcome::Done)
}

/// Writes the page of a command, and those of its subcommands.
fn pages(command: &clap::Command, directory: &Path) -> Result<(), StepError> {
    for below in command.get_subcommands().filter(|below| !below.is_hide_set()) {
        pages(below, directory)?;
    }
    let page = Man::new(command.clone());
    let path = directory.join(page.get_filename());
    if fs::symlink_metadata(&path).is_ok() && !is_page(&path) {
        return Err(FileError::Foreign { path }.into());
    }
    Ok(write_atomically(&path, |file| page.render(file))?)
}

/// Whether a file is the man page of a calib command, of any version.
fn is_page(path: &Path) -> bool {
    let title = format!(".TH {} ", path.file_stem().unwrap_or_default().to_string_lossy());
    let page = read_regular(path).unwrap_or_default();
    page.split(|&byte| byte == b'\n').any(|line| line.starts_with(title.as_bytes()))
}
