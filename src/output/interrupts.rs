//! Being asked to stop: by a person, or by whoever runs many such commands and needs the machine or sees a limit come.

use std::sync::{
    Once,
    atomic::{AtomicBool, Ordering},
};

static ASKED: AtomicBool = AtomicBool::new(false);
/// It is to go on later.
static FOR_NOW: AtomicBool = AtomicBool::new(false);

/// From now on Ctrl-C asks the work to stop at its next safe point; a second Ctrl-C ends at once. So do TERM, USR1 and
/// USR2, however often they come: batch systems send them to several processes of a task before its end.
pub(crate) fn watch_for_interrupts() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        // Without a handler Ctrl-C ends the process at once; that is safe too, only less polite.
        let _ = ctrlc::set_handler(|| {
            if ASKED.swap(true, Ordering::SeqCst) {
                std::process::exit(130);
            }
        });
        #[cfg(unix)]
        watch_for_batch_systems();
    });
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

/// Whether it is to be tried again: what was asked to stop has kept its state.
pub(crate) fn is_to_be_tried_again() -> bool {
    FOR_NOW.load(Ordering::Relaxed)
}
