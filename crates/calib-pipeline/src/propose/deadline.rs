//! Time limits of trials: work ends when the requested time is over.

use std::{io, sync::Arc};

use calib_base::{
    StepError,
    clock::Stopwatch,
    log::context::RunContext,
    output::{Observer, Printer, Remark, ResultPart, Shown},
};
use calib_core::Monitor;

/// A time limit, after which no work begins or continues.
pub(super) struct TimeLimit {
    deadline: Deadline,
    /// The printer of the command, whose user may interrupt it.
    printer: Printer,
    /// A silent context that asks work to stop when the time is over.
    watched: RunContext,
}

impl TimeLimit {
    /// Sets the limit to `within_secs` after the command has `begun`.
    pub(super) fn new(begun: Stopwatch, within_secs: f64, printer: &Printer) -> Self {
        let deadline = Deadline { begun, within_secs };
        let observer = StoppingObserver { printer: printer.silent(), deadline };
        let watched = RunContext::new(&Printer::new(Arc::new(observer)).silent());
        Self { deadline, printer: printer.silent(), watched }
    }

    /// Returns the remaining seconds.
    pub(super) fn left_secs(&self) -> f64 {
        self.deadline.left_secs()
    }

    /// Whether no time is left.
    pub(super) fn is_over(&self) -> bool {
        self.deadline.is_over()
    }

    /// Returns the result of `work`, or `None` if the time is over before it begins or ends.
    ///
    /// # Errors
    /// Returns an error if the work fails, or the user interrupts the command.
    pub(super) fn done<T>(
        &self,
        work: impl FnOnce(&RunContext) -> Result<T, StepError>,
    ) -> Result<Option<T>, StepError> {
        if self.is_over() {
            return Ok(None);
        }
        match work(&self.watched) {
            Err(reason) if reason.was_cancelled() && !self.printer.progress().interrupted() => {
                Ok(None)
            }
            made => made.map(Some),
        }
    }
}

/// The requested time, counted from the start of the command.
#[derive(Clone, Copy, Debug)]
struct Deadline {
    begun: Stopwatch,
    within_secs: f64,
}

impl Deadline {
    fn left_secs(self) -> f64 {
        (self.within_secs - self.begun.elapsed().as_secs_f64()).max(0.0)
    }

    fn is_over(self) -> bool {
        self.left_secs() <= 0.0
    }
}

/// Passes errors on, and asks work to stop when the time is over.
struct StoppingObserver {
    printer: Printer,
    deadline: Deadline,
}

impl Observer for StoppingObserver {
    fn remark(&self, remark: Remark<'_>) {
        if let Remark::Error(text) = remark {
            self.printer.error(text);
        }
    }

    fn result(&self, _result: ResultPart<'_>) -> io::Result<()> {
        Ok(())
    }

    fn progress(&self, _shown: Shown) -> Box<dyn Monitor> {
        Box::new(StoppingMonitor { inner: self.printer.progress(), deadline: self.deadline })
    }
}

struct StoppingMonitor {
    inner: Box<dyn Monitor>,
    deadline: Deadline,
}

impl Monitor for StoppingMonitor {
    fn begin(&self, task: &str, total: u64) {
        self.inner.begin(task, total);
    }

    fn advance(&self, units: u64) {
        self.inner.advance(units);
    }

    fn interrupted(&self) -> bool {
        self.inner.interrupted() || self.deadline.is_over()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn limit(within_secs: f64) -> TimeLimit {
        TimeLimit::new(Stopwatch::start(), within_secs, &Printer::nobody())
    }

    #[test]
    fn work_is_asked_to_stop_where_the_time_is_over() {
        for (within_secs, is_over) in [(0.0, true), (1e9, false)] {
            let limit = limit(within_secs);
            assert_eq!(limit.is_over(), is_over);
            assert_eq!(limit.watched.progress().interrupted(), is_over, "{within_secs} s");
        }
    }

    #[test]
    fn what_has_not_begun_in_time_does_not_begin() {
        let done = limit(0.0).done(|_| -> Result<(), StepError> { panic!("it began") });
        assert!(matches!(done, Ok(None)), "{done:?}");
        let done = limit(1e9).done(|context| Ok(context.progress().check()?));
        assert!(matches!(done, Ok(Some(()))), "{done:?}");
    }

    #[test]
    fn work_that_stops_for_the_time_is_no_failure() {
        let done = limit(1e9).done(|_| -> Result<(), StepError> { Err(StepError::Cancelled) });
        assert!(matches!(done, Ok(None)), "{done:?}");
        let done = limit(1e9).done(|_| -> Result<(), StepError> { Err(StepError::message("no")) });
        assert!(done.is_err_and(|reason| reason.to_string() == "no"));
    }
}
