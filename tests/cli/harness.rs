//! A directory with a small simulated plant, and the built `calib`.

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
    process::{Command, Output, Stdio},
};

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
        let args = [
            "simulate",
            name,
            "--days",
            "3",
            "--channels",
            "12",
            "--period",
            "60",
            "--gaps-per-day",
            "2",
        ];
        self.calib(&args).succeeds();
    }

    pub(crate) fn path(&self) -> &Path {
        self.directory.path()
    }

    pub(crate) fn write(&self, name: &str, text: &str) {
        fs::write(self.path().join(name), text).expect("writable");
    }

    /// `study.toml` with `from` replaced by `to`.
    pub(crate) fn edit_study(&self, from: &str, to: &str) {
        let path = self.path().join("study.toml");
        let text = fs::read_to_string(&path).expect("readable");
        assert!(text.contains(from), "the study has no {from}");
        fs::write(path, text.replacen(from, to, 1)).expect("writable");
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

    /// Everything below `name`, but wall times and what the file system said of the log: relative path → content.
    pub(crate) fn content(&self, name: &str) -> BTreeMap<PathBuf, Vec<u8>> {
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
