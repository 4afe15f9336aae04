use std::{
    borrow::Cow,
    io::{self, IsTerminal as _, Write as _},
};

use calib_core::Monitor;
use calib_pipeline::{
    Observer, Remark, Shown,
    output::{Lines, ResultPart, harmless, harmless_json},
};

use super::{progress::ProgressMonitor, stderr::eprint_line};
use crate::cli::ColorChoice;

/// Output to a terminal: results to stdout; messages, warnings and progress to stderr.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Terminal {
    color: bool,
}

impl Terminal {
    /// Creates a terminal output with or without colour.
    pub(crate) fn new(color: ColorChoice) -> Self {
        let color = match color {
            ColorChoice::Always => true,
            ColorChoice::Never => false,
            ColorChoice::Auto => {
                io::stderr().is_terminal()
                    && std::env::var_os("NO_COLOR").is_none_or(|value| value.is_empty())
            }
        };
        Self { color }
    }

    /// Highlights the next command to type.
    fn hinted(self, text: &str) -> String {
        let hint = ["next: ", "  or: "].iter().find_map(|word| text.strip_prefix(word));
        hint.map_or_else(
            || text.to_owned(),
            |command| {
                format!("{}{}", &text[..text.len() - command.len()], self.paint(command, "36"))
            },
        )
    }

    fn paint(self, text: &str, code: &str) -> String {
        if self.color { format!("\x1b[{code};1m{text}\x1b[0m") } else { text.to_owned() }
    }
}

fn one_line(text: &str) -> Cow<'_, str> {
    harmless(text, Lines::One)
}

impl Observer for Terminal {
    fn remark(&self, remark: Remark<'_>) {
        eprint_line(&match remark {
            Remark::Talk(text) => self.hinted(&one_line(text)),
            Remark::Table(text) | Remark::Detail(text) => {
                harmless(text, Lines::Several).into_owned()
            }
            Remark::Heading(text) => self.paint(&one_line(text), "1"),
            Remark::Warning(text) => format!("{} {}", self.paint("warning:", "33"), one_line(text)),
            Remark::Error(text) => format!("{} {}", self.paint("error:", "31"), one_line(text)),
        });
    }

    fn result(&self, result: ResultPart<'_>) -> io::Result<()> {
        let text = match result {
            ResultPart::Line(text) => one_line(text),
            ResultPart::Lines(text) => harmless(text, Lines::Several),
            ResultPart::Json(text) => harmless_json(text),
        };
        match writeln!(io::stdout().lock(), "{text}") {
            // A closed pipe, as in `calib … | head`, is not a failure.
            Err(error) if error.kind() == io::ErrorKind::BrokenPipe => Ok(()),
            other => other,
        }
    }

    fn progress(&self, shown: Shown) -> Box<dyn Monitor> {
        Box::new(ProgressMonitor::new(shown, None, None))
    }
}
