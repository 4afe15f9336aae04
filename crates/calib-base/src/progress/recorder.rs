//! An observer that records the progress of a command, and passes on everything that it receives.

use std::{
    io,
    path::PathBuf,
    sync::{
        Arc, Condvar, Mutex, MutexGuard, PoisonError,
        atomic::{AtomicU64, AtomicUsize, Ordering},
    },
    thread,
    time::Duration,
};

use calib_core::{Monitor, locked};
use calib_files::{Below, remove_note, remove_temporaries, write_note};
use calib_study::{Job, StepKind};

use super::note::{CommandState, FOLDER, Note, Task, notes};
use crate::{
    StepError,
    clock::{Stopwatch, unix_secs},
    output::{Announced, Observer, Printer, Remark, ResultPart, Shown, Stage},
};

/// Delay before the first note, so that a command that fails at once leaves no note.
const FIRST: Duration = Duration::from_millis(100);
/// Interval between two notes.
const EVERY: Duration = Duration::from_secs(1);
/// The remaining time of a task is estimated after this time,
const FIRST_ESTIMATE: Duration = Duration::from_secs(2);
/// or after this share of its work.
const FIRST_SHARE: f64 = 0.1;

/// Runs the work of a command on a study, and records its progress in the folder of results. A command that writes
/// nothing gets no note. If the disk cannot be written, the work continues.
///
/// # Errors
/// Those of the `work`.
pub fn recorded<T>(
    command: &str,
    job: &Job,
    printer: &Printer,
    work: impl FnOnce(&Printer) -> Result<T, StepError>,
) -> Result<T, StepError> {
    job.renamed_keys().iter().for_each(|told| printer.warn(told));
    if job.policy().is_dry() {
        return work(printer);
    }
    let recorder = Arc::new(Recorder::new(command, job));
    let ticking = thread::Builder::new().name("progress".to_owned()).spawn({
        let recorder = Arc::clone(&recorder);
        move || recorder.tick()
    });
    let ending = Ending { recorder: Arc::clone(&recorder), ticking: ticking.ok() };
    let done = work(&printer.observed_by(|inner| Arc::new(Recording { inner, recorder })));
    drop(ending);
    done
}

/// Ends the notes, however the work ends.
struct Ending {
    recorder: Arc<Recorder>,
    ticking: Option<thread::JoinHandle<()>>,
}

impl Drop for Ending {
    fn drop(&mut self) {
        self.recorder.state().is_over = true;
        self.recorder.news.notify_all();
        if let Some(ticking) = self.ticking.take() {
            let _ = ticking.join();
        }
    }
}

/// The progress to record, and the file for it.
struct Recorder {
    path: PathBuf,
    results: PathBuf,
    clock: Stopwatch,
    state: Mutex<State>,
    news: Condvar,
    /// Completed units of the task.
    done: AtomicU64,
}

struct State {
    note: Note,
    stage: Option<Stage>,
    task: Option<(String, u64, Stopwatch)>,
    announced: Option<Announced>,
    is_over: bool,
}

impl Recorder {
    fn new(command: &str, job: &Job) -> Self {
        /// A program may run several commands.
        static NUMBER: AtomicUsize = AtomicUsize::new(0);
        let results = job.layout().of_study().to_owned();
        let note = Note::begun(command, job.layout().study());
        let number = NUMBER.fetch_add(1, Ordering::Relaxed);
        let host = calib_files::file_name(&note.host);
        let name = format!("{host}-{}-{number}.json", note.process);
        let state = State { note, stage: None, task: None, announced: None, is_over: false };
        Self {
            path: results.join(FOLDER).join(name),
            results,
            clock: Stopwatch::start(),
            state: Mutex::new(state),
            news: Condvar::new(),
            done: AtomicU64::new(0),
        }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        locked(&self.state)
    }

    /// Writes a note soon, then every second, until the command is over.
    fn tick(&self) {
        // Usually there is no folder, and what cannot be removed does no harm.
        let _ = remove_temporaries(&self.results.join(FOLDER), Below::Unknown);
        for (path, note) in notes(&self.results) {
            if note.standing() == CommandState::Killed {
                remove_note(&path, &self.results);
            }
        }
        let mut state = self.state();
        let mut wait = FIRST;
        loop {
            let waited = self.news.wait_timeout_while(state, wait, |state| !state.is_over);
            wait = EVERY;
            (state, _) = waited.unwrap_or_else(PoisonError::into_inner);
            if state.is_over {
                break;
            }
            let note = self.noted(&mut state);
            drop(state);
            if let Ok(text) = serde_json::to_vec_pretty(&note) {
                // If the note cannot be written, only the progress report is missing.
                let _ = write_note(&self.path, &text);
            }
            state = self.state();
        }
        drop(state);
        remove_note(&self.path, &self.results);
    }

    /// Returns the present progress.
    fn noted(&self, state: &mut State) -> Note {
        let stage = state.stage;
        let task = state.task.as_ref().map(|(name, total, since)| {
            let done = self.done.load(Ordering::Relaxed).min(*total);
            let elapsed = since.elapsed();
            let share = done as f64 / (*total).max(1) as f64;
            let tells = done > 0 && (elapsed >= FIRST_ESTIMATE || share >= FIRST_SHARE);
            let left = tells.then(|| elapsed.as_secs_f64() * (1.0 / share - 1.0));
            (Task { name: name.clone(), done, total: *total, secs_left: left }, elapsed)
        });
        let secs_left = task.as_ref().and_then(|(task, elapsed)| {
            let left = task.secs_left?;
            match stage {
                // A command of one stage is over when its work is, except for the only one that has several tasks in a row.
                None => (state.note.command != StepKind::Control.command()).then_some(left),
                Some(stage) => Some(left + (elapsed.as_secs_f64() + left) * stage.later?),
            }
        });
        // Sweeps are almost all of the work, so their remaining time is that of the run.
        let is_sweep = stage.is_some_and(|stage| stage.later.is_some());
        let is_settled = task.as_ref().is_some_and(|(_, elapsed)| *elapsed >= FIRST_ESTIMATE);
        if let (None, Some(left), true) = (state.announced, secs_left, is_sweep && is_settled) {
            let after = self.clock.elapsed();
            let left = Duration::try_from_secs_f64(left).unwrap_or(Duration::MAX);
            state.announced = Some(Announced { whole: after.saturating_add(left), after });
        }
        state.note.stage = stage.map(|stage| [stage.number, stage.stages]);
        state.note.task = task.map(|(task, _)| task);
        state.note.secs_left = secs_left;
        state.note.written = unix_secs();
        state.note.clone()
    }
}

/// Passes on everything that it receives, and records it.
struct Recording {
    inner: Arc<dyn Observer>,
    recorder: Arc<Recorder>,
}

impl Observer for Recording {
    fn remark(&self, remark: Remark<'_>) {
        if let Remark::Heading(text) = remark {
            let note = &mut self.recorder.state().note;
            // A heading with a number begins a stage; one without is a part of a stage.
            if text.starts_with('[') {
                (note.doing, note.part) = (Some(text.to_owned()), None);
            } else {
                note.part = Some(text.to_owned());
            }
        }
        self.inner.remark(remark);
    }

    fn result(&self, result: ResultPart<'_>) -> io::Result<()> {
        self.inner.result(result)
    }

    fn stage(&self, stage: Stage) {
        self.recorder.state().stage = Some(stage);
        self.inner.stage(stage);
    }

    fn announced(&self) -> Option<Announced> {
        self.recorder.state().announced
    }

    fn progress(&self, shown: Shown) -> Box<dyn Monitor> {
        let inner = self.inner.progress(shown);
        let recorder = Arc::clone(&self.recorder);
        Box::new(Watched { inner, recorder })
    }
}

/// A monitor of long work.
struct Watched {
    inner: Box<dyn Monitor>,
    recorder: Arc<Recorder>,
}

impl Monitor for Watched {
    fn begin(&self, task: &str, total: u64) {
        self.recorder.done.store(0, Ordering::Relaxed);
        self.recorder.state().task = Some((task.to_owned(), total, Stopwatch::start()));
        self.inner.begin(task, total);
    }

    fn advance(&self, units: u64) {
        self.recorder.done.fetch_add(units, Ordering::Relaxed);
        self.inner.advance(units);
    }

    fn interrupted(&self) -> bool {
        self.inner.interrupted()
    }
}

impl Drop for Watched {
    fn drop(&mut self) {
        self.recorder.state().task = None;
    }
}
