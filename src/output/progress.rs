use std::{io::IsTerminal as _, sync::Mutex, time::Duration};

use calib_core::Monitor;
use calib_pipeline::{
    Shown, Stopwatch,
    output::{Stage, duration},
};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use super::interrupts::is_asked_to_stop;

/// Shows progress with an ETA and passes interrupts on.
#[derive(Debug)]
pub(crate) struct ProgressMonitor {
    bar: ProgressBar,
    /// Off a terminal: when the last line was printed. `None` where a bar is drawn or in silence.
    plain: Option<Mutex<PlainLines>>,
    /// Which stage of a whole run it is of.
    stage: Option<Stage>,
    /// When the bar last said how far the whole is.
    since_told: Mutex<Stopwatch>,
}

#[derive(Debug)]
struct PlainLines {
    task: String,
    since_line: Stopwatch,
    /// Whether the task has a line yet.
    told: bool,
    since_start: Stopwatch,
}

/// Time to the first line of a long task where no bar can be drawn.
const FIRST_LINE: Duration = Duration::from_secs(2);
/// Time between two looks at how far the whole is.
const BAR_EVERY: Duration = Duration::from_millis(500);
/// Time between two such lines.
const LINE_EVERY: Duration = Duration::from_secs(10);

impl ProgressMonitor {
    pub(crate) fn new(shown: Shown, stage: Option<Stage>) -> Self {
        let quiet = shown == Shown::No;
        let terminal = std::io::stderr().is_terminal();
        let target = if quiet || !terminal {
            ProgressDrawTarget::hidden()
        } else {
            ProgressDrawTarget::stderr_with_hz(10)
        };
        let plain = (!quiet && !terminal).then(|| {
            let now = Stopwatch::start();
            Mutex::new(PlainLines {
                task: String::new(),
                since_line: now,
                told: false,
                since_start: now,
            })
        });
        let bar = ProgressBar::with_draw_target(Some(0), target);
        let style = "{prefix:>14} [{bar:32}] {percent:>3}%  {human_pos}/{human_len}  {elapsed} elapsed, {eta} left{msg}";
        if let Ok(style) = ProgressStyle::with_template(style) {
            bar.set_style(style.progress_chars("=> "));
        }
        Self { bar, plain, stage, since_told: Mutex::new(Stopwatch::start()) }
    }

    /// How far the whole run is, when this task will take as long as it does by now.
    fn whole(&self, elapsed: Duration, left: Duration) -> String {
        let Some(Stage { number, of, later }) = self.stage else { return String::new() };
        let all = later.filter(|later| *later > 0.0).and_then(|later| {
            let after = Duration::try_from_secs_f64((elapsed + left).as_secs_f64() * later).ok()?;
            Some(format!(", about {} for all sweeps", duration(left + after)))
        });
        format!("; step {number} of {of}{}", all.unwrap_or_default())
    }

    /// Beside the bar, now and then.
    fn tell_whole(&self) {
        if self.stage.is_none() || self.bar.is_hidden() {
            return;
        }
        let Ok(mut since) = self.since_told.try_lock() else { return };
        if since.elapsed() > BAR_EVERY {
            *since = Stopwatch::start();
            self.bar.set_message(self.whole(self.bar.elapsed(), self.bar.eta()));
        }
    }

    fn plain_line(&self) {
        let Some(plain) = &self.plain else { return };
        let Ok(mut plain) = plain.lock() else { return };
        let done = self.bar.position();
        let total = self.bar.length().unwrap_or(0);
        if total == 0 {
            return;
        }
        let elapsed = plain.since_start.elapsed();
        let share = done as f64 / total as f64;
        let left = elapsed.mul_f64((1.0 - share).max(0.0) / share.max(1e-9));
        // A task that will be long says so early.
        let early = !plain.told && done > 0 && elapsed > FIRST_LINE && left > LINE_EVERY;
        if !early && plain.since_line.elapsed() < LINE_EVERY {
            return;
        }
        plain.told = true;
        plain.since_line = Stopwatch::start();
        let (left, whole) = if done == 0 {
            ("unknown time".to_owned(), String::new())
        } else {
            (duration(left), self.whole(elapsed, left))
        };
        eprintln_quietly(&format!("  {}: {:.0} %, {left} left{whole}", plain.task, 100.0 * share));
    }
}

fn eprintln_quietly(text: &str) {
    use std::io::Write as _;
    let _ = writeln!(std::io::stderr().lock(), "{text}");
}

impl Monitor for ProgressMonitor {
    fn begin(&self, task: &str, total: u64) {
        self.bar.reset();
        self.bar.set_length(total);
        self.bar.set_position(0);
        self.bar.set_prefix(task.to_owned());
        if let Some(plain) = &self.plain
            && let Ok(mut plain) = plain.lock()
        {
            task.clone_into(&mut plain.task);
            plain.since_start = Stopwatch::start();
            plain.told = false;
        }
    }

    fn advance(&self, units: u64) {
        self.bar.inc(units);
        self.plain_line();
        self.tell_whole();
    }

    fn interrupted(&self) -> bool {
        is_asked_to_stop()
    }
}

impl Drop for ProgressMonitor {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}
