//! The steps from a plant's log to a verdict, their inputs and results, and their order.
//!
//! A step takes a [`Job`], which is a study resolved once, and a [`Printer`], which reports progress to an
//! [`Observer`]. It makes the missing results and stores them in the folder of results. It does nothing if nothing is
//! missing, so an interrupted step resumes when it runs again. Results do not depend on the caller or on the number of
//! threads.
//!
//! ```no_run
//! use std::sync::Arc;
//!
//! use calib_pipeline::{Job, Printer, Request, Unobserved};
//!
//! let job = Job::resolve(Request::new("study.toml"))?;
//! calib_pipeline::run(&job, None, &Printer::new(Arc::new(Unobserved)))?;
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! [`run`] takes all steps in order: [`simulate`] (if the study describes its plant), [`pretrain`], [`represent`],
//! [`build_model`], [`rollout`], [`sweep`], [`evaluate`]. [`check`] compares stored results with their fingerprints.
//! [`control`] takes all steps for agents that act. [`validity`] judges how well calib chooses over several studies.

mod api;
mod changed_log;
mod check;
mod cluster;
mod control;
mod each;
mod inspect;
mod plan;
mod propose;
mod run_disk;
mod run_progress;
mod run_study;
mod schemas;
mod status;
mod validity;

pub use api::{
    build_model, check, cluster_merge, cluster_plan, cluster_run, cluster_status, cluster_submit,
    control, control_model, evaluate, evaluate_runs, pretrain, propose, propose_control, represent,
    rollout, run, simulate, simulate_plant, simulate_task, status, sweep, validity,
};
pub use calib_base::{
    Context, StepError, bail,
    clock::{Stopwatch, in_future},
    ensure,
    left_alone::text_left_alone,
    log::{
        plant_of_study::{data_of, plant_of},
        simulate::Simulated,
    },
    memory::{MemorySize, check_log, check_table, on_this_machine, require as require_memory},
    options::{
        ArrayOf, BuildOptions, ClusterPlanOptions, ClusterStatusOptions, ClusterSubmitOptions,
        Device, Engine, ExistingFile, Leftovers, Logs, ProposeOptions, ShardsToSubmit, Spill,
        Submission, ValidityExtent, ValidityOptions,
    },
    outcome::{Freshness, NoPlan, Outcome, StepResult, Told},
    output::{self, Announced, Observer, OutputFormat, Printer, Remark, Shown, Unobserved},
};
pub use calib_model_steps::{
    STEP_PATTERNS,
    model::{build_plan::BuildPlan, built_model::BuiltModel, calibration::Calibration},
    represent::Representations,
    rollouts::rollout::Rollouts,
};
pub use calib_propose::DecisionColumns;
pub use calib_study::{Job, Request, StepKind, StudyError};
pub use calib_sweep_steps::{
    agents::pretrain::PretrainedAgents,
    external::{ExternalCandidate, ExternalResult, StreamRun, SweepStreams},
    sweep::{SweepResult, Swept, plan::SweepPlan},
    verdict::{
        compare::{Compared, Summaries},
        described::{Descriptions, unknown as unknown_sensors},
        evaluate::Judgement,
        evaluation::Evaluation,
        judged::{SensorChoice, Summary},
    },
};
pub use check::{CheckedResults, Damage, UnreadableLog};
pub use cluster::{
    ClusterDryPlan, ClusterPlan, ClusterScript, ClusterScripts, ClusterShard, ClusterStatus,
    MergedSweeps, SubmittedPlan,
};
pub use control::{
    ActingAgent, Advice, ControlColumn, ControlEvaluation, ControlModel, ControlNames, ControlPlan,
    InspectedActions, PYTHON, Reason, SimulateTask, SimulatedTask, Vocabulary, unstored_networks,
};
pub use each::{PartResult, Results};
pub use inspect::{Inspection, inspect_deployments};
pub use propose::{ProposedControlStudy, ProposedStudy};
pub use run_study::StudyRun;
pub use schemas::{JsonDocuments, json_schemas};
pub use status::{ClusterStanding, StandingOf, StatusRequest, StudyStanding};
pub use validity::{JudgedStudies, SharedPlants, ValidityAnswer, ValidityPlan};
