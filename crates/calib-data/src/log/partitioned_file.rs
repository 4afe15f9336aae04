//! A file of the log and the hive folders around it.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

/// A file of the log, and the partitions (`key=value` folders) that contain it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct PartitionedFile {
    pub(crate) path: PathBuf,
    pub(crate) partitions: BTreeMap<String, String>,
}

impl PartitionedFile {
    pub(super) fn of(path: PathBuf) -> Self {
        Self { partitions: partitions(&path), path }
    }
}

fn partitions(path: &Path) -> BTreeMap<String, String> {
    path.parent()
        .into_iter()
        .flat_map(Path::components)
        .filter_map(|component| {
            let name = component.as_os_str().to_str()?;
            let (key, value) = name.split_once('=')?;
            Some((key.to_owned(), value.to_owned()))
        })
        .collect()
}
