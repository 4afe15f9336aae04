use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
    time::Duration,
};

use calib_agent::{Accelerator, check_accelerated};
use calib_base::{
    StepError,
    artefact::{self, Artefact, DirectoryLock},
    clock::Stopwatch,
    log::{
        context::RunContext,
        profile_file::{self, PROFILE},
    },
    options::Device,
    outcome::{Outcome, StepResult},
    output::Printer,
    torch,
};
use calib_data::Dataset;
use calib_files::{read_json, write_json};
use calib_model_steps::model::model_files;
use calib_study::{Job, Layout, StepKind, Study};
use calib_sweep::{
    Baselines, Candidate, CompletedSweep, Plan, Span, StoredUnits, Unit, UnitResult, UnitRuns,
    UnitStore,
};
use serde::{Deserialize, Serialize};

use crate::sweep::{
    candidates::candidates_of,
    constant_sensors::ConstantSensor,
    expected::{Expected, require_room},
    manifest::{OtherStreams, SweepFacts, SweepManifest},
    memory::{Memory, Sizes, agents_of},
    notes::{failed_rollouts, saved},
    plan::{DryRunTally, SweepPlan},
    planned::PlannedSweep,
    recorded,
    setting::{SkippedDeployment, SweepContext},
    simple,
    streams::{OnlineWindow, Streams, error_scales, online_windows},
    tables as sweep_tables,
    unit_store::unit_store,
};

/// The result of a sweep.
pub type SweepResult = StepResult<Swept, SweepPlan>;

/// A finished sweep.
#[derive(Debug)]
pub struct Swept {
    pub(crate) manifest: SweepManifest,
    pub(crate) directory: PathBuf,
    /// Number of units that lacked a run.
    pub(crate) ran: usize,
    /// Number of new runs.
    pub(crate) ran_runs: usize,
    /// Whether the tables were written, because they were not whole.
    pub(crate) rewrote: bool,
    pub(crate) took: Duration,
}

impl Swept {
    /// Returns every setting that agents were trained with, in the order of the results.
    pub fn candidates(&self) -> &[Candidate] {
        &self.manifest.candidates
    }

    /// Returns the number of units (sensor, environment, run).
    pub fn units(&self) -> usize {
        self.manifest.units.len()
    }

    /// Returns the number of units that lacked a run. The others were complete.
    pub fn ran(&self) -> usize {
        self.ran
    }

    /// Returns the number of new runs, counting one per setting of a unit.
    pub fn ran_runs(&self) -> usize {
        self.ran_runs
    }

    /// Returns notes for the reader of the results.
    pub fn notes(&self) -> &[String] {
        &self.manifest.notes
    }

    /// Returns the folder of the results.
    pub fn directory(&self) -> &Path {
        &self.directory
    }
}

/// Runs of units that other processes made, by unit and key.
pub type SharedRuns = BTreeMap<(Unit, String), UnitRuns>;

/// Trains every setting in every environment, on a device if one is given. A dry run reports units that the `tally` has
/// already counted.
///
/// # Errors
/// Returns an error if the study, the model or the log is wrong, training fails, or the observer asks to stop.
pub fn run(
    job: &Job,
    tally: &DryRunTally,
    device: Option<Device>,
    context: &RunContext,
) -> Result<SweepResult, StepError> {
    let accelerator = on_device(device, job.study())?;
    sweep(job, tally, ResultSource { pool: None, accelerator: accelerator.as_deref() }, context)
}

/// Returns the accelerator for a study's agents, if a device is given. Called before anything is read or made.
///
/// # Errors
/// Returns an error if this build has no libtorch, the device is not available, or the agents cannot be trained side by
/// side.
pub fn on_device(
    device: Option<Device>,
    study: &Study,
) -> Result<Option<Box<dyn Accelerator>>, StepError> {
    let Some(device) = device else { return Ok(None) };
    for candidate in candidates_of(study)? {
        check_accelerated(&candidate.agent)?;
    }
    Ok(Some(torch::accelerator(device)?))
}

/// Writes results that other processes made. Nothing may be left to train.
///
/// # Errors
/// Returns [`SweepError::Incomplete`](calib_sweep::SweepError::Incomplete) before anything is written, if a run is
/// missing.
pub fn put_together(
    job: &Job,
    pool: &SharedRuns,
    context: &RunContext,
) -> Result<SweepResult, StepError> {
    sweep(
        job,
        &DryRunTally::default(),
        ResultSource { pool: Some(pool), accelerator: None },
        context,
    )
}

/// The source of results other than this program's own arithmetic.
#[derive(Clone, Copy, Default)]
pub struct ResultSource<'a> {
    /// Runs of other processes.
    pool: Option<&'a SharedRuns>,
    /// The accelerator that trains agents.
    accelerator: Option<&'a dyn Accelerator>,
}

fn sweep(
    job: &Job,
    tally: &DryRunTally,
    ResultSource { pool, accelerator }: ResultSource<'_>,
    context: &RunContext,
) -> Result<SweepResult, StepError> {
    let clock = Stopwatch::start();
    let (study, directory) = (job.study(), job.layout().sweep());
    let setting = match SweepContext::of(job, context)? {
        Ok(setting) => setting,
        Err(skipped) => return leave_out(job, skipped, context),
    };
    let span = setting.span();
    let environments = setting.open(study)?;
    let baselines = Baselines::new(&setting.dataset.train);
    let plan = setting.plan(study, &environments, &baselines, accelerator);
    let arithmetic = accelerator.map(Accelerator::class);
    let store = unit_store(&directory, arithmetic);
    let KnownUnits { own, stored } =
        KnownUnits::of(&plan, &store, job, ResultSource { pool, accelerator });
    let missing = plan.left(&stored);
    if pool.is_some() && missing > 0 {
        plan.collected(&stored)?;
    }
    let passes = plan.passes(&stored);
    let sizes = Sizes::of(study, &setting.dataset, span, [plan.count(), passes]);
    let shared = if job.policy().is_dry() { shared_units(&plan, &stored, tally) } else { 0 };
    let left = RemainingRuns { units: missing, runs: plan.runs_left(&stored), shared };
    let mut preview = preview(&setting.candidates, &sizes, plan.count(), left, span);
    if let Some(accelerator) = accelerator {
        preview.memory = preview.memory.side_by_side(&sizes, accelerator);
    }
    // The time of a program, or of another arithmetic, is not known.
    let is_own = setting.program.is_none() && accelerator.is_none();
    let is_timed = is_own && missing > shared && preview.memory.fits();
    if job.policy().is_dry() && is_timed {
        preview.expected = Some(expected(job, &setting, &preview, passes, tally, context)?);
    }
    preview.announce(study, context)?;
    if job.policy().is_dry() {
        context.say(&format!("dry run: nothing written to {}", directory.display()));
        return Ok(StepResult::Planned(preview));
    }
    require_room(job, left.runs, &directory)?;
    // Nothing is discarded, and the disk need not be writable, until there is something to write.
    let is_done = missing == 0 && stored.whole().keys().all(|unit| own.whole().contains_key(unit));
    let kept = if is_done { finished(&directory, job) } else { None };
    let planned = PlannedSweep::of(study, &setting.candidates, &plan, arithmetic).begun_for(study);
    let claim = kept.is_none().then(|| begun(&directory, &planned)).transpose()?;
    if job.policy().redoes() {
        store.clear()?;
    }
    put_shared(&plan, &own, &stored, &store)?;
    let CompletedSweep { results, ran, runs: ran_runs } =
        plan.complete(stored, &store, &context.progress())?;
    let mut manifest = Artefact::new(facts(study, &setting, &plan, &results, context)?);
    if let Some(class) = arithmetic {
        note_arithmetic(&mut manifest, class);
    }
    manifest.files = kept.as_ref().map(|kept| kept.files.clone()).unwrap_or_default();
    let rewrote = kept.is_none();
    let is_the_same = match kept {
        Some(kept) => serde_json::to_value(&kept)? == serde_json::to_value(&manifest)?,
        None => false,
    };
    if !is_the_same {
        let claim = claim.map_or_else(|| begun(&directory, &planned), Ok)?;
        sweep_tables::write(&directory, &manifest, &results)?;
        let simple = setting.simple_errors(&environments, &baselines, &context.progress())?;
        context.say_all(simple.starts().as_slice());
        simple.write(&directory)?;
        write_data(&directory, study, &setting)?;
        if ran > 0 {
            write_timings(&directory, ran, &clock)?;
        }
        manifest = claim.finish(manifest.facts, tables(study))?;
    }
    let took = clock.elapsed();
    Ok(StepResult::Made(Swept { manifest, directory, ran, ran_runs, rewrote, took }))
}

/// Records that the agents were trained with another arithmetic, which rounds differently.
fn note_arithmetic(facts: &mut SweepFacts, class: &str) {
    facts.arithmetic = Some(class.to_owned());
    facts.notes.push(format!(
        "agents were trained by {class}, which rounds differently from calib, so compare only runs that were trained alike"
    ));
}

/// Estimates the time of the plan with `passes` left, by timing some steps of a pass.
fn expected(
    job: &Job,
    setting: &SweepContext,
    plan: &SweepPlan,
    passes: usize,
    tally: &DryRunTally,
    context: &RunContext,
) -> Result<Expected, StepError> {
    let cost = setting.cost(job.study(), tally.measured(), &context.silent().progress())?;
    let sensors_of_pass = setting.sensors.len().div_ceil(setting.groups.len());
    let expected = plan.expect(cost, passes, sensors_of_pass, job.study());
    context.expect(StepKind::Sweep, job, expected.of_step(plan.memory.total));
    tally.expect(job, expected.clone());
    Ok(expected)
}

/// Returns the facts to store about these results.
fn facts(
    study: &Study,
    setting: &SweepContext,
    plan: &Plan<'_>,
    results: &[UnitResult],
    printer: &Printer,
) -> Result<SweepFacts, StepError> {
    let SweepContext { model, dataset, candidates, groups, sensors, constant_sensors, .. } =
        setting;
    let units = plan.planned(results);
    let settings: Vec<String> = plan.settings().iter().map(ToString::to_string).collect();
    printer.say_all(saved(results, setting.runs()).as_slice());
    let failed = failed_rollouts(results, &dataset.normaliser, printer);
    let notes = [
        setting.notes.clone(),
        groups.iter().flat_map(|group| group.streams.notes.clone()).collect(),
        constant_sensors.iter().map(ConstantSensor::note).collect(),
        setting.environments.starts.clone(),
        failed,
    ];
    let content = model.as_ref().map(|model| model_files::content(&model.manifest)).transpose()?;
    let (first, others) =
        groups.split_first().unwrap_or_else(|| unreachable!("at least one group"));
    let others = others.iter().map(|group| OtherStreams {
        sensors: group.sensors.clone(),
        span: group.streams.demand.span,
        windows: windows(dataset, &group.streams),
    });
    let span = first.streams.demand.span;
    Ok(SweepFacts {
        key: artefact::key(&(&units, &settings))?,
        windows: windows(dataset, &first.streams),
        other_streams: others.collect(),
        standing_still: constant_sensors.iter().filter_map(ConstantSensor::everywhere).collect(),
        scales: error_scales(dataset, sensors, candidates),
        settings,
        units,
        notes: notes.concat(),
        ..SweepFacts::of_nothing(study, dataset, content, span, candidates.clone())
    })
}

/// Writes the data that a report shows. A report does not read the log.
fn write_data(directory: &Path, study: &Study, setting: &SweepContext) -> Result<(), StepError> {
    let SweepContext { dataset, pretrain, sensors, .. } = setting;
    recorded::write(directory, dataset, pretrain.as_ref(), sensors)?;
    if study.has_model() {
        return Ok(());
    }
    // The profile of a study with a model lies beside the model.
    profile_file::write(directory, &dataset.profile)
}

/// The remaining work of a sweep.
#[derive(Clone, Copy)]
struct RemainingRuns {
    units: usize,
    runs: usize,
    /// Number of these units that an earlier part of the same command runs.
    shared: usize,
}

/// Estimates the memory to train all `candidates` on these units, and returns the plan.
fn preview(
    candidates: &[Candidate],
    sizes: &Sizes,
    units: usize,
    left: RemainingRuns,
    span: Span,
) -> SweepPlan {
    let threads = rayon::current_num_threads();
    let memory = Memory::of(sizes, &agents_of(candidates), threads);
    SweepPlan {
        candidates: candidates.to_vec(),
        units,
        left: left.units,
        runs_left: left.runs,
        shared: left.shared,
        steps: span.steps,
        threads,
        memory,
        expected: None,
    }
}

/// Returns the files that a sweep writes besides its units. For a study without a model they include the profile of its
/// data.
fn tables(study: &Study) -> impl Iterator<Item = &'static str> {
    let profile = (!study.has_model()).then_some(PROFILE);
    sweep_tables::FILES.into_iter().chain([recorded::RECORDED, simple::FILE]).chain(profile)
}

/// Locks the directory of a sweep, and records the keys of its runs.
fn begun(directory: &Path, planned: &PlannedSweep) -> Result<DirectoryLock, StepError> {
    let claim = DirectoryLock::begun(directory)?;
    planned.write(directory)?;
    Ok(claim)
}

/// Returns the manifest of a sweep, if its tables are intact.
fn finished(directory: &Path, job: &Job) -> Option<SweepManifest> {
    let kept = artefact::read::<SweepManifest>(directory)?;
    (!job.policy().redoes() && kept.is_whole(directory)).then_some(kept)
}

/// Returns the windows that Online replays.
fn windows(dataset: &Dataset, streams: &Streams) -> Vec<OnlineWindow> {
    match (&streams.online, &dataset.held_out) {
        (Some(windows), Some(held_out)) => online_windows(windows, held_out),
        _ => Vec::new(),
    }
}

/// Records why nothing can be scored in a deployment, so that the others are judged without it.
fn leave_out(
    job: &Job,
    skipped: SkippedDeployment,
    printer: &Printer,
) -> Result<SweepResult, StepError> {
    let SkippedDeployment { dataset, model, candidates, reason } = skipped;
    let study = job.study();
    let name = job.deployment().unwrap_or_default();
    printer.error(&format!("deployment {name} is left out: {reason}"));
    if job.policy().is_dry() {
        return Ok(StepResult::Nothing(Outcome::Negative));
    }
    let span = Span::new(study.sweep.steps, study.gammas());
    let facts = SweepFacts {
        key: artefact::key(&reason)?,
        left_out: Some(reason),
        ..SweepFacts::of_nothing(study, &dataset, model, span, candidates)
    };
    DirectoryLock::begun(&job.layout().sweep())?.finish(facts, [])?;
    Ok(StepResult::Nothing(Outcome::Negative))
}

/// Returns the number of remaining units that an earlier part of the same command runs.
fn shared_units(plan: &Plan<'_>, stored: &StoredUnits, tally: &DryRunTally) -> usize {
    let units = plan.units();
    let left = units.iter().filter(|planned| !stored.whole().contains_key(&planned.unit));
    tally.count_repeated(left.map(|planned| planned.fingerprint(plan.settings())))
}

/// Copies runs that other sweeps made into this sweep's store.
fn put_shared(
    plan: &Plan<'_>,
    own: &StoredUnits,
    stored: &StoredUnits,
    store: &UnitStore,
) -> Result<(), StepError> {
    for (unit, result) in stored.whole() {
        if !own.whole().contains_key(unit) {
            store.put(&plan.runs_of(result))?;
        }
    }
    for (unit, runs) in stored.begun() {
        if own.begun().get(unit) != Some(runs) {
            store.put(runs)?;
        }
    }
    Ok(())
}

/// Units that need no run.
#[derive(Default)]
pub struct KnownUnits {
    /// Runs in this sweep's own store.
    own: StoredUnits,
    /// Own runs together with those of the study's other sweeps and of other processes. All models share Online and log
    /// replay. Deployments with the same start states share members.
    pub stored: StoredUnits,
}

impl KnownUnits {
    /// Looks in the `store` of a job, in those of other models and deployments, and in the pool.
    pub fn of(
        plan: &Plan<'_>,
        store: &UnitStore,
        job: &Job,
        ResultSource { pool, accelerator }: ResultSource<'_>,
    ) -> Self {
        if job.policy().redoes() {
            return Self::default();
        }
        let arithmetic = accelerator.map(Accelerator::class);
        let others = job.layout().other_sweeps();
        let others = others.iter().map(|sweep| unit_store(sweep, arithmetic)).collect();
        let store = store.clone();
        let own = plan.stored(&store);
        let all = store.beside(others);
        let stored = plan.known(&|unit, key| {
            let made = pool.and_then(|pool| pool.get(&(unit.clone(), key.to_owned())));
            UnitRuns::merged(made.cloned().into_iter().chain(all.get(unit, key)))
        });
        Self { own, stored }
    }
}

#[derive(Serialize, Deserialize)]
struct Timings {
    units: usize,
    wall_secs: f64,
}

fn write_timings(directory: &Path, units: usize, clock: &Stopwatch) -> Result<(), StepError> {
    let wall_secs = clock.elapsed().as_secs_f64();
    Ok(write_json(&directory.join("timings.json"), &Timings { units, wall_secs })?)
}

/// Returns the seconds that the sweep took when it last made runs.
pub fn wall_secs(paths: &Layout) -> Option<f64> {
    let timings: Timings = read_json(&paths.sweep().join("timings.json")).ok()?;
    Some(timings.wall_secs)
}
