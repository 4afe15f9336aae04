//! A temporary directory with a small simulated plant, and the built `calib`.

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

/// A study of three days of a small plant at one-minute samples, with linear agents; it runs in seconds.
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

/// A temporary directory in which tests run `calib`.
pub(crate) struct Place {
    directory: tempfile::TempDir,
}

impl Place {
    /// Creates an empty directory.
    pub(crate) fn new() -> Self {
        Self { directory: tempfile::tempdir().expect("a directory") }
    }

    /// Creates a directory with `data/` and `study.toml`.
    pub(crate) fn with_study() -> Self {
        let place = Self::new();
        place.simulate("data");
        place.write("study.toml", STUDY);
        place
    }

    /// Creates a directory with only `study.toml`, which describes the simulation of `data/`.
    pub(crate) fn with_plant() -> Self {
        let place = Self::new();
        let plant = "[simulate]\ndays = 3\nchannels = 12\nperiod_secs = 60\ngaps_per_day = 2\n";
        place.write("study.toml", &STUDY.replacen("[data]", &format!("{plant}\n[data]"), 1));
        place
    }

    /// Simulates a small plant into `name`.
    pub(crate) fn simulate(&self, name: &str) {
        let sizes = ["--days", "3", "--channels", "12", "--period", "60", "--gaps-per-day", "2"];
        self.calib(&[&["simulate", name][..], &sizes].concat()).succeeds();
    }

    /// Simulates another plant, with another seed, into `name`.
    pub(crate) fn simulate_other(&self, name: &str) {
        let sizes = ["--days", "3", "--channels", "12", "--period", "60", "--seed", "9"];
        self.calib(&[&["simulate", name][..], &sizes].concat()).succeeds();
    }

    /// Creates `pole/` with a log of cart-pole under a random policy, and a study of two agents.
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

    /// Returns the path of a file or folder in this directory.
    pub(crate) fn path_of(&self, name: &str) -> PathBuf {
        self.path().join(name)
    }

    pub(crate) fn write(&self, name: &str, text: &str) {
        fs::write(self.path().join(name), text).expect("writable");
    }

    /// Reads the text of a file.
    pub(crate) fn read(&self, name: &str) -> String {
        fs::read_to_string(self.path().join(name)).expect("readable")
    }

    /// Reads a JSON file.
    pub(crate) fn read_json(&self, name: &str) -> Value {
        serde_json::from_str(&self.read(name)).expect("JSON")
    }

    /// Replaces `from` by `to` in `study.toml`.
    pub(crate) fn edit_study(&self, from: &str, to: &str) {
        self.edit("study.toml", from, to);
    }

    /// Replaces the first `from` in a file by `to`.
    pub(crate) fn edit(&self, name: &str, from: &str, to: &str) {
        let text = self.read(name);
        assert!(text.contains(from), "{name} has no {from}");
        self.write(name, &text.replacen(from, to, 1));
    }

    /// Appends `more` to `study.toml`.
    pub(crate) fn extend_study(&self, more: &str) {
        self.write("study.toml", &(self.read("study.toml") + more));
    }

    pub(crate) fn command(&self, args: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_calib"));
        command.args(args).current_dir(self.path()).stdin(Stdio::null()).env_remove("CALIB_DATA");
        command
    }

    /// Runs `calib` with these arguments.
    pub(crate) fn calib(&self, args: &[&str]) -> Ran {
        self.calib_with(args, &[])
    }

    /// Runs `calib` with these arguments and environment variables.
    pub(crate) fn calib_with(&self, args: &[&str], environment: &[(&str, &str)]) -> Ran {
        let mut command = self.command(args);
        let output = command.envs(environment.iter().copied()).output().expect("calib runs");
        if args.contains(&"--json") {
            check_json(args, &output);
        }
        Ran { args: args.join(" "), output, directory: self.path().to_owned() }
    }

    /// Runs a command on `study.toml` with further arguments.
    pub(crate) fn on_study(&self, command: &str, more: &[&str]) -> Ran {
        self.calib(&[&[command, "study.toml"][..], more].concat())
    }

    /// Runs a command on `study.toml` with a key set, such as `seed=4`.
    pub(crate) fn on_study_with(&self, command: &str, set: &str) -> Ran {
        self.on_study(command, &["--set", set])
    }

    /// Asserts that a command on `study.toml` refuses a key set, and returns the error message.
    pub(crate) fn refusal(&self, command: &str, set: &str) -> String {
        self.on_study_with(command, set).fails(2)
    }

    /// Runs these commands on `study.toml`, one after the other.
    pub(crate) fn run_steps(&self, commands: &[&str]) {
        for command in commands {
            self.calib(&[*command, "study.toml"]).succeeds();
        }
    }

    /// Starts `calib` with these arguments, and does not wait for it.
    pub(crate) fn start(&self, args: &[&str], stderr: Stdio) -> Child {
        self.command(args).stdout(Stdio::null()).stderr(stderr).spawn().expect("calib runs")
    }

    /// Starts `calib` with environment variables. Its output is kept until it has [`ended`](Self::ended).
    pub(crate) fn start_with(&self, args: &[&str], environment: &[(&str, &str)]) -> Child {
        let mut command = self.command(args);
        command.envs(environment.iter().copied()).stdout(Stdio::null()).stderr(Stdio::piped());
        command.spawn().expect("calib runs")
    }

    /// Waits for the end of a started command; `told` names it in a failed assertion.
    pub(crate) fn ended(&self, told: &str, child: Child) -> Ran {
        let output = child.wait_with_output().expect("it ends");
        Ran { args: told.to_owned(), output, directory: self.path().to_owned() }
    }

    /// Returns all files below `name`, without wall times and file system data of the log: relative path → content.
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

/// Content of files by path.
pub(crate) type Content = BTreeMap<PathBuf, Vec<u8>>;

/// Asserts that files and bytes are equal, and names a file that differs.
#[track_caller]
pub(crate) fn assert_same(one: &Content, other: &Content) {
    assert_eq!(one.keys().collect::<Vec<_>>(), other.keys().collect::<Vec<_>>());
    for (path, content) in one {
        assert!(other[path] == *content, "{} differs", path.display());
    }
}

/// Sends a signal, such as `-INT`, to a process.
#[cfg(unix)]
pub(crate) fn send(signal: &str, process: &Child) {
    let sent = Command::new("kill").args([signal, &process.id().to_string()]).status();
    assert!(sent.expect("kill runs").success());
}

/// Waits up to twelve seconds until `is_so` holds, and returns whether it does.
pub(crate) fn wait_until(mut is_so: impl FnMut() -> bool) -> bool {
    for _ in 0..1200 {
        if is_so() {
            return true;
        }
        thread::sleep(Duration::from_millis(10));
    }
    false
}

/// Checks that JSON output matches the schema of the command.
fn check_json(args: &[&str], output: &Output) {
    let command = match args {
        ["cluster", part, ..] => format!("cluster {part}"),
        [command, ..] => (*command).to_owned(),
        [] => unreachable!("there is --json"),
    };
    // A refused command prints no JSON, and neither does a command that prints a list.
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

    /// Asserts exit code 0, and returns the output.
    pub(crate) fn succeeds(&self) -> String {
        assert_eq!(self.code(), 0, "calib {}\n{}{}", self.args, self.stdout(), self.stderr());
        self.stdout()
    }

    /// Asserts exit code 0, and that the output contains these parts.
    #[track_caller]
    pub(crate) fn succeeds_with(&self, parts: &[&str]) {
        assert_parts(&self.succeeds(), parts);
    }

    /// Asserts the exit code, and that the error message contains these parts.
    #[track_caller]
    pub(crate) fn fails_with(&self, code: i32, parts: &[&str]) {
        assert_parts(&self.fails(code), parts);
    }

    /// Asserts one of these exit codes, and returns the JSON output.
    pub(crate) fn json(&self, codes: &[i32]) -> Value {
        serde_json::from_str(&self.ends(codes)).expect("JSON")
    }

    /// Asserts the exit code, and returns the error message.
    pub(crate) fn fails(&self, code: i32) -> String {
        assert_eq!(self.code(), code, "calib {}\n{}{}", self.args, self.stdout(), self.stderr());
        let stderr = self.stderr();
        let error = stderr.find("error: ").map_or(stderr.as_str(), |position| &stderr[position..]);
        error.trim_end().to_owned()
    }

    /// Asserts one of these exit codes, and returns the output.
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

    /// Removes from the text what differs between runs.
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
