use std::{fmt, sync::Arc};

use calib_core::Monitor;
use schemars::JsonSchema;
use serde::Serialize;

use super::{Announced, Observer, OutputFormat, Remark, ResultPart, Shown, Stage, Unobserved};
use crate::{Context as _, StepError};

/// Decides what an observer is told: results, or talk where a step is on the way to another result.
#[derive(Clone)]
pub struct Printer {
    observer: Arc<dyn Observer>,
    verbosity: Verbosity,
    results: Results,
    format: OutputFormat,
    reasons: Reasons,
}

impl fmt::Debug for Printer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { verbosity, results, format, .. } = self;
        f.debug_tuple("Printer").field(verbosity).field(results).field(format).finish()
    }
}

/// Whether anything but results and errors is said.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Verbosity {
    Audible,
    /// What calib is doing is said only to those who ask for more: the step is up to date.
    InDetail,
    Quiet,
}

/// What results are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Results {
    /// What the command was run for.
    Wanted,
    /// Talk: they are a step on the way to another result.
    Talk,
}

/// Where a verdict's reasons are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Reasons {
    InTheReport,
    Printed,
}

impl Printer {
    /// A printer that tells this observer everything.
    pub fn new(observer: Arc<dyn Observer>) -> Self {
        let verbosity = Verbosity::Audible;
        let results = Results::Wanted;
        let reasons = Reasons::InTheReport;
        Self { observer, verbosity, results, format: OutputFormat::Text, reasons }
    }

    /// The same printer, which gives the reasons of verdicts as well.
    #[must_use]
    pub fn explaining(self) -> Self {
        Self { reasons: Reasons::Printed, ..self }
    }

    /// Whether verdicts come with their reasons.
    pub fn is_explaining(&self) -> bool {
        self.reasons == Reasons::Printed
    }

    /// A printer that nobody hears.
    pub fn nobody() -> Self {
        Self::new(Arc::new(Unobserved)).silent()
    }

    /// The same printer, which says nothing but results and errors.
    #[must_use]
    pub fn quiet(self) -> Self {
        Self { verbosity: Verbosity::Quiet, ..self }
    }

    /// The same printer for a step on the way: its results are talk.
    #[must_use]
    pub fn talking(&self) -> Self {
        Self { results: Results::Talk, format: OutputFormat::Text, ..self.clone() }
    }

    /// The same printer, whose result is in this format.
    #[must_use]
    pub fn in_format(&self, format: OutputFormat) -> Self {
        Self { format, ..self.clone() }
    }

    /// Whether the result is to be JSON.
    pub fn is_json(&self) -> bool {
        self.format == OutputFormat::Json
    }

    /// The same printer for what is done twice: it says nothing.
    #[must_use]
    pub fn silent(&self) -> Self {
        self.talking().quiet()
    }

    /// The same printer for a step that is up to date: what is done, and warnings that were told before, are for those who ask for more.
    #[must_use]
    pub fn in_detail(&self) -> Self {
        Self { verbosity: Verbosity::InDetail, ..self.clone() }
    }

    fn is_quiet(&self) -> bool {
        self.verbosity == Verbosity::Quiet
    }

    /// A line of the result.
    ///
    /// # Errors
    /// If it cannot be passed on.
    pub fn result(&self, text: &str) -> Result<(), StepError> {
        self.pass(ResultPart::Line(text.trim_end_matches('\n')))
    }

    /// Several lines of the result, such as a table, whose line breaks are calib's own.
    ///
    /// # Errors
    /// If they cannot be passed on.
    pub fn lines(&self, text: &str) -> Result<(), StepError> {
        self.pass(ResultPart::Lines(text.trim_end_matches('\n')))
    }

    /// The result for machines; whatever it is has a schema.
    ///
    /// # Errors
    /// If it cannot be passed on.
    pub fn json(&self, value: &(impl Serialize + JsonSchema)) -> Result<(), StepError> {
        self.pass(ResultPart::Json(&serde_json::to_string_pretty(value)?))
    }

    /// What calib is doing; silent with `-q`.
    pub fn say(&self, text: &str) {
        self.remark(Remark::Talk(text));
    }

    /// What only those want to know who ask for more.
    pub fn detail(&self, text: &str) {
        self.remark(Remark::Detail(text));
    }

    /// Several remarks, a line each.
    pub fn say_all(&self, remarks: &[String]) {
        for remark in remarks {
            self.say(remark);
        }
    }

    /// What to type next, one of several on a line each; a step on the way to another result is followed by the next step anyway.
    pub fn next(&self, commands: &[String]) {
        if self.results == Results::Wanted {
            for (number, command) in commands.iter().enumerate() {
                let word = if number == 0 { "next" } else { "  or" };
                self.say(&format!("{word}: {command}"));
            }
        }
    }

    /// Something that the user should look at.
    pub fn warn(&self, text: &str) {
        self.remark(Remark::Warning(text));
    }

    /// Why something was not done; never silent.
    pub fn error(&self, text: &str) {
        self.observer.remark(Remark::Error(text));
    }

    /// What begins.
    pub fn heading(&self, text: &str) {
        self.remark(Remark::Heading(text));
    }

    /// How far a run of several stages is.
    pub fn stage(&self, stage: Stage) {
        self.observer.stage(stage);
    }

    /// What was announced of how long a run takes, if anything was.
    pub fn announced(&self) -> Option<Announced> {
        self.observer.announced()
    }

    /// The same printer, which tells what `around` makes of its observer.
    #[must_use]
    pub(crate) fn observed_by(
        &self,
        around: impl FnOnce(Arc<dyn Observer>) -> Arc<dyn Observer>,
    ) -> Self {
        Self { observer: around(Arc::clone(&self.observer)), ..self.clone() }
    }

    /// Progress of long work.
    pub fn progress(&self) -> Box<dyn Monitor> {
        self.observer.progress(if self.is_quiet() { Shown::No } else { Shown::Yes })
    }

    fn remark(&self, remark: Remark<'_>) {
        match (self.verbosity, remark) {
            (Verbosity::Quiet, _) => {}
            (
                Verbosity::InDetail,
                Remark::Talk(text) | Remark::Heading(text) | Remark::Warning(text),
            ) => {
                self.observer.remark(Remark::Detail(text));
            }
            (Verbosity::InDetail | Verbosity::Audible, remark) => self.observer.remark(remark),
        }
    }

    fn pass(&self, result: ResultPart<'_>) -> Result<(), StepError> {
        if self.results == Results::Talk {
            let (ResultPart::Line(text) | ResultPart::Lines(text) | ResultPart::Json(text)) =
                result;
            self.detail(text);
            return Ok(());
        }
        self.observer.result(result).context("cannot write to stdout")
    }
}
