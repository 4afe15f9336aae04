//! Handling of lost pages of a mapped file: another process cut the file short, or its disk failed.

/// The message. The handler does not know which file it was.
const LOST: &[u8] = b"error: a file that calib was reading was cut short, or its disk failed; \
    what is finished is whole: see to that file, and run the same command again\n";

/// Exit code for all errors in input data.
const STATUS: i32 = crate::ExitStatus::BadInput as i32;

/// Installs a handler that prints a message. Otherwise the process would end silently.
pub(crate) fn tell_of_lost_pages() {
    let handler: extern "C" fn(libc::c_int) = tell_and_end;
    // SAFETY: the handler calls only `write` and `_exit`, which are allowed in a signal handler.
    #[expect(unsafe_code, reason = "signals are handled in C")]
    unsafe {
        libc::signal(libc::SIGBUS, handler as libc::sighandler_t);
    }
}

extern "C" fn tell_and_end(_: libc::c_int) {
    // SAFETY: both functions are allowed in a signal handler, and the length is that of the text.
    #[expect(unsafe_code, reason = "signals are handled in C")]
    unsafe {
        libc::write(libc::STDERR_FILENO, LOST.as_ptr().cast(), LOST.len());
        libc::_exit(STATUS);
    }
}
