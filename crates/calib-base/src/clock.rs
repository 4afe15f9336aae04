//! The only module that reads the time. It is used for progress and timings, never for results.

use std::{
    thread,
    time::{Duration, Instant, SystemTime, UNIX_EPOCH},
};

use calib_core::Timestamp;
use calib_data::format_time;
use calib_files::FileStat;

use super::memory;

/// A running stopwatch.
#[derive(Clone, Copy, Debug)]
pub struct Stopwatch(Instant);

impl Stopwatch {
    /// Starts the stopwatch.
    #[expect(
        clippy::disallowed_methods,
        reason = "timings are reported beside results, not in them"
    )]
    pub fn start() -> Self {
        Self(Instant::now())
    }

    /// Returns the time since the start.
    pub fn elapsed(self) -> Duration {
        self.0.elapsed()
    }
}

/// Returns seconds since 1970.
#[expect(
    clippy::disallowed_methods,
    reason = "notes of how work stands say when they were written"
)]
pub fn unix_secs() -> f64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0.0, |now| now.as_secs_f64())
}

/// Returns the start time of a process of this machine, in ticks since the machine started, as Linux reports it. A
/// later process with the same number has a later start.
pub(crate) fn process_began(process: u32) -> Option<u64> {
    let stat = memory::read_proc_stat(process)?;
    let (_, fields) = stat.rsplit_once(')')?;
    fields.split_whitespace().nth(19)?.parse().ok()
}

/// Returns a warning about a log whose last time is in the future.
#[expect(clippy::disallowed_methods, reason = "a remark, and no result")]
pub fn in_future(last: Timestamp) -> Option<String> {
    let now = SystemTime::now().duration_since(UNIX_EPOCH).ok()?.as_micros();
    // Local times may be ahead of UTC by half a day.
    let is_ahead = i128::from(last.as_micros()) > now as i128 + DAY_MICROS;
    is_ahead.then(|| {
        format!(
            "the log ends at {}, which is still to come: is data.timestamp_format right, or the clock of the logger?",
            format_time(last)
        )
    })
}

const DAY_MICROS: i128 = 86_400_000_000;

/// Wall and processor time of some work.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TimeTaken {
    /// Wall time, s.
    pub secs: f64,
    /// Processor time over all processors, s. Other work on the machine hardly changes it. 0 where the system does not
    /// report it.
    pub processor_secs: f64,
}

impl TimeTaken {
    /// Runs `work`, and returns its result and its time.
    pub fn by<T>(work: impl FnOnce() -> T) -> (T, Self) {
        let timer = Timer::start();
        let made = work();
        (made, timer.taken())
    }

    /// Returns the processor time, s. It is the wall time of work that is short against the ticks in which processor
    /// time is reported, or where the system does not report it.
    pub fn on_processors(&self) -> f64 {
        if self.processor_secs < TEN_TICKS { self.secs } else { self.processor_secs }
    }
}

/// A running measurement of wall and processor time.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Timer {
    clock: Stopwatch,
    /// Processor time at the start, s.
    processor_secs: f64,
}

impl Timer {
    /// Starts the measurement.
    pub(crate) fn start() -> Self {
        Self { clock: Stopwatch::start(), processor_secs: processor_secs() }
    }

    /// Returns the wall time since the start.
    pub(crate) fn elapsed(self) -> Duration {
        self.clock.elapsed()
    }

    /// Returns the time since the start.
    pub(crate) fn taken(self) -> TimeTaken {
        let secs = self.clock.elapsed().as_secs_f64();
        TimeTaken { secs, processor_secs: processor_secs() - self.processor_secs }
    }
}

/// Ten ticks of the processor time that Linux reports, s.
const TEN_TICKS: f64 = 0.1;

/// Returns the processor time of this process so far, as Linux reports it.
fn processor_secs() -> f64 {
    memory::read_proc_self("stat").and_then(|text| processor_secs_in(&text)).unwrap_or(0.0)
}

/// Parses `utime` and `stime` of `/proc/PID/stat` (proc(5)), which are in hundredths of a second on every machine.
fn processor_secs_in(text: &str) -> Option<f64> {
    // The name of the program may hold spaces and brackets.
    let (_, fields) = text.rsplit_once(')')?;
    let mut times = fields.split_whitespace().skip(11).map(str::parse::<u64>);
    Some((times.next()?.ok()? + times.next()?.ok()?) as f64 / 100.0)
}

/// Waits until any further change of the files with these stamps would give them other stamps. It does not wait for
/// files that were not written just now.
#[expect(clippy::disallowed_methods, reason = "how long to wait is no result")]
pub(crate) fn settle(stamps: impl Iterator<Item = FileStat>) {
    let since_1970 = SystemTime::now().duration_since(UNIX_EPOCH).ok();
    let now = since_1970.and_then(|now| i64::try_from(now.as_nanos()).ok());
    let longest = stamps.map(|stamp| stamp.unsettled_ns(now.unwrap_or(0))).max();
    thread::sleep(Duration::from_nanos(longest.unwrap_or(0)));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn processor_time_is_read_from_what_linux_says() {
        let stat = "71 (a b) c) S 1 71 71 0 -1 4194304 150 0 0 0 1234 66 7 8 20 0 4 0 99 1 1 1";
        assert_eq!(processor_secs_in(stat), Some(13.0));
        assert_eq!(processor_secs_in("71 (a) S 1"), None);
    }

    #[test]
    fn short_work_has_its_wall_time() {
        for (processor_secs, on_processors) in [(0.09, 0.07), (0.13, 0.13)] {
            let taken = TimeTaken { secs: 0.07, processor_secs };
            assert_eq!(taken.on_processors(), on_processors, "{taken:?}");
        }
    }

    #[test]
    fn what_work_took_is_told_with_what_it_made() {
        let (made, taken) = TimeTaken::by(|| 7);
        assert_eq!(made, 7);
        assert!(taken.secs >= 0.0 && taken.processor_secs >= 0.0, "{taken:?}");
    }
}
