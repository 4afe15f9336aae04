//! A model's file that is cut short while it is mapped: whoever reads a page that is gone gets a signal which ends the
//! interpreter. Here such a page becomes zeros, and the next call says that what was read is nothing.
//!
//! Steps are left as they are: what they write must not follow from zeros, and it is as whole after their end as after any
//! other.

use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};

use pyo3::prelude::*;

use crate::errors;

/// Pages that became zeros.
static LOST: AtomicU64 = AtomicU64::new(0);
/// Steps that are at work.
static STEPS: AtomicUsize = AtomicUsize::new(0);

/// How many pages had been lost when something was opened.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LostPages(u64);

impl LostPages {
    pub(crate) fn so_far() -> Self {
        Self(LOST.load(Ordering::Acquire))
    }

    /// Refuse what was read if more pages were lost since then.
    ///
    /// # Errors
    /// `CalibError`.
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

/// A step is at work as long as this lives.
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

    /// What was done about the signal before, and the length of a page.
    static BEFORE: OnceLock<(libc::sigaction, usize)> = OnceLock::new();

    /// From now on pages that are lost are noticed.
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

    /// Put a page of zeros in the place of one that is gone; whatever else it is, others deal with.
    extern "C" fn tolerate(signal: libc::c_int, info: *mut libc::siginfo_t, _: *mut libc::c_void) {
        let Some((before, page)) = BEFORE.get() else { return };
        // SAFETY: the system hands over the information of the signal. Only atomics are read, and `mmap` and `sigaction` are calls of
        // the system; the page lies in a mapping of calib's that is only read, and is not given back before the mapping is.
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
            // What the signal is of happens again, and is then dealt with as before.
            libc::sigaction(signal, ptr::from_ref(before), ptr::null_mut());
        }
    }
}
