//! A process that answers requests. Separate threads read and write, so that calib detects a process that hangs or does
//! not read.

use std::{
    fmt,
    io::{BufRead as _, BufReader, Read, Write as _},
    process::{Child, ChildStdin, ChildStdout, Command, ExitStatus, Stdio},
    sync::{
        Arc, Mutex,
        mpsc::{Receiver, RecvTimeoutError, Sender, SyncSender, channel, sync_channel},
    },
    thread,
    time::Duration,
};

use calib_core::{Monitor, locked};
use calib_sweep::ProgramStopped;

#[cfg(target_os = "linux")]
use super::guard;
use super::{
    ProgramCommand,
    command::is_path,
    error::{ProgramError, failed},
    message::{Answer, Failure},
};

/// Time between checks whether the user asked to stop.
const LOOK: Duration = Duration::from_millis(50);
/// Time limit for a process to end after its last request, or after it has closed its output.
const FAREWELL: Duration = Duration::from_secs(5);
/// Largest number of bytes of an answer, besides the requested data.
const LINE_BYTES: usize = 1 << 16;
/// Number of last bytes of error output in messages, and number of first characters of a line.
const SAID_BYTES: usize = 2000;
const LINE_SHOWN: usize = 120;

/// A running program, which answers one message at a time. Dropping it ends the program and all its descendants.
pub struct Process<'p> {
    program: &'p ProgramCommand,
    child: Child,
    messages: Option<Sender<Vec<u8>>>,
    lines: Receiver<Vec<u8>>,
    said: Arc<Mutex<Vec<u8>>>,
    /// Disconnects when all error output has been read.
    said_all: Receiver<()>,
}

impl<'p> Process<'p> {
    /// Starts the program. An answer has at most `answer_bytes` bytes, besides the usual length of a line.
    ///
    /// # Errors
    /// Returns an error if the program is missing, or cannot be run.
    pub fn start(program: &'p ProgramCommand, answer_bytes: usize) -> Result<Self, ProgramStopped> {
        let [name, arguments @ ..] = program.words.as_slice() else {
            unreachable!("a command was checked to have words")
        };
        let path =
            if is_path(name) { program.folder.join(name).into() } else { name.clone().into() };
        let mut command = Command::new::<std::ffi::OsString>(path);
        command.args(arguments).current_dir(&program.folder);
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        // Ctrl-C must only reach calib, which then ends the program.
        #[cfg(all(unix, not(target_os = "linux")))]
        std::os::unix::process::CommandExt::process_group(&mut command, 0);
        #[cfg(target_os = "linux")]
        guard::watch_over(&mut command);
        let mut child = command.spawn().map_err(|source| {
            failed(ProgramError::Start {
                command: program.shown(),
                folder: program.folder.clone(),
                source,
            })
        })?;
        let (messages, to_write) = channel();
        let (read, lines) = sync_channel(1);
        let (ending, said_all) = channel();
        let said = Arc::new(Mutex::new(Vec::new()));
        if let (Some(input), Some(output), Some(errors)) =
            (child.stdin.take(), child.stdout.take(), child.stderr.take())
        {
            let longest = LINE_BYTES + answer_bytes;
            let heard = Arc::clone(&said);
            thread::spawn(move || write(input, &to_write));
            thread::spawn(move || read_lines(output, longest, &read));
            thread::spawn(move || listen(errors, &heard, &ending));
        }
        Ok(Self { program, child, messages: Some(messages), lines, said, said_all })
    }

    /// Sends a message and waits for the answer. Error messages call the message `asked`.
    ///
    /// # Errors
    /// Returns an error if there is no answer in time, the answer has another form, or the monitor interrupts.
    pub fn ask<A: Answer>(
        &mut self,
        message: Vec<u8>,
        asked: &dyn fmt::Display,
        monitor: &dyn Monitor,
    ) -> Result<A, ProgramStopped> {
        // An unexpected line would be taken for the answer, and shift all later answers.
        if let Ok(line) = self.lines.try_recv() {
            let command = self.program.shown();
            return Err(failed(ProgramError::More { command, line: shown(&line) }));
        }
        // If the program no longer reads, it does not answer either, and that error is reported.
        let _ = self.messages.as_ref().map(|messages| messages.send(message));
        let look = LOOK.min(self.program.timeout);
        let mut waited = Duration::ZERO;
        loop {
            match self.lines.recv_timeout(look) {
                Ok(line) => return self.answer(&line, asked).map_err(failed),
                Err(ended) => {
                    monitor.check().map_err(ProgramStopped::Cancelled)?;
                    match ended {
                        RecvTimeoutError::Disconnected => return Err(failed(self.ended(asked))),
                        RecvTimeoutError::Timeout => waited += look,
                    }
                }
            }
            if waited >= self.program.timeout {
                let secs = self.program.timeout.as_secs_f64();
                let command = self.program.shown();
                let asked = asked.to_string();
                let said = self.said();
                return Err(failed(ProgramError::Silent { command, asked, secs, said }));
            }
        }
    }

    fn answer<A: Answer>(&self, line: &[u8], asked: &dyn fmt::Display) -> Result<A, ProgramError> {
        match serde_json::from_slice::<A>(line) {
            Ok(answer) if answer.is_valid() => return Ok(answer),
            _ => {}
        }
        let command = self.program.shown();
        let asked = asked.to_string();
        if let Ok(Failure { error: reason }) = serde_json::from_slice(line) {
            return Err(ProgramError::Refused { command, asked, reason });
        }
        let line = shown(line);
        let expected = A::LIKE;
        let said = self.said();
        Err(ProgramError::Babble { command, asked, line, expected, said })
    }

    /// Ends the process after the last request.
    ///
    /// # Errors
    /// Returns an error if it writes more lines, or ends with a status other than 0.
    pub fn finish(mut self) -> Result<(), ProgramStopped> {
        self.messages = None;
        let command = self.program.shown();
        let status = self.status();
        // Checks only for lines written so far. Other processes may keep the standard output open, and are not waited
        // for.
        if let Ok(line) = self.lines.recv_timeout(LOOK) {
            return Err(failed(ProgramError::More { command, line: shown(&line) }));
        }
        match status {
            Some(status) if !status.success() => {
                let how = how(status);
                let said = self.said_at_last();
                Err(failed(ProgramError::EndedBadly { command, how, said }))
            }
            _ => Ok(()),
        }
    }

    /// Returns the reason why no more lines come.
    fn ended(&mut self, asked: &dyn fmt::Display) -> ProgramError {
        let status = self.status();
        let is_killed = status.is_some_and(|status| status.code().is_none());
        let how = status.map_or_else(|| "has closed its standard output".to_owned(), how);
        let command = self.program.shown();
        let asked = asked.to_string();
        ProgramError::Ended { command, how, is_killed, asked, said: self.said_at_last() }
    }

    /// Returns how the process ended, if it ends soon.
    fn status(&mut self) -> Option<ExitStatus> {
        let mut waited = Duration::ZERO;
        while waited < FAREWELL {
            if let Ok(Some(status)) = self.child.try_wait() {
                return Some(status);
            }
            thread::sleep(LOOK / 10);
            waited += LOOK / 10;
        }
        None
    }

    fn said_at_last(&self) -> String {
        // Waits until the channel disconnects. Nothing is ever sent.
        let _ = self.said_all.recv_timeout(LOOK * 10);
        self.said()
    }

    fn said(&self) -> String {
        let said = locked(&self.said);
        String::from_utf8_lossy(&said).into_owned()
    }
}

impl Drop for Process<'_> {
    #[cfg(target_os = "linux")]
    fn drop(&mut self) {
        guard::end(&mut self.child);
    }

    #[cfg(not(target_os = "linux"))]
    fn drop(&mut self) {
        // A process that has already ended cannot be killed, which is fine.
        #[cfg(unix)]
        if matches!(self.child.try_wait(), Ok(None)) {
            kill_group(self.child.id());
        }
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Kills a process group by its leader.
#[cfg(all(unix, not(target_os = "linux")))]
fn kill_group(leader: u32) {
    let Ok(leader) = libc::pid_t::try_from(leader) else { return };
    // SAFETY: no memory is involved. The leader was not waited for, so its number belongs to no other group.
    #[expect(unsafe_code, reason = "the standard library ends single processes only")]
    unsafe {
        libc::kill(-leader, libc::SIGKILL);
    }
}

fn how(status: ExitStatus) -> String {
    format!("ended with {status}")
}

/// Returns the beginning of a line.
fn shown(line: &[u8]) -> String {
    let text = String::from_utf8_lossy(line);
    let text = text.trim_end();
    let short: String = text.chars().take(LINE_SHOWN).collect();
    if short.len() < text.len() { format!("{short}…") } else { short }
}

fn write(mut input: ChildStdin, messages: &Receiver<Vec<u8>>) {
    for message in messages {
        if input.write_all(&message).and_then(|()| input.flush()).is_err() {
            return;
        }
    }
}

fn read_lines(output: ChildStdout, longest: usize, lines: &SyncSender<Vec<u8>>) {
    let mut output = BufReader::new(output);
    loop {
        let mut line = Vec::new();
        match output.by_ref().take(longest as u64).read_until(b'\n', &mut line) {
            Ok(1..) if lines.send(line).is_ok() => {}
            _ => return,
        }
    }
}

fn listen(mut errors: impl Read, said: &Mutex<Vec<u8>>, _ending: &Sender<()>) {
    let mut buffer = [0; 4096];
    while let Ok(read @ 1..) = errors.read(&mut buffer) {
        let mut said = locked(said);
        said.extend_from_slice(&buffer[..read]);
        let old = said.len().saturating_sub(SAID_BYTES);
        said.drain(..old);
    }
}
