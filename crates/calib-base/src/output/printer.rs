use std::{fmt, sync::Arc};

use calib_core::Monitor;
use schemars::JsonSchema;
use serde::Serialize;

use super::{Announced, Observer, OutputFormat, Remark, ResultPart, Shown, Stage, Unobserved};
use crate::{Context as _, StepError};

/// Sends output to an observer: as results, or as talk where a step is on the way to another result.
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

/// How much is reported besides results and errors.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Verbosity {
    Audible,
    /// The step is up to date: its actions are reported only with more verbosity.
    InDetail,
    Quiet,
}

/// The role of results.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Results {
    /// The requested result of the command.
    Wanted,
    /// Talk, because the step is on the way to another result.
    Talk,
}

/// The place of a verdict's reasons.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Reasons {
    InTheReport,
    Printed,
}

impl Printer {
    /// Returns a printer that sends everything to this observer.
    pub fn new(observer: Arc<dyn Observer>) -> Self {
        let verbosity = Verbosity::Audible;
        let results = Results::Wanted;
        let reasons = Reasons::InTheReport;
        Self { observer, verbosity, results, format: OutputFormat::Text, reasons }
    }

    /// Returns the printer that also prints the reasons of verdicts.
    #[must_use]
    pub fn explaining(self) -> Self {
        Self { reasons: Reasons::Printed, ..self }
    }

    /// Whether verdicts are printed with their reasons.
    pub fn is_explaining(&self) -> bool {
        self.reasons == Reasons::Printed
    }

    /// Returns a printer without an observer.
    pub fn nobody() -> Self {
        Self::new(Arc::new(Unobserved)).silent()
    }

    /// Returns the printer that prints only results and errors.
    #[must_use]
    pub fn quiet(self) -> Self {
        Self { verbosity: Verbosity::Quiet, ..self }
    }

    /// Returns the printer for a step on the way to another result: its results are talk.
    #[must_use]
    pub fn talking(&self) -> Self {
        Self { results: Results::Talk, format: OutputFormat::Text, ..self.clone() }
    }

    /// Returns the printer with this format of the result.
    #[must_use]
    pub fn in_format(&self, format: OutputFormat) -> Self {
        Self { format, ..self.clone() }
    }

    /// Whether the result is printed as JSON.
    pub fn is_json(&self) -> bool {
        self.format == OutputFormat::Json
    }

    /// Returns the printer for repeated work: it prints nothing.
    #[must_use]
    pub fn silent(&self) -> Self {
        self.talking().quiet()
    }

    /// Returns the printer for a step that is up to date: its actions, and earlier warnings, are printed only with more
    /// verbosity.
    #[must_use]
    pub fn in_detail(&self) -> Self {
        Self { verbosity: Verbosity::InDetail, ..self.clone() }
    }

    fn is_quiet(&self) -> bool {
        self.verbosity == Verbosity::Quiet
    }

    /// Prints a line of the result.
    ///
    /// # Errors
    /// If it cannot be passed on.
    pub fn result(&self, text: &str) -> Result<(), StepError> {
        self.pass(ResultPart::Line(text.trim_end_matches('\n')))
    }

    /// Prints several lines of the result, such as a table, whose line breaks are calib's own.
    ///
    /// # Errors
    /// If they cannot be passed on.
    pub fn lines(&self, text: &str) -> Result<(), StepError> {
        self.pass(ResultPart::Lines(text.trim_end_matches('\n')))
    }

    /// Prints the result for machines. Its type has a schema.
    ///
    /// # Errors
    /// If it cannot be passed on.
    pub fn json(&self, value: &(impl Serialize + JsonSchema)) -> Result<(), StepError> {
        self.pass(ResultPart::Json(&serde_json::to_string_pretty(value)?))
    }

    /// Reports the present action; silent with `-q`.
    pub fn say(&self, text: &str) {
        self.remark(Remark::Talk(text));
    }

    /// Reports a detail, which is shown only with more verbosity.
    pub fn detail(&self, text: &str) {
        self.remark(Remark::Detail(text));
    }

    /// Reports several remarks, one per line.
    pub fn say_all(&self, remarks: &[String]) {
        for remark in remarks {
            self.say(remark);
        }
    }

    /// Reports the possible next commands, one per line. A step on the way to another result reports none, because the
    /// next step follows anyway.
    pub fn next(&self, commands: &[String]) {
        if self.results == Results::Wanted {
            for (number, command) in commands.iter().enumerate() {
                let word = if number == 0 { "next" } else { "  or" };
                self.say(&format!("{word}: {command}"));
            }
        }
    }

    /// Reports a warning for the user.
    pub fn warn(&self, text: &str) {
        self.remark(Remark::Warning(text));
    }

    /// Reports why something was not done; never silent.
    pub fn error(&self, text: &str) {
        self.observer.remark(Remark::Error(text));
    }

    /// Reports the heading of a new stage or part.
    pub fn heading(&self, text: &str) {
        self.remark(Remark::Heading(text));
    }

    /// Reports the position in a run of several stages.
    pub fn stage(&self, stage: Stage) {
        self.observer.stage(stage);
    }

    /// Returns the announced duration of the run, if there was an announcement.
    pub fn announced(&self) -> Option<Announced> {
        self.observer.announced()
    }

    /// Returns the printer with the observer that `around` makes from its own.
    #[must_use]
    pub(crate) fn observed_by(
        &self,
        around: impl FnOnce(Arc<dyn Observer>) -> Arc<dyn Observer>,
    ) -> Self {
        Self { observer: around(Arc::clone(&self.observer)), ..self.clone() }
    }

    /// Returns a monitor of the progress of long work.
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
