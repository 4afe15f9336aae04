//! The only place that reads the time. It is used for progress and timings, never for results.

use std::{
    thread,
    time::{Duration, Instant, SystemTime, UNIX_EPOCH},
};

use calib_files::Stamp;

/// A running stopwatch.
#[derive(Clone, Copy, Debug)]
pub struct Stopwatch(Instant);

impl Stopwatch {
    /// Start it.
    #[expect(
        clippy::disallowed_methods,
        reason = "timings are reported beside results, not in them"
    )]
    pub fn start() -> Self {
        Self(Instant::now())
    }

    /// Time since the start.
    pub fn elapsed(self) -> Duration {
        self.0.elapsed()
    }
}

/// Wait until the next change of files with these stamps gives them others: for files that were not written just now, not
/// at all.
#[expect(clippy::disallowed_methods, reason = "how long to wait is no result")]
pub(crate) fn settle(stamps: impl Iterator<Item = Stamp>) {
    let since_1970 = |now: Duration| i64::try_from(now.as_nanos()).ok();
    let now = SystemTime::now().duration_since(UNIX_EPOCH).ok().and_then(since_1970);
    let longest = stamps.map(|stamp| stamp.unsettled_ns(now.unwrap_or(0))).max();
    thread::sleep(Duration::from_nanos(longest.unwrap_or(0)));
}
