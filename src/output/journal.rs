//! Journal of all messages: a file beside the output on the terminal.

use std::{
    fs::File,
    io::{self, Read as _, Write as _},
    path::Path,
    sync::{Arc, Mutex},
};

use calib_core::{Monitor, locked};
use calib_pipeline::{
    Context as _, Observer, Remark, Shown, StepError, Stopwatch, ensure,
    output::{Lines, ResultPart, Stage, harmless},
};
use jiff::Timestamp;

use super::{
    Terminal,
    progress::{KeepLine, ProgressMonitor},
};
use crate::cli::GlobalArgs;

/// Amount of output on a terminal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Verbosity {
    /// Results and errors only.
    Quiet,
    Usual,
    /// Also the results of intermediate steps; lines have the elapsed time.
    Verbose,
}

impl Verbosity {
    pub(crate) const fn of(args: &GlobalArgs) -> Self {
        match (args.quiet, args.verbose) {
            (true, _) => Self::Quiet,
            (false, true) => Self::Verbose,
            (false, false) => Self::Usual,
        }
    }
}

/// A terminal, and optionally a file that keeps all messages.
#[derive(Debug)]
pub(crate) struct Journal {
    terminal: Terminal,
    verbosity: Verbosity,
    started: Stopwatch,
    stage: Mutex<Option<Stage>>,
    file: Option<Arc<Mutex<File>>>,
}

impl Journal {
    /// # Errors
    /// If the file cannot be appended to, or something else than a journal stands in it.
    pub(crate) fn open(
        terminal: Terminal,
        verbosity: Verbosity,
        path: Option<&Path>,
    ) -> Result<Self, StepError> {
        let file = path.map(open).transpose()?;
        let started = Stopwatch::start();
        let stage = Mutex::new(None);
        let file = file.map(|file| Arc::new(Mutex::new(file)));
        Ok(Self { terminal, verbosity, started, stage, file })
    }

    /// Keeps `text` in the file, if there is one; each line has a time and a kind.
    fn keep(&self, kind: &str, text: &str) {
        if let Some(file) = &self.file {
            keep_in(file, kind, text);
        }
    }
}

/// Keeps `text` in a file; each line has a time and a kind.
fn keep_in(file: &Mutex<File>, kind: &str, text: &str) {
    let now = Timestamp::now();
    let lines = text.lines().map(|line| {
        // Users read the file on a terminal, so control sequences are removed.
        format!("{now:.3} {kind:<7} {}\n", harmless(line, Lines::One))
    });
    let lines: String = lines.collect();
    // A full disk must not stop the work.
    let _ = locked(file).write_all(lines.as_bytes());
}

/// Opens or creates a journal. Nothing is appended to any other file that has content.
fn open(path: &Path) -> Result<File, StepError> {
    let mut begin = Vec::new();
    if path.exists() {
        let file = calib_files::open_regular(path)?;
        file.take(LONGEST).read_to_end(&mut begin).with_context(|| path.display().to_string())?;
    }
    let line = begin.split(|&byte| byte == b'\n').next().unwrap_or_default();
    ensure!(
        begin.is_empty() || is_entry(&String::from_utf8_lossy(line)),
        "--log {}: there is a file that is no log of calib's, and nothing is appended to it; name another file",
        path.display()
    );
    Ok(calib_files::open_to_append(path)?)
}

/// Length in bytes of the start of a line, enough to recognise a journal.
const LONGEST: u64 = 128;

/// Whether a line begins like a journal entry, with a time and a kind.
fn is_entry(line: &str) -> bool {
    let mut words = line.split_whitespace();
    let is_time = words.next().is_some_and(|word| word.parse::<Timestamp>().is_ok());
    is_time && words.next().is_some_and(|kind| KINDS.contains(&kind))
}

/// Kinds of journal entries.
const KINDS: [&str; 5] = ["info", "step", "warning", "error", "result"];

impl Observer for Journal {
    fn remark(&self, remark: Remark<'_>) {
        let (kind, text) = match remark {
            Remark::Talk(text) | Remark::Table(text) | Remark::Detail(text) => ("info", text),
            Remark::Heading(text) => ("step", text),
            Remark::Warning(text) => ("warning", text),
            Remark::Error(text) => ("error", text),
        };
        self.keep(kind, text);
        let secs = self.started.elapsed().as_secs_f64();
        match (self.verbosity, remark) {
            (Verbosity::Quiet, Remark::Error(_)) => self.terminal.remark(remark),
            (Verbosity::Quiet, _) | (Verbosity::Usual, Remark::Detail(_)) => {}
            (Verbosity::Verbose, Remark::Talk(text)) => {
                self.terminal.remark(Remark::Talk(&format!("{secs:8.2} s  {text}")));
            }
            (Verbosity::Verbose, Remark::Heading(text)) => {
                self.terminal.remark(Remark::Heading(&format!("{secs:8.2} s  {text}")));
            }
            _ => self.terminal.remark(remark),
        }
    }

    fn result(&self, result: ResultPart<'_>) -> io::Result<()> {
        let (ResultPart::Line(text) | ResultPart::Lines(text) | ResultPart::Json(text)) = result;
        self.keep("result", text);
        self.terminal.result(result)
    }

    fn stage(&self, stage: Stage) {
        *locked(&self.stage) = Some(stage);
    }

    fn progress(&self, shown: Shown) -> Box<dyn Monitor> {
        let shown = if self.verbosity == Verbosity::Quiet { Shown::No } else { shown };
        let stage = *locked(&self.stage);
        let file = self.file.clone();
        let keep =
            file.map(|file| -> KeepLine { Box::new(move |line| keep_in(&file, "info", line)) });
        Box::new(ProgressMonitor::new(shown, stage, keep))
    }
}
