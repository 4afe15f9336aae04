//! A guard process between calib and a program. It kills the program and all its descendants, in any process group or
//! session. It does this when the program ends, on request, and when calib ends for any reason.
//!
//! calib forks the guard before the program starts. The guard then forks the program and waits for it. No other process
//! can do this: Linux tells a child, but not a grandchild, that its parent died. Orphans are adopted by the nearest
//! ancestor that is a subreaper, which the guard is.

use std::{
    io,
    os::unix::process::CommandExt as _,
    process::{Child, Command},
    ptr,
    sync::atomic::{AtomicI32, Ordering},
    thread,
    time::Duration,
};

/// Time limit for killed processes to disappear.
const GONE: Duration = Duration::from_secs(2);
/// Time between checks for this.
const LOOK: Duration = Duration::from_millis(5);

/// Puts a guard between calib and the process that `command` starts.
pub(super) fn watch_over(command: &mut Command) {
    // SAFETY: `getpid` has no preconditions.
    #[expect(unsafe_code, reason = "processes are made in C")]
    let calib = unsafe { libc::getpid() };
    // SAFETY: between fork and exec, and in the guard, only async-signal-safe functions are called.
    #[expect(unsafe_code, reason = "what a child does before it begins is unsafe by nature")]
    unsafe {
        command.process_group(0).pre_exec(move || divide(calib));
    }
}

/// Ends a program and all its descendants through its guard.
pub(super) fn end(guard: &mut Child) {
    let number = libc::pid_t::try_from(guard.id()).unwrap_or(0);
    let mut waited = Duration::ZERO;
    while matches!(guard.try_wait(), Ok(None)) && waited < GONE {
        // SAFETY: no memory is involved. The guard was not waited for, so its number belongs to no other process.
        #[expect(unsafe_code, reason = "the standard library knows one signal")]
        unsafe {
            libc::kill(number, libc::SIGTERM);
        }
        thread::sleep(LOOK);
        waited += LOOK;
    }
    // Fails if the guard has already ended, which is fine.
    let _ = guard.kill();
    let _ = guard.wait();
}

/// Runs in the started process: the parent becomes the guard, and the function returns in the program's process.
fn divide(calib: libc::pid_t) -> io::Result<()> {
    let handler: extern "C" fn(libc::c_int) = end_by_signal;
    // SAFETY: the arguments are numbers, and the handler calls only async-signal-safe functions.
    #[expect(unsafe_code, reason = "processes are made in C")]
    unsafe {
        libc::signal(libc::SIGTERM, handler as libc::sighandler_t);
        if libc::prctl(libc::PR_SET_CHILD_SUBREAPER, 1) != 0
            || libc::prctl(libc::PR_SET_PDEATHSIG, libc::SIGTERM) != 0
        {
            return Err(io::Error::last_os_error());
        }
        // calib may have died before the death signal was requested.
        if libc::getppid() != calib {
            libc::_exit(1);
        }
        match libc::fork() {
            -1 => Err(io::Error::last_os_error()),
            0 => {
                libc::signal(libc::SIGTERM, libc::SIG_DFL);
                // The program dies with the guard.
                libc::prctl(libc::PR_SET_PDEATHSIG, libc::SIGKILL);
                Ok(())
            }
            program => stand_by(program),
        }
    }
}

/// The process number of the program, for the signal handler.
static PROGRAM: AtomicI32 = AtomicI32::new(0);

/// Waits for the program, ends its remaining descendants, and exits with the same status.
///
/// # Safety
/// Must only be called in the guard, which has one thread.
#[expect(unsafe_code, reason = "processes are made in C")]
unsafe fn stand_by(program: libc::pid_t) -> ! {
    PROGRAM.store(program, Ordering::Relaxed);
    // SAFETY: these are system calls, and the system writes `status`.
    unsafe {
        // Closes the pipes, so that a reader of the program's output waits for the program and not for the guard.
        if libc::syscall(libc::SYS_close_range, 0_u32, u32::MAX, 0_u32) != 0 {
            for file in 0..4096 {
                libc::close(file);
            }
        }
        let mut status = 0;
        loop {
            let ended = libc::waitpid(-1, &raw mut status, 0);
            if ended == program || (ended == -1 && *libc::__errno_location() == libc::ECHILD) {
                break;
            }
        }
        end_all();
        if libc::WIFSIGNALED(status) {
            let signal = libc::WTERMSIG(status);
            libc::signal(signal, libc::SIG_DFL);
            libc::kill(libc::getpid(), signal);
        }
        libc::_exit(libc::WEXITSTATUS(status))
    }
}

extern "C" fn end_by_signal(signal: libc::c_int) {
    // SAFETY: only system calls.
    #[expect(unsafe_code, reason = "signals are handled in C")]
    unsafe {
        end_all();
        libc::_exit(128 + signal)
    }
}

/// Kills every child, and every process that is adopted when children are gone, until none is left.
///
/// # Safety
/// Must only be called in the guard.
#[expect(unsafe_code, reason = "processes are ended in C")]
unsafe fn end_all() {
    // SAFETY: system calls with buffers of this function.
    unsafe {
        let pause = libc::timespec { tv_sec: 0, tv_nsec: 5_000_000 };
        for _ in 0..200 {
            let list = libc::open(c"/proc/thread-self/children".as_ptr(), libc::O_RDONLY);
            if list < 0 {
                // Without the list of children only the process group is known. It includes the guard.
                libc::kill(PROGRAM.load(Ordering::Relaxed), libc::SIGKILL);
                libc::kill(0, libc::SIGKILL);
            }
            let mut buffer = [0_u8; 4096];
            let read = libc::read(list, buffer.as_mut_ptr().cast(), buffer.len());
            libc::close(list);
            let read = usize::try_from(read).unwrap_or(0);
            let mut child: libc::pid_t = 0;
            for &byte in &buffer[..read] {
                if byte.is_ascii_digit() {
                    child = child.wrapping_mul(10).wrapping_add(libc::pid_t::from(byte - b'0'));
                } else {
                    // A number that the buffer cuts off is read again in the next round.
                    if child > 1 {
                        libc::kill(child, libc::SIGKILL);
                    }
                    child = 0;
                }
            }
            loop {
                match libc::waitpid(-1, ptr::null_mut(), libc::WNOHANG) {
                    0 => break,
                    -1 if *libc::__errno_location() == libc::ECHILD => return,
                    _ => {}
                }
            }
            libc::nanosleep(&raw const pause, ptr::null_mut());
        }
    }
}
