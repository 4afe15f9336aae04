use std::{io, time::Duration};

use calib_core::{Monitor, Silent};

/// A message of a step during its work.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Remark<'a> {
    /// The present action, in one line.
    Talk(&'a str),
    /// Several lines of the same kind, such as a table.
    Table(&'a str),
    /// The result of a step on the way to another result, in one or several lines. Shown only with more verbosity.
    Detail(&'a str),
    /// The heading of a new stage or part.
    Heading(&'a str),
    /// A warning for the user.
    Warning(&'a str),
    /// The reason why something was not done.
    Error(&'a str),
}

/// A part of the requested result of a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ResultPart<'a> {
    /// One line.
    Line(&'a str),
    /// Several lines, such as a table, whose line breaks are calib's own.
    Lines(&'a str),
    /// The whole result, for machines.
    Json(&'a str),
}

/// The format of results.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OutputFormat {
    /// Lines and tables.
    Text,
    /// JSON.
    Json,
}

/// Whether progress is shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shown {
    /// Shown.
    Yes,
    /// Not shown; the observer can still ask the work to stop.
    No,
}

/// The position in a run of several stages.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stage {
    /// The present stage, counted from 1.
    pub number: usize,
    /// Total number of stages.
    pub stages: usize,
    /// The work after this stage as a multiple of this stage's work, where that is known.
    pub later: Option<f64>,
}

/// The announced duration of a run, and the time of the announcement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Announced {
    /// Duration of the whole run.
    pub whole: Duration,
    /// Time of the announcement since the run began.
    pub after: Duration,
}

/// The observer of a step: a terminal, a notebook or a log. Texts hold names and words of logs unchanged, including any
/// character that a terminal would obey.
pub trait Observer: Send + Sync {
    /// Receives a remark. The work continues if it cannot be shown.
    fn remark(&self, remark: Remark<'_>);

    /// Receives a part of the result.
    ///
    /// # Errors
    /// If it cannot be passed on; the step then ends.
    fn result(&self, result: ResultPart<'_>) -> io::Result<()>;

    /// Receives the position in a run of several stages. Work that follows belongs to this stage.
    fn stage(&self, _stage: Stage) {}

    /// Returns the announced duration of the run, if there was an announcement.
    fn announced(&self) -> Option<Announced> {
        None
    }

    /// Returns a monitor of long work, which can stop it.
    fn progress(&self, shown: Shown) -> Box<dyn Monitor>;
}

/// An observer that ignores everything.
#[derive(Clone, Copy, Debug)]
pub struct Unobserved;

impl Observer for Unobserved {
    fn remark(&self, _remark: Remark<'_>) {}

    fn result(&self, _result: ResultPart<'_>) -> io::Result<()> {
        Ok(())
    }

    fn progress(&self, _shown: Shown) -> Box<dyn Monitor> {
        Box::new(Silent)
    }
}
