//! Trials that end where the time that was asked for does.

use std::{io, sync::Arc};

use calib_base::{
    clock::Stopwatch,
    log::context::RunContext,
    output::{Observer, Printer, Remark, Result as Answered, Shown},
};
use calib_core::Monitor;

/// The time that was asked for, from the beginning of the command on.
#[derive(Clone, Copy, Debug)]
pub(super) struct Deadline {
    begun: Stopwatch,
    within_secs: f64,
}

impl Deadline {
    pub(super) fn new(begun: Stopwatch, within_secs: f64) -> Self {
        Self { begun, within_secs }
    }

    /// Seconds that are left.
    pub(super) fn left_secs(self) -> f64 {
        (self.within_secs - self.begun.elapsed().as_secs_f64()).max(0.0)
    }

    /// Whether no time is left.
    pub(super) fn is_over(self) -> bool {
        self.left_secs() <= 0.0
    }

    /// For work that says nothing, and is asked to stop where the time is over.
    pub(super) fn stopping(self, printer: &Printer) -> RunContext {
        let observer = StoppingObserver { printer: printer.silent(), deadline: self };
        RunContext::new(&Printer::new(Arc::new(observer)).silent())
    }
}

/// Passes errors on, and asks work to stop where the time is over.
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

    fn result(&self, _result: Answered<'_>) -> io::Result<()> {
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

    #[test]
    fn work_is_asked_to_stop_where_the_time_is_over() {
        for (within_secs, is_over) in [(0.0, true), (1e9, false)] {
            let deadline = Deadline::new(Stopwatch::start(), within_secs);
            assert_eq!(deadline.is_over(), is_over);
            let context = deadline.stopping(&Printer::nobody());
            assert_eq!(context.progress().interrupted(), is_over, "{within_secs} s");
        }
    }
}
