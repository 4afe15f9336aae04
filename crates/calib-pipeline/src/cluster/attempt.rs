//! Records of attempts at a shard: where it runs, what it is doing, how it ended. Results do not depend on them.

use std::{
    fs,
    path::{Path, PathBuf},
    process,
    sync::Mutex,
    time::Duration,
};

use calib_core::locked;
use calib_files::{file_name, host_name, read_sealed_json, write_sealed_json};
use serde::{Deserialize, Serialize};

/// The record of an attempt.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Attempt {
    /// Number of earlier attempts.
    pub(crate) before: usize,
    pub(crate) host: String,
    pub(crate) process: u32,
    /// Passes that have begun and not finished. After a kill they show what was running.
    pub(crate) doing: Vec<String>,
    pub(crate) made: Vec<MadePass>,
    /// Failed passes with reasons.
    pub(crate) failed: Vec<String>,
    pub(crate) ended: AttemptEnd,
}

#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct MadePass {
    pub(crate) pass: String,
    pub(crate) units: usize,
    pub(crate) predicted_secs: f64,
    pub(crate) secs: f64,
}

#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum AttemptEnd {
    /// The attempt is running, or it was killed.
    NotYet,
    Done,
    /// It was asked to stop, and kept its state.
    Stopped,
    Failed(String),
}

/// The record file of an attempt that this process makes.
pub(crate) struct AttemptFile {
    path: PathBuf,
    attempt: Mutex<Attempt>,
}

impl AttemptFile {
    /// Begins an attempt in `folder`, which holds the earlier attempts.
    pub(crate) fn begin(folder: &Path) -> Self {
        let host = host_name().to_owned();
        let process = process::id();
        let before = read(folder).len();
        let path = folder.join(format!("{before:04}-{}-{process}.json", file_name(&host)));
        let attempt = Attempt {
            before,
            host,
            process,
            doing: Vec::new(),
            made: Vec::new(),
            failed: Vec::new(),
            ended: AttemptEnd::NotYet,
        };
        let file = Self { path, attempt: Mutex::new(attempt) };
        file.change(|_| ());
        file
    }

    /// Whether this is the first attempt.
    pub(crate) fn is_first(&self) -> bool {
        locked(&self.attempt).before == 0
    }

    pub(crate) fn begins(&self, pass: &str) {
        self.change(|attempt| attempt.doing.push(pass.to_owned()));
    }

    pub(crate) fn made(&self, pass: &str, units: usize, predicted_secs: f64, took: Duration) {
        self.change(|attempt| {
            attempt.doing.retain(|doing| doing != pass);
            let pass = pass.to_owned();
            let secs = took.as_secs_f64();
            attempt.made.push(MadePass { pass, units, predicted_secs, secs });
        });
    }

    pub(crate) fn failed(&self, pass: &str, reason: &str) {
        self.change(|attempt| {
            attempt.doing.retain(|doing| doing != pass);
            attempt.failed.push(format!("{pass}: {reason}"));
        });
    }

    pub(crate) fn ends(&self, ended: AttemptEnd) {
        self.change(|attempt| attempt.ended = ended);
    }

    /// Writes a change to the record. Write errors are ignored, because a full disk must not stop the computation.
    fn change(&self, edit: impl FnOnce(&mut Attempt)) {
        let mut attempt = locked(&self.attempt);
        edit(&mut attempt);
        let _ = write_sealed_json(&self.path, &*attempt);
    }
}

/// Returns the recorded attempts in a folder, in order.
pub(crate) fn read(folder: &Path) -> Vec<Attempt> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let mut paths: Vec<PathBuf> = entries.map(|entry| entry.path()).collect();
    paths.retain(|path| path.extension().is_some_and(|extension| extension == "json"));
    paths.sort();
    paths.iter().filter_map(|path| read_sealed_json(path).ok()).collect()
}
