//! Work divided between processes that share only the plan: on one machine, on the nodes of a cluster, or on machines
//! without a common disk.
//!
//! A plan is a folder. `plan.json` lists the work and its shards. `inputs/` holds what the shards read. Each shard
//! writes its results to its own file in `shards/`. A shard reads no log and locks nothing. Running it twice gives the
//! same bytes. Only [`merge`](merge::merge) combines results, and it writes nothing unless every result is present and
//! intact.

mod arithmetic;
mod attempt;
mod config;
mod divide;
mod engines;
mod inputs;
mod make;
mod maker;
mod merge;
mod plan_file;
mod results;
mod run;
mod runs;
mod shard_ranges;
mod show;
mod sink;
mod status;
mod submit;

pub(crate) use make::plan;
pub use make::{ClusterDryPlan, ClusterPlan};
pub use merge::MergedSweeps;
pub(crate) use merge::merge;
pub(crate) use plan_file::is_plan;
pub use run::ClusterShard;
pub(crate) use run::run;
pub(crate) use runs::standing;
pub use status::ClusterStatus;
pub(crate) use status::{Status, Summary, status};
pub(crate) use submit::submit;
pub use submit::{ClusterScript, ClusterScripts, SubmittedPlan};
