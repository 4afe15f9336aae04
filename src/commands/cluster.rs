//! `calib cluster`: plans, shards, and what becomes of them.

use std::num::NonZeroUsize;

use anyhow::Context as _;
use calib_pipeline::{
    ArrayOf, ClusterPlanOptions, ClusterStatusOptions, ClusterSubmitOptions, Engine, Leftovers, Of,
    Outcome, Printer, Submission, cluster_merge, cluster_plan, cluster_run, cluster_status,
    cluster_submit,
};

use crate::cli::{ClusterCommand, ClusterEngine, MissingAs};

/// Do what is asked of a plan.
pub(super) fn run(command: ClusterCommand, printer: &Printer) -> anyhow::Result<Outcome> {
    Ok(match command {
        ClusterCommand::Plan { study, of: _, task_minutes, max_tasks, shards, plan } => {
            anyhow::ensure!(
                task_minutes > 0.0,
                "--task-minutes must be above 0, got {task_minutes}"
            );
            let options = ClusterPlanOptions {
                directory: plan,
                task_minutes,
                max_tasks: max_tasks.get(),
                shards: shards.map(NonZeroUsize::get),
            };
            cluster_plan(&study.job()?, &options, printer)?
        }
        ClusterCommand::Run { plan, shard } => {
            cluster_run(&plan, number(&shard, |name| std::env::var(name).ok())?, printer)?
        }
        ClusterCommand::Status { plan, missing, clean, json: _ } => {
            let missing = missing.map(|missing| match missing {
                MissingAs::Slurm => ArrayOf::Slurm,
                MissingAs::Lines => ArrayOf::Lines,
            });
            let leftovers = if clean { Leftovers::Removed } else { Leftovers::Kept };
            cluster_status(&plan, ClusterStatusOptions { missing, leftovers }, printer)?
        }
        ClusterCommand::Merge { plan } => cluster_merge(&plan, printer)?,
        ClusterCommand::Submit { plan, engine, config, missing_only, dry_run } => {
            let engine = match engine {
                ClusterEngine::Slurm => Engine::Slurm,
                ClusterEngine::Ray => Engine::Ray,
                ClusterEngine::Kubernetes => Engine::Kubernetes,
            };
            let of = if missing_only { Of::Missing } else { Of::All };
            let submission = if dry_run { Submission::Shown } else { Submission::Done };
            let options = ClusterSubmitOptions { engine, config, of, submission };
            cluster_submit(&plan, &options, printer)?
        }
    })
}

/// What systems call the number of a task, and what the first one is.
const NUMBERS: [(&str, usize); 5] = [
    ("SLURM_ARRAY_TASK_ID", 0),
    ("JOB_COMPLETION_INDEX", 0),
    ("PBS_ARRAY_INDEX", 0),
    ("PBS_ARRAYID", 0),
    ("PARALLEL_SEQ", 1),
];

/// The number of a shard as it was typed, or as the system says in the environment.
fn number(typed: &str, environment: impl Fn(&str) -> Option<String>) -> anyhow::Result<usize> {
    if typed != "auto" {
        return typed.parse().with_context(|| {
            format!("--shard must be the number of a shard or auto, got '{typed}'")
        });
    }
    let found = NUMBERS.iter().find_map(|&(name, first)| Some((name, first, environment(name)?)));
    let (name, first, value) = found.with_context(|| {
        let names: Vec<&str> = NUMBERS.iter().map(|(name, _)| *name).collect();
        format!("--shard auto: none of {} is in the environment; give a number", names.join(", "))
    })?;
    let number: Option<usize> = value.trim().parse().ok();
    number.and_then(|number| number.checked_sub(first)).with_context(|| {
        format!("--shard auto: {name} is '{value}', expected a number from {first} on")
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn systems_say_which_task_it_is() {
        let with = |name: &'static str, value: &'static str| {
            move |asked: &str| (asked == name).then(|| value.to_owned())
        };
        let nothing = |_: &str| None;
        assert_eq!(number("17", nothing).expect("typed"), 17);
        assert_eq!(number("auto", with("SLURM_ARRAY_TASK_ID", "3")).expect("an array"), 3);
        assert_eq!(number("auto", with("JOB_COMPLETION_INDEX", "0")).expect("a job"), 0);
        // GNU parallel counts from 1.
        assert_eq!(number("auto", with("PARALLEL_SEQ", "1")).expect("parallel"), 0);
        for refused in [
            number("auto", nothing),
            number("auto", with("PARALLEL_SEQ", "0")),
            number("auto", with("SLURM_ARRAY_TASK_ID", "1-3")),
            number("-1", nothing),
        ] {
            assert!(refused.is_err());
        }
    }
}
