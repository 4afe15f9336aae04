//! A process between calib and a program: it ends the program and everything that this has started, in whichever group or
//! session, when the program ends, when it is told to, and when calib is gone, however calib ended.
//!
//! It is made of the process that calib starts, before the program begins: that process begins the program in a process of
//! its own, and waits. Nobody else can do it. The system tells a child that its parent died, but not a grandchild; and what
//! has lost its parent is adopted by the nearest ancestor that asked for it, which the guard does.

use std::{
    io,
    os::unix::process::CommandExt as _,
    process::{Child, Command},
    ptr,
    sync::atomic::{AtomicI32, Ordering},
    thread,
    time::Duration,
};

/// How long processes may take to be gone that were killed.
const GONE: Duration = Duration::from_secs(2);
/// Between two looks whether they are.
const LOOK: Duration = Duration::from_millis(5);

/// Let a guard stand between calib and what `command` starts.
pub(super) fn watch_over(command: &mut Command) {
    // SAFETY: asking for a process's own number has no conditions.
    #[expect(unsafe_code, reason = "processes are made in C")]
    let calib = unsafe { libc::getpid() };
    // SAFETY: between fork and exec, and in the guard, only functions are called that may be called from a handler of signals.
    #[expect(unsafe_code, reason = "what a child does before it begins is unsafe by nature")]
    unsafe {
        command.process_group(0).pre_exec(move || divide(calib));
    }
}

/// End a program, with everything that it has started, by its guard.
pub(super) fn end(guard: &mut Child) {
    let number = libc::pid_t::try_from(guard.id()).unwrap_or(0);
    let mut waited = Duration::ZERO;
    while matches!(guard.try_wait(), Ok(None)) && waited < GONE {
        // SAFETY: no memory is involved; the guard was not waited for, so that its number is no other process's.
        #[expect(unsafe_code, reason = "the standard library knows one signal")]
        unsafe {
            libc::kill(number, libc::SIGTERM);
        }
        thread::sleep(LOOK);
        waited += LOOK;
    }
    // One that has ended already cannot be ended, which is as well.
    let _ = guard.kill();
    let _ = guard.wait();
}

/// In the process that was started: become the guard, and return in the process of the program.
fn divide(calib: libc::pid_t) -> io::Result<()> {
    let handler: extern "C" fn(libc::c_int) = end_by_signal;
    // SAFETY: numbers, and a handler that calls only what a handler may.
    #[expect(unsafe_code, reason = "processes are made in C")]
    unsafe {
        libc::signal(libc::SIGTERM, handler as libc::sighandler_t);
        if libc::prctl(libc::PR_SET_CHILD_SUBREAPER, 1) != 0
            || libc::prctl(libc::PR_SET_PDEATHSIG, libc::SIGTERM) != 0
        {
            return Err(io::Error::last_os_error());
        }
        // Calib may have died before it was asked for.
        if libc::getppid() != calib {
            libc::_exit(1);
        }
        match libc::fork() {
            -1 => Err(io::Error::last_os_error()),
            0 => {
                libc::signal(libc::SIGTERM, libc::SIG_DFL);
                // Whoever ends the guard ends the program.
                libc::prctl(libc::PR_SET_PDEATHSIG, libc::SIGKILL);
                Ok(())
            }
            program => stand_by(program),
        }
    }
}

/// The program, for the handler.
static PROGRAM: AtomicI32 = AtomicI32::new(0);

/// Wait for the program, end what it has left behind, and end as it did.
///
/// # Safety
/// Only in the guard, which has one thread.
#[expect(unsafe_code, reason = "processes are made in C")]
unsafe fn stand_by(program: libc::pid_t) -> ! {
    PROGRAM.store(program, Ordering::Relaxed);
    // SAFETY: the functions are calls of the system, and `status` is written by it.
    unsafe {
        // Who waits for the end of what the program says waits for the program, and not for the guard.
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
    // SAFETY: calls of the system alone.
    #[expect(unsafe_code, reason = "signals are handled in C")]
    unsafe {
        end_all();
        libc::_exit(128 + signal)
    }
}

/// Kill every child, and what is adopted when these are gone, until there is none.
///
/// # Safety
/// Only in the guard.
#[expect(unsafe_code, reason = "processes are ended in C")]
unsafe fn end_all() {
    // SAFETY: calls of the system with buffers of this function.
    unsafe {
        let pause = libc::timespec { tv_sec: 0, tv_nsec: 5_000_000 };
        for _ in 0..200 {
            let list = libc::open(c"/proc/thread-self/children".as_ptr(), libc::O_RDONLY);
            if list < 0 {
                // The group is all that is known then, and the guard is of it.
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
                    // A number that is cut off is read again.
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
