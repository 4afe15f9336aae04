//! Submission of a plan to a system that runs it.

use std::{
    io::Write as _,
    path::{Path, PathBuf},
    process::Command,
};

use calib_base::{
    Context as _, StepError, bail, ensure,
    options::{ClusterSubmitOptions, Engine, ShardsToSubmit, Submission},
    outcome::StepResult,
};
use calib_files::{FolderRecord, write_atomically, write_json};
use calib_study::{StepKind, shell_words};

use crate::cluster::{
    config::ClusterConfig,
    engines::{
        RAY_DRIVER, TaskDemand, kubernetes,
        queue::{JOBS, SubmittedJobs},
        slurm,
    },
    plan_file::OpenedPlan,
    status::missing,
};

/// The result of a submission: in a dry run only scripts.
pub(crate) type SubmitResult = StepResult<SubmittedPlan, ClusterScripts>;

/// A submitted plan.
#[derive(Debug)]
pub enum SubmittedPlan {
    /// Jobs in the queue of Slurm.
    Slurm {
        /// The folder of the plan.
        directory: PathBuf,
        /// Number of submitted shards.
        shards: usize,
        /// Job numbers of the arrays, one per stage.
        arrays: Vec<String>,
        /// Job number of the merge.
        merge: String,
    },
    /// A finished driver for Ray.
    Ray {
        /// Whether every shard is done.
        is_done: bool,
    },
    /// Written manifests, which are not applied yet.
    Kubernetes {
        /// The manifests, in the order in which to apply them.
        manifests: Vec<PathBuf>,
    },
}

/// The scripts that a submission would use.
#[derive(Debug)]
pub struct ClusterScripts {
    /// The scripts that would be stored in the plan.
    pub scripts: Vec<ClusterScript>,
    /// The command that would then run, if calib runs a program itself.
    pub command: Option<String>,
}

/// A script that is stored in a plan.
#[derive(Debug)]
pub struct ClusterScript {
    /// Its file name in the plan's folder.
    pub name: String,
    /// Its content.
    pub text: String,
}

pub(crate) fn submit(
    directory: &Path,
    options: &ClusterSubmitOptions,
) -> Result<SubmitResult, StepError> {
    let opened = OpenedPlan::of(&std::path::absolute(directory)?)?;
    let config = ClusterConfig::read(options.config.as_deref())?;
    let submitter = Submitter { opened: &opened, config: &config, options };
    match options.engine {
        Engine::Slurm => submitter.slurm(),
        Engine::Ray => submitter.ray(),
        Engine::Kubernetes => submitter.kubernetes(),
    }
}

struct Submitter<'a> {
    opened: &'a OpenedPlan,
    config: &'a ClusterConfig,
    options: &'a ClusterSubmitOptions,
}

impl Submitter<'_> {
    fn is_dry(&self) -> bool {
        self.options.submission == Submission::Shown
    }

    /// Returns the shards to submit, by stage. Empty stages are left out.
    fn stages(&self) -> Vec<Vec<usize>> {
        let plan = &self.opened.plan;
        let missing = match self.options.shards {
            ShardsToSubmit::All => None,
            ShardsToSubmit::Missing => Some(missing(self.opened)),
        };
        let stages = (0..plan.stages()).map(|stage| {
            plan.of_stage(stage)
                .filter(|number| missing.as_ref().is_none_or(|shards| shards.contains(number)))
                .collect()
        });
        stages.filter(|shards: &Vec<usize>| !shards.is_empty()).collect()
    }

    fn place(&self) -> String {
        self.opened.directory.display().to_string()
    }

    fn slurm(&self) -> Result<SubmitResult, StepError> {
        let place = self.place();
        let stages = self.stages();
        // Slurm reads options up to the first blank, and has no quotes for them.
        ensure!(
            !place.contains(char::is_whitespace),
            "{place}: Slurm cannot write to a path with blanks; plan into another folder"
        );
        let mut scripts = Vec::new();
        for shards in &stages {
            let stage = self.opened.plan.shards[shards[0]].stage;
            let demand = TaskDemand::of(&self.opened.plan, shards, self.config);
            let text = slurm::array(&place, stage, shards, demand, self.config);
            scripts.push(ClusterScript { name: format!("slurm/stage-{stage}.sh"), text });
        }
        let all: Vec<usize> = (0..self.opened.plan.shards.len()).collect();
        let demand = TaskDemand::of(&self.opened.plan, &all, self.config);
        let evaluate = self.config.evaluate.then(|| self.evaluate()).transpose()?;
        let text = slurm::merge(&place, evaluate.as_deref(), demand, self.config);
        scripts.push(ClusterScript { name: "slurm/merge.sh".to_owned(), text });
        if self.is_dry() {
            return Ok(StepResult::Planned(ClusterScripts { scripts, command: None }));
        }
        let written = self.write(&scripts)?;
        let mut submitted = SubmittedJobs::default();
        let (merge, arrays) = written.split_last().context("there is a script that merges")?;
        for script in arrays {
            // A stage needs all results of the stage before. Without them it must not begin.
            let after = submitted.arrays.last().map(|job| format!("afterok:{job}"));
            submitted.arrays.push(sbatch(script, after.as_deref())?);
        }
        // The merge also runs after failures. It then reports them and writes nothing.
        let after = submitted.arrays.last().map(|job| format!("afterany:{job}"));
        submitted.merge = sbatch(merge, after.as_deref())?;
        write_json(&self.opened.directory.join(JOBS), &submitted)?;
        let SubmittedJobs { arrays, merge } = submitted;
        Ok(StepResult::Made(SubmittedPlan::Slurm {
            directory: self.opened.directory.clone(),
            shards: stages.iter().map(Vec::len).sum(),
            arrays,
            merge,
        }))
    }

    /// Returns the command that judges the merged sweep.
    fn evaluate(&self) -> Result<String, StepError> {
        let command = self.opened.plan.asked.job()?.command(StepKind::Evaluate);
        let rest = command.strip_prefix("calib").unwrap_or(&command).to_owned();
        Ok(format!("{}{rest}", self.config.calib))
    }

    fn ray(&self) -> Result<SubmitResult, StepError> {
        let text = RAY_DRIVER.to_owned();
        let script = ClusterScript { name: "ray/calib_ray.py".to_owned(), text };
        let path = self.path(&script).display().to_string();
        let mut words = vec!["python3".to_owned(), path, self.place()];
        words.extend(["--calib".to_owned(), self.config.calib.clone()]);
        words.extend(["--threads".to_owned(), self.config.threads.to_string()]);
        if self.is_dry() {
            let scripts = vec![script];
            let command = Some(shell_words(&words));
            return Ok(StepResult::Planned(ClusterScripts { scripts, command }));
        }
        self.write(&[script])?;
        let status = Command::new("python3")
            .args(&words[1..])
            .status()
            .context("cannot run python3, which the driver for Ray is a program of")?;
        let is_done = match status.code() {
            Some(0) => true,
            Some(4) => false,
            code => bail!("the driver for Ray ended with {code:?}; it needs `pip install ray`"),
        };
        Ok(StepResult::Made(SubmittedPlan::Ray { is_done }))
    }

    fn kubernetes(&self) -> Result<SubmitResult, StepError> {
        let plan = &self.opened.plan;
        let mut scripts = Vec::new();
        for stage in 0..plan.stages() {
            let shards: Vec<usize> = plan.of_stage(stage).collect();
            let demand = TaskDemand::of(plan, &shards, self.config);
            let text = kubernetes::job(stage, shards.len(), shards[0], demand, self.config);
            scripts.push(ClusterScript { name: format!("kubernetes/stage-{stage}.yaml"), text });
        }
        if self.is_dry() {
            return Ok(StepResult::Planned(ClusterScripts { scripts, command: None }));
        }
        let manifests = self.write(&scripts)?;
        Ok(StepResult::Made(SubmittedPlan::Kubernetes { manifests }))
    }

    fn path(&self, script: &ClusterScript) -> PathBuf {
        self.opened.directory.join(&script.name)
    }

    /// Stores the scripts in the plan.
    fn write(&self, scripts: &[ClusterScript]) -> Result<Vec<PathBuf>, StepError> {
        let names = scripts.iter().map(|script| script.name.clone());
        let jobs = (self.options.engine == Engine::Slurm).then(|| JOBS.to_owned());
        FolderRecord::open(&self.opened.directory)?.note(names.chain(jobs))?;
        let mut written = Vec::new();
        for script in scripts {
            let path = self.path(script);
            write_atomically(&path, |file| file.write_all(script.text.as_bytes()))?;
            written.push(path);
        }
        Ok(written)
    }
}

/// Submits a script, and returns the number of its job.
fn sbatch(script: &Path, after: Option<&str>) -> Result<String, StepError> {
    let mut command = Command::new("sbatch");
    command.arg("--parsable");
    if let Some(after) = after {
        command.args(["--kill-on-invalid-dep=yes", &format!("--dependency={after}")]);
    }
    let output =
        command.arg(script).output().context("cannot run sbatch; is this a Slurm cluster?")?;
    ensure!(
        output.status.success(),
        "sbatch {} was refused: {}",
        script.display(),
        String::from_utf8_lossy(&output.stderr).trim()
    );
    let told = String::from_utf8_lossy(&output.stdout);
    // The job number comes first, followed by the cluster's name if there are several.
    Ok(told.trim().split(';').next().unwrap_or_default().to_owned())
}
