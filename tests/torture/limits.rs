//! Runs a command under limits: thirty seconds, and four gibibytes of address space.

use std::{
    collections::BTreeMap,
    fs::{self, File},
    process::Stdio,
    thread,
    time::Duration,
};

use crate::{
    campaign::{Draws, number, on_all_cores},
    harness::Place,
};

/// How a command ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Ended {
    /// Exit code 0 or 1.
    Done,
    /// Exit code 2, with a message that names the mistake.
    Refused(String),
    /// Any other end, described in words.
    Wrong(String),
}

/// Seconds after which a command counts as hanging; `CALIB_SECONDS` on machines with other load.
const SECONDS: u64 = 30;
/// Largest address space of a command in bytes.
#[cfg(unix)]
const BYTES: u64 = 4 << 30;

/// Runs a command in a place. `names` are the words with which a refusal may name the mistake.
pub(crate) fn run(place: &Place, args: &[&str], names: &[&str]) -> Ended {
    let stderr = place.path().join("stderr.txt");
    let mut command = place.command(args);
    command.stdout(Stdio::null()).stderr(File::create(&stderr).expect("writable"));
    #[cfg(unix)]
    limit(&mut command);
    let mut child = command.spawn().expect("calib runs");
    let mut status = None;
    let seconds = number("CALIB_SECONDS", SECONDS);
    for _ in 0..seconds * 200 {
        status = child.try_wait().expect("a status");
        if status.is_some() {
            break;
        }
        thread::sleep(Duration::from_millis(5));
    }
    let Some(status) = status else {
        child.kill().expect("it runs");
        child.wait().expect("a status");
        return Ended::Wrong(format!("hangs: nothing after {seconds} s"));
    };
    let told = fs::read(&stderr).expect("readable");
    let told = String::from_utf8_lossy(&told).replace(&*place.path().to_string_lossy(), "PLACE");
    let begins = told.starts_with("error: ").then_some(0);
    let begins = begins.or_else(|| told.find("\nerror: ").map(|end| end + 1));
    let error = begins.map(|start| told[start..].trim_end().to_owned());
    match (status.code(), error) {
        _ if told.contains("panicked at") => Ended::Wrong(format!("panic: {told}")),
        _ if told.contains(['\u{1b}', '\u{202e}']) => {
            Ended::Wrong(format!("obeyed by terminals: {told}"))
        }
        (Some(0 | 1), _) => Ended::Done,
        (Some(2), Some(error)) if names.iter().any(|name| error.contains(name)) => {
            Ended::Refused(error)
        }
        (code, _) => Ended::Wrong(format!(
            "{}: {told}",
            code.map_or_else(|| status.to_string(), |code| format!("exit code {code}"))
        )),
    }
}

#[cfg(unix)]
fn limit(command: &mut std::process::Command) {
    use std::os::unix::process::CommandExt as _;
    // SAFETY: between fork and exec only `setrlimit` is called.
    #[expect(unsafe_code, reason = "what a child does before it begins is unsafe by nature")]
    unsafe {
        command.pre_exec(limit_own_addresses);
    }
}

/// Limits the address space of the calling process.
#[cfg(unix)]
fn limit_own_addresses() -> std::io::Result<()> {
    let limit = libc::rlimit { rlim_cur: BYTES, rlim_max: BYTES };
    // SAFETY: the call only reads the limit, and keeps no reference to it.
    #[expect(unsafe_code, reason = "limits are set in C")]
    let set = unsafe { libc::setrlimit(libc::RLIMIT_AS, &raw const limit) };
    if set == 0 { Ok(()) } else { Err(std::io::Error::last_os_error()) }
}

/// Words in messages that show a remedy, an expectation or an alternative. A
/// caret below a TOML syntax error counts as one.
const REMEDIES: [&str; 49] = [
    "expected",
    "run `",
    "say which",
    "say how",
    "choose",
    "give ",
    "remove",
    "set ",
    "use ",
    "must be",
    "must have",
    "leave",
    "name ",
    "needs",
    "wants",
    "from ",
    "at least",
    "at most",
    "write ",
    "again",
    "try ",
    "check ",
    "above",
    "did you mean",
    "keys are",
    "there are",
    "the glob pattern is malformed",
    "known keys",
    "known values",
    "profiles are",
    "^",
    "take ",
    "lower",
    "raise",
    "shorter",
    "longer",
    "fewer",
    "more",
    "add ",
    "move",
    "another",
    "less",
    "one of",
    "shows every",
    "scale the",
    "columns are",
    "no such file",
    "is not a readable",
    "is not a channel",
];

/// A case of a campaign.
pub(crate) struct TriedCase {
    /// Group in which the case is counted.
    pub(crate) kind: String,
    /// Description of the case.
    pub(crate) told: String,
    pub(crate) ended: Ended,
}

/// Runs `count` cases on all cores. The draws depend on the seed, the number of the case, and `apart`, which separates
/// these cases from others. Prints the counts, and fails if a case went wrong.
pub(crate) fn run_cases(
    title: &str,
    cases: u64,
    apart: u64,
    case: impl Fn(usize, &mut Draws) -> TriedCase + Sync,
) {
    let seed = number("CALIB_SEED", 1);
    let tried = on_all_cores(cases as usize, |number| {
        case(number, &mut Draws(seed << 32 | apart | number as u64))
    });
    let mut tally = Tally::default();
    for (number, TriedCase { kind, told, ended }) in tried.into_iter().enumerate() {
        tally.add(&kind, &format!("case {number} of seed {seed}, {told}"), ended);
    }
    tally.close(title);
}

/// Counts by kind, and forbidden outcomes.
#[derive(Default)]
struct Tally {
    counts: BTreeMap<String, [usize; 3]>,
    /// First case of each kind of fault, and the number of such cases.
    wrong: BTreeMap<String, (String, usize)>,
    /// Messages without a remedy, once each.
    helpless: BTreeMap<String, usize>,
}

impl Tally {
    fn add(&mut self, kind: &str, case: &str, ended: Ended) {
        let counts = self.counts.entry(kind.to_owned()).or_default();
        match ended {
            Ended::Done => counts[0] += 1,
            Ended::Refused(message) => {
                counts[1] += 1;
                let told = message.to_lowercase();
                if !REMEDIES.iter().any(|remedy| told.contains(remedy)) {
                    *self.helpless.entry(bare(&message)).or_default() += 1;
                }
            }
            Ended::Wrong(how) => {
                counts[2] += 1;
                self.wrong
                    .entry(bare(&how))
                    .or_insert_with(|| (format!("{kind}: {case}: {how}"), 0))
                    .1 += 1;
            }
        }
    }

    /// Prints the table, and fails if a case went wrong.
    #[expect(clippy::print_stdout, reason = "a campaign by hand says what it counted")]
    fn close(self, title: &str) {
        let [done, refused, wrong] =
            [0, 1, 2].map(|place| self.counts.values().map(|counts| counts[place]).sum::<usize>());
        println!("{title:<40} {:>8} {:>8} {:>8}", "done", "refused", "wrong");
        for (kind, [done, refused, wrong]) in &self.counts {
            println!("{kind:<40} {done:>8} {refused:>8} {wrong:>8}");
        }
        println!("{:<40} {done:>8} {refused:>8} {wrong:>8}", "all");
        for (message, count) in &self.helpless {
            println!("says not what to do ({count}): {message}");
        }
        let shown: Vec<String> = self
            .wrong
            .values()
            .map(|(case, count): &(String, usize)| format!("{count} such: {case}"))
            .collect();
        assert!(shown.is_empty(), "{} kinds of wrong:\n{}", shown.len(), shown.join("\n\n"));
        assert!(self.helpless.is_empty(), "{} messages do not say what to do", self.helpless.len());
    }
}

/// Removes the numbers of a message, so that similar messages are reported once.
fn bare(message: &str) -> String {
    message.chars().filter(|letter| !letter.is_ascii_digit()).take(200).collect()
}
