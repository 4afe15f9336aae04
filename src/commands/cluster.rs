//! `calib cluster`: makes plans, runs their shards, and merges the results.

use std::num::NonZeroUsize;

use calib_pipeline::{
    ArrayOf, ClusterPlanOptions, ClusterStatusOptions, ClusterSubmitOptions, Engine, Leftovers,
    Outcome, Printer, ShardsToSubmit, StepError, Submission, Told as _, cluster_merge,
    cluster_plan, cluster_run, cluster_status, cluster_submit, ensure,
};

use super::share::{environment, number};
use crate::cli::{ClusterCommand, ClusterEngine, MissingAs};

/// Runs a command on a plan.
pub(super) fn run(command: ClusterCommand, printer: &Printer) -> Result<Outcome, StepError> {
    Ok(match command {
        ClusterCommand::Plan { study, of: _, task_minutes, max_tasks, shards, plan } => {
            ensure!(task_minutes > 0.0, "--task-minutes must be above 0, got {task_minutes}");
            let options = ClusterPlanOptions {
                directory: plan,
                task_minutes,
                max_tasks: max_tasks.get(),
                shards: shards.map(NonZeroUsize::get),
            };
            cluster_plan(&study.job()?, &options, printer)?.outcome()
        }
        ClusterCommand::Run { plan, shard } => {
            cluster_run(&plan, number("--shard", &shard, environment)?, printer)?.outcome()
        }
        ClusterCommand::Status { plan, missing, clean, json: _ } => {
            let missing = missing.map(|missing| match missing {
                MissingAs::Slurm => ArrayOf::Slurm,
                MissingAs::Lines => ArrayOf::Lines,
            });
            let leftovers = if clean { Leftovers::Removed } else { Leftovers::Kept };
            cluster_status(&plan, ClusterStatusOptions { missing, leftovers }, printer)?.outcome()
        }
        ClusterCommand::Merge { plan } => cluster_merge(&plan, printer)?.outcome(),
        ClusterCommand::Submit { plan, engine, config, missing_only, dry_run } => {
            let engine = match engine {
                ClusterEngine::Slurm => Engine::Slurm,
                ClusterEngine::Ray => Engine::Ray,
                ClusterEngine::Kubernetes => Engine::Kubernetes,
            };
            let shards = if missing_only { ShardsToSubmit::Missing } else { ShardsToSubmit::All };
            let submission = if dry_run { Submission::Shown } else { Submission::Done };
            let options = ClusterSubmitOptions { engine, config, shards, submission };
            cluster_submit(&plan, &options, printer)?.outcome()
        }
    })
}
