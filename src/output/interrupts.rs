//! Requests to stop: from a user, or from a batch system that needs the machine or reaches a time limit.

use std::{
    sync::{
        Once,
        atomic::{AtomicBool, Ordering},
    },
    thread,
    time::Duration,
};

use crate::ExitStatus;

static ASKED: AtomicBool = AtomicBool::new(false);
/// Whether the request came from a batch system, so that the command can resume later.
static FOR_NOW: AtomicBool = AtomicBool::new(false);
/// Whether the command saves nothing before its end.
static KEEPS_NOTHING: AtomicBool = AtomicBool::new(false);

/// Time for work to reach its next safe point. Some work has no safe point for long: within an update of a large
/// network, or in a library.
const GRACE: Duration = Duration::from_millis(1_500);
/// Time for work that has reached a safe point and is writing its checkpoint.
const WRITING_CHECKPOINT: Duration = Duration::from_secs(10);
/// Interval between checks.
const LOOK: Duration = Duration::from_millis(50);

/// What the same command does after an interruption.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum AfterInterruption {
    /// It resumes from the saved state.
    GoesOn,
    /// It starts again from the beginning.
    BeginsAnew,
}

/// Makes signals stop the work. Ctrl-C asks it to stop at its next safe point, and a second Ctrl-C ends the process at
/// once. TERM, USR1 and USR2 only ask, however often they come: batch systems send them to several processes of a task
/// before its end. If no safe point comes soon, the process ends. Results are then whole or absent, as after any kill.
pub(crate) fn watch_for_interrupts(after: AfterInterruption) {
    static ONCE: Once = Once::new();
    KEEPS_NOTHING.store(after == AfterInterruption::BeginsAnew, Ordering::Relaxed);
    ONCE.call_once(|| {
        // Without a handler, Ctrl-C ends the process at once. That is also safe, but less polite.
        let _ = ctrlc::set_handler(|| {
            if ASKED.swap(true, Ordering::SeqCst) {
                std::process::exit(130);
            }
        });
        #[cfg(unix)]
        watch_for_batch_systems();
        // Without this thread, the work has no time limit.
        let _ = thread::Builder::new().name("interrupts".to_owned()).spawn(end_in_time);
    });
}

/// Waits for a signal, and ends the process if the work does not stop in time.
fn end_in_time() {
    while !is_asked_to_stop() {
        thread::sleep(LOOK);
    }
    let mut waited = Duration::ZERO;
    while waited < GRACE || (calib_files::is_writing_checkpoint() && waited < WRITING_CHECKPOINT) {
        thread::sleep(LOOK);
        waited += LOOK;
    }
    let status =
        if is_to_be_tried_again() { ExitStatus::TryAgain } else { ExitStatus::Interrupted };
    end(status)
}

/// Ends the process at once. It takes no lock, such as that of standard
/// error: the thread that does not end may hold it.
#[cfg(unix)]
fn end(status: ExitStatus) -> ! {
    let told = format!("error: {}\n", interrupted());
    // SAFETY: the pointer and the length belong to the same text, and no code runs at exit.
    #[expect(unsafe_code, reason = "a process is left at once in C")]
    unsafe {
        libc::write(libc::STDERR_FILENO, told.as_ptr().cast(), told.len());
        libc::_exit(status as i32)
    }
}

#[cfg(not(unix))]
fn end(status: ExitStatus) -> ! {
    std::process::exit(status as i32)
}

#[cfg(unix)]
fn watch_for_batch_systems() {
    let handler: extern "C" fn(libc::c_int) = stop_for_now;
    for signal in [libc::SIGTERM, libc::SIGUSR1, libc::SIGUSR2] {
        // SAFETY: the handler stores two atomic numbers, which is allowed in a signal handler.
        #[expect(unsafe_code, reason = "signals are handled in C")]
        unsafe {
            libc::signal(signal, handler as libc::sighandler_t);
        }
    }
}

#[cfg(unix)]
extern "C" fn stop_for_now(_: libc::c_int) {
    FOR_NOW.store(true, Ordering::SeqCst);
    ASKED.store(true, Ordering::SeqCst);
}

/// Whether a request to stop was received.
pub(crate) fn is_asked_to_stop() -> bool {
    ASKED.load(Ordering::Relaxed)
}

/// Returns the message about an interruption, and about what the same command does next.
pub(crate) fn interrupted() -> &'static str {
    if KEEPS_NOTHING.load(Ordering::Relaxed) {
        "interrupted; nothing is kept, so the same command begins anew"
    } else {
        "interrupted; run the same command again to go on"
    }
}

/// Whether the command can resume later: a batch system stopped it, and its state is saved.
pub(crate) fn is_to_be_tried_again() -> bool {
    FOR_NOW.load(Ordering::Relaxed)
}
