use std::io::{IsTerminal as _, Write as _};

use anyhow::Context as _;
use serde::Serialize;

use super::{
    ProgressMonitor,
    harmless::{Lines, harmless, harmless_json},
};
use crate::cli::{Answer, ColorChoice, GlobalArgs};

/// Decides what goes where: results to stdout, talk, warnings and progress to stderr.
#[derive(Debug)]
pub(crate) struct Printer {
    quiet: bool,
    color: bool,
    results: Results,
    answer: Answer,
}

/// Where results go.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Results {
    /// To stdout: they are what the command was run for.
    Stdout,
    /// To stderr, as talk: they are a step on the way to another result.
    Talk,
}

impl Printer {
    /// The printer that these arguments ask for.
    pub(crate) fn new(global: &GlobalArgs) -> Self {
        let color = match global.color {
            ColorChoice::Always => true,
            ColorChoice::Never => false,
            ColorChoice::Auto => {
                std::io::stderr().is_terminal()
                    && std::env::var_os("NO_COLOR").is_none_or(|value| value.is_empty())
            }
        };
        Self { quiet: global.quiet, color, results: Results::Stdout, answer: Answer::ForPeople }
    }

    /// The same printer for a step on the way: its results are talk.
    pub(crate) fn talking(&self) -> Self {
        Self { results: Results::Talk, answer: Answer::ForPeople, ..*self }
    }

    /// The same printer for a result that is an `answer`.
    pub(crate) fn answering(&self, answer: Answer) -> Self {
        Self { answer, ..*self }
    }

    /// Whether the result is to be JSON.
    pub(crate) fn is_for_machines(&self) -> bool {
        self.answer == Answer::ForMachines
    }

    /// The same printer for what is done twice: it says nothing.
    pub(crate) fn silent(&self) -> Self {
        Self { quiet: true, ..self.talking() }
    }

    /// A line of the result.
    pub(crate) fn result(&self, text: &str) -> anyhow::Result<()> {
        if self.results == Results::Talk {
            self.say(text);
            return Ok(());
        }
        print(&harmless(text.trim_end_matches('\n'), Lines::One))
    }

    /// Several lines of the result, such as a table, whose line breaks are calib's own.
    pub(crate) fn lines(&self, text: &str) -> anyhow::Result<()> {
        let text = harmless(text.trim_end_matches('\n'), Lines::Several);
        if self.results == Results::Talk {
            if !self.quiet {
                eprint_line(&text);
            }
            return Ok(());
        }
        print(&text)
    }

    /// The result for machines.
    pub(crate) fn json(&self, value: &impl Serialize) -> anyhow::Result<()> {
        self.lines(&harmless_json(&serde_json::to_string_pretty(value)?))
    }

    /// What calib is doing; silent with `-q`.
    pub(crate) fn say(&self, text: &str) {
        if !self.quiet {
            eprint_line(&harmless(text, Lines::One));
        }
    }

    /// Several remarks, a line each.
    pub(crate) fn say_all(&self, remarks: &[String]) {
        for remark in remarks {
            self.say(remark);
        }
    }

    /// What to type next, one of several on a line each; a step on the way to another result is followed by the next step anyway.
    pub(crate) fn next(&self, commands: &[String]) {
        if self.results == Results::Stdout {
            for (number, command) in commands.iter().enumerate() {
                let word = if number == 0 { "next" } else { "  or" };
                self.say(&format!("{word}: {command}"));
            }
        }
    }

    /// Something that the user should look at.
    pub(crate) fn warn(&self, text: &str) {
        if !self.quiet {
            eprint_line(&format!(
                "{} {}",
                self.paint("warning:", "33"),
                harmless(text, Lines::One)
            ));
        }
    }

    /// Why the command failed; never silent.
    pub(crate) fn error(&self, text: &str) {
        eprint_line(&format!("{} {}", self.paint("error:", "31"), harmless(text, Lines::One)));
    }

    /// As [`Printer::error`], with the lines of a file that it is about.
    pub(crate) fn error_in(&self, text: &str, excerpt: &str) {
        self.error(text);
        for line in excerpt.lines() {
            eprint_line(&harmless(line, Lines::One));
        }
    }

    /// Emphasis for a heading on stderr.
    pub(crate) fn heading(&self, text: &str) {
        if !self.quiet {
            eprint_line(&self.paint(&harmless(text, Lines::One), "1"));
        }
    }

    /// Progress of long work: a bar on a terminal, a line now and then elsewhere.
    pub(crate) fn progress(&self) -> ProgressMonitor {
        ProgressMonitor::new(self.quiet)
    }

    fn paint(&self, text: &str, code: &str) -> String {
        if self.color { format!("\x1b[{code};1m{text}\x1b[0m") } else { text.to_owned() }
    }
}

fn print(text: &str) -> anyhow::Result<()> {
    match writeln!(std::io::stdout().lock(), "{text}") {
        // `calib … | head` is no failure.
        Err(error) if error.kind() == std::io::ErrorKind::BrokenPipe => Ok(()),
        other => other.context("cannot write to stdout"),
    }
}

fn eprint_line(text: &str) {
    // A closed stderr is no reason to stop working.
    let _ = writeln!(std::io::stderr().lock(), "{text}");
}
