//! `control-model/`: the model with actions, which is built once and then memory-mapped. Its networks are trained at
//! their first use.

use std::{
    error::Error as _,
    path::{Path, PathBuf},
    sync::Arc,
};

use calib_base::{
    StepError,
    artefact::{self, Artefact, Below, DirectoryLock, Facts, TOOL},
    ensure,
    output::Printer,
};
use calib_control::{
    ActionModel, ActionModelRecord, ControlConfig, ControlError, Distance, NetworkFiles,
    NetworkModel, Pessimism, Rules, open_action_model, write_action_model,
};
use calib_core::{Bounds, Monitor, Period, Seed, States};
use calib_files::{
    FileError, Fingerprint, Tensors, map_npy, read_sealed_tensors, remove_known, write_npy,
};
use calib_model_steps::represent::decisions;
use calib_study::{Job, StepKind, Study};
use serde::{Deserialize, Serialize};

use super::{
    log::{self, ActionLog, Names},
    rare,
    section::no_section,
};

/// Time of every row in microseconds, `i64 [rows, 1]`.
const TIMES: &str = "times.npy";
/// Rows in which episodes begin, `u32 [starts, 1]`.
const START_ROWS: &str = "start-rows.npy";

/// A state column.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ControlColumn {
    /// The name.
    pub name: String,
    /// The map to the unit of the log.
    pub bounds: Bounds,
}

/// The meaning of the numbers in a model with actions.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ControlNames {
    /// State columns.
    pub columns: Vec<ControlColumn>,
    /// Action columns.
    pub action_columns: Vec<String>,
    /// The values that each action sets, `[levels][action columns]`.
    pub levels: Vec<Vec<f64>>,
    /// Names of the actions.
    pub actions: Vec<String>,
    /// Smallest and largest recorded value of each action column.
    pub ranges: Vec<[f64; 2]>,
    /// Whether the log has a column of terminals.
    pub has_terminals: bool,
    /// Time from one row to the next, which is the time between decisions.
    pub period: Period,
    /// Steps after which the study cuts an episode.
    pub timeout: usize,
    /// Root of the study's random seeds.
    pub seed: u64,
    /// Largest share of uncovered steps that the study accepts.
    pub most_uncovered: f64,
    /// Smallest number of terminals that the study accepts.
    pub fewest_terminals: usize,
}

/// `manifest.json` of a model with actions.
type ControlModelManifest = Artefact<ControlModelFacts>;

/// The inputs of a model with actions, and what its files mean.
#[derive(Serialize, Deserialize)]
struct ControlModelFacts {
    /// Fingerprint of the inputs.
    key: String,
    study: Study,
    /// Fingerprint of the log.
    log: Fingerprint,
    record: ActionModelRecord,
    names: ControlNames,
}

impl Facts for ControlModelFacts {
    const FORMAT: u32 = 1;
    const STEP: StepKind = StepKind::Control;

    fn key(&self) -> &str {
        &self.key
    }
}

/// A model with actions that was opened from a folder, with the meaning of its numbers.
pub struct ControlModel {
    /// The model.
    pub model: Arc<ActionModel>,
    /// The meaning of its numbers.
    pub names: ControlNames,
    /// Time of every row, in microseconds since 1970.
    pub times: Vec<i64>,
    /// Rows in which episodes begin.
    pub start_rows: Vec<u32>,
    /// Share of the recorded states that determined the radius of coverage.
    pub coverage: f64,
    /// Rows from one decision to the next.
    every: usize,
    /// Absolute path of its folder.
    directory: PathBuf,
    /// Fingerprint of its inputs.
    key: String,
}

impl ControlModel {
    /// Maps the model in a folder.
    ///
    /// # Errors
    /// Returns an error if there is none, or it was damaged.
    pub fn in_directory(directory: &Path) -> Result<Self, StepError> {
        opened(directory, "calib control STUDY")
    }

    /// Maps the model of a study.
    ///
    /// # Errors
    /// Fails as [`in_directory`](Self::in_directory) does.
    pub fn of_job(job: &Job) -> Result<Self, StepError> {
        opened(&job.layout().control_model(), &job.command(StepKind::Control))
    }

    /// Returns the reason why agents have nothing to choose in it, if its log has only one action. An earlier
    /// calib may have built it.
    pub fn only_action(&self) -> Option<String> {
        rare::only_action(&self.names.actions, self.every)
    }

    /// Returns the networks of the model, which are those of `calib control`. They are trained and stored at their first
    /// use, and read later.
    ///
    /// # Errors
    /// Returns an error if a network diverged, or the monitor interrupts.
    pub fn networks(&self, monitor: &dyn Monitor) -> Result<NetworkModel, ControlError> {
        let seed = seed(self.names.seed);
        let files = files_of_networks(&self.directory, &self.key);
        NetworkModel::for_model(&self.model, seed, files.as_ref(), monitor)
    }
}

fn opened(directory: &Path, command: &str) -> Result<ControlModel, StepError> {
    let manifest: ControlModelManifest = artefact::require(directory, command)?;
    artefact::check_files(directory, &manifest.files, command)?;
    let ControlModelFacts { key, study, record, names, .. } = manifest.facts;
    let model = open_action_model(directory, &record)?;
    let times = map_npy::<i64>(&directory.join(TIMES))?;
    let rows = map_npy::<u32>(&directory.join(START_ROWS))?;
    ensure!(
        times.rows() == model.log().states().rows() && rows.rows() == model.starts().rows(),
        "{} does not belong to its model; run `{command}` to make it again",
        directory.join(TIMES).display()
    );
    Ok(ControlModel {
        model: Arc::new(model),
        names,
        times: times.as_slice().to_vec(),
        start_rows: rows.as_slice().to_vec(),
        coverage: record.config.coverage,
        every: study.control.map_or(1, |config| config.every),
        // The process may go to another folder before it needs networks.
        directory: std::path::absolute(directory).unwrap_or_else(|_| directory.to_owned()),
        key,
    })
}

/// Returns the seed of all random numbers for agents in the model of a study with this seed.
pub(super) fn seed(study: u64) -> Seed {
    Seed::new(study).child("control")
}

/// Returns a warning if the networks could not be stored.
pub fn unstored_networks(networks: &NetworkModel) -> Option<String> {
    let error = networks.unstored()?;
    let cause = error.source().map_or_else(String::new, |cause| format!(": {cause}"));
    Some(format!(
        "the trained networks were not stored: {error}{cause}; make room for them, or they are trained again each time"
    ))
}

/// Returns the files of the networks of a study's model, if that is stored.
pub(super) fn network_files(
    job: &Job,
    config: &ControlConfig,
    log: &ActionLog,
) -> Result<Option<NetworkFiles>, StepError> {
    Ok(files_of_networks(&job.layout().control_model(), &key(job, config, log)?))
}

/// Returns the files of the networks beside the tables in `directory`, if these have the key `key`. Otherwise the folder
/// is not this model's to write to.
fn files_of_networks(directory: &Path, key: &str) -> Option<NetworkFiles> {
    let manifest: ControlModelManifest = artefact::read(directory)?;
    (manifest.key == key).then(|| NetworkFiles::new(directory, key))
}

/// Returns the fingerprint of the model's inputs. The behaviour of agents in it is not an input.
fn key(job: &Job, config: &ControlConfig, log: &ActionLog) -> Result<String, StepError> {
    let represented = match config.model.distance {
        Distance::Euclidean => None,
        Distance::Laplacian => Some((job.study().representation.candidates(), job.study().seed)),
    };
    // The rule for uncovered steps does not affect the tables.
    let model = calib_control::ActionModelConfig { pessimism: Pessimism::Nearest, ..config.model };
    let format = ControlModelFacts::FORMAT;
    let names = control_names(job.study(), config, log);
    artefact::key(&(format, TOOL, &log.fingerprint, model, config.start, represented, names))
}

/// Returns the coordinates in which the model measures distance: the states, or their representation.
fn metric(
    job: &Job,
    config: &ControlConfig,
    log: &ActionLog,
    printer: &Printer,
) -> Result<States, StepError> {
    match config.model.distance {
        Distance::Euclidean => Ok(log.decisions.states().clone()),
        Distance::Laplacian => decisions::open_or_train(job, log.material(), printer),
    }
}

/// Returns the study's rule for steps that the log does not cover.
pub(super) fn rules(config: &ControlConfig, log: &ActionLog) -> Result<Rules, StepError> {
    let recorded = log.decisions.recorded_return(config.longest_episode())?;
    let worst_return = config.worst_return.or(recorded.worst).unwrap_or(recorded.mean);
    Ok(Rules { pessimism: config.model.pessimism, worst_return })
}

/// Opens the model of a study, or builds it. If nothing may be written, it stays in memory.
pub(super) fn open_or_build(
    job: &Job,
    config: &ControlConfig,
    log: &ActionLog,
    printer: &Printer,
) -> Result<ActionModel, StepError> {
    let directory = &job.layout().control_model();
    if let Some(model) = open_kept(job, config, log)? {
        printer.say(&format!("the model in {} is up to date", directory.display()));
        return Ok(model);
    }
    let key = key(job, config, log)?;
    let rules = rules(config, log)?;
    let metric = metric(job, config, log, printer)?;
    let starts = log::starts(&log.decisions, &metric, config.start)?;
    let progress = printer.progress();
    let decisions = log.decisions.clone();
    let worst = rules.worst_return;
    let model = ActionModel::build(decisions, &metric, starts, &config.model, worst, &progress)?;
    let claim = if job.policy().share.is_none() {
        Some(DirectoryLock::new(directory, Below::Ours))
    } else {
        // Another share that writes the same files need not be waited for.
        DirectoryLock::try_new(directory, Below::Ours).transpose()
    };
    if let Some(claim) = claim {
        let written = claim.and_then(|claim| write(&claim, job, config, log, &model, &key));
        artefact::or_read_only(written, directory, printer)?;
    }
    Ok(model)
}

/// Opens the stored model of a study, if it has the same inputs and is not to be rebuilt.
pub(super) fn open_kept(
    job: &Job,
    config: &ControlConfig,
    log: &ActionLog,
) -> Result<Option<ActionModel>, StepError> {
    if job.policy().redoes() {
        return Ok(None);
    }
    let key = key(job, config, log)?;
    kept(&job.layout().control_model(), &key, rules(config, log)?, log)
}

/// Makes the representation and the model again if they exist and are damaged. Damaged networks are removed, and trained
/// again at their next use.
///
/// # Errors
/// Returns an error if a file cannot be read, for example without permission. Such a file may be intact, so it is kept.
pub(super) fn mend(
    job: &Job,
    config: &ControlConfig,
    log: &ActionLog,
    printer: &Printer,
) -> Result<(), StepError> {
    if config.model.distance == Distance::Laplacian {
        decisions::mend(job, log.material(), printer)?;
    }
    let directory = &job.layout().control_model();
    let manifest: Option<ControlModelManifest> = artefact::read(directory);
    let command = job.command(StepKind::Control);
    let is_whole = match manifest {
        None => false,
        Some(manifest) => match artefact::check_files(directory, &manifest.files, &command) {
            Ok(()) => true,
            Err(StepError::Missing(_) | StepError::Stale(_)) => false,
            Err(unread) => return Err(unread),
        },
    };
    if directory.exists() && !is_whole {
        open_or_build(job, config, log, printer)?;
    }
    let (removed, unread) = remove_damaged(directory, read_sealed_tensors);
    artefact::or_read_only(removed.map_err(StepError::from), directory, printer)?;
    Ok(unread?)
}

/// Removes the networks in a folder whose content is damaged. `read` reads one. Returns whether that succeeded, and whether the
/// others could be read.
fn remove_damaged(
    directory: &Path,
    read: impl Fn(&Path) -> Result<Tensors, FileError>,
) -> (Result<(), FileError>, Result<(), FileError>) {
    let mut unread = Ok(());
    let removed = remove_known(directory, &mut |path: &Path| {
        if !is_network(path) {
            return false;
        }
        match read(&directory.join(path)) {
            Ok(_) => false,
            Err(error) if error.is_of_content() => true,
            // Another process has just removed it.
            Err(error) if error.is_not_found() => false,
            Err(error) => {
                unread = Err(error);
                false
            }
        }
    });
    (removed, unread)
}

/// Whether a file in the folder of a model is that of a network.
fn is_network(path: &Path) -> bool {
    NetworkFiles::is_name(&path.to_string_lossy())
}

/// Opens the stored model, if it has the same inputs and is intact. It combines the stored tables with the log
/// that was read.
fn kept(
    directory: &Path,
    key: &str,
    rules: Rules,
    log: &ActionLog,
) -> Result<Option<ActionModel>, StepError> {
    let Some(manifest) = ControlModelManifest::find(directory, key) else { return Ok(None) };
    let model = open_action_model(directory, &manifest.record)?;
    Ok(Some(model.with_log(log.decisions.clone()).with_rules(rules)))
}

fn write(
    claim: &DirectoryLock,
    job: &Job,
    config: &ControlConfig,
    log: &ActionLog,
    model: &ActionModel,
    key: &str,
) -> Result<(), StepError> {
    claim.begin()?;
    let directory = &job.layout().control_model();
    remove_known(directory, &mut is_network)?;
    let (mut names, record) = write_action_model(directory, model, &config.model)?;
    write_npy(&directory.join(TIMES), &log.times, log.times.len(), 1)?;
    let starts: Vec<u32> = log::start_rows(model.log(), config.start);
    write_npy(&directory.join(START_ROWS), &starts, starts.len(), 1)?;
    names.extend([TIMES, START_ROWS].map(str::to_owned));
    let facts = ControlModelFacts {
        key: key.to_owned(),
        study: job.study().clone(),
        log: log.fingerprint.clone(),
        record,
        names: control_names(job.study(), config, log),
    };
    claim.finish(facts, names.iter().map(String::as_str)).map(drop)
}

fn control_names(study: &Study, config: &ControlConfig, log: &ActionLog) -> ControlNames {
    let Names { columns, bounds, levels, actions, ranges, .. } = &log.names;
    let columns = columns.iter().zip(bounds);
    ControlNames {
        columns: columns
            .map(|(name, &bounds)| ControlColumn { name: name.clone(), bounds })
            .collect(),
        action_columns: config.actions.clone(),
        levels: levels.clone(),
        actions: actions.clone(),
        ranges: ranges.clone(),
        has_terminals: config.terminal.is_some(),
        period: log.period,
        timeout: config.timeout,
        seed: study.seed,
        most_uncovered: config.most_uncovered,
        fewest_terminals: config.fewest_terminals,
    }
}

/// Builds the model with actions of a study, if it is missing.
pub(crate) fn build(job: &Job, printer: &Printer) -> Result<ActionModel, StepError> {
    job.refuse_deployment()?;
    let Some(config) = &job.study().control else { return Err(no_section(job)) };
    let log = log::read(job, config, printer)?;
    log.tell_doubts(printer);
    rare::check_actions(&log.names.actions, &log.decisions.counts(), config, printer)?;
    log::require_model(&log.decisions, config)?;
    open_or_build(job, config, &log, printer)
}

#[cfg(test)]
mod tests {
    use std::{fs, io};

    use calib_files::{Tensor, write_tensors};

    use super::*;

    #[test]
    fn a_network_that_cannot_be_read_is_reported_and_kept() {
        let folder = tempfile::tempdir().expect("a folder");
        let networks =
            [0, 1, 2].map(|member| folder.path().join(format!("network-{member}.safetensors")));
        let rewards = folder.path().join("rewards.npy");
        for network in &networks {
            let tensors = vec![Tensor::flat("weights", vec![0.5])];
            let content = Tensors { tensors, ..Tensors::default() };
            write_tensors(network, &content).expect("written");
        }
        fs::write(&networks[1], "damaged").expect("written");
        fs::write(&rewards, "damaged").expect("written");
        let (removed, unread) = remove_damaged(folder.path(), |path| {
            if path == networks[2] {
                // All file handles are in use.
                return Err(FileError::io("read", path, io::Error::from_raw_os_error(24)));
            }
            read_sealed_tensors(path)
        });
        removed.expect("removed");
        let told = unread.expect_err("not read").to_string();
        assert!(told.contains("network-2.safetensors"), "{told}");
        assert_eq!([0, 1, 2].map(|member| networks[member].exists()), [true, false, true]);
        assert!(rewards.exists(), "no network");
        let (removed, unread) = remove_damaged(folder.path(), read_sealed_tensors);
        assert!(removed.is_ok() && unread.is_ok() && networks[2].exists());
    }
}
