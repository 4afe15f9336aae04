use std::{io::IsTerminal as _, sync::Mutex, time::Duration};

use calib_core::Monitor;
use calib_pipeline::{Shown, Stopwatch, output::duration};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use super::interrupts::is_asked_to_stop;

/// Shows progress with an ETA and passes interrupts on.
#[derive(Debug)]
pub(crate) struct ProgressMonitor {
    bar: ProgressBar,
    /// Off a terminal: when the last line was printed. `None` where a bar is drawn or in silence.
    plain: Option<Mutex<PlainLines>>,
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
/// Time between two such lines.
const LINE_EVERY: Duration = Duration::from_secs(10);

impl ProgressMonitor {
    pub(crate) fn new(shown: Shown) -> Self {
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
        let style = "{prefix:>14} [{bar:32}] {percent:>3}%  {human_pos}/{human_len}  {elapsed} elapsed, {eta} left";
        if let Ok(style) = ProgressStyle::with_template(style) {
            bar.set_style(style.progress_chars("=> "));
        }
        Self { bar, plain }
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
        let left = if done == 0 { "unknown time".to_owned() } else { duration(left) };
        eprintln_quietly(&format!("  {}: {:.0} %, {left} left", plain.task, 100.0 * share));
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
