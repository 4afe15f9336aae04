use std::path::{Path, PathBuf};

use calib_files::{file_name, read_json, write_json};

use crate::{EnvironmentId, PlannedUnit, SweepError, Unit, UnitResult};

/// Finished units, one small file each, so that an interrupted sweep loses only units in progress.
#[derive(Clone, Debug)]
pub struct UnitStore {
    directory: PathBuf,
    beside: Vec<UnitStore>,
}

impl UnitStore {
    /// The store in `directory`, which need not exist.
    pub fn new(directory: PathBuf) -> Self {
        Self { directory, beside: Vec::new() }
    }

    /// The same store that also has the results of others: a result follows from its inputs alone, so whose it is does
    /// not matter. What is put goes to this store.
    #[must_use]
    pub fn beside(self, others: Vec<UnitStore>) -> Self {
        Self { beside: others, ..self }
    }

    /// The directory of the files.
    pub fn directory(&self) -> &Path {
        &self.directory
    }

    /// The stored result of `unit`, if it was made from the inputs that `key` stands for.
    /// A file that is missing, damaged or made from other inputs is no result.
    pub fn get(&self, unit: &Unit, key: &str) -> Option<UnitResult> {
        let own = read_json(&self.path(unit)).ok();
        own.filter(|result: &UnitResult| result.key == key && result.unit == *unit)
            .or_else(|| self.beside.iter().find_map(|other| other.get(unit, key)))
    }

    /// The stored results of all planned units, in their order.
    ///
    /// # Errors
    /// [`SweepError::Incomplete`] if a unit has no result.
    pub fn collect(&self, planned: &[PlannedUnit]) -> Result<Vec<UnitResult>, SweepError> {
        let results: Vec<_> =
            planned.iter().map(|planned| self.get(&planned.unit, &planned.key)).collect();
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

    /// Store a result.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn put(&self, result: &UnitResult) -> Result<(), SweepError> {
        Ok(write_json(&self.path(&result.unit), result)?)
    }

    /// Where the state of an unfinished run of this unit's environment is kept.
    pub(crate) fn unfinished(&self, unit: &Unit) -> PathBuf {
        let name = format!("{}-run-{:04}.safetensors", environment(unit), unit.run);
        self.directory.join(UNFINISHED).join(name)
    }

    /// Remove the states of unfinished runs: there are none, or they are of other inputs.
    pub(crate) fn forget_unfinished(&self) {
        // What stays is not looked at again.
        let _ = std::fs::remove_dir_all(self.directory.join(UNFINISHED));
    }

    fn path(&self, unit: &Unit) -> PathBuf {
        self.directory
            .join(file_name(&unit.sensor))
            .join(environment(unit))
            .join(format!("run-{:04}.json", unit.run))
    }
}

/// The folder of unfinished runs; no sensor's folder begins with a dot.
const UNFINISHED: &str = ".unfinished";

fn environment(unit: &Unit) -> String {
    match unit.environment {
        EnvironmentId::Member(member) => format!("member-{member}"),
        EnvironmentId::Online => "online".to_owned(),
        EnvironmentId::LogReplay => "log-replay".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_results_of_the_same_inputs_count() {
        let directory = tempfile::tempdir().expect("a directory");
        let store = UnitStore::new(directory.path().join("units"));
        let unit = Unit { sensor: "P/1".to_owned(), environment: EnvironmentId::Member(2), run: 7 };
        assert_eq!(store.get(&unit, "a"), None);
        let result = UnitResult {
            key: "a".to_owned(),
            unit: unit.clone(),
            seed: 1,
            start_row: 2,
            not_finite: None,
            rows: vec![],
        };
        store.put(&result).expect("written");
        assert_eq!(store.get(&unit, "a"), Some(result));
        assert_eq!(store.get(&unit, "b"), None);
        let other = UnitStore::new(directory.path().join("other")).beside(vec![store.clone()]);
        assert_eq!(other.get(&unit, "a"), store.get(&unit, "a"), "whose it is does not matter");
        assert_eq!(other.get(&unit, "b"), None);
        std::fs::write(store.path(&unit), b"{\"key\": \"a\"").expect("written");
        assert_eq!(store.get(&unit, "a"), None, "a damaged file is run again");
    }
}
