//! Pre-training in several processes, each for some of the sensors, and merging of their agents.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::Path,
};

use calib_agent::{PretrainingDiverged, StateFile};
use calib_base::{
    StepError, artefact,
    log::partition::Parts,
    outcome::Outcome,
    output::{Printer, counted},
};
use calib_files::{
    FileError, file_name, is_temporary, link_or_copy, read_sealed_json, remove_known,
    write_sealed_json,
};
use calib_study::{Job, Share, StepKind};
use serde::{Deserialize, Serialize};

use crate::agents::{
    pretrain_files::{self, PretrainedAgent, write_agent},
    train::{AgentToTrain, train},
};

/// The folder for results of shares, below the directory of the agents. It is removed after they are merged.
const SHARES: &str = "shares";

/// Suffix of the state of an unfinished training, and the number of key digits before it.
const UNFINISHED: &str = ".unfinished.safetensors";
const KEY_DIGITS: usize = 16;

/// The result of pre-training for a sensor.
#[derive(Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum TrainingEnd {
    Trained(Box<PretrainedAgent>),
    Diverged { key: String, epoch: usize },
}

/// The agents that shares have trained.
#[derive(Default)]
pub(super) struct AgentsOfShares {
    pub(super) agents: BTreeMap<String, PretrainedAgent>,
    /// The epoch in which the agent of a sensor diverged.
    pub(super) diverged: BTreeMap<String, usize>,
}

impl AgentsOfShares {
    pub(super) fn has(&self, sensor: &str) -> bool {
        self.agents.contains_key(sensor) || self.diverged.contains_key(sensor)
    }

    pub(super) fn len(&self) -> usize {
        self.agents.len() + self.diverged.len()
    }

    pub(super) fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// Returns the results of shares for agents that are `wanted` and not `done`. Damaged files and files of other
/// trainings are ignored.
pub(super) fn finished(
    directory: &Path,
    wanted: &[AgentToTrain],
    done: &BTreeMap<String, PretrainedAgent>,
) -> AgentsOfShares {
    let mut found = AgentsOfShares::default();
    for AgentToTrain { sensor, key, .. } in
        wanted.iter().filter(|agent| !done.contains_key(&agent.sensor))
    {
        match read_sealed_json(&record(directory, sensor)) {
            Ok(TrainingEnd::Trained(agent))
                if agent.key == *key
                    && artefact::are_whole(&directory.join(SHARES), &agent.files) =>
            {
                found.agents.insert(sensor.clone(), *agent);
            }
            Ok(TrainingEnd::Diverged { key: own, epoch }) if own == *key => {
                found.diverged.insert(sensor.clone(), epoch);
            }
            _ => {}
        }
    }
    found
}

/// Pre-trains the `missing` agents of a share. Every agent has its own files, so that shares need no common lock.
pub(super) fn run(
    share: Share,
    job: &Job,
    parts: &Parts,
    wanted: &[AgentToTrain],
    missing: &[&AgentToTrain],
    printer: &Printer,
) -> Result<Outcome, StepError> {
    let study = job.study();
    let directory = job.layout().pretrain();
    artefact::own(&directory)?;
    let own: Vec<&str> = wanted
        .iter()
        .enumerate()
        .filter(|(place, _)| share.has(*place))
        .map(|(_, wanted)| wanted.sensor.as_str())
        .collect();
    let left: Vec<&AgentToTrain> =
        missing.iter().filter(|agent| own.contains(&agent.sensor.as_str())).copied().collect();
    let keys: Vec<&str> = left.iter().map(|wanted| wanted.key.as_str()).collect();
    // Named after its inputs, because other shares store their states in the same folder.
    let key = artefact::key(&keys)?;
    let name = format!("{}{UNFINISHED}", &key[..KEY_DIGITS]);
    let file = StateFile::new(directory.join(SHARES).join(name), key);
    let width = parts.dataset.train.states().columns();
    let trained = train(study, parts, &left, Some(&file), &printer.progress())?;
    for (AgentToTrain { sensor, column, key }, ended) in left.iter().zip(trained) {
        let ended = match ended {
            Ok(pretrained) => {
                let config = study.pretrain.agent(&study.agent.for_sensor(sensor));
                // Kept apart from the agents in the manifest until all are there.
                let place = directory.join(SHARES);
                let agent =
                    write_agent(&place, sensor, *column, key.clone(), config, width, pretrained)?;
                TrainingEnd::Trained(Box::new(agent))
            }
            Err(PretrainingDiverged { epoch }) => {
                printer.warn(&format!("pre-training for {sensor} diverged in epoch {epoch}"));
                TrainingEnd::Diverged { key: key.clone(), epoch }
            }
        };
        write_sealed_json(&record(&directory, sensor), &ended)?;
    }
    file.remove();
    let made = finished(&directory, wanted, &BTreeMap::new());
    let diverged: Vec<&str> =
        own.iter().copied().filter(|sensor| made.diverged.contains_key(*sensor)).collect();
    printer.result(&format!(
        "share {share}: {} pre-trained, of {} in all",
        counted(own.len() - diverged.len(), "agent"),
        wanted.len()
    ))?;
    printer.next(&[job.command(StepKind::Pretrain)]);
    if diverged.is_empty() {
        return Ok(Outcome::Done);
    }
    printer.error(&format!("the agents for {} diverged", diverged.join(", ")));
    Ok(Outcome::Negative)
}

/// Links or copies the agents of shares to their final folder.
pub(super) fn take(directory: &Path, found: &AgentsOfShares) -> Result<(), StepError> {
    for name in found.agents.values().flat_map(|agent| agent.files.keys()) {
        link_or_copy(&directory.join(SHARES).join(name), &directory.join(name))?;
    }
    Ok(())
}

/// Removes the files of shares, after all agents are in the manifest. Other files stay.
pub(super) fn remove(directory: &Path, wanted: &[AgentToTrain]) -> Result<(), FileError> {
    let shares = directory.join(SHARES);
    let mut own: BTreeSet<String> = BTreeSet::new();
    for AgentToTrain { sensor, .. } in wanted {
        own.extend(pretrain_files::names(sensor));
        own.insert(record_name(sensor));
    }
    own.extend(of_others(&shares));
    remove_known(&shares, &mut |path: &Path| {
        let name = path.to_str().unwrap_or_default();
        is_unfinished(name) || is_temporary(path) || own.contains(name)
    })
}

/// Whether a file is named like the state of an unfinished training.
fn is_unfinished(name: &str) -> bool {
    name.strip_suffix(UNFINISHED).is_some_and(|key| {
        key.len() == KEY_DIGITS && key.bytes().all(|digit| digit.is_ascii_hexdigit())
    })
}

/// Returns files of sensors that the study used before, found by their records.
fn of_others(shares: &Path) -> Vec<String> {
    let mut found = Vec::new();
    for entry in fs::read_dir(shares).into_iter().flatten().flatten() {
        let Ok(ended) = read_sealed_json::<TrainingEnd>(&entry.path()) else { continue };
        found.push(entry.file_name().to_string_lossy().into_owned());
        if let TrainingEnd::Trained(agent) = ended {
            found.extend(agent.files.into_keys());
        }
    }
    found
}

fn record(directory: &Path, sensor: &str) -> std::path::PathBuf {
    directory.join(SHARES).join(record_name(sensor))
}

fn record_name(sensor: &str) -> String {
    format!("{}.json", file_name(sensor))
}
