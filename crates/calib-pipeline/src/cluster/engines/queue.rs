//! The state of submitted tasks in the queue of a batch system.

use std::{collections::BTreeMap, path::Path, process::Command};

use calib_files::read_json;
use serde::{Deserialize, Serialize};

/// The file of submitted jobs, in the folder of the plan.
pub(crate) const JOBS: &str = "slurm/jobs.json";

/// The jobs of the last submission of a plan.
#[derive(Debug, Default, Serialize, Deserialize)]
pub(crate) struct SubmittedJobs {
    /// Array jobs, one per stage.
    pub(crate) arrays: Vec<String>,
    pub(crate) merge: String,
}

/// Returns the queue state of each shard, such as `running` or `pending`. Empty if nothing was submitted, or the queue
/// cannot be read.
pub(crate) fn states(plan: &Path) -> BTreeMap<usize, String> {
    let Ok(submitted) = read_json::<SubmittedJobs>(&plan.join(JOBS)) else {
        return BTreeMap::new();
    };
    let jobs = submitted.arrays.join(",");
    let asked = Command::new("squeue")
        .args(["--noheader", "--array", "--format=%K %T", "--jobs", &jobs])
        .output();
    match asked {
        Ok(output) if output.status.success() => read(&String::from_utf8_lossy(&output.stdout)),
        _ => BTreeMap::new(),
    }
}

/// Parses one line per task: its number and its state.
fn read(text: &str) -> BTreeMap<usize, String> {
    text.lines()
        .filter_map(|line| {
            let (number, state) = line.trim().split_once(' ')?;
            Some((number.parse().ok()?, state.trim().to_lowercase()))
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_a_task() {
        let read = read("3 RUNNING\n 12 PENDING \nN/A PENDING\n\n");
        let expected = [(3, "running".to_owned()), (12, "pending".to_owned())];
        assert_eq!(read, expected.into());
    }
}
