use std::{io::IsTerminal as _, sync::Mutex, time::Duration};

use calib_core::{Monitor, locked};
use calib_pipeline::{
    Shown, Stopwatch,
    output::{Stage, duration},
};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use super::{interrupts::is_asked_to_stop, stderr::eprint_line};

/// Function that keeps a line in a file.
pub(crate) type KeepLine = Box<dyn Fn(&str) + Send + Sync>;

/// Shows progress with the remaining time, and passes interrupts on.
pub(crate) struct ProgressMonitor {
    bar: ProgressBar,
    /// Lines for output without a terminal. `None` if there is a progress bar, or no output.
    plain: Option<Mutex<Lines>>,
    /// Lines for the journal, if there is one, and the function that keeps them.
    kept: Option<(Mutex<Lines>, KeepLine)>,
    /// Stage of a run of several stages.
    stage: Option<Stage>,
    /// Time since the bar last showed the progress of the whole run.
    since_told: Mutex<Stopwatch>,
}

/// Occasional lines that report the progress of a task.
struct Lines {
    task: String,
    every: Duration,
    since_line: Stopwatch,
    /// Whether the task has had a line.
    told: bool,
    since_start: Stopwatch,
}

impl Lines {
    fn new(every: Duration) -> Self {
        let now = Stopwatch::start();
        Self { task: String::new(), every, since_line: now, told: false, since_start: now }
    }

    fn begin(&mut self, task: &str) {
        task.clone_into(&mut self.task);
        self.since_start = Stopwatch::start();
        self.told = false;
    }
}

/// Time until the first line of a long task without a progress bar.
const FIRST_LINE: Duration = Duration::from_secs(2);
/// Interval between updates of the progress of the whole run.
const BAR_EVERY: Duration = Duration::from_millis(500);
/// Interval between lines without a progress bar.
const LINE_EVERY: Duration = Duration::from_secs(10);
/// Interval between lines in a journal.
const KEPT_EVERY: Duration = Duration::from_mins(1);

impl ProgressMonitor {
    pub(crate) fn new(shown: Shown, stage: Option<Stage>, keep: Option<KeepLine>) -> Self {
        let quiet = shown == Shown::No;
        let terminal = std::io::stderr().is_terminal();
        let target = if quiet || !terminal {
            ProgressDrawTarget::hidden()
        } else {
            ProgressDrawTarget::stderr_with_hz(10)
        };
        let plain = (!quiet && !terminal).then(|| Mutex::new(Lines::new(LINE_EVERY)));
        let kept = keep.map(|keep| (Mutex::new(Lines::new(KEPT_EVERY)), keep));
        let bar = ProgressBar::with_draw_target(Some(0), target);
        let style = "{prefix:>14} [{bar:32}] {percent:>3}%  {human_pos}/{human_len}  {elapsed} elapsed, {eta} left{msg}";
        if let Ok(style) = ProgressStyle::with_template(style) {
            bar.set_style(style.progress_chars("=> "));
        }
        Self { bar, plain, kept, stage, since_told: Mutex::new(Stopwatch::start()) }
    }

    /// Returns the progress of the whole run, if this task takes as long as it now seems.
    fn whole(&self, elapsed: Duration, left: Duration) -> String {
        let Some(Stage { number, stages, later }) = self.stage else { return String::new() };
        let all = later.filter(|later| *later > 0.0).and_then(|later| {
            let after = Duration::try_from_secs_f64((elapsed + left).as_secs_f64() * later).ok()?;
            Some(format!(", about {} for all sweeps", duration(left + after)))
        });
        format!("; step {number} of {stages}{}", all.unwrap_or_default())
    }

    /// Updates the text beside the bar from time to time.
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

    /// Returns a progress line, if it is time for one.
    fn line(&self, lines: &Mutex<Lines>) -> Option<String> {
        let mut lines = lines.try_lock().ok()?;
        let done = self.bar.position();
        let total = self.bar.length().unwrap_or(0);
        if total == 0 {
            return None;
        }
        let elapsed = lines.since_start.elapsed();
        let share = done as f64 / total as f64;
        let left = elapsed.mul_f64((1.0 - share).max(0.0) / share.max(1e-9));
        // A long task has an early first line.
        let early = !lines.told && done > 0 && elapsed > FIRST_LINE && left > lines.every;
        if !early && lines.since_line.elapsed() < lines.every {
            return None;
        }
        lines.told = true;
        lines.since_line = Stopwatch::start();
        let (left, whole) = if done == 0 {
            ("unknown time".to_owned(), String::new())
        } else {
            (duration(left), self.whole(elapsed, left))
        };
        Some(format!("{}: {:.0} %, {left} left{whole}", lines.task, 100.0 * share))
    }

    fn tell_lines(&self) {
        if let Some(line) = self.plain.as_ref().and_then(|lines| self.line(lines)) {
            eprint_line(&format!("  {line}"));
        }
        if let Some((lines, keep)) = &self.kept
            && let Some(line) = self.line(lines)
        {
            keep(&line);
        }
    }
}

impl Monitor for ProgressMonitor {
    fn begin(&self, task: &str, total: u64) {
        self.bar.reset();
        self.bar.set_length(total);
        self.bar.set_position(0);
        self.bar.set_prefix(task.to_owned());
        let kept = self.kept.as_ref().map(|(lines, _)| lines);
        for lines in self.plain.as_ref().into_iter().chain(kept) {
            locked(lines).begin(task);
        }
    }

    fn advance(&self, units: u64) {
        self.bar.inc(units);
        self.tell_lines();
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

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;

    #[test]
    fn a_journal_keeps_lines_of_what_nobody_is_shown() {
        let lines: Arc<Mutex<Vec<String>>> = Arc::default();
        let kept = Arc::clone(&lines);
        let keep: KeepLine =
            Box::new(move |line| kept.lock().expect("whole").push(line.to_owned()));
        let stage = Stage { number: 4, stages: 5, later: None };
        let mut monitor = ProgressMonitor::new(Shown::No, Some(stage), Some(keep));
        monitor.begin("training", 4);
        monitor.advance(1);
        assert!(lines.lock().expect("whole").is_empty(), "a minute has not passed");
        if let Some((lines, _)) = &mut monitor.kept {
            lines.get_mut().expect("whole").every = Duration::ZERO;
        }
        monitor.advance(1);
        let lines = lines.lock().expect("whole");
        assert_eq!(lines.len(), 1, "{lines:?}");
        assert!(lines[0].starts_with("training: 50 %, "), "{lines:?}");
        assert!(lines[0].ends_with(" left; step 4 of 5"), "{lines:?}");
    }
}
