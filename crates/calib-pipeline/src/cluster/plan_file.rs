//! `plan.json`: the work of a plan and its division into shards.

use std::{
    collections::BTreeSet,
    path::{Path, PathBuf},
};

use calib_base::{Context as _, StepError, artefact::Files, bail, ensure};
use calib_files::{Fingerprint, fingerprint_file, read_sealed_json};
use calib_study::{Job, Request, Study};
use calib_sweep::{Candidate, EnvironmentId, PassId, Span};
use calib_sweep_steps::sweep::{environments::EnvironmentSpec, planned::PlannedSweep};
use serde::{Deserialize, Serialize};

use crate::cluster::{maker::Maker, results::ShardResults};

pub(crate) const PLAN: &str = "plan.json";
pub(crate) const INPUTS: &str = "inputs";

/// Version of a plan and its other files.
pub(crate) const FORMAT: u32 = 5;

#[derive(Debug, Serialize, Deserialize)]
pub(crate) struct PlanFile {
    pub(crate) format: u32,
    pub(crate) maker: Maker,
    pub(crate) asked: PlannedStudy,
    pub(crate) parts: Vec<PlannedPart>,
    pub(crate) shards: Vec<Shard>,
}

/// The study as it was at planning time.
#[derive(Debug, Serialize, Deserialize)]
pub(crate) struct PlannedStudy {
    pub(crate) study: PathBuf,
    pub(crate) text: String,
    pub(crate) set: Vec<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) profile: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) model: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) deployment: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) output: Option<PathBuf>,
}

impl PlannedStudy {
    pub(crate) fn of(job: &Job) -> Result<Self, StepError> {
        let request = job.request();
        Ok(Self {
            study: std::path::absolute(&request.study)?,
            text: job.text().to_owned(),
            set: request.set.clone(),
            profile: request.profile.clone(),
            model: request.model.clone(),
            deployment: request.deployment.clone(),
            output: request.output.as_ref().map(std::path::absolute).transpose()?,
        })
    }

    /// Returns the job of the study as it was at planning time, whatever its file says now.
    pub(crate) fn job(&self) -> Result<Job, StepError> {
        let request = Request {
            study: self.study.clone(),
            set: self.set.clone(),
            profile: self.profile.clone(),
            model: self.model.clone(),
            deployment: self.deployment.clone(),
            output: self.output.clone(),
            ..Request::default()
        };
        Ok(Job::of_text(request, self.text.clone())?)
    }
}

/// One model in one deployment.
#[derive(Debug, Serialize, Deserialize)]
pub(crate) struct PlannedPart {
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) model: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) deployment: Option<String>,
    /// The sweep that its shards make. `None` if nothing can be trained or nothing is left.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) sweep: Option<SweepPart>,
}

impl PlannedPart {
    /// Returns the name of the part, if there are several.
    pub(crate) fn name(&self) -> String {
        let names = [self.model.as_deref(), self.deployment.as_deref()];
        names.into_iter().flatten().collect::<Vec<_>>().join(" ")
    }
}

/// The sweep of one model in one deployment.
#[derive(Debug, Serialize, Deserialize)]
pub(crate) struct SweepPart {
    pub(crate) study: Study,
    pub(crate) candidates: Vec<Candidate>,
    /// The inputs that identify its runs.
    pub(crate) planned: PlannedSweep,
    /// Name and column of each sensor.
    pub(crate) sensors: Vec<(String, usize)>,
    /// Groups of sensors that share passes.
    pub(crate) groups: Vec<BTreeSet<String>>,
    /// Length of the longest streams.
    pub(crate) span: Span,
    /// The streams of each discount factor.
    pub(crate) streams: Vec<PartStreams>,
    /// Number of state columns.
    pub(crate) width: usize,
    /// Largest number of file bytes that one shard maps.
    pub(crate) mapped: u64,
    /// The input files of shards, by name in the part's input folder.
    pub(crate) files: Files,
}

/// The agents and environments of the sensors with one discount factor.
#[derive(Debug, Serialize, Deserialize)]
pub(crate) struct PartStreams {
    pub(crate) sensors: Vec<String>,
    /// The settings of the part, with this discount factor.
    pub(crate) candidates: Vec<Candidate>,
    pub(crate) span: Span,
    pub(crate) environments: Vec<EnvironmentSpec>,
}

/// The work of one process.
#[derive(Debug, Serialize, Deserialize)]
pub(crate) struct Shard {
    /// The stage. The shard can begin when all shards of earlier stages are complete.
    pub(crate) stage: usize,
    /// Predicted seconds on one thread.
    pub(crate) secs: f64,
    /// Predicted bytes of memory with one thread.
    pub(crate) memory: u64,
    pub(crate) passes: Vec<PlannedPass>,
}

impl Shard {
    /// Returns the number of units that it makes. In a race it is an upper bound.
    pub(crate) fn units(&self, plan: &PlanFile) -> usize {
        self.passes.iter().map(|pass| plan.sensors(pass).map_or(0, BTreeSet::len)).sum()
    }

    /// Returns the number of training runs that it makes: one for each setting of a unit. In a race it is an upper
    /// bound.
    pub(crate) fn training_runs(&self) -> usize {
        self.passes.iter().map(|pass| pass.training_runs).sum()
    }
}

/// A pass over the stream of a run.
#[derive(Debug, Serialize, Deserialize)]
pub(crate) struct PlannedPass {
    pub(crate) part: usize,
    pub(crate) environment: EnvironmentId,
    pub(crate) run: usize,
    pub(crate) group: usize,
    /// Number of training runs without a result. In a race it is an upper bound.
    pub(crate) training_runs: usize,
    /// Predicted seconds.
    pub(crate) secs: f64,
}

impl PlanFile {
    pub(crate) fn stages(&self) -> usize {
        self.shards.iter().map(|shard| shard.stage + 1).max().unwrap_or(0)
    }

    pub(crate) fn of_stage(&self, stage: usize) -> impl Iterator<Item = usize> + '_ {
        let all = self.shards.iter().enumerate();
        all.filter(move |(_, shard)| shard.stage == stage).map(|(number, _)| number)
    }

    pub(crate) fn pass(&self, planned: &PlannedPass) -> Result<PassId, StepError> {
        let PlannedPass { environment, run, .. } = *planned;
        Ok(PassId { environment, run, sensors: self.sensors(planned)?.clone() })
    }

    fn sensors(&self, planned: &PlannedPass) -> Result<&BTreeSet<String>, StepError> {
        let groups = &self.sweep(planned.part)?.groups;
        groups.get(planned.group).context("the plan names a group that it lacks")
    }

    /// Returns the sweep of a part.
    pub(crate) fn sweep(&self, part: usize) -> Result<&SweepPart, StepError> {
        let part = self.parts.get(part).and_then(|part| part.sweep.as_ref());
        part.context("the plan names a part that it lacks")
    }
}

/// Returns the folder of what shards write.
pub(crate) fn shards_in(directory: &Path) -> PathBuf {
    directory.join("shards")
}

pub(crate) fn is_plan(directory: &Path) -> bool {
    path_in(directory).is_file() && shards_in(directory).is_dir()
}

/// An opened plan and its folder.
pub(crate) struct OpenedPlan {
    pub(crate) directory: PathBuf,
    pub(crate) plan: PlanFile,
    /// Fingerprint of the plan, which its results must name.
    pub(crate) fingerprint: Fingerprint,
}

impl OpenedPlan {
    /// Opens the plan in `directory`.
    ///
    /// # Errors
    /// Returns an error if it is missing, damaged, or of another format.
    pub(crate) fn of(directory: &Path) -> Result<Self, StepError> {
        let path = path_in(directory);
        ensure!(
            path.exists(),
            "{} does not exist; `calib cluster plan STUDY -o {}` makes it",
            path.display(),
            directory.display()
        );
        let plan: PlanFile = read_sealed_json(&path).context("plan the work again")?;
        ensure!(
            plan.format == FORMAT,
            "{} has format {}, this calib reads format {FORMAT}; use the calib that planned it ({})",
            path.display(),
            plan.format,
            plan.maker.tool
        );
        let fingerprint = fingerprint_file(&path)?;
        Ok(Self { directory: directory.to_owned(), plan, fingerprint })
    }

    pub(crate) fn shard(&self, number: usize) -> Result<&Shard, StepError> {
        let count = self.plan.shards.len();
        self.plan.shards.get(number).with_context(|| match count {
            0 => "the plan has no shards: nothing is left to train; run `calib cluster merge`"
                .to_owned(),
            _ => format!("there is no shard {number}: the plan has shards 0 to {}", count - 1),
        })
    }

    pub(crate) fn results(&self, shard: usize) -> PathBuf {
        self.of_shard(shard, "units")
    }

    /// Returns the folder for the states of a shard's unfinished passes.
    pub(crate) fn states(&self, shard: usize) -> PathBuf {
        self.of_shard(shard, "state")
    }

    pub(crate) fn attempts(&self, shard: usize) -> PathBuf {
        self.of_shard(shard, "attempts")
    }

    fn of_shard(&self, shard: usize, ending: &str) -> PathBuf {
        shards_in(&self.directory).join(format!("{shard:04}.{ending}"))
    }

    pub(crate) fn inputs(&self, part: usize) -> PathBuf {
        inputs_in(&self.directory, part)
    }

    /// Reads and checks a shard's results: intact bytes, from this plan, shard and maker. `None` if there
    /// are no results yet.
    ///
    /// # Errors
    /// Returns an error that says what is wrong with them.
    pub(crate) fn read(&self, shard: usize) -> Result<Option<ShardResults>, StepError> {
        let path = self.results(shard);
        let results = match ShardResults::read(&path) {
            Err(error) if error.is_not_found() => return Ok(None),
            results => results?,
        };
        if let Some(difference) = self.plan.maker.difference(&results.header.maker) {
            bail!("{} was made by another calib: the plan is of {difference}", path.display());
        }
        let own = results.header.plan == self.fingerprint.as_str() && results.header.shard == shard;
        ensure!(own, "{} is of another plan or shard", path.display());
        Ok(Some(results))
    }
}

pub(crate) fn path_in(directory: &Path) -> PathBuf {
    directory.join(PLAN)
}

/// Returns the input folder of a part.
pub(crate) fn inputs_in(directory: &Path, part: usize) -> PathBuf {
    directory.join(INPUTS).join(part.to_string())
}
