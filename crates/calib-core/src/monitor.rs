/// How long work says what it has done, and learns that it should stop.
///
/// The command line draws a progress bar from it; libraries and tests pass [`Silent`].
pub trait Monitor: Sync {
    /// Work of `total` units called `task` begins.
    fn begin(&self, task: &str, total: u64);

    /// `units` more units are done.
    fn advance(&self, units: u64);

    /// Whether the user asked to stop. Work then ends at its next safe point.
    fn interrupted(&self) -> bool {
        false
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

impl Monitor for Silent {
    fn begin(&self, _task: &str, _total: u64) {}

    fn advance(&self, _units: u64) {}
}
