//! The step that pre-trains one agent per sensor.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
    time::Duration,
};

use calib_agent::{PretrainingDiverged, StateFile, parameter_count, pretraining_bytes};
use calib_base::{
    Context as _, StepError,
    artefact::{self, Below, DirectoryLock},
    bail,
    clock::Stopwatch,
    cost::{StepCost, processor_secs},
    log::{
        context::RunContext,
        partition::{self, Parts, span},
    },
    memory,
    outcome::{NoPlan, StepResult},
    output::{Printer, bytes, count},
};
use calib_files::write_json;
use calib_model_steps::model::model_files::sensor_columns;
use calib_study::{Job, StepKind, Study};
use serde::Serialize;

use crate::agents::{
    pretrain_files::{
        self, PretrainFacts, PretrainManifest, PretrainedAgent, agent_key, write_agent,
    },
    shares::{self, AgentsOfShares},
    train::{AgentToTrain, train},
};

/// Agents that were pre-trained on the log.
#[derive(Debug)]
pub struct PretrainedAgents {
    pub(crate) manifest: PretrainManifest,
    pub(crate) directory: PathBuf,
    /// Number of newly trained agents.
    pub(crate) trained: usize,
    pub(crate) took: Duration,
}

impl PretrainedAgents {
    /// Returns the sensors that have an agent.
    pub fn sensors(&self) -> Vec<&str> {
        self.manifest.agents.iter().map(|agent| agent.sensor.as_str()).collect()
    }

    /// Returns the sensors whose agents diverged, with the epoch.
    pub fn diverged(&self) -> &BTreeMap<String, usize> {
        &self.manifest.diverged
    }

    /// Returns the folder of the agents.
    pub fn directory(&self) -> &Path {
        &self.directory
    }
}

/// Pre-trains one agent per sensor.
///
/// # Errors
/// Returns an error if the study has no pre-training, the log cannot be read, the disk refuses a write, or
/// the observer asks to stop.
pub fn run(job: &Job, context: &RunContext) -> Result<StepResult<PretrainedAgents>, StepError> {
    let clock = Stopwatch::start();
    let (study, paths) = (job.study(), job.layout());
    check(study)?;
    let parts = partition::load(job, context)?;
    let wanted = wanted(study, &parts)?;
    let directory = paths.pretrain();
    let mut done =
        if job.policy().redoes() { BTreeMap::new() } else { finished(&directory, &wanted) };
    let of_shares = if job.policy().redoes() {
        AgentsOfShares::default()
    } else {
        shares::finished(&directory, &wanted, &done)
    };
    let missing: Vec<&AgentToTrain> = wanted
        .iter()
        .filter(|wanted| !done.contains_key(&wanted.sensor) && !of_shares.has(&wanted.sensor))
        .collect();
    let cost = announce(study, &parts, &wanted, missing.len(), context)?;
    if job.policy().is_dry() {
        expect_cost(job, &parts, &missing, cost, context)?;
        context.say(&format!("dry run: nothing written to {}", directory.display()));
        return Ok(StepResult::Planned(NoPlan));
    }
    if let Some(share) = job.policy().share {
        let ended = shares::run(share, job, &parts, &wanted, &missing, context)?;
        return Ok(StepResult::Nothing(ended));
    }
    if missing.is_empty()
        && of_shares.is_empty()
        && let Some(manifest) = up_to_date(&directory, study, &parts)
    {
        let (trained, took) = (0, clock.elapsed());
        return Ok(StepResult::Made(PretrainedAgents { manifest, directory, trained, took }));
    }
    let claim = DirectoryLock::new(&directory, Below::Ours)?;
    let width = parts.dataset.train.states().columns();
    let file = state_file(&directory, &missing)?;
    if job.policy().redoes() {
        // Discards everything first, so that an interrupted run resumes without `--force`.
        claim.begin()?;
        file.remove();
        shares::remove(&directory, &wanted)?;
    }
    let trained = missing.len() + of_shares.len();
    let pretrained = train(study, &parts, &missing, Some(&file), &context.progress())?;
    claim.begin()?;
    shares::take(&directory, &of_shares)?;
    let mut diverged = of_shares.diverged;
    done.extend(of_shares.agents);
    for (AgentToTrain { sensor, column, key }, pretrained) in missing.iter().zip(pretrained) {
        let pretrained = match pretrained {
            Ok(pretrained) => pretrained,
            Err(PretrainingDiverged { epoch }) => {
                diverged.insert(sensor.clone(), epoch);
                continue;
            }
        };
        let config = study.pretrain.agent(&study.agent.for_sensor(sensor));
        let agent =
            write_agent(&directory, sensor, *column, key.clone(), config, width, pretrained)?;
        done.insert(sensor.clone(), agent);
    }
    let agents = wanted.iter().filter_map(|wanted| done.remove(&wanted.sensor)).collect();
    let facts = facts(study, &parts, agents, diverged)?;
    artefact::write_table(pretrain_files::curves(&facts.agents), &directory.join(CURVES))?;
    if !missing.is_empty() {
        let wall_secs = clock.elapsed().as_secs_f64();
        write_json(&directory.join("timings.json"), &Timings { agents: missing.len(), wall_secs })?;
    }
    let manifest = claim.finish(facts, [CURVES])?;
    file.remove();
    shares::remove(&directory, &wanted)?;
    let took = clock.elapsed();
    Ok(StepResult::Made(PretrainedAgents { manifest, directory, trained, took }))
}

/// Returns the facts to store about these agents.
fn facts(
    study: &Study,
    parts: &Parts,
    agents: Vec<PretrainedAgent>,
    diverged: BTreeMap<String, usize>,
) -> Result<PretrainFacts, StepError> {
    let part = parts.pretrain.as_ref().context("agents are pre-trained")?;
    Ok(PretrainFacts {
        study: study.clone(),
        data: part.fingerprint.clone(),
        span: span(&part.frames)?,
        period: parts.dataset.period,
        normaliser: parts.dataset.normaliser.clone(),
        agents,
        diverged,
    })
}

#[derive(Serialize)]
struct Timings {
    agents: usize,
    wall_secs: f64,
}

fn check(study: &Study) -> Result<(), StepError> {
    if let Some(checkpoint) = &study.pretrain.checkpoint {
        bail!(
            "pretrain.checkpoint takes the agents from {}: there is nothing to pre-train",
            checkpoint.display()
        );
    }
    if study.pretrain.epochs == 0 {
        bail!("pretrain.epochs is 0: say how many passes over the log to make, such as 20");
    }
    if study.sweep.sensors.is_empty() {
        bail!("sweep.sensors is empty; name the sensors to predict, such as [\"PIT300\"]");
    }
    Ok(())
}

fn wanted(study: &Study, parts: &Parts) -> Result<Vec<AgentToTrain>, StepError> {
    let Parts { dataset, pretrain, .. } = parts;
    let part = pretrain.as_ref().context("agents are pre-trained")?;
    let sensors = sensor_columns(study, &dataset.normaliser, &dataset.profile)?.into_iter();
    let wanted = sensors.map(|(sensor, column)| {
        let key = agent_key(study, &part.fingerprint, &sensor, column)?;
        Ok(AgentToTrain { sensor, column, key })
    });
    wanted.collect()
}

/// The learning curves of all agents.
const CURVES: &str = "curves.parquet";

/// Returns the manifest, if it still describes the study and its files are intact.
fn up_to_date(directory: &Path, study: &Study, parts: &Parts) -> Option<PretrainManifest> {
    let part = parts.pretrain.as_ref()?;
    artefact::read::<PretrainManifest>(directory).filter(|kept| {
        kept.study == *study
            && kept.data == part.fingerprint
            && kept.normaliser == parts.dataset.normaliser
            && kept.is_whole(directory)
    })
}

/// Returns the wanted agents that already exist.
fn finished(directory: &Path, wanted: &[AgentToTrain]) -> BTreeMap<String, PretrainedAgent> {
    let Some(manifest) = artefact::read::<PretrainManifest>(directory) else {
        return BTreeMap::new();
    };
    let agents = manifest.facts.agents.into_iter().filter(|agent| {
        wanted.iter().any(|wanted| wanted.key == agent.key)
            && artefact::are_whole(directory, &agent.files)
    });
    agents.map(|agent| (agent.sensor.clone(), agent)).collect()
}

/// Returns the file for the state of unfinished training.
fn state_file(directory: &Path, missing: &[&AgentToTrain]) -> Result<StateFile, StepError> {
    let keys: Vec<&str> = missing.iter().map(|wanted| wanted.key.as_str()).collect();
    Ok(StateFile::new(directory.join(".unfinished.safetensors"), artefact::key(&keys)?))
}

/// Says in a dry run how long the pre-training of the `missing` agents takes, by training them for a moment.
fn expect_cost(
    job: &Job,
    parts: &Parts,
    missing: &[&AgentToTrain],
    cost: StepCost,
    context: &RunContext,
) -> Result<(), StepError> {
    if missing.is_empty() {
        return Ok(());
    }
    let secs = processor_secs(&context.silent().progress(), |monitor| {
        train(job.study(), parts, missing, None, monitor)
    })?;
    let Some(processor_secs) = secs else { return Ok(()) };
    context.tell_cost(StepKind::Pretrain, job, StepCost { processor_secs, ..cost });
    Ok(())
}

/// Reports the agents to train, and returns what they take, still without time.
fn announce(
    study: &Study,
    parts: &Parts,
    wanted: &[AgentToTrain],
    missing: usize,
    printer: &Printer,
) -> Result<StepCost, StepError> {
    let part = parts.pretrain.as_ref().context("agents are pre-trained")?;
    let width = part.frames.states().columns();
    let parameters = parameter_count(&study.agent, study.agent.seen_width(width));
    printer.say(&format!(
        "{} states from {} for pre-training, the last {:.0} % of them for validation; {} from {} are left for {}; \
         the normaliser is fitted on both",
        count(part.frames.rows()),
        span(&part.frames)?,
        100.0 * study.pretrain.validation_fraction,
        count(parts.dataset.train.rows()),
        span(&parts.dataset.train)?,
        if study.has_model() { "the model" } else { "log replay" },
    ));
    let memory = pretraining_bytes(
        &study.agent,
        study.pretrain.settings(),
        missing,
        width,
        part.frames.rows(),
        rayon::current_num_threads(),
    );
    let disk = (parameters * 4 * 3 * wanted.len()) as u64;
    printer.say(&format!(
        "{} of {} agents left to train, {} parameters each, at most {} epochs; \
         expecting {} of memory beside the states and {} on disk",
        missing,
        wanted.len(),
        count(parameters),
        count(study.pretrain.epochs),
        bytes(memory),
        bytes(disk),
    ));
    match memory::available() {
        Some(available) if missing > 0 && memory > available => bail!(
            "pre-training may take {} beside the states and {} are available; use fewer --threads or sensors, \
             a smaller agent.hidden_units, or a larger preprocess.subsample",
            bytes(memory),
            bytes(available)
        ),
        _ => Ok(StepCost { processor_secs: 0.0, memory, disk }),
    }
}
