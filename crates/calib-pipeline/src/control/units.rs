//! `control-units/`: the runs of an unfinished sweep, so that it can resume.

use std::{
    collections::{BTreeMap, btree_map::Entry},
    fs,
    path::{Path, PathBuf},
    sync::atomic::{AtomicUsize, Ordering},
    time::SystemTime,
};

use calib_base::{
    StepError,
    artefact::{self, Below, DirectoryLock},
};
use calib_control::{ActionModelKind, ControlError, Run, RunId, RunKeeper};
use calib_files::{Fingerprint, read_sealed_json, remove_file, remove_known, write_sealed_json};
use calib_study::Share;
use serde::{Deserialize, Serialize};

/// Runs that are stored in one file each.
pub(super) struct RunFiles {
    directory: PathBuf,
    /// The inputs of the runs.
    origin: RunOrigin,
    /// The share of runs to make here. All runs if `None`.
    share: Option<Share>,
    /// Number of runs made and stored so far.
    made: AtomicUsize,
    /// Number of requested runs that were already stored.
    found: AtomicUsize,
    /// Excludes other writers, except those of shares. Every run has its own file.
    _lock: Option<DirectoryLock>,
}

/// The inputs of runs.
#[derive(Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct RunOrigin {
    /// Fingerprint of their verdict's inputs.
    pub(super) key: String,
    /// Fingerprint of the log. With it the key of a study can be computed without reading the log.
    pub(super) log: Fingerprint,
}

/// The file of a run.
#[derive(Serialize, Deserialize)]
struct RunFile {
    origin: RunOrigin,
    run: Run,
}

impl RunFiles {
    /// Opens a folder of runs for writing.
    ///
    /// # Errors
    /// Returns an error if it cannot be written, or another process is writing there.
    pub(super) fn open(directory: &Path, origin: RunOrigin) -> Result<Self, StepError> {
        let claim = DirectoryLock::new(directory, Below::Ours)?;
        Ok(Self::with(directory, origin, None, Some(claim)))
    }

    /// Opens a folder for the runs of one share, next to processes with other shares.
    ///
    /// # Errors
    /// Returns an error if the folder cannot be written.
    pub(super) fn of_share(
        directory: &Path,
        origin: RunOrigin,
        share: Share,
    ) -> Result<Self, StepError> {
        artefact::own(directory)?;
        Ok(Self::with(directory, origin, Some(share), None))
    }

    /// Opens the runs of a folder for reading, of one share or of all. The folder need not exist.
    pub(super) fn seen(directory: &Path, origin: RunOrigin, share: Option<Share>) -> Self {
        Self::with(directory, origin, share, None)
    }

    fn with(
        directory: &Path,
        origin: RunOrigin,
        share: Option<Share>,
        lock: Option<DirectoryLock>,
    ) -> Self {
        let directory = directory.to_owned();
        let (made, found) = (AtomicUsize::new(0), AtomicUsize::new(0));
        Self { directory, origin, share, made, found, _lock: lock }
    }

    fn path(&self, id: RunId) -> PathBuf {
        let RunId { kind, member, run, candidate } = id;
        let of_kind = match kind {
            ActionModelKind::Neighbors => "run",
            ActionModelKind::Increments => "run-increments",
            ActionModelKind::Network => "run-network",
        };
        // Shares of another study may store runs in the same folder.
        let key = short(&self.origin.key);
        self.directory.join(format!("{of_kind}-{key}-{member}-{run}-{candidate}.json"))
    }

    /// Returns a run, if it was stored for this verdict.
    fn kept(&self, id: RunId) -> Option<Run> {
        let unit: RunFile = read_sealed_json(&self.path(id)).ok()?;
        (unit.origin == self.origin && unit.run.id() == id).then_some(unit.run)
    }

    /// Splits runs into those stored for this verdict, which then count as found, and those left to make.
    pub(super) fn split(&self, ids: Vec<RunId>) -> (Vec<Run>, Vec<RunId>) {
        let mut kept = Vec::new();
        let mut left = Vec::new();
        for id in ids {
            match self.kept(id) {
                Some(run) => kept.push(run),
                None => left.push(id),
            }
        }
        self.found.fetch_add(kept.len(), Ordering::Relaxed);
        (kept, left)
    }

    /// Returns how many runs of a kind of model are made here, out of `of_kind` in all.
    pub(super) fn own_runs(&self, kind: ActionModelKind, of_kind: usize) -> usize {
        let first = kind as usize * of_kind;
        self.share.map_or(of_kind, |share| share.pieces(first..first + of_kind))
    }

    /// Whether the folder has runs for such a verdict. They are not read.
    pub(super) fn has_kept(&self) -> bool {
        has_runs(&self.directory, &self.origin.key)
    }

    /// Whether all runs are made here.
    pub(super) fn are_all(&self) -> bool {
        self.share.is_none()
    }

    /// Removes these runs, which cannot be trusted.
    ///
    /// # Errors
    /// Returns an error if a file cannot be removed.
    pub(super) fn forget(&self, runs: &[Run]) -> Result<(), StepError> {
        for run in runs {
            remove_file(&self.path(run.id()))?;
        }
        Ok(())
    }

    /// Removes all runs in the folder, including those of other verdicts. They are no longer needed, or cannot be
    /// trusted.
    ///
    /// # Errors
    /// Returns an error if a file cannot be removed.
    pub(super) fn remove(&self) -> Result<(), StepError> {
        Ok(remove_known(&self.directory, &mut is_unit)?)
    }

    /// Returns how many runs were made, and how many were already stored.
    pub(super) fn counts(&self) -> RunCounts {
        let [made, found] = [&self.made, &self.found].map(|count| count.load(Ordering::Relaxed));
        RunCounts { made, found }
    }
}

/// The numbers of new and existing runs of a process.
pub(super) struct RunCounts {
    /// Made and stored.
    pub(super) made: usize,
    /// Already stored.
    pub(super) found: usize,
}

/// Removes runs of the verdict `key` from a folder, unless another process is writing there. A share that ends after
/// the verdict may leave some. Runs of other verdicts stay.
///
/// # Errors
/// Returns an error if the folder cannot be written.
pub(super) fn remove_left(directory: &Path, key: &str) -> Result<(), StepError> {
    if !has_runs(directory, key) {
        return Ok(());
    }
    if let Some(_claim) = DirectoryLock::try_new(directory, Below::Ours)? {
        remove_known(directory, &mut |path: &Path| is_unit_of(path, key))?;
    }
    Ok(())
}

/// Whether a folder has runs of the verdict `key`.
fn has_runs(directory: &Path, key: &str) -> bool {
    let mut files = fs::read_dir(directory).into_iter().flatten().flatten();
    files.any(|file| is_unit_of(Path::new(&file.file_name()), key))
}

/// The runs in a folder.
pub(super) struct StoredRuns {
    /// Runs of the study, on the same log as the newest of them.
    pub(super) own: Vec<Run>,
    /// Number of runs of other settings of the study, or on another log.
    pub(super) others: usize,
}

/// Returns the runs in `directory`. `key_on` gives the key of the study's verdict on a log. Another process may be
/// writing there.
///
/// # Errors
/// Returns the errors of `key_on`.
pub(super) fn stored(
    directory: &Path,
    key_on: impl Fn(&Fingerprint) -> Result<String, StepError>,
) -> Result<StoredRuns, StepError> {
    let files = fs::read_dir(directory).into_iter().flatten().flatten();
    let runs: Vec<(SystemTime, RunFile)> = files
        .filter(|file| is_unit(Path::new(&file.file_name())))
        .filter_map(|file| {
            let modified = file.metadata().and_then(|metadata| metadata.modified()).ok()?;
            Some((modified, read_sealed_json(&file.path()).ok()?))
        })
        .collect();
    // Computed once per key: there are many runs, and few keys.
    let mut are_own: BTreeMap<&str, bool> = BTreeMap::new();
    for (_, RunFile { origin, .. }) in &runs {
        if let Entry::Vacant(entry) = are_own.entry(origin.key.as_str()) {
            entry.insert(key_on(&origin.log)? == origin.key);
        }
    }
    let own = runs.iter().filter(|(_, file)| are_own[file.origin.key.as_str()]);
    let newest = own.max_by_key(|(modified, _)| *modified).map(|(_, file)| file.origin.clone());
    let all = runs.len();
    let own: Vec<Run> = runs
        .into_iter()
        .filter(|(_, file)| newest.as_ref() == Some(&file.origin))
        .map(|(_, file)| file.run)
        .collect();
    Ok(StoredRuns { others: all - own.len(), own })
}

/// Returns the digits of a key in the names of its runs.
fn short(key: &str) -> &str {
    key.get(..KEY_DIGITS).unwrap_or(key)
}

/// Number of digits of a key in the name of a run.
const KEY_DIGITS: usize = 8;

fn is_unit(path: &Path) -> bool {
    let name = path.to_string_lossy();
    name.starts_with("run-") && name.ends_with(".json")
}

fn is_unit_of(path: &Path, key: &str) -> bool {
    is_unit(path) && path.to_string_lossy().contains(short(key))
}

impl RunKeeper for RunFiles {
    fn known(&self, id: RunId) -> Option<Run> {
        let run = self.kept(id)?;
        self.found.fetch_add(1, Ordering::Relaxed);
        Some(run)
    }

    fn keep(&self, run: &Run) -> Result<(), ControlError> {
        write_sealed_json(
            &self.path(run.id()),
            &RunFile { origin: self.origin.clone(), run: run.clone() },
        )?;
        self.made.fetch_add(1, Ordering::Relaxed);
        Ok(())
    }

    fn has(&self, number: usize) -> bool {
        self.share.is_none_or(|share| share.has(number))
    }
}
