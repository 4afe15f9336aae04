//! Reports the dated changes of a simulated plant, and writes them beside its log.

use std::path::Path;

use calib_core::Timestamp;
use calib_data::format_time;
use calib_files::{FileError, FolderRecord, remove_file, write_json};
use calib_plant::{Change, ChangeKind, Plant};
use schemars::JsonSchema;
use serde::Serialize;

/// The file beside the day files. It is not a log: logs are Parquet files.
pub(crate) const CHANGES: &str = "changes.json";

/// `changes.json`: every change of the plant in time order.
#[derive(Serialize)]
struct ChangesFile<'a> {
    format: u32,
    changes: &'a [DatedChange],
}

/// One change of the plant, with its time.
#[derive(Debug, Serialize, JsonSchema)]
pub(crate) struct DatedChange {
    /// Time of the change.
    at: Timestamp,
    /// The change in words.
    told: String,
    /// The change in numbers.
    #[serde(flatten)]
    kind: ChangeKind,
}

impl DatedChange {
    fn of(change: Change) -> Self {
        Self { at: change.at, told: change.kind.to_string(), kind: change.kind }
    }

    pub(crate) fn at(&self) -> String {
        format_time(self.at)
    }

    pub(crate) fn line(&self) -> String {
        format!("{}  {}", self.at(), self.told)
    }
}

/// Writes the changes of `plant` beside its log. If the plant does not change, it removes the file of an
/// earlier plant.
pub(crate) fn write(
    directory: &Path,
    record: &FolderRecord,
    plant: &Plant,
) -> Result<Vec<DatedChange>, FileError> {
    let path = directory.join(CHANGES);
    if plant.options().change.strength == 0.0 {
        if record.has(CHANGES) {
            remove_file(&path)?;
        }
        return Ok(Vec::new());
    }
    let changes: Vec<DatedChange> = plant.changes().into_iter().map(DatedChange::of).collect();
    write_json(&path, &ChangesFile { format: 1, changes: &changes })?;
    Ok(changes)
}
