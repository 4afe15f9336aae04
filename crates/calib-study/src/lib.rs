//! A study is one TOML file that says what to compute. It is resolved once and checked before anything runs.
//!
//! - [`Study`]: every section of the file, in the type of the package that uses it.
//! - [`Job`]: a study with a chosen profile, model and deployment, its overrides, the paths of its results ([`Layout`]),
//!   and the rules for existing results ([`Policy`]). [`Job::resolve`] reads the file **once**: a later edit affects the
//!   next command, not this one.
//! - [`Job::parts`]: one job per model and deployment. [`Job::command`]: the command that continues this job.
//! - [`StudyError`]: what is wrong, where it stands, what was expected, and the nearest key.
//! - [`schema`]: every key with its type, default and meaning, for editors.
//! - [`Study::inputs`]: the keys that affect a result. They tell in which keys a stored result differs from the study.
//! - [`Protocol`]: the plants and tasks of several studies, drawn from one seed.
//!
//! ```
//! use calib_study::{Job, Request, StepKind};
//!
//! let text = "[sweep]\nsensors = [\"PIT300\"]\nsteps = 6000\n";
//! let mut request = Request::new("plant.toml");
//! request.set.push("agent.gamma=0.9".to_owned());
//! let job = Job::of_text(request, text.to_owned())?;
//! assert_eq!(job.study().sweep.steps, 6000);
//! assert_eq!(job.layout().sweep(), std::path::Path::new("plant-results/sweep"));
//! assert_eq!(job.command(StepKind::Sweep), "calib sweep plant.toml --set 'agent.gamma=0.9'");
//!
//! let error = Job::of_text(Request::new("plant.toml"), text.replace("steps", "step")).expect_err("no such key");
//! assert!(error.to_string().starts_with("plant.toml:3:1: unknown key `step`; did you mean `steps`?"));
//! # Ok::<(), calib_study::StudyError>(())
//! ```

mod check;
mod data_path;
mod deployments;
mod error;
mod hint;
mod inputs;
mod job;
mod layout;
mod message;
mod model_section;
mod models;
mod overlay;
mod overrides;
mod partition;
mod parts;
mod pretrain;
mod profiles;
mod protocol;
mod request;
mod schema;
mod share;
mod shell;
mod simulate;
mod source;
mod step;
mod study;
mod toml_json;
mod typed;
mod without_model;
mod written;

pub use data_path::with_variables;
pub use error::StudyError;
pub use inputs::{Difference, Inputs};
pub use job::Job;
pub use layout::{Layout, Rollouts};
pub use message::{meant_key, option_error, setting_error};
pub use model_section::ModelSection;
pub use overrides::of_data;
pub use partition::Partition;
pub use pretrain::{MomentsRule, PretrainConfig};
pub use protocol::{DrawnStudy, Protocol};
pub use request::{Existing, Policy, Request, Writes};
pub use schema::schema;
pub use share::Share;
pub use shell::shell_words;
pub use simulate::SimulateConfig;
pub use source::Place;
pub use step::{Scope, StepKind};
pub use study::{EvaluateConfig, Study};
pub use written::study_files;
