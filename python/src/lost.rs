//! Handles files of a model that are cut short while they are mapped. Reading a page that is gone raises a signal, which
//! would end the interpreter. Instead the page becomes zeros here, and the next call reports that the values are not valid.
//!
//! Steps are not protected: their output must not depend on zeros. If the signal ends a step, its files are as complete as
//! after any other interruption.

use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};

use pyo3::prelude::*;

use crate::errors;

/// Number of pages that became zeros.
static LOST: AtomicU64 = AtomicU64::new(0);
/// Number of steps that are running.
static STEPS: AtomicUsize = AtomicUsize::new(0);

/// The number of lost pages when something was opened.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LostPages(u64);

impl LostPages {
    pub(crate) fn so_far() -> Self {
        Self(LOST.load(Ordering::Acquire))
    }

    /// Refuses values if more pages were lost since then.
    ///
    /// # Errors
    /// `CalibError` if so.
    pub(crate) fn check(self, py: Python<'_>) -> PyResult<()> {
        if LOST.load(Ordering::Acquire) == self.0 {
            return Ok(());
        }
        Err(errors::of_text(
            py,
            "a file of a model was cut short while it was open, or its disk failed, and what was read of it since may be \
             zeros; see to the file, and open the model again",
        ))
    }
}

/// A guard: a step is running as long as this value exists.
pub(crate) struct Step;

impl Step {
    pub(crate) fn begin() -> Self {
        STEPS.fetch_add(1, Ordering::AcqRel);
        Self
    }
}

impl Drop for Step {
    fn drop(&mut self) {
        STEPS.fetch_sub(1, Ordering::AcqRel);
    }
}

#[cfg(unix)]
pub(crate) use unix::watch;

#[cfg(not(unix))]
pub(crate) fn watch() {}

#[cfg(unix)]
mod unix {
    use std::{mem::MaybeUninit, ptr, sync::OnceLock};

    use super::{LOST, Ordering, STEPS};

    /// The previous handler of the signal, and the length of a page.
    static BEFORE: OnceLock<(libc::sigaction, usize)> = OnceLock::new();

    /// Installs the handler that notices lost pages.
    pub(crate) fn watch() {
        let handler: extern "C" fn(libc::c_int, *mut libc::siginfo_t, *mut libc::c_void) = tolerate;
        // SAFETY: the actions are filled in by the system or here; the handler is one for `SA_SIGINFO`.
        #[expect(unsafe_code, reason = "signals are handled in C")]
        unsafe {
            let mut before = MaybeUninit::<libc::sigaction>::zeroed();
            if libc::sigaction(libc::SIGBUS, ptr::null(), before.as_mut_ptr()) != 0 {
                return;
            }
            let page = usize::try_from(libc::sysconf(libc::_SC_PAGESIZE)).unwrap_or(4096);
            if BEFORE.set((before.assume_init(), page)).is_err() {
                return;
            }
            let mut action = MaybeUninit::<libc::sigaction>::zeroed().assume_init();
            action.sa_sigaction = handler as libc::sighandler_t;
            action.sa_flags = libc::SA_SIGINFO | libc::SA_ONSTACK;
            libc::sigaction(libc::SIGBUS, &raw const action, ptr::null_mut());
        }
    }

    /// Maps a page of zeros in the place of a lost one. Other signals go to the previous handler.
    extern "C" fn tolerate(signal: libc::c_int, info: *mut libc::siginfo_t, _: *mut libc::c_void) {
        let Some((before, page)) = BEFORE.get() else { return };
        // SAFETY: the system provides the information of the signal. Only atomics are read, and `mmap` and `sigaction` are calls of
        // the system. The page lies in a read-only mapping of calib, and is not given back before the mapping is.
        #[expect(unsafe_code, reason = "signals are handled in C")]
        unsafe {
            let address = (*info).si_addr() as usize;
            if STEPS.load(Ordering::Acquire) == 0 && calib_files::is_mapped(address) {
                let start = (address / page * page) as *mut libc::c_void;
                let flags = libc::MAP_PRIVATE | libc::MAP_ANONYMOUS | libc::MAP_FIXED;
                if libc::mmap(start, *page, libc::PROT_READ, flags, -1, 0) == start {
                    LOST.fetch_add(1, Ordering::AcqRel);
                    return;
                }
            }
            // The previous handler is installed again. It deals with the signal when the access is repeated.
            libc::sigaction(signal, ptr::from_ref(before), ptr::null_mut());
        }
    }
}
