//! Work that is divided between processes, which need have nothing in common but the plan: on one machine, on the nodes
//! of a cluster, or on machines that share no disk.
//!
//! A plan is a folder. `plan.json` says what there is to do and in which shards, `inputs/` holds what they read, and each
//! shard writes its results to one file of its own in `shards/`. A shard reads no log and claims nothing: whoever
//! runs one twice gets the same bytes. Only [`merge`](merge::merge) brings results together, and it writes nothing
//! unless every one is there and whole.

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
