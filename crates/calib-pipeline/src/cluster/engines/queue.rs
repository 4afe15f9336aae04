//! What a batch system says of its tasks, where there is one.

use std::{collections::BTreeMap, path::Path, process::Command};

use calib_files::read_json;
use serde::{Deserialize, Serialize};

/// Where it is kept which jobs were submitted, in the folder of the plan.
pub(crate) const JOBS: &str = "slurm/jobs.json";

/// Jobs that were submitted of a plan, the last time.
#[derive(Debug, Default, Serialize, Deserialize)]
pub(crate) struct SubmittedJobs {
    /// Arrays, one a stage.
    pub(crate) arrays: Vec<String>,
    pub(crate) merge: String,
}

/// What the queue says of each shard: `running`, `pending` and so on. Nothing where nothing was submitted, or no queue can be asked.
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

/// A line a task: its number, and how it stands.
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
