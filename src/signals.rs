//! A mapped file whose pages are gone: it was cut short by somebody else, or its disk failed.

/// All that can be said of it; which file it was is not known.
const LOST: &[u8] = b"error: a file that calib was reading was cut short, or its disk failed; \
    what is finished is whole: see to that file, and run the same command again\n";

/// As for everything that is wrong with what is read.
const STATUS: i32 = crate::ExitStatus::BadInput as i32;

/// Say what happened instead of ending without a word.
pub(crate) fn tell_of_lost_pages() {
    let handler: extern "C" fn(libc::c_int) = tell_and_end;
    // SAFETY: the handler calls nothing but `write` and `_exit`, which may be called from a handler.
    #[expect(unsafe_code, reason = "signals are handled in C")]
    unsafe {
        libc::signal(libc::SIGBUS, handler as libc::sighandler_t);
    }
}

extern "C" fn tell_and_end(_: libc::c_int) {
    // SAFETY: both are safe in a handler, and the text is as long as is said.
    #[expect(unsafe_code, reason = "signals are handled in C")]
    unsafe {
        libc::write(libc::STDERR_FILENO, LOST.as_ptr().cast(), LOST.len());
        libc::_exit(STATUS);
    }
}
