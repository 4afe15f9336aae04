use std::{
    collections::BTreeMap,
    fs::DirEntry,
    io,
    path::{Path, PathBuf},
    time::SystemTime,
};

use calib_files::{
    FileError, file_name, is_temporary, read_sealed_json, remove_empty_folder, remove_file,
    remove_known, write_sealed_json,
};

use crate::{EnvironmentId, PlannedUnit, SweepError, Unit, UnitResult, UnitRuns, UnitSink};

/// Finished units in one small file each. An interrupted sweep loses only the units in progress.
#[derive(Clone, Debug)]
pub struct UnitStore {
    directory: PathBuf,
    beside: Vec<UnitStore>,
}

impl UnitStore {
    /// Creates the store in `directory`, which need not exist.
    pub fn new(directory: PathBuf) -> Self {
        Self { directory, beside: Vec::new() }
    }

    /// Adds other stores to read from. A result depends only on its inputs, so it does not matter who made it. New
    /// results still go to this store.
    #[must_use]
    pub fn beside(self, others: Vec<UnitStore>) -> Self {
        Self { beside: others, ..self }
    }

    /// Returns the stored runs of `unit` whose inputs have the fingerprint `key`. A missing or damaged file, or one
    /// from other inputs, gives `None`.
    pub fn get(&self, unit: &Unit, key: &str) -> Option<UnitRuns> {
        let others = self.beside.iter().filter_map(|other| other.get(unit, key));
        UnitRuns::merged(self.own(unit, key).into_iter().chain(others))
    }

    fn own(&self, unit: &Unit, key: &str) -> Option<UnitRuns> {
        let own = read_sealed_json(&self.path(unit)).ok();
        own.filter(|runs: &UnitRuns| runs.is_of(unit, key))
    }

    /// Returns the stored results of all planned units, in order. `settings` are the keys of all settings.
    ///
    /// # Errors
    /// Returns [`SweepError::Incomplete`] if a unit lacks a run.
    pub fn collect<S: AsRef<str>>(
        &self,
        planned: &[PlannedUnit],
        settings: &[S],
    ) -> Result<Vec<UnitResult>, SweepError> {
        let results: Vec<_> = planned
            .iter()
            .map(|planned| self.get(&planned.unit, &planned.key)?.result(planned.trained(settings)))
            .collect();
        let missing = results.iter().filter(|result| result.is_none()).count();
        match planned.iter().zip(&results).find(|(_, result)| result.is_none()) {
            Some((first, _)) => Err(SweepError::Incomplete {
                missing,
                planned: planned.len(),
                example: first.unit.clone(),
            }),
            None => Ok(results.into_iter().flatten().collect()),
        }
    }

    /// Stores runs of a unit. Runs of other settings from the same inputs, which another grid has left, stay.
    ///
    /// # Errors
    /// Returns an error if the file cannot be written.
    pub fn put(&self, runs: &UnitRuns) -> Result<(), SweepError> {
        let path = self.path(&runs.unit);
        let Some(mut all) = self.own(&runs.unit, &runs.key) else {
            return Ok(write_sealed_json(&path, runs)?);
        };
        all.merge(runs.clone());
        Ok(write_sealed_json(&path, &all)?)
    }

    /// Returns the saved states of unfinished runs, with the time of the last write.
    pub(crate) fn states_kept(&self) -> StatesKept {
        let kept = listed(&self.directory.join(UNFINISHED)).unwrap_or_default().into_iter();
        kept.filter(|entry| is_state(&entry.path()))
            .filter_map(|entry| Some((entry.path(), entry.metadata().ok()?.modified().ok()?)))
            .collect()
    }

    /// Removes the states in `before` that have not been written since, because they belong to other inputs. Another
    /// process may be writing the rest.
    pub(crate) fn forget_stale(&self, before: &StatesKept) {
        let now = self.states_kept();
        for (path, _) in now.iter().filter(|(path, written)| before.get(*path) == Some(*written)) {
            // A file that cannot be removed is never read again.
            let _ = remove_file(path);
        }
        remove_empty_folder(&self.directory.join(UNFINISHED));
    }

    /// Removes all units. Only files named like units are removed, and folders that are then empty. Targets of links
    /// and other files stay.
    ///
    /// # Errors
    /// Returns an error if a file cannot be removed.
    pub fn clear(&self) -> Result<(), SweepError> {
        // States that cannot be removed are never read again.
        let _ = remove_states(&self.directory.join(UNFINISHED));
        for sensor in folders(&self.directory)? {
            for environment in folders(&sensor)? {
                for entry in listed(&environment)? {
                    let name = entry.file_name();
                    let is_file = entry.file_type().is_ok_and(|kind| kind.is_file());
                    if is_file && is_unit(&name.to_string_lossy()) {
                        remove_file(&entry.path())?;
                    }
                }
                // Fails where the folder is not empty, which then stays.
                remove_empty_folder(&environment);
            }
            remove_empty_folder(&sensor);
        }
        Ok(())
    }

    /// Returns the paths of the `planned` units without a file. The files are not read.
    pub fn missing(&self, planned: &[PlannedUnit]) -> Vec<PathBuf> {
        let paths = planned.iter().map(|planned| self.path(&planned.unit));
        paths.filter(|path| !path.exists()).collect()
    }

    fn path(&self, unit: &Unit) -> PathBuf {
        self.directory
            .join(file_name(&unit.sensor))
            .join(environment_name(unit))
            .join(format!("run-{:04}.json", unit.run))
    }
}

impl UnitSink for UnitStore {
    fn put(&self, runs: &[UnitRuns]) -> Result<(), SweepError> {
        runs.iter().try_for_each(|runs| self.put(runs))
    }

    fn state(&self, name: &str) -> PathBuf {
        self.directory.join(UNFINISHED).join(name)
    }
}

/// Saved states of unfinished runs, with the time of the last write.
pub(crate) type StatesKept = BTreeMap<PathBuf, SystemTime>;

/// Whether a file name has the form `run-0000.json`.
fn is_unit(name: &str) -> bool {
    let number = name.strip_prefix("run-").and_then(|rest| rest.strip_suffix(".json"));
    number.is_some_and(is_run_number)
}

/// Whether part of a file name is a run number.
fn is_run_number(text: &str) -> bool {
    text.len() >= 4 && text.bytes().all(|digit| digit.is_ascii_digit())
}

/// Whether a file is named like the state of an unfinished run, or like its remains after a kill.
fn is_state(path: &Path) -> bool {
    let name = path.file_name().and_then(|name| name.to_str());
    let number_and_key = name.and_then(number_and_key_of_state);
    let is_ours = number_and_key.is_some_and(|(number, key)| {
        is_run_number(number) && key.bytes().all(|digit| digit.is_ascii_hexdigit())
    });
    is_ours || is_temporary(path)
}

/// Returns the run number and the key from a name such as `online-run-0003-0123456789ab.safetensors`.
fn number_and_key_of_state(name: &str) -> Option<(&str, &str)> {
    let (_, run) = name.strip_suffix(".safetensors")?.rsplit_once("-run-")?;
    run.split_once('-')
}

/// Removes the states of unfinished runs in `folder`. Other files stay.
///
/// # Errors
/// Returns an error if one cannot be removed.
pub fn remove_states(folder: &Path) -> Result<(), FileError> {
    remove_known(folder, &mut is_state)
}

/// Returns the entries of a folder, which need not exist. A link to a folder counts as empty.
fn listed(folder: &Path) -> Result<Vec<DirEntry>, FileError> {
    let is_own = std::fs::symlink_metadata(folder).is_ok_and(|found| found.is_dir());
    if !is_own {
        return Ok(Vec::new());
    }
    let entries = std::fs::read_dir(folder).and_then(Iterator::collect::<io::Result<_>>);
    entries.map_err(|source| FileError::io("read", folder, source))
}

/// Returns the subfolders of a folder.
fn folders(folder: &Path) -> Result<Vec<PathBuf>, FileError> {
    let inside = listed(folder)?.into_iter();
    let inside = inside.filter(|entry| entry.file_type().is_ok_and(|kind| kind.is_dir()));
    Ok(inside.map(|entry| entry.path()).collect())
}

/// The folder of unfinished runs. No sensor's folder begins with a dot.
const UNFINISHED: &str = ".unfinished";

/// Returns the prefix of the file names of an environment.
pub(crate) fn environment_name(unit: &Unit) -> String {
    match unit.environment {
        EnvironmentId::Member(member) => format!("member-{member}"),
        EnvironmentId::Online => "online".to_owned(),
        EnvironmentId::LogReplay => "log-replay".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;
    use crate::SettingRun;

    #[cfg(unix)]
    fn write(path: &Path) {
        std::fs::create_dir_all(path.parent().expect("below")).expect("made");
        std::fs::write(path, b"content").expect("written");
    }

    #[cfg(unix)]
    #[test]
    fn clearing_leaves_what_is_not_a_unit() {
        let directory = tempfile::tempdir().expect("a directory");
        let root = directory.path();
        let own = [
            "units/P/online/run-0000.json",
            "units/P/member-0/run-12345.json",
            "units/.unfinished/online-run-0003-0123456789ab.safetensors",
        ];
        let foreign = [
            "units/.unfinished/notes.txt",
            "units/.unfinished/weights-run-3.safetensors",
            "units/notes.txt",
            "units/P/online/run-7.json",
            "units/P/online/deeper/run-0001.json",
            "theirs/online/run-0000.json",
        ];
        own.iter().chain(&foreign).for_each(|name| write(&root.join(name)));
        std::os::unix::fs::symlink(root.join("theirs"), root.join("units/linked")).expect("linked");
        UnitStore::new(root.join("units")).clear().expect("cleared");
        assert!(
            own.iter().all(|name| !root.join(name).exists())
                && !root.join("units/P/member-0").exists()
        );
        assert!(foreign.iter().all(|name| root.join(name).exists()));
        std::fs::rename(root.join("units"), root.join("elsewhere")).expect("renamed");
        write(&root.join("elsewhere/P/online/run-0000.json"));
        std::os::unix::fs::symlink(root.join("elsewhere"), root.join("units")).expect("linked");
        UnitStore::new(root.join("units")).clear().expect("nothing to clear");
        assert!(root.join("elsewhere/P/online/run-0000.json").exists());
    }

    /// Returns failed runs of these settings.
    fn runs_of(unit: &Unit, settings: &[&str]) -> UnitRuns {
        let runs = settings.iter().map(|name| ((*name).to_owned(), SettingRun::failed(3)));
        UnitRuns {
            key: "a".to_owned(),
            unit: unit.clone(),
            seed: 1,
            start_row: 2,
            not_finite: None,
            runs: runs.collect(),
        }
    }

    #[test]
    fn only_results_of_the_same_inputs_count() {
        let directory = tempfile::tempdir().expect("a directory");
        let store = UnitStore::new(directory.path().join("units"));
        let unit = Unit { sensor: "P/1".to_owned(), environment: EnvironmentId::Member(2), run: 7 };
        assert_eq!(store.get(&unit, "a"), None);
        store.put(&runs_of(&unit, &["x", "y"])).expect("written");
        assert_eq!(store.get(&unit, "a"), Some(runs_of(&unit, &["x", "y"])));
        assert_eq!(store.get(&unit, "b"), None);
        store.put(&runs_of(&unit, &["z"])).expect("written");
        assert_eq!(
            store.get(&unit, "a"),
            Some(runs_of(&unit, &["x", "y", "z"])),
            "those of other settings stay"
        );
        let settings = ["z", "x"];
        let planned =
            PlannedUnit { unit: unit.clone(), key: "a".to_owned(), dropped: BTreeSet::new() };
        let collected = store.collect(std::slice::from_ref(&planned), &settings).expect("there");
        let candidates: Vec<usize> = collected[0].rows.iter().map(|row| row.candidate).collect();
        assert_eq!(candidates, [0, 1]);
        let more = ["z", "w"];
        assert!(store.collect(std::slice::from_ref(&planned), &more).is_err(), "w was not run");
        let raced = PlannedUnit { dropped: [1].into(), ..planned };
        assert_eq!(store.collect(&[raced], &more).expect("there")[0].rows.len(), 1);
        let other = UnitStore::new(directory.path().join("other")).beside(vec![store.clone()]);
        assert_eq!(other.get(&unit, "a"), store.get(&unit, "a"), "whose it is does not matter");
        assert_eq!(other.get(&unit, "b"), None);
        std::fs::write(store.path(&unit), b"{\"key\": \"a\"").expect("written");
        assert_eq!(store.get(&unit, "a"), None, "a damaged file is run again");
    }
}
