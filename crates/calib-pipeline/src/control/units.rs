//! `control-units/`: runs of a sweep that is not finished, so that it goes on from them.

use std::{
    fs,
    path::{Path, PathBuf},
    time::SystemTime,
};

use calib_base::{
    StepError,
    artefact::{self, Below, DirectoryLock},
};
use calib_control::{ActionModelKind, ControlError, Run, RunId, RunKeeper};
use calib_files::{read_sealed_json, remove_file, remove_known, write_sealed_json};
use calib_study::Share;
use serde::{Deserialize, Serialize};

/// Runs in files of their own.
pub(super) struct RunFiles {
    directory: PathBuf,
    /// Of the verdict that they are for.
    key: String,
    /// Which runs are made here; all without one.
    share: Option<Share>,
    /// Nobody else writes there meanwhile, unless it is for another share: every run has a file of its own.
    _lock: Option<DirectoryLock>,
}

/// A run in its file.
#[derive(Serialize, Deserialize)]
struct RunFile {
    key: String,
    run: Run,
}

impl RunFiles {
    /// Keep runs of the verdict `key` in a folder.
    ///
    /// # Errors
    /// If it cannot be written, or another process does.
    pub(super) fn open(directory: &Path, key: &str) -> Result<Self, StepError> {
        let claim = DirectoryLock::new(directory, Below::Ours)?;
        let (directory, key) = (directory.to_owned(), key.to_owned());
        Ok(Self { directory, key, share: None, _lock: Some(claim) })
    }

    /// Keep the runs of one share, beside other processes that keep those of theirs.
    ///
    /// # Errors
    /// If the folder cannot be written.
    pub(super) fn of_share(directory: &Path, key: &str, share: Share) -> Result<Self, StepError> {
        artefact::own(directory)?;
        let (directory, key) = (directory.to_owned(), key.to_owned());
        Ok(Self { directory, key, share: Some(share), _lock: None })
    }

    fn path(&self, id: RunId) -> PathBuf {
        let RunId { kind, member, run, candidate } = id;
        let of_kind = match kind {
            ActionModelKind::Neighbors => "run",
            ActionModelKind::Increments => "run-increments",
            ActionModelKind::Network => "run-network",
        };
        self.directory.join(format!("{of_kind}-{member}-{run}-{candidate}.json"))
    }

    /// Whether all runs are made here.
    pub(super) fn are_all(&self) -> bool {
        self.share.is_none()
    }

    /// Forget these runs, which cannot be trusted.
    ///
    /// # Errors
    /// If a file cannot be removed.
    pub(super) fn forget(&self, runs: &[Run]) -> Result<(), StepError> {
        for run in runs {
            remove_file(&self.path(run.id()))?;
        }
        Ok(())
    }

    /// Forget them: the verdict is there, or they cannot be trusted.
    ///
    /// # Errors
    /// If a file cannot be removed.
    pub(super) fn remove(&self) -> Result<(), StepError> {
        Ok(remove_known(&self.directory, &mut is_unit)?)
    }
}

/// The runs in `directory` that belong to the verdict of the newest one. Another process may be at work there.
pub(super) fn stored(directory: &Path) -> Vec<Run> {
    let files = fs::read_dir(directory).into_iter().flatten().flatten();
    let mut runs: Vec<(SystemTime, RunFile)> = files
        .filter(|file| is_unit(Path::new(&file.file_name())))
        .filter_map(|file| {
            let modified = file.metadata().and_then(|metadata| metadata.modified()).ok()?;
            Some((modified, read_sealed_json(&file.path()).ok()?))
        })
        .collect();
    let newest = runs.iter().max_by_key(|(modified, _)| *modified);
    let Some(key) = newest.map(|(_, file)| file.key.clone()) else { return Vec::new() };
    runs.retain(|(_, file)| file.key == key);
    runs.into_iter().map(|(_, file)| file.run).collect()
}

fn is_unit(path: &Path) -> bool {
    let name = path.to_string_lossy();
    name.starts_with("run-") && name.ends_with(".json")
}

impl RunKeeper for RunFiles {
    fn known(&self, id: RunId) -> Option<Run> {
        let unit: RunFile = read_sealed_json(&self.path(id)).ok()?;
        (unit.key == self.key && unit.run.id() == id).then_some(unit.run)
    }

    fn keep(&self, run: &Run) -> Result<(), ControlError> {
        Ok(write_sealed_json(
            &self.path(run.id()),
            &RunFile { key: self.key.clone(), run: run.clone() },
        )?)
    }

    fn has(&self, number: usize) -> bool {
        self.share.is_none_or(|share| share.has(number))
    }
}
