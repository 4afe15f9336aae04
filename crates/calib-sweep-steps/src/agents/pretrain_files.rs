//! The directory of pre-trained agents: `pretrain` writes it, and `sweep` starts from it.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use calib_agent::{AgentConfig, Checkpoint, Epoch, FittedPredictor, Pretrained, layer_sizes};
use calib_base::{
    Context as _, StepError,
    artefact::{self, Artefact, Facts, MANIFEST},
    ensure,
    log::partition::{PretrainPart, span},
    stale::StoredArtefact,
};
use calib_core::{Normaliser, Period};
use calib_data::{Dataset, table::Table};
use calib_files::{Fingerprint, Tensor, Tensors, file_name, read_tensors, write_tensors};
use calib_nn::{Mlp, Moments, Naming};
use calib_study::{Job, MomentsRule, StepKind, Study};
use calib_sweep::{Candidate, Start};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// `manifest.json` of a directory of pre-trained agents.
pub type PretrainManifest = Artefact<PretrainFacts>;

/// Pre-trained agents, in their manifest.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
pub struct PretrainFacts {
    /// The study that they were made with.
    #[schemars(with = "calib_base::resolved::ResolvedStudy")]
    pub study: Study,
    /// Fingerprint of the states that agents were pre-trained on.
    pub(crate) data: Fingerprint,
    /// First and last time of these states.
    pub(crate) span: String,
    /// Time from one state to the next.
    pub(crate) period: Period,
    /// The columns of the states, with maps fitted on the whole training range.
    pub(crate) normaliser: Normaliser,
    pub(crate) agents: Vec<PretrainedAgent>,
    /// Sensors whose agents diverged, with the epoch of the divergence. They have no agent.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub(crate) diverged: BTreeMap<String, usize>,
}

impl Facts for PretrainFacts {
    const FORMAT: u32 = 2;
    const STEP: StepKind = StepKind::Pretrain;

    fn key(&self) -> &'static str {
        ""
    }
}

/// One pre-trained agent.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub(crate) struct PretrainedAgent {
    pub(crate) sensor: String,
    /// Index of its column in the states.
    pub(crate) column: usize,
    /// Fingerprint of everything that the agent depends on.
    pub(crate) key: String,
    pub(crate) agent: AgentConfig,
    /// Sizes of the layers, input first.
    pub(crate) layer_sizes: Vec<usize>,
    /// The fitted predictor that its value function is added to, if `agent.baseline` names one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) baseline: Option<FittedPredictor>,
    /// The epoch after which the checkpoint was taken.
    pub(crate) epoch: usize,
    pub(crate) curve: Vec<Epoch>,
    /// Fingerprint of each file.
    pub(crate) files: BTreeMap<String, Fingerprint>,
}

/// Returns the file names of a sensor's agent: weights, moments.
pub(super) fn names(sensor: &str) -> [String; 2] {
    ["safetensors", "moments.safetensors"].map(|kind| format!("{}.{kind}", file_name(sensor)))
}

/// Returns the fingerprint of all inputs of a pre-trained agent.
pub(crate) fn agent_key(
    study: &Study,
    data: &Fingerprint,
    sensor: &str,
    column: usize,
) -> Result<String, StepError> {
    let agent = study.pretrain.agent(&study.agent.for_sensor(sensor));
    let settings = study.pretrain.settings();
    artefact::key(&(PretrainFacts::FORMAT, data, sensor, column, agent, settings, study.seed))
}

/// A pre-trained agent, and the predictor under its value function.
pub(crate) struct TrainedAgent {
    pub(crate) pretrained: Pretrained,
    pub(crate) baseline: Option<FittedPredictor>,
}

/// Writes the files of one agent, and returns its description.
pub(crate) fn write_agent(
    directory: &Path,
    sensor: &str,
    column: usize,
    key: String,
    agent: AgentConfig,
    width: usize,
    trained: TrainedAgent,
) -> Result<PretrainedAgent, StepError> {
    let TrainedAgent { pretrained, baseline } = trained;
    let layer_sizes = layer_sizes(&agent, agent.seen_width(width));
    let [weights, moments] = names(sensor);
    let Checkpoint { parameters, moments: left } = pretrained.checkpoint;
    let metadata = BTreeMap::from([
        ("sensor".to_owned(), sensor.to_owned()),
        ("gamma".to_owned(), agent.gamma.to_string()),
        ("key".to_owned(), key.clone()),
    ]);
    let tensors = tensors_of(&layer_sizes, "", &parameters)?;
    let content = Tensors { tensors, metadata: metadata.clone() };
    write_tensors(&directory.join(&weights), &content)?;
    let mut files = vec![weights];
    if let Some(Moments { mean, square, powers }) = left {
        let mut tensors = tensors_of(&layer_sizes, "mean.", &mean)?;
        tensors.extend(tensors_of(&layer_sizes, "square.", &square)?);
        let powers = ("powers".to_owned(), serde_json::to_string(&powers)?);
        let metadata = metadata.into_iter().chain([powers]).collect();
        write_tensors(&directory.join(&moments), &Tensors { tensors, metadata })?;
        files.push(moments);
    }
    Ok(PretrainedAgent {
        sensor: sensor.to_owned(),
        column,
        key,
        agent,
        layer_sizes,
        baseline,
        epoch: pretrained.epoch,
        curve: pretrained.curve,
        files: artefact::fingerprints(directory, files.iter().map(String::as_str))?,
    })
}

/// Returns the tensors of a network with these parameters, or of their moments, with a prefix to their names.
fn tensors_of(
    layer_sizes: &[usize],
    prefix: &str,
    values: &[f32],
) -> Result<Vec<Tensor>, StepError> {
    let mut tensors = Mlp::from_parameters(layer_sizes, values)?.to_tensors(Naming::Sequential);
    for tensor in &mut tensors {
        tensor.name.insert_str(0, prefix);
    }
    Ok(tensors)
}

/// Reads the files that [`write_agent`] wrote.
fn read_agent(
    directory: &Path,
    agent: &PretrainedAgent,
    rule: MomentsRule,
    command: &str,
) -> Result<Checkpoint, StepError> {
    artefact::check_files(directory, &agent.files, command)?;
    let [weights, moments] = names(&agent.sensor);
    let sizes = &agent.layer_sizes;
    let read =
        |name: &str| -> Result<Tensors, StepError> { Ok(read_tensors(&directory.join(name))?) };
    let moments = match rule {
        MomentsRule::Reset => None,
        MomentsRule::Keep => {
            ensure!(
                agent.files.contains_key(&moments),
                "pretrain.moments = \"keep\" wants an optimiser with moments; \
                 the agent for {} was pre-trained with sgd",
                agent.sensor
            );
            let file = read(&moments)?;
            let powers = file.metadata.get("powers").context("no powers in the metadata")?;
            Some(Moments {
                mean: parameters(&file, "mean.", sizes)?,
                square: parameters(&file, "square.", sizes)?,
                powers: serde_json::from_str(powers)?,
            })
        }
    };
    Ok(Checkpoint { parameters: parameters(&read(&weights)?, "", sizes)?, moments })
}

/// Reads the parameters of a network of these layers, or their moments, from the tensors with a prefix.
fn parameters(file: &Tensors, prefix: &str, layer_sizes: &[usize]) -> Result<Vec<f32>, StepError> {
    let network = Mlp::from_tensors(file, prefix, Naming::Sequential)?;
    let sizes: Vec<usize> = [network.inputs()]
        .into_iter()
        .chain(network.layers().iter().map(|layer| layer.outputs))
        .collect();
    ensure!(sizes == layer_sizes, "layers of {sizes:?}, expected {layer_sizes:?}");
    Ok(network.parameters().to_vec())
}

/// Returns the learning curves, one row per epoch of an agent.
pub(crate) fn curves(agents: &[PretrainedAgent]) -> Table {
    let rows: Vec<(&str, Epoch)> = agents
        .iter()
        .flat_map(|agent| agent.curve.iter().map(|&epoch| (agent.sensor.as_str(), epoch)))
        .collect();
    let column = |value: fn(&Epoch) -> f64| rows.iter().map(|(_, epoch)| value(epoch)).collect();
    let known = |value: fn(&Epoch) -> Option<f64>| {
        rows.iter().map(|(_, epoch)| value(epoch)).collect::<Vec<_>>()
    };
    Table::new()
        .with("sensor", rows.iter().map(|(sensor, _)| (*sensor).to_owned()).collect())
        .with("epoch", rows.iter().map(|(_, epoch)| epoch.epoch as u32).collect())
        .with("training_loss", column(|epoch| epoch.training_loss))
        .with("validation_loss", column(|epoch| epoch.validation_loss))
        .with_optional("validation_rmse", known(|epoch| epoch.validation_rmse))
        .with_optional("validation_nrmse", known(|epoch| epoch.validation_nrmse))
}

/// Returns the directory of a study's agents, if they are pre-trained.
fn directory(job: &Job) -> Option<PathBuf> {
    let pretrain = &job.study().pretrain;
    match &pretrain.checkpoint {
        Some(given) => Some(job.beside(given)),
        None => pretrain.is_on().then(|| job.layout().pretrain()),
    }
}

/// Returns the checkpoint for each sensor's agents, checked against the study, and notes for the
/// reader.
///
/// # Errors
/// [`StepError::Missing`] or [`StepError::Stale`] if the study's own pre-training has to run first. Returns another
/// error if the agents do not fit the study, or if those in `pretrain.checkpoint` cannot be used.
pub(crate) fn starts(
    job: &Job,
    dataset: &Dataset,
    part: Option<&PretrainPart>,
    sensors: &[(String, usize)],
    candidates: &[Candidate],
) -> Result<(BTreeMap<String, Start>, Vec<String>), StepError> {
    let found = checked_starts(job, dataset, part, sensors, candidates);
    found.map_err(|reason| {
        // No step of this study makes the agents that it takes from elsewhere.
        let is_given = job.study().pretrain.checkpoint.is_some();
        if is_given && reason.lacks_result() {
            StepError::message(format!("pretrain.checkpoint: {reason}"))
        } else {
            reason
        }
    })
}

fn checked_starts(
    job: &Job,
    dataset: &Dataset,
    part: Option<&PretrainPart>,
    sensors: &[(String, usize)],
    candidates: &[Candidate],
) -> Result<(BTreeMap<String, Start>, Vec<String>), StepError> {
    let study = job.study();
    let (Some(directory), Some(part)) = (directory(job), part) else {
        return Ok((BTreeMap::new(), vec![]));
    };
    let command = job.command(StepKind::Pretrain);
    let is_given = study.pretrain.checkpoint.is_some();
    let manifest: PretrainManifest =
        if is_given { given(&directory)? } else { artefact::require(&directory, &command)? };
    check_columns(&directory, &manifest, dataset)
        .map_err(|reason| StepError::Stale(reason.to_string()))?;
    if manifest.data != part.fingerprint {
        return Err(StepError::Stale(format!(
            "the agents in {} were pre-trained on {}, and the study gives {} to pre-training; {}",
            directory.display(),
            manifest.span,
            span(&part.frames)?,
            match &study.pretrain.checkpoint {
                Some(_) => "give both studies the same [data], [preprocess] and periods".to_owned(),
                None => format!("run `{command}` again"),
            }
        )));
    }
    if !is_given {
        let kept = StoredArtefact {
            step: StepKind::Pretrain,
            study: &manifest.study,
            directory: &directory,
        };
        kept.check(job)?;
    }
    let mut starts = BTreeMap::new();
    for (sensor, column) in sensors {
        let agent = manifest.agents.iter().find(|agent| agent.sensor == *sensor);
        let again = format!("run `{command}` again");
        let remedy = if is_given { PRETRAIN_THERE } else { &again };
        let agent = agent.ok_or_else(|| no_agent(sensor, &directory, &manifest, remedy))?;
        ensure!(
            !is_given || artefact::are_whole(&directory, &agent.files),
            "pretrain.checkpoint: files of the agent for {sensor} in {} are missing, damaged or replaced; {PRETRAIN_THERE}",
            directory.display()
        );
        if !is_given && agent.key != agent_key(study, &part.fingerprint, sensor, *column)? {
            return Err(StepError::Stale(format!(
                "the agent for {sensor} in {} was pre-trained otherwise; run `{command}` again",
                directory.display()
            )));
        }
        for candidate in candidates {
            check_candidate(&directory, agent, candidate, dataset.train.states().columns())?;
            ensure!(
                study.pretrain.moments == MomentsRule::Reset
                    || candidate.agent.optimiser == agent.agent.optimiser,
                "pretrain.moments = \"keep\" wants the optimiser that the agent for {sensor} was pre-trained with, and \
                 {} has another; sweep one optimiser, or use pretrain.moments = \"reset\"",
                candidate.label()
            );
        }
        let checkpoint = read_agent(&directory, agent, study.pretrain.moments, &command)
            .with_context(|| format!("the agent for {sensor} in {}", directory.display()))?;
        let inputs = match &agent.baseline {
            None => serde_json::to_vec(&(&agent.files, study.pretrain.moments))?,
            Some(baseline) => {
                serde_json::to_vec(&(&agent.files, study.pretrain.moments, baseline))?
            }
        };
        let baseline = agent.baseline.clone();
        let start = Start { checkpoint, baseline, fingerprint: Fingerprint::of(&inputs) };
        starts.insert(sensor.clone(), start);
    }
    Ok((starts, vec![note(study, part, dataset)?]))
}

/// What to do if the folder of `pretrain.checkpoint` lacks something. The study itself cannot pre-train.
const PRETRAIN_THERE: &str = "pre-train there, or correct pretrain.checkpoint";

/// Reads the manifest of the agents in the folder of `pretrain.checkpoint`.
fn given(directory: &Path) -> Result<PretrainManifest, StepError> {
    let path = directory.join(MANIFEST);
    ensure!(
        path.exists(),
        "pretrain.checkpoint: {} does not exist; {PRETRAIN_THERE}",
        path.display()
    );
    artefact::read(directory).with_context(|| {
        format!(
            "pretrain.checkpoint: {} is no list of agents that this calib can read; {PRETRAIN_THERE}",
            path.display()
        )
    })
}

/// Returns the error that the agents of `manifest` do not predict `sensor`.
fn no_agent(
    sensor: &str,
    directory: &Path,
    manifest: &PretrainManifest,
    remedy: &str,
) -> StepError {
    let known: Vec<&str> = manifest.agents.iter().map(|agent| agent.sensor.as_str()).collect();
    let reason = format!(
        "no agent in {} predicts {sensor}: it has {}; {remedy}",
        directory.display(),
        known.join(", ")
    );
    // An agent that diverged would diverge again.
    if manifest.diverged.contains_key(sensor) {
        StepError::message(reason)
    } else {
        StepError::Stale(reason)
    }
}

/// Returns a note on the data of the pre-training, and on the data for choosing a setting.
fn note(study: &Study, part: &PretrainPart, dataset: &Dataset) -> Result<String, StepError> {
    let rest = if study.has_model() {
        "the calibration model is built from"
    } else {
        "log replay replays"
    };
    let [learned, chosen] = [span(&part.frames)?, span(&dataset.train)?];
    Ok(format!("agents start from what they learned from {learned}; {rest} {chosen}"))
}

fn check_columns(
    directory: &Path,
    manifest: &PretrainManifest,
    dataset: &Dataset,
) -> Result<(), StepError> {
    let made = &manifest.normaliser;
    let now = &dataset.normaliser;
    ensure!(
        made.len() == now.len(),
        "the agents in {} see states of {} columns, and the study's states have {}; \
         pre-train again with the present [data] and [preprocess]",
        directory.display(),
        made.len(),
        now.len()
    );
    for (number, (made, now)) in made.columns().iter().zip(now.columns()).enumerate() {
        ensure!(
            made.name == now.name,
            "column {number} of the states is {} for the agents in {}, and {} in the study; \
             pre-train again with the present [data] and [preprocess]",
            made.name,
            directory.display(),
            now.name
        );
        ensure!(
            made.bounds == now.bounds,
            "column {} was normalised otherwise for the agents in {} ({} + {} x value, now {} + {} x value): \
             the training range or [preprocess] differs; pre-train again",
            made.name,
            directory.display(),
            made.bounds.offset,
            made.bounds.scale,
            now.bounds.offset,
            now.bounds.scale
        );
    }
    ensure!(
        manifest.period == dataset.period,
        "the agents in {} learned at {} s a step, and the study has {} s; pre-train again",
        directory.display(),
        manifest.period.as_secs(),
        dataset.period.as_secs()
    );
    Ok(())
}

/// Checks that a setting has the same value function and the same return as the pre-trained agent.
fn check_candidate(
    directory: &Path,
    agent: &PretrainedAgent,
    candidate: &Candidate,
    width: usize,
) -> Result<(), StepError> {
    ensure!(
        candidate.agent.traces == agent.agent.traces,
        "{} sees traces of {:?} and the agent for {} in {} was pre-trained with {:?}; give both the same",
        candidate.label(),
        candidate.agent.traces,
        agent.sensor,
        directory.display(),
        agent.agent.traces
    );
    ensure!(
        candidate.agent.baseline == agent.agent.baseline,
        "{} has another agent.baseline than the agent for {} in {} was pre-trained with; give both the same",
        candidate.label(),
        agent.sensor,
        directory.display()
    );
    let sizes = layer_sizes(&candidate.agent, candidate.agent.seen_width(width));
    ensure!(
        sizes == agent.layer_sizes,
        "{} has layers of {sizes:?} units and the agent for {} in {} has {:?}: what was pre-trained keeps its shape; \
         sweep something else, or pre-train again with another [agent]",
        candidate.label(),
        agent.sensor,
        directory.display(),
        agent.layer_sizes
    );
    ensure!(
        candidate.agent.gamma_for(&agent.sensor) == agent.agent.gamma,
        "{} predicts returns with gamma = {} and the agent for {} in {} was pre-trained with gamma = {}; \
         give both the same",
        candidate.label(),
        candidate.agent.gamma_for(&agent.sensor),
        agent.sensor,
        directory.display(),
        agent.agent.gamma
    );
    Ok(())
}
