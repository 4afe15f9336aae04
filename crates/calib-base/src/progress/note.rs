//! `.progress/HOST-PROCESS-0.json`: the progress of a command.

use std::{
    fs,
    path::{Path, PathBuf},
};

use calib_files::host_name;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{
    artefact::TOOL,
    clock::{process_began, unix_secs},
};

/// The folder of notes, inside the folder of all results.
pub(super) const FOLDER: &str = ".progress";

/// Version of a note.
const FORMAT: u32 = 1;

/// Age, in seconds, after which a note of another machine means that its command was killed. Notes are written every
/// second.
const STALE_SECS: f64 = 30.0;

/// The progress of a running command.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Note {
    pub(super) format: u32,
    pub(super) tool: String,
    /// The command, such as `run`.
    pub command: String,
    /// Path of the study, as given on the command line.
    pub(crate) study: PathBuf,
    /// Name of the machine.
    pub host: String,
    /// Process id on that machine.
    pub process: u32,
    /// Start of the process as Linux reports it. It distinguishes the process from a later one with the same id.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) process_began: Option<u64>,
    /// Start of the command, in seconds since 1970.
    pub began: f64,
    /// Time at which this note was written, in seconds since 1970.
    pub(crate) written: f64,
    /// Current stage of the command, counted from 1, and the number of stages.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) stage: Option<[usize; 2]>,
    /// Name of the stage that was started last: `[3/5] sweep`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub doing: Option<String>,
    /// The current model and deployment, if there are several.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub part: Option<String>,
    /// The current long task, with its units done and all its units.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub task: Option<Task>,
    /// Estimated seconds until the whole command ends, if known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub secs_left: Option<f64>,
}

/// A long task within a command.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Task {
    pub name: String,
    pub done: u64,
    pub total: u64,
    /// Estimated seconds until the task is done.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub secs_left: Option<f64>,
}

/// Whether the command of a note is still running.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum CommandState {
    /// The command is running.
    Running,
    /// The command was killed: a command that ends removes its note.
    Killed,
}

impl Note {
    /// Returns the note of a command of this process that begins now.
    pub(super) fn begun(command: &str, study: &Path) -> Self {
        let process = std::process::id();
        let now = unix_secs();
        Self {
            format: FORMAT,
            tool: TOOL.to_owned(),
            command: command.to_owned(),
            study: study.to_owned(),
            host: host_name().to_owned(),
            process,
            process_began: process_began(process),
            began: now,
            written: now,
            stage: None,
            doing: None,
            part: None,
            task: None,
            secs_left: None,
        }
    }

    /// Returns whether its command is at work.
    pub fn standing(&self) -> CommandState {
        let is_here = self.host == host_name();
        let is_running = match (is_here, self.process_began) {
            (true, Some(began)) => process_began(self.process) == Some(began),
            _ => unix_secs() - self.written < STALE_SECS,
        };
        if is_running { CommandState::Running } else { CommandState::Killed }
    }
}

/// Returns the notes of commands that write to `results`, each with its file, in the order in which the commands began.
/// Other files are ignored.
pub(super) fn notes(results: &Path) -> Vec<(PathBuf, Note)> {
    let entries = fs::read_dir(results.join(FOLDER)).into_iter().flatten().flatten();
    let paths = entries.map(|entry| entry.path());
    let mut notes: Vec<(PathBuf, Note)> = paths
        .filter_map(|path| {
            let text = calib_files::read_regular(&path).ok()?;
            let note: Note = serde_json::from_slice(&text).ok()?;
            (note.format == FORMAT).then_some((path, note))
        })
        .collect();
    notes.sort_by(|a, b| a.1.began.total_cmp(&b.1.began).then_with(|| a.0.cmp(&b.0)));
    notes
}

/// Returns the same notes without their files.
pub fn running(results: &Path) -> Vec<Note> {
    notes(results).into_iter().map(|(_, note)| note).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_note_of_a_process_that_is_gone_is_of_a_killed_one() {
        let note = Note::begun("run", Path::new("study.toml"));
        assert_eq!(note.standing(), CommandState::Running);
        let other = Note { host: "another machine".to_owned(), ..note.clone() };
        assert_eq!(other.standing(), CommandState::Running);
        let old = Note { written: unix_secs() - 2.0 * STALE_SECS, ..other };
        assert_eq!(old.standing(), CommandState::Killed);
        if let Some(began) = note.process_began {
            // The number was given to another process.
            let killed = Note { process_began: Some(began + 1), ..note.clone() };
            assert_eq!(killed.standing(), CommandState::Killed);
            let long = Note { written: 0.0, ..note };
            assert_eq!(long.standing(), CommandState::Running, "stopped in a debugger, say");
        }
    }
}
