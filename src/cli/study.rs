//! Arguments of the commands on a study.

use std::path::{Path, PathBuf};

use calib_pipeline::{ValidityExtent, ValidityOptions};
use calib_study::{Existing, Job, Policy, Request, Study, StudyError, Writes};
use clap::Args;

use super::heading::OUTPUT;

/// Heading of the options that choose a study.
const STUDY: &str = "Which study";
const RESULTS: &str = "Results";

/// What every command on a study takes.
#[derive(Clone, Debug, Args)]
pub(crate) struct StudyArgs {
    /// The study file (TOML)
    pub(crate) study: PathBuf,
    /// Override a key of the study; may be given several times
    #[arg(long = "set", value_name = "SECTION.KEY=VALUE", help_heading = STUDY)]
    pub(crate) set: Vec<String>,
    /// Use this profile from the study's [profiles]
    #[arg(long, value_name = "NAME", help_heading = STUDY)]
    pub(crate) profile: Option<String>,
    /// Only this one of the study's [models] (default: one after the other)
    #[arg(long, value_name = "NAME", help_heading = STUDY)]
    pub(crate) model: Option<String>,
    /// Only this one of the study's [deployments] (default: one after the other)
    #[arg(long, value_name = "NAME", help_heading = STUDY)]
    pub(crate) deployment: Option<String>,
    /// Where results go (default: beside the study file)
    #[arg(long, value_name = "DIR", help_heading = RESULTS)]
    pub(crate) output: Option<PathBuf>,
    /// Redo everything, also steps that are up to date
    #[arg(long, help_heading = RESULTS)]
    pub(crate) force: bool,
    /// Print what calib would do, and stop
    #[arg(long, help_heading = RESULTS)]
    pub(crate) dry_run: bool,
    /// Print the result as JSON
    #[arg(long, help_heading = OUTPUT)]
    pub(crate) json: bool,
}

impl StudyArgs {
    /// Reads and resolves the study. The command never reads the file again.
    ///
    /// # Errors
    /// As for [`Job::resolve`].
    pub(crate) fn job(self) -> Result<Job, StudyError> {
        let Self { study, set, profile, model, deployment, output, force, dry_run, json: _ } = self;
        let existing = if force { Existing::Redo } else { Existing::Keep };
        let writes = if dry_run { Writes::Nothing } else { Writes::Missing };
        let policy = Policy { existing, writes, ..Policy::default() };
        Job::resolve(Request { study, set, profile, model, deployment, output, policy })
    }
}

/// Stands for a missing study file.
pub(super) const NO_STUDY: &str = "-";

#[derive(Debug, Args)]
pub(crate) struct ControlArgs {
    #[command(flatten)]
    pub(crate) study: StudyArgs,
    /// Make only this share of the runs, where others make the rest, such as 0/8 or auto/8; then run it without
    #[arg(long, value_name = "I/N")]
    pub(crate) share: Option<String>,
    /// Print all reasons of the verdict, as in the report
    #[arg(long)]
    pub(crate) why: bool,
}

#[derive(Debug, Args)]
pub(crate) struct EvaluateArgs {
    #[command(flatten)]
    pub(crate) study: StudyArgs,
    /// Judge the runs of this table (Parquet) instead of a sweep; a study then only says how to judge
    #[arg(long, value_name = "FILE")]
    pub(crate) runs: Option<PathBuf>,
    /// Print all reasons of a verdict, as in the report
    #[arg(long)]
    pub(crate) why: bool,
}

impl EvaluateArgs {
    /// Returns the study that judges the runs of a table, and the output folder. Without a study it has the defaults and `--set`.
    ///
    /// # Errors
    /// As for [`Job::resolve`].
    pub(crate) fn judging(study: StudyArgs) -> Result<(Study, Option<PathBuf>), StudyError> {
        let output = study.output.clone();
        if study.study == Path::new(NO_STUDY) {
            return Ok((calib_study::of_data(Path::new(NO_STUDY), &study.set)?, output));
        }
        Ok((study.job()?.study().clone(), output))
    }
}

#[derive(Debug, Args)]
pub(crate) struct ValidityArgs {
    /// A protocol, which draws plants and tasks; or study files, each of one plant, or folders of them
    #[arg(required = true, value_name = "PROTOCOL|STUDY|FOLDER")]
    pub(crate) studies: Vec<PathBuf>,
    /// Override a key of all studies; may be given several times
    #[arg(long = "set", value_name = "SECTION.KEY=VALUE")]
    pub(crate) set: Vec<String>,
    /// Draw plants and tasks from this seed instead of the protocol's, in a folder of their own
    #[arg(long, value_name = "N")]
    pub(crate) draw: Option<u64>,
    /// The folder for the judgement, and for what a protocol draws (default: validity-results beside the protocol or the first study)
    #[arg(long, value_name = "DIR")]
    pub(crate) output: Option<PathBuf>,
    /// Judge the sweeps that exist, and run nothing
    #[arg(long)]
    pub(crate) judge_only: bool,
    /// Run only this share of the plants, where others run the rest, such as 0/8 or auto/8; then run it without
    #[arg(long, value_name = "I/N", conflicts_with_all = ["judge_only", "dry_run", "json"])]
    pub(crate) share: Option<String>,
    /// List the plants and what is left to run, and stop
    #[arg(long)]
    pub(crate) dry_run: bool,
    /// Print the judgement as JSON
    #[arg(long, help_heading = OUTPUT)]
    pub(crate) json: bool,
}

impl From<ValidityArgs> for ValidityOptions {
    fn from(args: ValidityArgs) -> Self {
        let ValidityArgs { studies, set, draw, output, .. } = args;
        let extent = match (args.dry_run, args.judge_only) {
            (true, _) => ValidityExtent::Plan,
            (false, true) => ValidityExtent::Judge,
            (false, false) => ValidityExtent::Run,
        };
        Self { studies, set, draw, output, extent, share: None }
    }
}

/// What `check` takes.
#[derive(Clone, Debug, Args)]
pub(crate) struct CheckArgs {
    /// A folder of results, such as study-results, or the study file that is beside it
    #[arg(value_name = "DIR|STUDY")]
    pub(crate) results: PathBuf,
    /// Also read the logs that the results were made from
    #[arg(long)]
    pub(crate) read_data: bool,
    /// Print the result as JSON
    #[arg(long, help_heading = OUTPUT)]
    pub(crate) json: bool,
}
