//! The steps from a plant's log to a verdict: what each makes, what it follows from, and in which order.
//!
//! A step takes a [`Job`], the study as it was resolved once, and a [`Printer`], which tells an [`Observer`] what is
//! done. It makes what is missing, keeps it in the folder of results, and does nothing where nothing is missing: an interrupted
//! step goes on when it is run again. Results are the same whoever runs it, on however many threads.
//!
//! ```no_run
//! use std::sync::Arc;
//!
//! use calib_pipeline::{Job, Printer, Request, Unobserved};
//!
//! let job = Job::resolve(Request::new("study.toml"))?;
//! calib_pipeline::run(&job, &Printer::new(Arc::new(Unobserved)))?;
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! [`run`] makes all of them in order: [`simulate`] (where the study describes its plant), [`pretrain`], [`represent`],
//! [`build_model`], [`rollout`], [`sweep`], [`evaluate`]. [`check`] compares what is there with what was written, [`validity`] judges
//! how well calib chooses over several studies.

mod artefact;
mod build_check;
mod build_model;
mod build_network;
mod build_plan;
mod chain;
mod changes;
mod check;
mod clock;
mod collapse;
mod compare;
mod compare_choices;
mod compare_pairs;
mod compare_tables;
mod comparison;
mod deployed;
mod each;
mod environments;
mod evaluate;
mod figures;
mod frames;
mod jumps;
mod kept_report;
mod learning;
mod memory;
mod model;
mod model_files;
mod one_step;
mod options;
mod outcome;
pub mod output;
mod partition;
mod plant_of_study;
mod prepared;
mod pretrain;
mod pretrain_files;
mod recorded;
mod recurrence;
mod report;
mod report_data;
mod represent;
mod rollout;
mod simulate;
mod stale;
mod standing_still;
mod starts;
mod steps;
mod streams;
mod sweep;
mod sweep_notes;
mod sweep_plan;
mod sweep_tables;
mod torch;
mod train_model;
mod trajectory;
mod trajectory_columns;
mod truth;
mod validity;
mod verdict_rows;

pub use calib_study::{Job, Request, StudyError};
pub use clock::Stopwatch;
pub use memory::{MemorySize, check_log};
pub use options::{BuildOptions, Device, Logs, Spill, ValidityExtent, ValidityOptions};
pub use outcome::{Outcome, StepError};
pub use output::{Answer, Observer, Printer, Remark, Shown, Unobserved};
pub use plant_of_study::{data_of, plant_of};
pub use simulate::Simulated;
pub use steps::{
    build_model, check, evaluate, pretrain, represent, rollout, run, simulate, simulate_plant,
    sweep, validity,
};

/// The step patterns by which trajectories are compared: those of the paper's Table 1.
pub const STEP_PATTERNS: [&str; 4] = ["symmetric2", "asymmetric", "symmetricP1", "rabinerJuang:6c"];
