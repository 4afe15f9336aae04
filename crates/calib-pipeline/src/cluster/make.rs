//! Planning: divides the remaining work of a study's sweeps into shards, and writes their inputs.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::{Path, PathBuf},
};

use calib_agent::training_bytes;
use calib_base::{
    StepError,
    artefact::{DirectoryLock, Files},
    bail, ensure,
    log::context::RunContext,
    options::ClusterPlanOptions,
    outcome::StepResult,
};
use calib_files::{
    FileError, FolderRecord, create_directory, is_temporary, remove_known, write_new_sealed_json,
};
use calib_study::{Job, Scope, StepKind};
use calib_sweep::{Baselines, EnvironmentId, PassId, Plan, StoredUnits, UnitRuns};
use calib_sweep_steps::sweep::{
    KnownUnits, ResultSource, candidates::require_predicting, cost::MeasuredPasses,
    groups::StudyGroup, memory::agents_of, planned::PlannedSweep, setting::SweepContext,
    unit_store,
};

use crate::cluster::{
    divide::{Division, evenly},
    inputs,
    maker::Maker,
    plan_file::{
        FORMAT, INPUTS, PLAN, PartStreams, PlanFile, PlannedPart, PlannedPass, PlannedStudy, Shard,
        SweepPart, inputs_in, path_in, shards_in,
    },
    results::Header,
    status::{Summary, summary},
};

/// Memory of an idle process.
const BASE_BYTES: u64 = 150 << 20;

/// A written plan: the remaining work of a study's sweeps, in shards.
#[derive(Debug)]
pub struct ClusterPlan {
    pub(crate) directory: PathBuf,
    pub(crate) summary: Summary,
}

/// A plan that a dry run would write.
#[derive(Debug)]
pub struct ClusterDryPlan(pub(crate) ClusterPlan);

impl ClusterPlan {
    /// Returns the folder of the plan.
    pub fn directory(&self) -> &Path {
        &self.directory
    }

    /// Returns the number of shards.
    pub fn shards(&self) -> usize {
        self.summary.shards
    }

    /// Returns the predicted time of all shards on one thread, in seconds.
    pub fn secs(&self) -> f64 {
        self.summary.secs
    }
}

impl ClusterDryPlan {
    /// Returns the plan.
    pub fn plan(&self) -> &ClusterPlan {
        &self.0
    }
}

pub(crate) fn plan(
    job: &Job,
    options: &ClusterPlanOptions,
    context: &RunContext,
) -> Result<StepResult<ClusterPlan, ClusterDryPlan>, StepError> {
    require_predicting(job.study())?;
    ensure!(
        !job.study().agent.is_external(),
        "agent.kind = \"external\": a plan does not carry the program to other machines; run `{}` where it is",
        job.command(StepKind::Sweep)
    );
    let directory = &options.directory;
    let path = path_in(directory);
    ensure!(!path.exists(), is_planned(directory));
    let mut claim = None;
    if job.policy().is_dry() {
        FolderRecord::check(directory, || false)?;
    } else {
        claim = Some(DirectoryLock::new_named(directory)?);
    }
    // Another process may have planned in the meantime.
    ensure!(!path.exists(), is_planned(directory));
    let maker = Maker::here()?;
    let division = Division {
        secs: 60.0 * options.task_minutes,
        most: options.max_tasks,
        exactly: options.shards,
    };
    let mut record = claim.as_mut().map(DirectoryLock::record);
    if let Some(record) = &mut record {
        // Inputs that a killed process left belong to no plan.
        remove_inputs(directory, record)?;
        record.note([PLAN])?;
    }
    let mut planning = Planning {
        directory,
        record,
        maker: &maker,
        division,
        measured: MeasuredPasses::default(),
        seen: BTreeSet::new(),
    };
    let mut parts = Vec::new();
    let mut work = Vec::new();
    for part in job.parts(Scope::Deployment)? {
        let mut planned = PlannedPart {
            model: part.model().map(str::to_owned),
            deployment: part.deployment().map(str::to_owned),
            sweep: None,
        };
        if let Some((sweep, passes)) = planning.part(parts.len(), &part, context)? {
            planned.sweep = Some(sweep);
            work.extend(passes);
        }
        parts.push(planned);
    }
    let shards = planning.shards(&parts, work);
    let plan = PlanFile { format: FORMAT, maker, asked: PlannedStudy::of(job)?, parts, shards };
    let planned = ClusterPlan { directory: directory.clone(), summary: summary(&plan) };
    if job.policy().is_dry() {
        return Ok(StepResult::Planned(ClusterDryPlan(planned)));
    }
    create_directory(&shards_in(directory))?;
    match write_new_sealed_json(&path, &plan) {
        // Reached on file systems without locks.
        Err(FileError::Occupied { .. }) => bail!(is_planned(directory)),
        written => written?,
    }
    Ok(StepResult::Made(planned))
}

/// Returns the message for a folder that already holds a plan.
fn is_planned(directory: &Path) -> String {
    let place = directory.display();
    format!(
        "{place} is a plan already; go on with `calib cluster status {place}`, or plan into another folder"
    )
}

/// Removes the inputs of an unfinished plan. Other files stay.
fn remove_inputs(directory: &Path, record: &FolderRecord) -> Result<(), FileError> {
    remove_known(&directory.join(INPUTS), &mut |path: &Path| {
        let name = Path::new(INPUTS).join(path);
        is_temporary(path) || name.to_str().is_some_and(|name| record.names().contains(name))
    })
}

struct Planning<'a> {
    directory: &'a Path,
    /// The record of written files. `None` in a dry run.
    record: Option<&'a mut FolderRecord>,
    maker: &'a Maker,
    division: Division,
    measured: MeasuredPasses,
    /// Keys of units that earlier parts make. Equal units are made only once.
    seen: BTreeSet<String>,
}

/// A pass and its stage.
struct StagedPass {
    stage: usize,
    pass: PlannedPass,
}

impl Planning<'_> {
    /// Returns the remaining work of one part. `None` if nothing is left, or nothing can be trained.
    fn part(
        &mut self,
        number: usize,
        job: &Job,
        context: &RunContext,
    ) -> Result<Option<(SweepPart, Vec<StagedPass>)>, StepError> {
        let study = job.study();
        let setting = match SweepContext::of(job, context)? {
            Ok(setting) => setting,
            Err(skipped) => {
                let name = job.deployment().unwrap_or_default();
                context.warn(&format!("deployment {name} is left out: {}", skipped.reason));
                return Ok(None);
            }
        };
        let environments = setting.open(study)?;
        let baselines = Baselines::new(&setting.dataset.train);
        let plan = setting.plan(study, &environments, &baselines, None);
        let store = unit_store(&job.layout().sweep(), None);
        let KnownUnits { stored, .. } = KnownUnits::of(&plan, &store, job, ResultSource::default());
        if plan.left(&stored) == 0 {
            return Ok(None);
        }
        context.say("timing some steps of a pass");
        let cost = setting.cost(study, &self.measured, &context.silent().progress())?;
        let mut groups: Vec<BTreeSet<String>> = Vec::new();
        let mut work = Vec::new();
        for (StudyGroup { sensors, .. }, environments) in setting.groups.iter().zip(&environments) {
            let runs: Vec<(EnvironmentId, usize)> = environments
                .iter()
                .flat_map(|place| (0..place.runs()).map(move |run| (place.id(), run)))
                .collect();
            let secs = cost.of(sensors.len()) * runs.len() as f64;
            let count = self.division.groups(runs.len(), sensors.len(), secs);
            let first = groups.len();
            groups.extend(
                evenly(sensors.len(), count)
                    .map(|range| sensors[range].iter().cloned().collect::<BTreeSet<String>>()),
            );
            for (environment, run) in runs {
                for (group, sensors) in groups.iter().enumerate().skip(first) {
                    let pass = PassId { environment, run, sensors: sensors.clone() };
                    if self.is_needed(&plan, &pass, &stored) {
                        let stage = plan.stage(&pass);
                        let secs = cost.of(sensors.len());
                        let training_runs = training_runs(&plan, &pass, &stored);
                        let part = number;
                        let pass =
                            PlannedPass { part, environment, run, group, training_runs, secs };
                        work.push(StagedPass { stage, pass });
                    }
                }
            }
        }
        let whole = stored.whole().values().map(|result| plan.runs_of(result));
        let runs: Vec<UnitRuns> = whole.chain(stored.begun().values().cloned()).collect();
        let (files, mapped) = self.inputs(number, job, &setting, &runs)?;
        let width = setting.dataset.train.states().columns();
        let part = SweepPart {
            study: study.clone(),
            candidates: setting.candidates.clone(),
            planned: PlannedSweep::of(study, &setting.candidates, &plan, None),
            sensors: setting.sensors.clone(),
            groups,
            span: setting.span(),
            streams: part_streams(&setting),
            width,
            mapped,
            files,
        };
        Ok(Some((part, work)))
    }

    /// Writes the inputs of a part's shards. Returns the files, and how many of their bytes a shard maps.
    fn inputs(
        &mut self,
        number: usize,
        job: &Job,
        setting: &SweepContext,
        stored: &[UnitRuns],
    ) -> Result<(Files, u64), StepError> {
        let place = inputs_in(self.directory, number);
        // Every discount factor has the same members.
        let described = &setting.environments.described[0];
        let Some(record) = self.record.as_deref_mut() else {
            let files = inputs::of_model(setting);
            let mapped = inputs::mapped_bytes(&job.layout().model(), &files, described);
            return Ok((files, mapped + inputs::log_bytes(setting)));
        };
        let header = Header::new(String::new(), number, self.maker);
        let own = inputs::names(setting, stored);
        record.note(own.into_iter().map(|name| format!("{INPUTS}/{number}/{name}")))?;
        let files = inputs::write(&place, job, setting, stored, header)?;
        let mapped = inputs::mapped_bytes(&place, &files, described);
        Ok((files, mapped))
    }

    /// Whether a unit of a pass has no result and no earlier part makes it. The settings of later race stages are not
    /// known yet.
    fn is_needed(&mut self, plan: &Plan<'_>, pass: &PassId, stored: &StoredUnits) -> bool {
        if plan.stage(pass) > 0 {
            return pass.units().any(|unit| !stored.whole().contains_key(&unit));
        }
        let ready = plan.ready(std::slice::from_ref(pass), &BTreeMap::new());
        let mut is_needed = false;
        for planned in ready.iter().flat_map(calib_sweep::ReadyPass::units) {
            is_needed |= !stored.whole().contains_key(&planned.unit)
                && self.seen.insert(planned.fingerprint(plan.settings()));
        }
        is_needed
    }

    /// Returns the shards of all stages. In each stage the longest comes first.
    fn shards(&self, parts: &[PlannedPart], work: Vec<StagedPass>) -> Vec<Shard> {
        let total: f64 = work.iter().map(|work| work.pass.secs).sum();
        let mut stages: BTreeMap<usize, Vec<PlannedPass>> = BTreeMap::new();
        for StagedPass { stage, pass } in work {
            stages.entry(stage).or_default().push(pass);
        }
        let mut shards = Vec::new();
        // Stages are renumbered without gaps, because a stage may have nothing left.
        for (stage, mut passes) in stages.into_values().enumerate() {
            // Puts passes that read the same files next to each other.
            passes.sort_by_key(|pass| (pass.part, pass.environment, pass.run, pass.group));
            let secs: Vec<f64> = passes.iter().map(|pass| pass.secs).collect();
            let mut own = Vec::new();
            let mut passes = passes.into_iter();
            for range in self.division.cut(&secs, total) {
                let passes: Vec<PlannedPass> = passes.by_ref().take(range.len()).collect();
                let secs = passes.iter().map(|pass| pass.secs).sum();
                let memory = memory(parts, &passes);
                own.push(Shard { stage, secs, memory, passes });
            }
            own.sort_by(|a, b| b.secs.total_cmp(&a.secs));
            shards.extend(own);
        }
        shards
    }
}

/// Returns the number of training runs of a pass that have no result: one for each setting of a unit. In a race it is
/// an upper bound.
fn training_runs(plan: &Plan<'_>, pass: &PassId, stored: &StoredUnits) -> usize {
    let settings = plan.settings().len();
    pass.units()
        .filter(|unit| !stored.whole().contains_key(unit))
        .map(|unit| {
            let made = stored.begun().get(&unit).map_or(0, |begun| begun.runs.len());
            settings.saturating_sub(made)
        })
        .sum()
}

/// Returns the streams of each discount factor, on which its sensors are trained.
fn part_streams(setting: &SweepContext) -> Vec<PartStreams> {
    let groups = setting.groups.iter().zip(&setting.environments.described);
    let streams = groups.map(|(group, environments)| PartStreams {
        sensors: group.sensors.clone(),
        candidates: group.candidates.clone(),
        span: group.streams.demand.span,
        environments: environments.clone(),
    });
    streams.collect()
}

/// Returns the predicted memory of a shard on one thread, in bytes.
fn memory(parts: &[PlannedPart], passes: &[PlannedPass]) -> u64 {
    let sweep = |part: usize| parts.get(part)?.sweep.as_ref();
    let groups: BTreeSet<(usize, usize)> =
        passes.iter().map(|pass| (pass.part, pass.group)).collect();
    let training = groups
        .iter()
        .filter_map(|&(part, group)| {
            let part = sweep(part)?;
            let agents = agents_of(&part.candidates);
            let states = part.span.states();
            let sensors = part.groups[group].len();
            Some(4 * states as u64 + training_bytes(&agents, sensors, part.width, states))
        })
        .max()
        .unwrap_or(0);
    // Files are mapped. All files of a part count, because any of them may be read.
    let mapped = groups.iter().filter_map(|&(part, _)| Some(sweep(part)?.mapped)).max();
    let results: u64 = passes
        .iter()
        .filter_map(|pass| {
            let part = sweep(pass.part)?;
            let units = part.groups[pass.group].len() * part.candidates.len();
            Some(units as u64 * (200 + 80 * part.study.sweep.curve_points as u64))
        })
        .sum();
    BASE_BYTES + training + 2 * results + mapped.unwrap_or(0)
}
