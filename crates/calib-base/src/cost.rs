//! Expected costs of steps, from short measurements on this machine.

use std::{
    sync::{
        Mutex, MutexGuard,
        atomic::{AtomicU64, Ordering},
    },
    time::Duration,
};

use calib_core::{Monitor, locked};
use calib_study::StepKind;
use schemars::JsonSchema;
use serde::Serialize;

use crate::{StepError, clock::Timer, output::duration_of_secs};

/// Time limit of one measured task: long against the tick of the processor's clock, and short for whoever waits (our
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

/// Returns the processor seconds of `work`. If its last task takes too long, `work` is ended, and the time of the task
/// is extrapolated from the units that the monitor was told of. Time before the task, such as that of a preparation,
/// counts once. `None` if no unit was done by then.
///
/// # Errors
/// If the work fails, or `monitor` interrupts it.
pub fn processor_secs<T, E: Into<StepError>>(
    monitor: &dyn Monitor,
    work: impl FnOnce(&dyn Monitor) -> Result<T, E>,
) -> Result<Option<f64>, StepError> {
    let begun = Timer::start();
    let limit = TaskLimitMonitor {
        monitor,
        begun,
        task: Mutex::new(TimedTask { secs_before: 0.0, timer: begun, total: 0 }),
        done: AtomicU64::new(0),
    };
    let ended = work(&limit);
    let task = *limit.task();
    let [all, secs] = [begun, task.timer].map(|timer| timer.taken().on_processors());
    let Err(reason) = ended else { return Ok(Some(all)) };
    let reason: StepError = reason.into();
    if !reason.was_cancelled() || monitor.interrupted() {
        return Err(reason);
    }
    Ok(extrapolated(task.secs_before, secs, limit.done.into_inner(), task.total))
}

/// Returns the seconds of work whose task took `secs` for `done` of its `total` units, after `secs_before` of other
/// work. `None` if no unit was done.
fn extrapolated(secs_before: f64, secs: f64, done: u64, total: u64) -> Option<f64> {
    (done > 0).then(|| secs_before + secs * total.max(done) as f64 / done as f64)
}

/// A monitor that ends work [`MEASURED`] after its last task began, and counts the units of the task until then.
struct TaskLimitMonitor<'a> {
    monitor: &'a dyn Monitor,
    begun: Timer,
    task: Mutex<TimedTask>,
    done: AtomicU64,
}

/// The task that was begun last. Before the first one, all work so far.
#[derive(Clone, Copy)]
struct TimedTask {
    /// Processor seconds of the work before it.
    secs_before: f64,
    timer: Timer,
    /// Number of its units.
    total: u64,
}

impl TaskLimitMonitor<'_> {
    fn task(&self) -> MutexGuard<'_, TimedTask> {
        locked(&self.task)
    }
}

impl Monitor for TaskLimitMonitor<'_> {
    fn begin(&self, _task: &str, total: u64) {
        let secs_before = self.begun.taken().on_processors();
        *self.task() = TimedTask { secs_before, timer: Timer::start(), total };
        self.done.store(0, Ordering::Relaxed);
    }

    fn advance(&self, units: u64) {
        self.done.fetch_add(units, Ordering::Relaxed);
    }

    fn interrupted(&self) -> bool {
        self.monitor.interrupted() || self.task().timer.elapsed() >= MEASURED
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

    /// Makes `units` units of 20 ms, and counts those that it `made`.
    fn units(monitor: &dyn Monitor, units: u64, made: &AtomicU64) -> Result<(), Cancelled> {
        monitor.begin("sleeping", units);
        for _ in 0..units {
            monitor.check()?;
            thread::sleep(Duration::from_millis(20));
            monitor.advance(1);
            made.fetch_add(1, Ordering::Relaxed);
        }
        Ok(())
    }

    #[test]
    fn units_are_extrapolated_and_the_time_before_them_is_not() {
        assert_eq!(extrapolated(0.0, 0.25, 10, 1_000_000), Some(25_000.0));
        assert_eq!(extrapolated(0.5, 0.25, 10, 1_000_000), Some(25_000.5));
        assert_eq!(extrapolated(0.5, 0.25, 10, 0), Some(0.75), "more units than were announced");
        assert_eq!(extrapolated(0.5, 0.25, 0, 1_000_000), None);
    }

    #[test]
    fn long_work_is_ended_after_some_of_its_units() {
        let made = AtomicU64::new(0);
        let secs = processor_secs(&Silent, |monitor| {
            // A preparation that alone takes longer than the limit.
            thread::sleep(Duration::from_millis(400));
            units(monitor, 1_000_000, &made)
        });
        let made = made.into_inner();
        assert!((1..1_000_000).contains(&made), "{made}");
        assert!(secs.expect("no error").is_some());
    }

    #[test]
    fn a_preparation_counts_once() {
        let [ended, unfinished] = [1, 0].map(|done: u64| {
            let secs = processor_secs(&Silent, |monitor| {
                thread::sleep(Duration::from_millis(400));
                monitor.begin("nothing", 1);
                monitor.advance(done);
                Err::<(), _>(Cancelled)
            });
            secs.expect("no error")
        });
        // The processor time of other threads counts too, from 0.1 s on.
        assert!(ended.is_some_and(|secs| secs >= 0.1));
        assert_eq!(unfinished, None);
    }

    #[test]
    fn interruptions_and_failures_are_errors() {
        struct Interrupted;
        impl Monitor for Interrupted {
            fn interrupted(&self) -> bool {
                true
            }
        }
        let ended = processor_secs(&Interrupted, |monitor| monitor.check());
        assert!(ended.expect_err("interrupted").was_cancelled());
        let failed =
            processor_secs(&Silent, |_| Err::<(), _>(StepError::message("no such sensor")));
        assert_eq!(failed.expect_err("an error").to_string(), "no such sensor");
    }
}
