//! Runs long work from Python. Other threads of Python run meanwhile, Ctrl-C ends the work at its next safe point, and the calling
//! thread receives its messages.
//!
//! Python handles signals on its main thread only. So the work has its own thread, and the calling thread waits.
//!
//! A forked process has none of its parent's threads. If the parent had started rayon's threads, the child's work gets a thread pool
//! of its own. Code that reads or writes tables has other threads that cannot be replaced, so it is refused.

use std::{
    panic::{AssertUnwindSafe, catch_unwind, resume_unwind},
    process,
    sync::{
        Arc, Mutex, OnceLock,
        atomic::{AtomicBool, Ordering},
    },
    thread::Builder,
    time::Duration,
};

use calib_core::locked;
use calib_pipeline::{Printer, StepError};
use pyo3::{exceptions::PyRuntimeError, prelude::*};
use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::{
    errors,
    lost::Step,
    observer::{Progress, Told, Watch, watch_printer},
};

/// Time between two checks for signals.
const BETWEEN_SIGNAL_CHECKS: Duration = Duration::from_millis(50);
/// Stack of a thread, as large as that of a main thread.
const STACK_BYTES: usize = 8 << 20;
/// A limit that no machine needs to exceed.
const MOST_THREADS: usize = 1024;

/// The first process that asked for threads. A process with another number was forked from it.
static FIRST_PROCESS: OnceLock<u32> = OnceLock::new();
/// Whether that process read or wrote tables.
static HAS_USED_TABLES: AtomicBool = AtomicBool::new(false);

/// The threads that some work needs.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Needs {
    Threads,
    /// Threads for tables in files as well.
    Tables,
}

/// Sets the number of threads, before the first work.
#[pyfunction]
pub(crate) fn set_threads(threads: usize) -> PyResult<()> {
    if !(1..=MOST_THREADS).contains(&threads) {
        return Err(errors::value(format!(
            "threads must be from 1 to {MOST_THREADS}, got {threads}"
        )));
    }
    let built = ThreadPoolBuilder::new().num_threads(threads).build_global();
    built.map_err(|_| {
        PyRuntimeError::new_err(
            "threads are at work already; call set_threads before anything else",
        )
    })
}

/// Returns whether this process was forked from one that had started threads.
fn is_forked() -> bool {
    let here = process::id();
    *FIRST_PROCESS.get_or_init(|| here) != here
}

fn check(needs: Needs) -> PyResult<()> {
    let forked = is_forked();
    if needs == Needs::Tables && forked && HAS_USED_TABLES.load(Ordering::Relaxed) {
        return Err(PyRuntimeError::new_err(
            "this process was forked from one in which calib had read or written tables, and threads do not survive that; \
             start it with multiprocessing.get_context(\"spawn\") or \"forkserver\"",
        ));
    }
    if needs == Needs::Tables && !forked {
        HAS_USED_TABLES.store(true, Ordering::Relaxed);
    }
    Ok(())
}

/// Runs `work` with threads of this process.
fn pooled<T: Send>(work: impl FnOnce() -> T + Send) -> T {
    static OWN: Mutex<Option<(u32, Arc<ThreadPool>)>> = Mutex::new(None);
    if !is_forked() {
        return work();
    }
    let mut own = locked(&OWN);
    let here = process::id();
    if own.as_ref().is_none_or(|(process, _)| *process != here) {
        match ThreadPoolBuilder::new().build() {
            // A parent's pool cannot be ended here, because its threads do not exist in this process.
            Ok(pool) => std::mem::forget(own.replace((here, Arc::new(pool)))),
            Err(_) => return work(),
        }
    }
    let pool = own.as_ref().map(|(_, pool)| Arc::clone(pool));
    drop(own);
    match pool {
        Some(pool) => pool.install(work),
        None => work(),
    }
}

/// Runs `work` while the calling thread checks for signals and passes messages to `observer`:
/// `observer.told(kind, text)`, `observer.progress(task, done, total)`.
///
/// # Errors
/// `RuntimeError` if this process cannot start the threads; the exception of a signal or of the observer, which ends the work.
pub(crate) fn watched<T: Send>(
    py: Python<'_>,
    needs: Needs,
    observer: Option<&Bound<'_, PyAny>>,
    work: impl FnOnce(&Arc<Watch>) -> T + Send,
) -> PyResult<T> {
    check(needs)?;
    let watch = Arc::new(Watch::default());
    let ended = std::thread::scope(|scope| {
        let mine = Arc::clone(&watch);
        let worker = Builder::new().name("calib".to_owned()).stack_size(STACK_BYTES).spawn_scoped(
            scope,
            move || {
                let done = catch_unwind(AssertUnwindSafe(|| pooled(|| work(&mine))));
                mine.finish();
                done
            },
        );
        let worker = worker
            .map_err(|error| PyRuntimeError::new_err(format!("cannot start a thread: {error}")))?;
        let listened = listen(py, &watch, observer);
        let done = py.detach(|| worker.join());
        listened.map(|()| done)
    })?;
    match ended {
        Ok(Ok(done)) => Ok(done),
        Ok(Err(panic)) | Err(panic) => resume_unwind(panic),
    }
}

/// Runs a step as [`watched`] runs work, and returns its result.
///
/// # Errors
/// As [`watched`]; `CalibError` or `StudyError` if the step fails.
pub(crate) fn run_step<T: Send>(
    py: Python<'_>,
    observer: Option<&Bound<'_, PyAny>>,
    step: impl FnOnce(&Printer) -> Result<T, StepError> + Send,
) -> PyResult<T> {
    let ended = watched(py, Needs::Tables, observer, |watch| {
        let _at_work = Step::begin();
        step(&watch_printer(watch))
    })?;
    ended.map_err(|error| errors::of_step(py, &error))
}

/// Passes on messages until the work has ended. The first exception asks the work to stop.
fn listen(py: Python<'_>, watch: &Watch, observer: Option<&Bound<'_, PyAny>>) -> PyResult<()> {
    let mut raised = None;
    let mut shown = Progress::default();
    loop {
        let (told, progress, finished) = py.detach(|| watch.wait(BETWEEN_SIGNAL_CHECKS));
        let news = Some(&progress).filter(|progress| **progress != shown);
        if raised.is_none()
            && let Err(error) = pass_on(py, observer, told, news)
        {
            watch.stop();
            raised = Some(error);
        }
        shown = progress;
        if finished {
            return raised.map_or(Ok(()), Err);
        }
    }
}

/// Checks for signals, and passes on the messages and the progress, if that is new.
fn pass_on(
    py: Python<'_>,
    observer: Option<&Bound<'_, PyAny>>,
    told: Vec<Told>,
    news: Option<&Progress>,
) -> PyResult<()> {
    py.check_signals()?;
    let Some(observer) = observer else { return Ok(()) };
    for (kind, text) in told {
        observer.call_method1("told", (kind, text))?;
    }
    if let Some(Progress { task, done, total }) = news {
        observer.call_method1("progress", (task, done, total))?;
    }
    Ok(())
}
