//! A directory with a small simulated plant, and the built `calib`.

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
    process::{Child, Command, Output, Stdio},
    thread,
    time::Duration,
};

use serde_json::Value;

#[path = "schema.rs"]
pub(crate) mod schema;

/// A study on three days of a small plant at one-minute samples, with linear agents: seconds to run.
const STUDY: &str = r#"
seed = 3

[data]
path = "data"
train_fraction = 0.7

[preprocess]
fill_limit = 5

[model]
members = 3
exclude_self = true

[rollout]
steps = 400
rollouts = 2

[agent]
value_function = "linear"
gamma = 0.9
batch_size = 16
learning_rate = 1e-3

[sweep]
sensors = ["PIT300", "TIT101"]
steps = 800
online_runs = 3
member_runs = 2
log_replay_runs = 2

[sweep.grid]
learning_rate = [1e-5, 1e-3, 1e-2]
"#;

/// A temporary directory to run `calib` in.
pub(crate) struct Place {
    directory: tempfile::TempDir,
}

impl Place {
    /// An empty directory.
    pub(crate) fn new() -> Self {
        Self { directory: tempfile::tempdir().expect("a directory") }
    }

    /// A directory with `data/` and `study.toml`.
    pub(crate) fn with_study() -> Self {
        let place = Self::new();
        place.simulate("data");
        place.write("study.toml", STUDY);
        place
    }

    /// A directory with `study.toml` alone, which says how `data/` is simulated.
    pub(crate) fn with_plant() -> Self {
        let place = Self::new();
        let plant = "[simulate]\ndays = 3\nchannels = 12\nperiod_secs = 60\ngaps_per_day = 2\n";
        place.write("study.toml", &STUDY.replacen("[data]", &format!("{plant}\n[data]"), 1));
        place
    }

    /// Simulate a small plant into `name`.
    pub(crate) fn simulate(&self, name: &str) {
        let sizes = ["--days", "3", "--channels", "12", "--period", "60", "--gaps-per-day", "2"];
        self.calib(&[&["simulate", name][..], &sizes].concat()).succeeds();
    }

    /// Simulate another plant, of another seed, into `name`.
    pub(crate) fn simulate_other(&self, name: &str) {
        let sizes = ["--days", "3", "--channels", "12", "--period", "60", "--seed", "9"];
        self.calib(&[&["simulate", name][..], &sizes].concat()).succeeds();
    }

    /// Cart-pole as a random policy acts in it, in `pole/`, with a study of two agents.
    pub(crate) fn with_pole(transitions: usize, steps: usize, members: usize) -> Self {
        let place = Self::new();
        let args = ["simulate", "pole", "--task", "cart-pole", "--policy", "random"];
        let transitions = ["--transitions", &transitions.to_string()];
        place.calib(&[&args[..], &transitions].concat()).succeeds();
        let text = place.read("pole/study.toml");
        let (before, _) = text.split_once("[control.grid]").expect("a grid");
        let small = before.replace("steps = 15000", &format!("steps = {steps}"));
        let model = format!("[control.model]\nmembers = {members}\n\n");
        let grid = "[control.grid]\nstep_size = [0.03, 0.3]\n";
        place.write("pole/study.toml", &format!("{small}{model}{grid}"));
        place
    }

    pub(crate) fn path(&self) -> &Path {
        self.directory.path()
    }

    pub(crate) fn write(&self, name: &str, text: &str) {
        fs::write(self.path().join(name), text).expect("writable");
    }

    /// The text of a file.
    pub(crate) fn read(&self, name: &str) -> String {
        fs::read_to_string(self.path().join(name)).expect("readable")
    }

    /// The content of a file of JSON.
    pub(crate) fn read_json(&self, name: &str) -> Value {
        serde_json::from_str(&self.read(name)).expect("JSON")
    }

    /// `study.toml` with `from` replaced by `to`.
    pub(crate) fn edit_study(&self, from: &str, to: &str) {
        self.edit("study.toml", from, to);
    }

    /// A file with `from` replaced by `to`, where it stands first.
    pub(crate) fn edit(&self, name: &str, from: &str, to: &str) {
        let text = self.read(name);
        assert!(text.contains(from), "{name} has no {from}");
        self.write(name, &text.replacen(from, to, 1));
    }

    /// `study.toml` with `more` at its end.
    pub(crate) fn extend_study(&self, more: &str) {
        self.write("study.toml", &(self.read("study.toml") + more));
    }

    pub(crate) fn command(&self, args: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_calib"));
        command.args(args).current_dir(self.path()).stdin(Stdio::null()).env_remove("CALIB_DATA");
        command
    }

    /// Run `calib` with these arguments.
    pub(crate) fn calib(&self, args: &[&str]) -> Ran {
        self.calib_with(args, &[])
    }

    /// As [`calib`](Self::calib), with something in the environment.
    pub(crate) fn calib_with(&self, args: &[&str], environment: &[(&str, &str)]) -> Ran {
        let mut command = self.command(args);
        let output = command.envs(environment.iter().copied()).output().expect("calib runs");
        if args.contains(&"--json") {
            check_json(args, &output);
        }
        Ran { args: args.join(" "), output, directory: self.path().to_owned() }
    }

    /// Run these commands on `study.toml`, one after the other.
    pub(crate) fn run_steps(&self, commands: &[&str]) {
        for command in commands {
            self.calib(&[*command, "study.toml"]).succeeds();
        }
    }

    /// Start `calib` with these arguments, and do not wait for it.
    pub(crate) fn start(&self, args: &[&str], stderr: Stdio) -> Child {
        self.command(args).stdout(Stdio::null()).stderr(stderr).spawn().expect("calib runs")
    }

    /// As [`start`](Self::start), with something in the environment; what it says is kept until it has [`ended`](Self::ended).
    pub(crate) fn start_with(&self, args: &[&str], environment: &[(&str, &str)]) -> Child {
        let mut command = self.command(args);
        command.envs(environment.iter().copied()).stdout(Stdio::null()).stderr(Stdio::piped());
        command.spawn().expect("calib runs")
    }

    /// Wait for the end of a command that was started; `told` is what a failed assertion calls it.
    pub(crate) fn ended(&self, told: &str, child: Child) -> Ran {
        let output = child.wait_with_output().expect("it ends");
        Ran { args: told.to_owned(), output, directory: self.path().to_owned() }
    }

    /// Everything below `name`, but wall times and what the file system said of the log: relative path → content.
    pub(crate) fn content(&self, name: &str) -> Content {
        let root = self.path().join(name);
        let mut content = BTreeMap::new();
        let mut pending = vec![root.clone()];
        while let Some(directory) = pending.pop() {
            for entry in fs::read_dir(&directory).expect("readable").flatten() {
                let path = entry.path();
                if path.is_dir() {
                    pending.push(path);
                } else if !["timings.json", "sources.json"].iter().any(|name| path.ends_with(name))
                {
                    let relative = path.strip_prefix(&root).expect("below the root").to_owned();
                    content.insert(relative, fs::read(&path).expect("readable"));
                }
            }
        }
        content
    }
}

/// Files by their paths.
pub(crate) type Content = BTreeMap<PathBuf, Vec<u8>>;

/// Assert that there are the same files, to the byte, and name one that differs.
#[track_caller]
pub(crate) fn assert_same(one: &Content, other: &Content) {
    assert_eq!(one.keys().collect::<Vec<_>>(), other.keys().collect::<Vec<_>>());
    for (path, content) in one {
        assert!(other[path] == *content, "{} differs", path.display());
    }
}

/// Send a process a signal, such as `-INT`.
#[cfg(unix)]
pub(crate) fn send(signal: &str, process: &Child) {
    let sent = Command::new("kill").args([signal, &process.id().to_string()]).status();
    assert!(sent.expect("kill runs").success());
}

/// Wait until something is so, or twelve seconds; whether it is.
pub(crate) fn wait_until(mut is_so: impl FnMut() -> bool) -> bool {
    for _ in 0..1200 {
        if is_so() {
            return true;
        }
        thread::sleep(Duration::from_millis(10));
    }
    false
}

/// What a command prints for machines is what the schema of it says.
fn check_json(args: &[&str], output: &Output) {
    let command = match args {
        ["cluster", part, ..] => format!("cluster {part}"),
        [command, ..] => (*command).to_owned(),
        [] => unreachable!("there is --json"),
    };
    // A refused command, and one that was asked for a list, prints none.
    if output.stdout.first() != Some(&b'{') {
        return;
    }
    let printed = serde_json::from_slice(&output.stdout).expect("one JSON document");
    if let Some(problem) = schema::problem(&schema::of(&command), &printed) {
        panic!("calib {}: {problem}", args.join(" "));
    }
}

/// A finished command.
pub(crate) struct Ran {
    args: String,
    output: Output,
    directory: PathBuf,
}

impl Ran {
    pub(crate) fn code(&self) -> i32 {
        self.output.status.code().unwrap_or(-1)
    }

    pub(crate) fn stdout(&self) -> String {
        self.clean(&self.output.stdout)
    }

    pub(crate) fn stderr(&self) -> String {
        self.clean(&self.output.stderr)
    }

    /// Assert that it exits with 0, and return what it printed.
    pub(crate) fn succeeds(&self) -> String {
        assert_eq!(self.code(), 0, "calib {}\n{}{}", self.args, self.stdout(), self.stderr());
        self.stdout()
    }

    /// Assert that it exits with 0, and that what it printed has these parts.
    #[track_caller]
    pub(crate) fn succeeds_with(&self, parts: &[&str]) {
        assert_parts(&self.succeeds(), parts);
    }

    /// Assert that it exits with `code`, and that its error message has these parts.
    #[track_caller]
    pub(crate) fn fails_with(&self, code: i32, parts: &[&str]) {
        assert_parts(&self.fails(code), parts);
    }

    /// Assert that it exits with one of `codes`, and return the JSON that it printed.
    pub(crate) fn json(&self, codes: &[i32]) -> Value {
        serde_json::from_str(&self.ends(codes)).expect("JSON")
    }

    /// Assert that it exits with `code`, and return its error message.
    pub(crate) fn fails(&self, code: i32) -> String {
        assert_eq!(self.code(), code, "calib {}\n{}{}", self.args, self.stdout(), self.stderr());
        let stderr = self.stderr();
        let error = stderr.find("error: ").map_or(stderr.as_str(), |position| &stderr[position..]);
        error.trim_end().to_owned()
    }

    /// Assert that it exits with one of `codes`, and return what it printed.
    pub(crate) fn ends(&self, codes: &[i32]) -> String {
        assert!(
            codes.contains(&self.code()),
            "calib {}\n{}{}",
            self.args,
            self.stdout(),
            self.stderr()
        );
        self.stdout()
    }

    /// Text without what differs from run to run.
    fn clean(&self, bytes: &[u8]) -> String {
        let text = String::from_utf8_lossy(bytes).into_owned();
        text.replace(&*self.directory.to_string_lossy(), "PLACE")
    }
}

#[track_caller]
fn assert_parts(text: &str, parts: &[&str]) {
    for part in parts {
        assert!(text.contains(part), "{part} is missing in {text}");
    }
}
