//! Being asked to stop: by a person, or by whoever runs many such commands and needs the machine or sees a limit come.

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
/// It is to go on later.
static FOR_NOW: AtomicBool = AtomicBool::new(false);
/// The command keeps nothing of what it did before it is done.
static KEEPS_NOTHING: AtomicBool = AtomicBool::new(false);

/// How long work has to come to its next safe point. Some has none for long: inside an update of a large network, or in
/// a library.
const GRACE: Duration = Duration::from_millis(1_500);
/// How long it has if it has come there, and is writing what it goes on from.
const WRITING_CHECKPOINT: Duration = Duration::from_secs(10);
/// Between two looks.
const LOOK: Duration = Duration::from_millis(50);

/// What the same command does after an interruption.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum AfterInterruption {
    /// It goes on from what was kept.
    GoesOn,
    /// It does everything again.
    BeginsAnew,
}

/// From now on Ctrl-C asks the work to stop at its next safe point; a second Ctrl-C ends at once. So do TERM, USR1 and
/// USR2, however often they come: batch systems send them to several processes of a task before its end. Where no safe
/// point comes soon, the process ends: results are whole or absent after that as after any kill.
pub(crate) fn watch_for_interrupts(after: AfterInterruption) {
    static ONCE: Once = Once::new();
    KEEPS_NOTHING.store(after == AfterInterruption::BeginsAnew, Ordering::Relaxed);
    ONCE.call_once(|| {
        // Without a handler Ctrl-C ends the process at once; that is safe too, only less polite.
        let _ = ctrlc::set_handler(|| {
            if ASKED.swap(true, Ordering::SeqCst) {
                std::process::exit(130);
            }
        });
        #[cfg(unix)]
        watch_for_batch_systems();
        // Without it the work is only waited for.
        let _ = thread::Builder::new().name("interrupts".to_owned()).spawn(end_in_time);
    });
}

/// Wait for a signal, and end the process where the work does not end in time.
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

/// End at once. Whoever holds a lock, such as that of standard error, may be what does not end.
#[cfg(unix)]
fn end(status: ExitStatus) -> ! {
    let told = format!("error: {}\n", interrupted());
    // SAFETY: the text is as long as is said, and nothing is run on the way out.
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
        // SAFETY: the handler stores two atomic numbers, which may be done in a handler.
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

/// Whether the work is to stop.
pub(crate) fn is_asked_to_stop() -> bool {
    ASKED.load(Ordering::Relaxed)
}

/// What is said of an interruption, and of what the same command does after it.
pub(crate) fn interrupted() -> &'static str {
    if KEEPS_NOTHING.load(Ordering::Relaxed) {
        "interrupted; nothing is kept, so the same command begins anew"
    } else {
        "interrupted; run the same command again to go on"
    }
}

/// Whether it is to be tried again: what was asked to stop has kept its state.
pub(crate) fn is_to_be_tried_again() -> bool {
    FOR_NOW.load(Ordering::Relaxed)
}
