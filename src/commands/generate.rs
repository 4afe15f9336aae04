use std::path::Path;

use clap::CommandFactory as _;
use clap_complete::Shell;

use crate::{cli::Cli, exit::ExitStatus, output::Printer};

/// Print a completion script.
pub(super) fn completions(shell: Shell, printer: &Printer) -> anyhow::Result<ExitStatus> {
    let mut script = Vec::new();
    clap_complete::generate(shell, &mut Cli::command(), "calib", &mut script);
    printer.lines(&String::from_utf8_lossy(&script))?;
    Ok(ExitStatus::Done)
}

/// Write one man page a command.
pub(super) fn man(directory: &Path, printer: &Printer) -> anyhow::Result<ExitStatus> {
    calib_files::create_directory(directory)?;
    clap_mangen::generate_to(Cli::command(), directory)?;
    printer.result(&format!("wrote man pages to {}", directory.display()))?;
    Ok(ExitStatus::Done)
}
