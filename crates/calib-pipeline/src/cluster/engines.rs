//! The systems that run shards, and the scripts for them. Every text depends only on a plan and a configuration.

pub(crate) mod kubernetes;
pub(crate) mod queue;
pub(crate) mod slurm;

use crate::cluster::{config::ClusterConfig, plan_file::PlanFile};

/// The driver for Ray, a Python program that needs `ray` from the package index. It is also a package of its
/// own, in `python/calib_ray`.
pub(crate) const RAY_DRIVER: &str = include_str!("../../../../python/calib_ray/calib_ray.py");

/// The resources that a task of a plan needs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct TaskDemand {
    pub(crate) minutes: u64,
    pub(crate) memory_mb: u64,
}

impl TaskDemand {
    /// Returns the demand of the shards with these numbers.
    pub(crate) fn of(plan: &PlanFile, shards: &[usize], config: &ClusterConfig) -> Self {
        let shards = shards.iter().filter_map(|number| plan.shards.get(*number));
        let secs = shards.clone().map(|shard| shard.secs).fold(0.0, f64::max);
        let bytes = shards.map(|shard| shard.memory).max().unwrap_or(0) as f64;
        let grace = config.grace_secs.div_ceil(60);
        let minutes = ((2.0 * secs / 60.0).ceil() as u64).max(10) + grace;
        Self {
            minutes: config.minutes.unwrap_or(minutes),
            // Every thread has its own pass. Files are mapped only once, so this is more than enough.
            memory_mb: config.memory_mb.unwrap_or_else(|| {
                (1.5 * bytes * config.threads as f64 / f64::from(1 << 20)).ceil() as u64
            }),
        }
    }
}
