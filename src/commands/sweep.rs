use std::{collections::BTreeMap, path::Path};

use anyhow::bail;
use calib_agent::AgentConfig;
use calib_core::{Period, Seed};
use calib_data::Dataset;
use calib_files::{Fingerprint, read_json, write_json};
use calib_study::{Job, Layout, Study};
use calib_sweep::{
    Candidate, Completed, ErrorScale, Plan, PlanOptions, PlannedUnit, Span, SweepError, Unit,
    UnitResult, UnitStore, candidates,
};
use serde::{Deserialize, Serialize};

use super::{
    artefact::{self, Below, Claim, Files, Manifest, TOOL},
    environments::Environments,
    model_files,
    partition::{self, Parts},
    plant_of_study, pretrain_files, recorded,
    standing_still::Still,
    streams::{OnlineWindow, Streams, Unscorable, error_scales, online_windows},
    sweep_notes::{failed_rollouts, saved, standing_still},
    sweep_plan::{Counted, Memory, Sizes, SweepPlan},
    sweep_tables,
};
use crate::{
    clock::Stopwatch,
    exit::ExitStatus,
    output::{Printer, count, duration},
};

/// `manifest.json` of a sweep directory.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct SweepManifest {
    pub(super) format: u32,
    pub(super) tool: String,
    /// Fingerprint of all units.
    pub(super) key: String,
    pub(super) study: Study,
    pub(super) data: Fingerprint,
    pub(super) model: String,
    pub(super) period: Period,
    /// What Online replays.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) held_out: Option<HeldOut>,
    /// How long streams are.
    pub(super) span: Span,
    /// The windows of it that are replayed, in the order of time.
    #[serde(default)]
    pub(super) windows: Vec<OnlineWindow>,
    /// What errors are divided by.
    pub(super) scales: Vec<ErrorScale>,
    /// Sensors that stand still in all of these windows.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(super) standing_still: Vec<String>,
    /// Why nothing was trained, if nothing was: the deployment cannot be scored.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) left_out: Option<String>,
    pub(super) candidates: Vec<Candidate>,
    pub(super) units: Vec<PlannedUnit>,
    /// What the reader of the results should know.
    pub(super) notes: Vec<String>,
    /// Fingerprint of every table.
    pub(super) files: Files,
}

/// The states of a deployment.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct HeldOut {
    pub(super) rows: u64,
    /// Times of the first and the last.
    pub(super) times: [String; 2],
    /// Their fingerprint.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) data: Option<Fingerprint>,
}

impl HeldOut {
    fn of(dataset: &Dataset) -> Option<Self> {
        let frames = dataset.held_out.as_ref()?;
        let times = model_files::first_and_last(frames)?;
        let data = dataset.held_out_fingerprint.clone();
        Some(Self { rows: frames.rows() as u64, times, data })
    }
}

impl Manifest for SweepManifest {
    const FORMAT: u32 = 3;

    fn format(&self) -> u32 {
        self.format
    }
}

/// Where a sweep keeps its finished units.
pub(super) fn unit_store(directory: &Path) -> UnitStore {
    UnitStore::new(directory.join("units"))
}

/// Train every candidate in every environment. A dry run says what was `counted` before.
pub(super) fn run(job: &Job, counted: &Counted, printer: &Printer) -> anyhow::Result<ExitStatus> {
    let clock = Stopwatch::start();
    let (study, paths) = (job.study(), job.layout());
    if study.sweep.sensors.is_empty() {
        bail!("sweep.sensors is empty; name the sensors to predict, such as [\"PIT300\"]");
    }
    let candidates = candidates(&study.sweep, &study.agent, Seed::new(study.seed).child("sweep"))?;
    let model = model_files::open(job)?;
    printer.say(&format!("sweep: reading {}", plant_of_study::data(job)?.path.0.join(", ")));
    let (Parts { dataset, pretrain, .. }, streams) = scorable(job, &candidates, printer)?;
    model_files::check_data(job, &model.manifest, &dataset)?;
    let content = model.manifest.content()?;
    let streams = match streams {
        Ok(streams) => streams,
        Err(reason) => {
            let made = LeftOut { job, dataset: &dataset, model: &content, candidates };
            return made.leave_out(reason, printer);
        }
    };
    let span = streams.demand.span;
    let Environments { environments, starts: told_starts } =
        Environments::new(job, &model, &dataset, &streams, printer)?;
    let sensors = model_files::sensor_columns(study, &dataset.normaliser, &dataset.profile)?;
    let scales = error_scales(&dataset, &sensors, &candidates);
    let still = standing_still(&dataset, &streams, &sensors, printer);
    let (starts, notes) =
        pretrain_files::starts(job, &dataset, pretrain.as_ref(), &sensors, &candidates)?;
    printer.say_all(&notes);
    let as_dyn = environments.iter().map(|environment| &**environment).collect();
    let options = options(study, &streams);
    let plan = Plan::new(&candidates, as_dyn, sensors.clone(), options).starting_from(starts);
    let plan = raced(plan, study)?;
    let directory = paths.sweep();
    let store = unit_store(&directory);
    let Found { own, stored } =
        if job.policy().redoes() { Found::default() } else { Found::of(&plan, &store, paths)? };
    let missing = plan.left(&stored)?;
    let sizes = Sizes::of(study, &dataset, span, [plan.count(), plan.passes(&stored)?]);
    let shared = if job.policy().is_dry() { shared_units(&plan, &stored, counted) } else { 0 };
    let preview = preview(&candidates, &sizes, [plan.count(), missing, shared], span);
    preview.announce(study, printer)?;
    if job.policy().is_dry() {
        preview.show(printer)?;
        printer.say(&format!("dry run: nothing written to {}", directory.display()));
        return Ok(ExitStatus::Done);
    }
    // Nothing is given up, nor need the disk be writable, before there is something to write.
    let is_done = missing == 0 && stored.keys().all(|unit| own.contains_key(unit));
    let kept = if is_done { finished(&directory, job) } else { None };
    let claim = kept.is_none().then(|| begin(&directory)).transpose()?;
    if job.policy().redoes() {
        store.clear()?;
    }
    let mut shared = stored.iter().filter(|(unit, _)| !own.contains_key(unit));
    shared.try_for_each(|(_, result)| store.put(result))?;
    let Completed { results, ran } = plan.complete(stored, &store, &printer.progress())?;
    let units: Vec<PlannedUnit> = results.iter().map(planned).collect();
    if let Some(saved) = saved(&results, candidates.len()) {
        printer.say(&saved);
    }
    let failed = failed_rollouts(&results, &dataset.normaliser, printer);
    let mut manifest = SweepManifest {
        format: SweepManifest::FORMAT,
        tool: TOOL.to_owned(),
        key: artefact::key(&units)?,
        study: study.clone(),
        data: dataset.fingerprint.clone(),
        model: content,
        period: dataset.period,
        held_out: HeldOut::of(&dataset),
        span,
        windows: windows(&dataset, &streams),
        standing_still: still.iter().filter_map(Still::everywhere).collect(),
        scales,
        left_out: None,
        candidates,
        units,
        notes: [notes, streams.notes, still.iter().map(Still::note).collect(), told_starts, failed]
            .concat(),
        files: kept.as_ref().map(|kept| kept.files.clone()).unwrap_or_default(),
    };
    if let Some(kept) = kept
        && serde_json::to_value(&kept)? == serde_json::to_value(&manifest)?
    {
        finish(job, &manifest, ran, clock, printer)?;
        return Ok(ExitStatus::Done);
    }
    let claim = claim.map_or_else(|| begin(&directory), Ok)?;
    sweep_tables::write(&directory, &manifest, &results)?;
    recorded::write(&directory, &dataset, pretrain.as_ref(), &sensors)?;
    manifest.files = artefact::fingerprints(&directory, tables())?;
    if ran > 0 {
        write_timings(&directory, ran, &clock)?;
    }
    claim.complete(&manifest)?;
    finish(job, &manifest, ran, clock, printer)?;
    Ok(ExitStatus::Done)
}

/// What is read, and the streams of it; or why a deployment is left out: the log has nothing of it, or nothing of it can be scored.
fn scorable(
    job: &Job,
    candidates: &[Candidate],
    printer: &Printer,
) -> anyhow::Result<(Parts, Result<Streams, String>)> {
    let is_one_of_several = job.deployment().is_some();
    let parts = match partition::load(job, printer) {
        Err(reason) if is_one_of_several && partition::is_outside(&reason) => {
            let rest = partition::load_training(job, printer)?;
            return Ok((rest, Err(format!("{reason:#}"))));
        }
        parts => parts?,
    };
    let streams = match Streams::of(job.study(), &parts.dataset, candidates, printer) {
        Err(reason) if is_one_of_several && reason.is::<Unscorable>() => Err(reason.to_string()),
        streams => Ok(streams?),
    };
    Ok((parts, streams))
}

/// What it takes to train all `candidates`: units, those that are left, and those of them that others share.
fn preview<'a>(
    candidates: &'a [Candidate],
    sizes: &Sizes,
    [units, left, shared]: [usize; 3],
    span: Span,
) -> SweepPlan<'a> {
    let agents: Vec<AgentConfig> = candidates.iter().map(|of| of.agent.clone()).collect();
    let threads = rayon::current_num_threads();
    let memory = Memory::of(sizes, &agents, threads);
    SweepPlan { candidates, units, left, shared, steps: span.steps, threads, memory }
}

/// What a sweep writes beside its units.
fn tables() -> impl Iterator<Item = &'static str> {
    sweep_tables::FILES.into_iter().chain([recorded::RECORDED])
}

/// The manifest of a sweep whose tables are what was written.
fn finished(directory: &Path, job: &Job) -> Option<SweepManifest> {
    let kept = artefact::read::<SweepManifest>(directory)?;
    (!job.policy().redoes() && artefact::are_whole(directory, &kept.files)).then_some(kept)
}

/// Claim the directory of a sweep that has something to write.
fn begin(directory: &Path) -> anyhow::Result<Claim> {
    let claim = Claim::new(directory, Below::Ours)?;
    claim.begin()?;
    Ok(claim)
}

fn planned(result: &UnitResult) -> PlannedUnit {
    PlannedUnit { unit: result.unit.clone(), key: result.key.clone() }
}

fn options(study: &Study, streams: &Streams) -> PlanOptions {
    PlanOptions {
        part: streams.demand.part,
        span: streams.demand.span,
        curve_points: study.sweep.curve_points,
        seed: Seed::new(study.seed).child("agent"),
    }
}

fn raced<'a>(plan: Plan<'a>, study: &Study) -> Result<Plan<'a>, SweepError> {
    let sweep = &study.sweep;
    if sweep.race { plan.race(sweep.race_error_rate) } else { Ok(plan) }
}

/// What Online replays.
fn windows(dataset: &Dataset, streams: &Streams) -> Vec<OnlineWindow> {
    match (&streams.online, &dataset.held_out) {
        (Some(windows), Some(held_out)) => online_windows(windows, held_out),
        _ => Vec::new(),
    }
}

/// A deployment in which nothing can be scored.
struct LeftOut<'a> {
    job: &'a Job,
    dataset: &'a Dataset,
    model: &'a str,
    candidates: Vec<Candidate>,
}

impl LeftOut<'_> {
    /// Write down why, so that the other deployments are judged without it.
    fn leave_out(self, reason: String, printer: &Printer) -> anyhow::Result<ExitStatus> {
        let Self { job, dataset, model, candidates } = self;
        let study = job.study();
        let name = job.deployment().unwrap_or_default();
        printer.error(&format!("deployment {name} is left out: {reason}"));
        if job.policy().is_dry() {
            return Ok(ExitStatus::Negative);
        }
        let span = Span::new(study.sweep.steps, candidates.iter().map(|of| of.agent.gamma));
        let manifest = SweepManifest {
            format: SweepManifest::FORMAT,
            tool: TOOL.to_owned(),
            key: artefact::key(&reason)?,
            study: study.clone(),
            data: dataset.fingerprint.clone(),
            model: model.to_owned(),
            period: dataset.period,
            held_out: HeldOut::of(dataset),
            span,
            windows: Vec::new(),
            standing_still: Vec::new(),
            scales: Vec::new(),
            left_out: Some(reason),
            candidates,
            units: Vec::new(),
            notes: Vec::new(),
            files: Files::new(),
        };
        let claim = begin(&job.layout().sweep())?;
        claim.complete(&manifest)?;
        Ok(ExitStatus::Negative)
    }
}

/// Units that are left to run, and that another part of the same command runs before.
fn shared_units(plan: &Plan<'_>, stored: &BTreeMap<Unit, UnitResult>, counted: &Counted) -> usize {
    let units = plan.units();
    let left = units.iter().filter(|planned| !stored.contains_key(&planned.unit));
    counted.again(left.map(|planned| &planned.key))
}

/// Units that need not be run.
#[derive(Default)]
struct Found {
    /// What this sweep has.
    own: BTreeMap<Unit, UnitResult>,
    /// The same and what others of the study have: Online and log replay are the same for all models, members for all
    /// deployments that give the same start states.
    stored: BTreeMap<Unit, UnitResult>,
}

impl Found {
    fn of(plan: &Plan<'_>, store: &UnitStore, paths: &Layout) -> anyhow::Result<Self> {
        let others = paths.other_sweeps().iter().map(|sweep| unit_store(sweep)).collect();
        let stored = plan.stored(&store.clone().beside(others))?;
        Ok(Self { own: plan.stored(store)?, stored })
    }
}

#[derive(Serialize, Deserialize)]
struct Timings {
    units: usize,
    wall_secs: f64,
}

fn write_timings(directory: &Path, units: usize, clock: &Stopwatch) -> anyhow::Result<()> {
    let wall_secs = clock.elapsed().as_secs_f64();
    Ok(write_json(&directory.join("timings.json"), &Timings { units, wall_secs })?)
}

/// How long the sweep took when it last ran anything.
pub(super) fn wall_secs(paths: &Layout) -> Option<f64> {
    let timings: Timings = read_json(&paths.sweep().join("timings.json")).ok()?;
    Some(timings.wall_secs)
}

fn finish(
    job: &Job,
    manifest: &SweepManifest,
    ran: usize,
    clock: Stopwatch,
    printer: &Printer,
) -> anyhow::Result<()> {
    if printer.is_for_machines() {
        printer.json(manifest)?;
    } else {
        let did = if ran == 0 {
            "up to date".to_owned()
        } else {
            format!("{} units run in {}", count(ran), duration(clock.elapsed()))
        };
        let runs = job.layout().sweep().join("runs.parquet");
        printer.result(&format!("{did}; results in {}", runs.display()))?;
    }
    printer.next(&[job.command("evaluate")]);
    Ok(())
}
