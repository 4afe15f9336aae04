/// The error of work that the observer asked to stop. Results that were finished by
/// then are kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("interrupted")]
pub struct Cancelled;

/// Receives the progress of long work, and tells it when to stop.
///
/// The command line draws a progress bar from it. Libraries and tests pass [`Silent`].
pub trait Monitor: Sync {
    /// Begins the task `task` with `total` units of work.
    fn begin(&self, task: &str, total: u64) {
        let _ = (task, total);
    }

    /// Reports `units` more units as done.
    fn advance(&self, units: u64) {
        let _ = units;
    }

    /// Whether the user asked to stop. Work then ends at its next safe point.
    fn interrupted(&self) -> bool {
        false
    }

    /// Returns an error if the work should stop: for `monitor.check()?` where work can
    /// end.
    ///
    /// # Errors
    /// [`Cancelled`] if [`interrupted`](Self::interrupted).
    fn check(&self) -> Result<(), Cancelled> {
        if self.interrupted() { Err(Cancelled) } else { Ok(()) }
    }
}

impl<M: Monitor + ?Sized> Monitor for Box<M> {
    fn begin(&self, task: &str, total: u64) {
        (**self).begin(task, total);
    }

    fn advance(&self, units: u64) {
        (**self).advance(units);
    }

    fn interrupted(&self) -> bool {
        (**self).interrupted()
    }
}

/// A monitor that ignores progress and never stops the work.
#[derive(Clone, Copy, Debug, Default)]
pub struct Silent;

impl Monitor for Silent {}
