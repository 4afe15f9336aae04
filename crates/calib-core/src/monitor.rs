/// The observer asked to stop. Whatever was finished by then stays.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("interrupted")]
pub struct Cancelled;

/// How long work says what it has done, and learns that it should stop.
///
/// The command line draws a progress bar from it; libraries and tests pass [`Silent`].
pub trait Monitor: Sync {
    /// Work of `total` units called `task` begins.
    fn begin(&self, task: &str, total: u64) {
        let _ = (task, total);
    }

    /// `units` more units are done.
    fn advance(&self, units: u64) {
        let _ = units;
    }

    /// Whether the user asked to stop. Work then ends at its next safe point.
    fn interrupted(&self) -> bool {
        false
    }

    /// For `monitor.check()?` where work can end.
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

/// A monitor that nobody watches.
#[derive(Clone, Copy, Debug, Default)]
pub struct Silent;

impl Monitor for Silent {}
