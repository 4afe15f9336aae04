use std::{io, time::Duration};

use calib_core::{Monitor, Silent};

/// Something that a step says while it works.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Remark<'a> {
    /// What is being done; one line.
    Talk(&'a str),
    /// Several lines of the same, such as a table.
    Table(&'a str),
    /// What a step came to that is on the way to another result; one line or several. Shown to those who ask for more.
    Detail(&'a str),
    /// What begins.
    Heading(&'a str),
    /// What the user should look at.
    Warning(&'a str),
    /// Why something was not done.
    Error(&'a str),
}

/// A part of what a step was run for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ResultPart<'a> {
    /// A line.
    Line(&'a str),
    /// Several lines, such as a table, whose line breaks are calib's own.
    Lines(&'a str),
    /// All of it, for machines.
    Json(&'a str),
}

/// Whom results are for.
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
    /// It is.
    Yes,
    /// It is not; whoever watches can still ask the work to stop.
    No,
}

/// How far a run of several stages is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stage {
    /// The stage that was begun, counted from 1.
    pub number: usize,
    /// Stages in all.
    pub stages: usize,
    /// The work after that of this one as a multiple of it, where that is known.
    pub later: Option<f64>,
}

/// How long a run was announced to take, and when.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Announced {
    /// All of it.
    pub whole: Duration,
    /// Since it began.
    pub after: Duration,
}

/// Whoever watches a step: a terminal, a notebook, a log. Texts hold names and words of logs as they are, with whatever
/// a terminal would obey.
pub trait Observer: Send + Sync {
    /// Hear a remark. What cannot be shown is no reason to stop.
    fn remark(&self, remark: Remark<'_>);

    /// Take a part of the result.
    ///
    /// # Errors
    /// If it cannot be passed on; the step then ends.
    fn result(&self, result: ResultPart<'_>) -> io::Result<()>;

    /// Hear how far a run of several stages is; what is watched from now on is work of this part of it.
    fn stage(&self, _stage: Stage) {}

    /// What was announced of how long a run takes, if anything was.
    fn announced(&self) -> Option<Announced> {
        None
    }

    /// Watch long work, and stop it.
    fn progress(&self, shown: Shown) -> Box<dyn Monitor>;
}

/// Nobody.
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
