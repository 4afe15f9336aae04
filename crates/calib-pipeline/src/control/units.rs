//! `control-units/`: runs of a sweep that is not finished, so that it goes on from them.

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

/// Runs in files of their own.
pub(super) struct RunFiles {
    directory: PathBuf,
    /// What they follow from.
    origin: RunOrigin,
    /// Which runs are made here; all without one.
    share: Option<Share>,
    /// Runs that were made and kept here so far.
    made: AtomicUsize,
    /// Runs that were asked for and there already.
    found: AtomicUsize,
    /// Nobody else writes there meanwhile, unless it is for another share: every run has a file of its own.
    _lock: Option<DirectoryLock>,
}

/// What runs follow from.
#[derive(Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct RunOrigin {
    /// Of the verdict that they are for.
    pub(super) key: String,
    /// The log. With it the key of a study is known without reading the log.
    pub(super) log: Fingerprint,
}

/// A run in its file.
#[derive(Serialize, Deserialize)]
struct RunFile {
    origin: RunOrigin,
    run: Run,
}

impl RunFiles {
    /// Keep runs in a folder.
    ///
    /// # Errors
    /// If it cannot be written, or another process does.
    pub(super) fn open(directory: &Path, origin: RunOrigin) -> Result<Self, StepError> {
        let claim = DirectoryLock::new(directory, Below::Ours)?;
        Ok(Self::with(directory, origin, None, Some(claim)))
    }

    /// Keep the runs of one share, beside other processes that keep those of theirs.
    ///
    /// # Errors
    /// If the folder cannot be written.
    pub(super) fn of_share(
        directory: &Path,
        origin: RunOrigin,
        share: Share,
    ) -> Result<Self, StepError> {
        artefact::own(directory)?;
        Ok(Self::with(directory, origin, Some(share), None))
    }

    /// Look at the runs of a folder, which need not be there, of one share or of all; nothing is written there.
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
        // Shares of another study may keep theirs in the same folder.
        let key = short(&self.origin.key);
        self.directory.join(format!("{of_kind}-{key}-{member}-{run}-{candidate}.json"))
    }

    /// A run, if it was kept for this verdict.
    fn kept(&self, id: RunId) -> Option<Run> {
        let unit: RunFile = read_sealed_json(&self.path(id)).ok()?;
        (unit.origin == self.origin && unit.run.id() == id).then_some(unit.run)
    }

    /// The runs of these that were kept for this verdict, which then count as found, and those that are left to make.
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

    /// How many runs are made here of a kind of models that has so many in all.
    pub(super) fn own_runs(&self, kind: ActionModelKind, of_kind: usize) -> usize {
        let first = kind as usize * of_kind;
        self.share.map_or(of_kind, |share| share.pieces(first..first + of_kind))
    }

    /// Whether runs were kept here for a verdict like this one; they are not read.
    pub(super) fn has_kept(&self) -> bool {
        has_runs(&self.directory, &self.origin.key)
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

    /// Forget all runs in the folder, also those of other verdicts: the verdict is there, or they cannot be trusted.
    ///
    /// # Errors
    /// If a file cannot be removed.
    pub(super) fn remove(&self) -> Result<(), StepError> {
        Ok(remove_known(&self.directory, &mut is_unit)?)
    }

    /// How many runs were made and kept, and how many were there already.
    pub(super) fn counts(&self) -> RunCounts {
        let [made, found] = [&self.made, &self.found].map(|count| count.load(Ordering::Relaxed));
        RunCounts { made, found }
    }
}

/// What became of the runs that a process was to make.
pub(super) struct RunCounts {
    /// Made and kept.
    pub(super) made: usize,
    /// There already.
    pub(super) found: usize,
}

/// Forget runs of the verdict `key` in a folder, as a share may leave them that ends after the verdict; unless another process writes
/// there. Runs of other verdicts stay.
///
/// # Errors
/// If the folder cannot be written.
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

/// Runs in a folder.
pub(super) struct StoredRuns {
    /// Of the study, on the log of the newest of them.
    pub(super) own: Vec<Run>,
    /// How many there are of other values of its keys, or on another log.
    pub(super) others: usize,
}

/// The runs in `directory`, where `key_on` is the key of the study's verdict on a log. Another process may be at work there.
///
/// # Errors
/// Those of `key_on`.
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
    // There are many runs, and few keys.
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

/// The digits of a key that stand in the names of its runs.
fn short(key: &str) -> &str {
    key.get(..KEY_DIGITS).unwrap_or(key)
}

/// Digits of a key in the name of a run.
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
