//! Passes the messages of a step to the Python code that waits for it.

use std::{
    collections::VecDeque,
    io,
    sync::{
        Arc, Condvar, Mutex, MutexGuard, PoisonError,
        atomic::{AtomicBool, Ordering},
    },
    time::Duration,
};

use calib_core::{Monitor, locked};
use calib_pipeline::{
    Observer, Printer, Remark, Shown,
    output::{Lines, ResultPart, harmless},
};

/// A message: its kind and its text.
pub(crate) type Told = (&'static str, String);

/// The progress of a task.
#[derive(Clone, Default, PartialEq)]
pub(crate) struct Progress {
    pub(crate) task: String,
    pub(crate) done: u64,
    pub(crate) total: u64,
}

/// The state that work shares with the thread that waits for it.
#[derive(Default)]
pub(crate) struct Watch {
    stop: AtomicBool,
    state: Mutex<State>,
    news: Condvar,
}

#[derive(Default)]
struct State {
    told: VecDeque<Told>,
    progress: Progress,
    finished: bool,
}

impl Watch {
    fn state(&self) -> MutexGuard<'_, State> {
        locked(&self.state)
    }

    pub(crate) fn stop(&self) {
        self.stop.store(true, Ordering::Relaxed);
    }

    /// Marks the end of the work, whether it succeeded or not.
    pub(crate) fn finish(&self) {
        self.state().finished = true;
        self.news.notify_all();
    }

    fn tell(&self, kind: &'static str, text: &str) {
        self.state().told.push_back((kind, text.to_owned()));
        self.news.notify_all();
    }

    /// Waits for a message or the end of the work, but at most `longest`. Returns the new messages, the progress, and whether
    /// the work ended.
    pub(crate) fn wait(&self, longest: Duration) -> (Vec<Told>, Progress, bool) {
        let state = self.state();
        let (mut state, _) = self
            .news
            .wait_timeout_while(state, longest, |state| state.told.is_empty() && !state.finished)
            .unwrap_or_else(PoisonError::into_inner);
        (state.told.drain(..).collect(), state.progress.clone(), state.finished)
    }
}

/// Returns a printer whose output goes to `watch`.
pub(crate) fn watch_printer(watch: &Arc<Watch>) -> Printer {
    Printer::new(Arc::new(WatchObserver(Arc::clone(watch))))
}

/// Passes on the messages of a step.
struct WatchObserver(Arc<Watch>);

impl Observer for WatchObserver {
    fn remark(&self, remark: Remark<'_>) {
        let (kind, text, lines) = match remark {
            Remark::Talk(text) => ("talk", text, Lines::One),
            Remark::Table(text) => ("table", text, Lines::Several),
            Remark::Detail(text) => ("detail", text, Lines::Several),
            Remark::Heading(text) => ("heading", text, Lines::One),
            Remark::Warning(text) => ("warning", text, Lines::One),
            Remark::Error(text) => ("error", text, Lines::One),
        };
        self.0.tell(kind, &harmless(text, lines));
    }

    fn result(&self, result: ResultPart<'_>) -> io::Result<()> {
        match result {
            ResultPart::Line(text) => self.0.tell("result", &harmless(text, Lines::One)),
            ResultPart::Lines(text) => self.0.tell("result", &harmless(text, Lines::Several)),
            ResultPart::Json(text) => self.0.tell("json", text),
        }
        Ok(())
    }

    fn progress(&self, _shown: Shown) -> Box<dyn Monitor> {
        Box::new(WatchMonitor(Arc::clone(&self.0)))
    }
}

/// A monitor of long work, which updates a watch.
pub(crate) struct WatchMonitor(pub(crate) Arc<Watch>);

impl Monitor for WatchMonitor {
    fn begin(&self, task: &str, total: u64) {
        self.0.state().progress = Progress { task: task.to_owned(), done: 0, total };
    }

    fn advance(&self, units: u64) {
        self.0.state().progress.done += units;
    }

    fn interrupted(&self) -> bool {
        self.0.stop.load(Ordering::Relaxed)
    }
}

impl Drop for WatchMonitor {
    fn drop(&mut self) {
        self.0.state().progress = Progress::default();
    }
}
