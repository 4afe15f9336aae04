//! Expected costs of steps, from short measurements on this machine.

use std::{
    sync::atomic::{AtomicU64, Ordering},
    time::Duration,
};

use calib_core::Monitor;
use calib_study::StepKind;
use schemars::JsonSchema;
use serde::Serialize;

use crate::{
    StepError,
    clock::{Stopwatch, TimeTaken},
    output::duration_of_secs,
};

/// Time limit of one measurement: long against the tick of the processor's clock, and short for whoever waits (our
/// choice).
const MEASURED: Duration = Duration::from_millis(300);

/// The expected cost of a step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, JsonSchema)]
pub struct StepCost {
    /// Processor seconds of all threads together.
    pub processor_secs: f64,
    /// Upper bound on memory, in bytes.
    pub memory: u64,
    /// Upper bound on disk space, in bytes.
    pub disk: u64,
}

impl StepCost {
    /// Returns the cost of this step and of another that runs after it.
    #[must_use]
    pub fn then(self, next: Self) -> Self {
        Self {
            processor_secs: self.processor_secs + next.processor_secs,
            memory: self.memory.max(next.memory),
            disk: self.disk.saturating_add(next.disk),
        }
    }

    /// Returns a line on the time.
    pub fn line(&self) -> String {
        format!("expecting about {} of a processor", duration_of_secs(self.processor_secs))
    }
}

/// The expected cost of a step for one model and deployment.
#[derive(Clone, Debug, PartialEq)]
pub struct ExpectedStep {
    /// The step.
    pub step: StepKind,
    /// The model, if there are several.
    pub model: Option<String>,
    /// The deployment, if there are several.
    pub deployment: Option<String>,
    /// The cost.
    pub cost: StepCost,
}

/// Returns the processor seconds of `work`. If `work` takes too long, it is ended, and the time is extrapolated from
/// the units that its monitor was told of.
///
/// # Errors
/// If the work fails, or `monitor` interrupts it.
pub fn processor_secs<T, E: Into<StepError>>(
    monitor: &dyn Monitor,
    work: impl FnOnce(&dyn Monitor) -> Result<T, E>,
) -> Result<f64, StepError> {
    let limit = TimeLimit {
        monitor,
        clock: Stopwatch::start(),
        total: AtomicU64::new(0),
        done: AtomicU64::new(0),
    };
    let (ended, taken) = TimeTaken::by(|| work(&limit));
    let secs = taken.on_processors();
    let Err(reason) = ended else { return Ok(secs) };
    let reason: StepError = reason.into();
    if !reason.was_cancelled() || monitor.interrupted() {
        return Err(reason);
    }
    // At least one unit was under way.
    let done = limit.done.into_inner().max(1);
    let total = limit.total.into_inner().max(done);
    Ok(secs * total as f64 / done as f64)
}

/// A monitor that ends work after [`MEASURED`], and counts its units until then.
struct TimeLimit<'a> {
    monitor: &'a dyn Monitor,
    clock: Stopwatch,
    total: AtomicU64,
    done: AtomicU64,
}

impl Monitor for TimeLimit<'_> {
    fn begin(&self, _task: &str, total: u64) {
        self.total.store(total, Ordering::Relaxed);
        self.done.store(0, Ordering::Relaxed);
    }

    fn advance(&self, units: u64) {
        self.done.fetch_add(units, Ordering::Relaxed);
    }

    fn interrupted(&self) -> bool {
        self.monitor.interrupted() || self.clock.elapsed() >= MEASURED
    }
}

#[cfg(test)]
mod tests {
    use std::thread;

    use calib_core::{Cancelled, Silent};

    use super::*;

    #[test]
    fn steps_follow_one_another() {
        let first = StepCost { processor_secs: 1.5, memory: 7, disk: 10 };
        let next = StepCost { processor_secs: 2.0, memory: 5, disk: u64::MAX };
        let both = StepCost { processor_secs: 3.5, memory: 7, disk: u64::MAX };
        assert_eq!(first.then(next), both);
        assert_eq!(first.line(), "expecting about 1.5 s of a processor");
    }

    /// Makes `units` units of 20 ms.
    fn units(monitor: &dyn Monitor, units: u64) -> Result<u64, Cancelled> {
        monitor.begin("sleeping", units);
        for _ in 0..units {
            monitor.check()?;
            thread::sleep(Duration::from_millis(20));
            monitor.advance(1);
        }
        Ok(units)
    }

    #[test]
    fn long_work_is_ended_and_extrapolated() {
        let clock = Stopwatch::start();
        let long = processor_secs(&Silent, |monitor| units(monitor, 1_000_000));
        let waited = clock.elapsed().as_secs_f64();
        let long = long.expect("no error");
        // At most 15 units are made.
        assert!(long >= waited * 50_000.0, "{long} after {waited}");
        let short = processor_secs(&Silent, |monitor| units(monitor, 1)).expect("no error");
        assert!(short < long, "{short}");
    }

    #[test]
    fn what_ends_work_otherwise_is_an_error() {
        struct Interrupted;
        impl Monitor for Interrupted {
            fn interrupted(&self) -> bool {
                true
            }
        }
        let ended = processor_secs(&Interrupted, |monitor| units(monitor, 1));
        assert!(ended.expect_err("interrupted").was_cancelled());
        let failed =
            processor_secs(&Silent, |_| Err::<(), _>(StepError::message("no such sensor")));
        assert_eq!(failed.expect_err("an error").to_string(), "no such sensor");
    }
}
