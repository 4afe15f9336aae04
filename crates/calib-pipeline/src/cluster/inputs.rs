//! Inputs of shards: the model or the replayed log, held-out data, pre-trained agents, and earlier results.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::Path,
};

use calib_agent::{FittedPredictor, StateFile, ValueState};
use calib_base::{
    Context as _, StepError,
    artefact::{self, Files},
    ensure, frames,
};
use calib_core::Frames;
use calib_files::{Fingerprint, fingerprint_file, link_or_copy};
use calib_model::ModelFamily;
use calib_model_steps::model::kinds::{self, OpenedModel};
use calib_study::Job;
use calib_sweep::{
    Baselines, ClosedEnvironment, Environment, EnvironmentId, Plan, PlanOptions, SensorGroup,
    Start, UnitRuns,
};
use calib_sweep_steps::sweep::{
    agent_seed::agent_seed,
    environments::{EnvironmentSpec, Sources, StreamParameters},
    groups::planned_sensors,
    setting::{OpenedEnvironments, SweepContext, raced},
};

use crate::cluster::{
    plan_file::{PartStreams, SweepPart},
    results::{self, Completeness, Header, ShardResults, UnitsInOrder},
};

/// The files for log replay. A model has files of the same names.
const LOG: [&str; 2] = ["states.npy", "rows.parquet"];
const HELD_OUT: [&str; 2] = ["held_out.npy", "held_out.parquet"];
const STARTS: &str = "starts.safetensors";
const STORED: &str = "stored.units";

/// Returns the names of the files that [`write`] writes.
pub(crate) fn names(setting: &SweepContext, stored: &[UnitRuns]) -> Vec<String> {
    let held_out = setting.dataset.held_out.is_some().then_some(HELD_OUT);
    let starts = (!setting.starts.is_empty()).then_some(STARTS);
    let stored = (!stored.is_empty()).then_some(STORED);
    let log = setting.model.is_none().then_some(LOG);
    let own = log.into_iter().chain(held_out).flatten().chain(starts).chain(stored);
    of_model(setting).into_keys().chain(own.map(str::to_owned)).collect()
}

/// Returns the files of the model. Empty without a model.
pub(crate) fn of_model(setting: &SweepContext) -> Files {
    setting.model.as_ref().map_or_else(Files::new, |model| model.manifest.lasting_files())
}

/// Returns the size in bytes of the replayed log before it is written, if there is no model.
pub(crate) fn log_bytes(setting: &SweepContext) -> u64 {
    let train = &setting.dataset.train;
    // States are f32, and a row has its time and segment.
    let of_log = (train.rows() * (4 * train.states().columns() + 12)) as u64;
    if setting.model.is_none() { of_log } else { 0 }
}

/// Writes the inputs of a part's shards to `directory`, and returns their fingerprints. Files of the model are
/// hard-linked on the same disk, and copied otherwise.
pub(crate) fn write(
    directory: &Path,
    job: &Job,
    setting: &SweepContext,
    stored: &[UnitRuns],
    header: Header,
) -> Result<Files, StepError> {
    let mut files = of_model(setting);
    for name in files.keys() {
        link_or_copy(&job.layout().model().join(name), &directory.join(name))?;
    }
    let mut written = Vec::new();
    if setting.model.is_none() {
        write_frames(directory, LOG, &setting.dataset.train)?;
        written.extend(LOG);
    }
    if let Some(held_out) = &setting.dataset.held_out {
        write_frames(directory, HELD_OUT, held_out)?;
        written.extend(HELD_OUT);
    }
    if !setting.starts.is_empty() {
        write_starts(directory, &setting.starts)?;
        written.push(STARTS);
    }
    if !stored.is_empty() {
        let mut units = UnitsInOrder::new();
        results::add(&mut units, stored.iter().cloned());
        let results = ShardResults { header, units, completeness: Completeness::Whole };
        results.write(&directory.join(STORED))?;
        written.push(STORED);
    }
    for name in written {
        files.insert(name.to_owned(), fingerprint_file(&directory.join(name))?);
    }
    Ok(files)
}

/// Writes states and their rows under these names.
fn write_frames(
    directory: &Path,
    [states, rows]: [&str; 2],
    written: &Frames,
) -> Result<(), StepError> {
    frames::write_states(&directory.join(states), written)?;
    artefact::write_table(frames::rows_table(written), &directory.join(rows))
}

/// Returns the results that existed at planning time, if any.
pub(crate) fn stored(directory: &Path) -> Option<UnitsInOrder> {
    ShardResults::read(&directory.join(STORED)).ok().map(|results| results.units)
}

/// Returns how many bytes of these files a shard of one environment maps. Each ensemble member has its own table.
pub(crate) fn mapped_bytes(
    directory: &Path,
    files: &Files,
    environments: &[EnvironmentSpec],
) -> u64 {
    let members = environments
        .iter()
        .filter(|environment| matches!(environment, EnvironmentSpec::Member { .. }))
        .count();
    let (tables, others): (Vec<&String>, Vec<&String>) =
        files.keys().partition(|name| name.starts_with("members/"));
    bytes(directory, &others) + bytes(directory, &tables) / members.max(1) as u64
}

/// Returns the total size of these files in `directory`. Missing files count as zero.
fn bytes(directory: &Path, names: &[&String]) -> u64 {
    let sizes =
        (names.iter()).map(|name| directory.join(name).metadata().map_or(0, |found| found.len()));
    sizes.sum()
}

/// The key of the agents' file. Its content has a fingerprint of its own.
const AGENTS: &str = "agents to start from";

/// The data stored for each sensor's agent besides its parameters.
type StartNames = BTreeMap<String, (Fingerprint, Option<FittedPredictor>)>;

fn write_starts(directory: &Path, starts: &BTreeMap<String, Start>) -> Result<(), StepError> {
    let names: BTreeMap<&String, (&Fingerprint, &Option<FittedPredictor>)> = starts
        .iter()
        .map(|(sensor, start)| (sensor, (&start.fingerprint, &start.baseline)))
        .collect();
    let values = starts.values().map(|start| ValueState::from(&start.checkpoint)).enumerate();
    let file = StateFile::new(directory.join(STARTS), AGENTS.to_owned());
    Ok(file.write(&names, values.collect())?)
}

fn read_starts(directory: &Path) -> Result<BTreeMap<String, Start>, StepError> {
    let file = StateFile::new(directory.join(STARTS), AGENTS.to_owned());
    let (names, values): (StartNames, Vec<(usize, ValueState)>) =
        file.read().with_context(|| format!("{} is damaged", file.path().display()))?;
    ensure!(names.len() == values.len(), "{} is damaged", file.path().display());
    let mut starts = BTreeMap::new();
    for ((sensor, (fingerprint, baseline)), (_, state)) in names.into_iter().zip(values) {
        starts.insert(sensor, Start { checkpoint: state.checkpoint, baseline, fingerprint });
    }
    Ok(starts)
}

/// The opened inputs of a part, as a shard needs them.
pub(crate) struct Inputs<'p> {
    part: &'p SweepPart,
    opened: BTreeSet<EnvironmentId>,
    states: Option<Frames>,
    model: Option<OpenedModel>,
    held_out: Option<Frames>,
    starts: BTreeMap<String, Start>,
    /// Results that existed at planning time.
    pub(crate) stored: UnitsInOrder,
}

impl<'p> Inputs<'p> {
    /// Opens only the inputs of the streams of these environments. Every file is checked against its planned
    /// fingerprint before use.
    pub(crate) fn open(
        directory: &Path,
        part: &'p SweepPart,
        opened: BTreeSet<EnvironmentId>,
    ) -> Result<Self, StepError> {
        let files = CheckedFiles { directory, files: &part.files };
        let members: Vec<usize> = opened.iter().filter_map(member).collect();
        let replays = opened.contains(&EnvironmentId::LogReplay);
        // Baselines are fitted on the log, whatever is replayed.
        let needs_log = replays || has_baselines(part) || !members.is_empty();
        let states = needs_log.then(|| files.frames(LOG)).transpose()?;
        let model = match &states {
            Some(states) if !members.is_empty() => Some(files.model(part, states, &members)?),
            _ => None,
        };
        let held_out = opened.contains(&EnvironmentId::Online);
        let held_out = held_out.then(|| files.frames(HELD_OUT)).transpose()?;
        let starts = if files.has(STARTS)? { read_starts(directory)? } else { BTreeMap::new() };
        let stored = if files.has(STORED)? {
            ShardResults::read(&directory.join(STORED))?.units
        } else {
            UnitsInOrder::new()
        };
        Ok(Self { part, opened, states, model, held_out, starts, stored })
    }

    /// Returns all environments of the part for each discount factor. Those of this shard are opened, and the others
    /// only described.
    pub(crate) fn environments(&self) -> Result<Vec<OpenedEnvironments<'_>>, StepError> {
        self.part.streams.iter().map(|streams| self.environments_of(streams)).collect()
    }

    fn environments_of(&self, streams: &PartStreams) -> Result<OpenedEnvironments<'_>, StepError> {
        let states = self.states.as_ref();
        let sources = Sources {
            states,
            model: self.model.as_deref(),
            train: states,
            held_out: self.held_out.as_ref(),
        };
        let parameters = StreamParameters::of(&self.part.study, streams.span)?;
        streams
            .environments
            .iter()
            .map(|described| -> Result<Box<dyn Environment + '_>, StepError> {
                if self.opened.contains(&described.id()) {
                    return described.open(sources, parameters);
                }
                let id = described.id();
                let inputs = described.inputs();
                Ok(Box::new(ClosedEnvironment { id, inputs }))
            })
            .collect()
    }

    /// Returns the baselines that agents start from, if any are fitted on the log.
    pub(crate) fn baselines(&self) -> Option<Baselines<'_>> {
        self.states.as_ref().filter(|_| has_baselines(self.part)).map(Baselines::new)
    }

    /// Returns the plan of the part's sweep.
    pub(crate) fn plan<'a>(
        &'a self,
        environments: &'a [OpenedEnvironments<'a>],
        baselines: Option<&'a Baselines<'a>>,
    ) -> Plan<'a> {
        let SweepPart { study, candidates, sensors, span, streams, .. } = self.part;
        let groups = streams.iter().zip(environments).map(|(streams, environments)| SensorGroup {
            candidates: &streams.candidates,
            environments: environments.iter().map(|environment| &**environment).collect(),
            span: streams.span,
        });
        let names: Vec<&[String]> = streams.iter().map(|streams| &streams.sensors[..]).collect();
        let sensors = planned_sensors(sensors, &names);
        let options = PlanOptions {
            part: study.part(),
            span: *span,
            curve_points: study.sweep.curve_points,
            seed: agent_seed(study),
        };
        let plan = Plan::of_groups(candidates, groups.collect(), sensors, options);
        let plan = plan.starting_from(self.starts.clone()).with_baselines(baselines);
        raced(plan, study)
    }
}

/// Whether an agent starts from a predictor that is fitted on the log.
fn has_baselines(part: &SweepPart) -> bool {
    part.candidates.iter().any(|candidate| candidate.agent.baseline.is_some())
}

fn member(id: &EnvironmentId) -> Option<usize> {
    match id {
        EnvironmentId::Member(member) => Some(*member),
        EnvironmentId::Online | EnvironmentId::LogReplay => None,
    }
}

/// Files that are checked against their planned fingerprints on access.
struct CheckedFiles<'a> {
    directory: &'a Path,
    files: &'a Files,
}

impl CheckedFiles<'_> {
    /// Whether the plan has this file. If so, the file is intact.
    fn has(&self, name: &str) -> Result<bool, StepError> {
        let Some(written) = self.files.get(name) else { return Ok(false) };
        let path = self.directory.join(name);
        let found = artefact::fingerprint_once(&path)?;
        ensure!(
            found == *written,
            "{} is not what was planned: it was damaged or replaced; plan the work again",
            path.display()
        );
        Ok(true)
    }

    fn require(&self, name: &str) -> Result<(), StepError> {
        ensure!(self.has(name)?, "the plan has no {name}; plan the work again");
        Ok(())
    }

    fn frames(&self, [states, rows]: [&str; 2]) -> Result<Frames, StepError> {
        self.require(states)?;
        self.require(rows)?;
        frames::open(&self.directory.join(rows), frames::map_states(&self.directory.join(states))?)
    }

    /// Opens the model with these members.
    fn model(
        &self,
        part: &SweepPart,
        states: &Frames,
        members: &[usize],
    ) -> Result<OpenedModel, StepError> {
        let settings = &part.study.model;
        let mut read = self.files.keys().filter(|name| match settings.kind.family() {
            ModelFamily::Neighbors => {
                members.iter().any(|member| name.starts_with(&format!("members/{member}/")))
            }
            ModelFamily::Network => !name.starts_with("held_out"),
            ModelFamily::None => false,
        });
        read.try_for_each(|name| self.require(name))?;
        // A rollout only reads tables and rows. Distances were measured when the tables were made.
        kinds::open(self.directory, &part.study, states, states.states().clone(), Some(members))
    }
}
