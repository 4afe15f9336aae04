//! Models that are networks: trained, stored as weights, opened.

use std::{
    io::Write as _,
    path::{Path, PathBuf},
    time::Duration,
};

use calib_base::{
    Context as _, StepError,
    artefact::{self, Manifest as _},
    bail,
    clock::Stopwatch,
    cost::{StepCost, processor_secs},
    ensure, memory,
    options::Device,
    output::{Printer, bytes, count, counted},
    torch,
};
use calib_core::{Monitor, Seed, Transitions};
use calib_data::Dataset;
use calib_dynamics::{
    Dynamics, DynamicsConfig, FeedForward, FeedForwardTrainer, Recurrent, RecurrentTrainer,
    Residuals, Trainer, TrainingRecord, Transitioning,
};
use calib_files::{
    CheckpointFile, Fingerprint, fingerprint_file, read_regular, read_tensors, remove_file,
    write_atomically, write_json, write_tensors,
};
use calib_model::ModelKind;
use calib_nn::Mlp;
use calib_study::{Job, Study};

use super::{manifest::ModelManifest, training_summary::TrainingSummary};

/// The file of the weights.
const WEIGHTS: &str = "weights.safetensors";
/// The file of the user's own network.
const SCRIPT: &str = "model.pt";
/// The file of the residuals of its predictions.
const RESIDUALS: &str = "residuals.safetensors";
/// The file of the losses of every epoch.
const TRAINING: &str = "training.json";
/// The file from which interrupted training resumes. It is removed when training is complete.
const CHECKPOINT: &str = "checkpoint.safetensors";

/// The name of this program's own arithmetic.
const NATIVE: &str = "native arithmetic";

/// Returns the files of the model directory that only networks of this kind have.
pub(crate) fn files(kind: ModelKind) -> &'static [&'static str] {
    match kind {
        ModelKind::Knn | ModelKind::None => &[],
        ModelKind::Nn | ModelKind::Gru => &[WEIGHTS, TRAINING, RESIDUALS],
        ModelKind::Torchscript => &[SCRIPT, RESIDUALS],
    }
}

/// Checks that this program can train such models on such a device, before any work.
pub(crate) fn check_available(study: &Study, device: Option<Device>) -> Result<(), StepError> {
    match study.model.kind {
        ModelKind::Torchscript => {
            ensure!(
                study.dynamics.path.is_some(),
                "model.kind = \"torchscript\" wants dynamics.path, a file that torch.jit.save wrote"
            );
            torch::require("model.kind = \"torchscript\"")
        }
        _ if device.is_some() => torch::require("--device"),
        ModelKind::Knn | ModelKind::Nn | ModelKind::Gru | ModelKind::None => Ok(()),
    }
}

/// Returns the fingerprint of all inputs of a network. Keys that its kind does not use are excluded.
pub(crate) fn key(data: &Fingerprint, job: &Job) -> Result<String, StepError> {
    let study = job.study();
    let kind = study.model.kind;
    if kind == ModelKind::Torchscript {
        let script = fingerprint_file(&script_path(job)?)?;
        return artefact::key(&(ModelManifest::FORMAT, data, kind, script, RESIDUALS));
    }
    let unused = DynamicsConfig::default();
    let mut used = DynamicsConfig { path: None, noise: unused.noise, ..study.dynamics.clone() };
    if kind == ModelKind::Nn {
        used.sequence_length = unused.sequence_length;
        used.sequence_stride = unused.sequence_stride;
    }
    artefact::key(&(ModelManifest::FORMAT, data, kind, used, study.seed, RESIDUALS))
}

/// Returns the path of the study's `TorchScript` file. Relative paths start from the study file.
fn script_path(job: &Job) -> Result<PathBuf, StepError> {
    let path = job.study().dynamics.path.as_ref().context("dynamics.path is not set")?;
    Ok(job.beside(path))
}

/// Copies the study's `TorchScript` file to the model, after checking that it fits the states.
pub(crate) fn import(job: &Job, dataset: &Dataset, directory: &Path) -> Result<(), StepError> {
    let path = script_path(job)?;
    torch::open_script(&path, dataset.train.states().columns())?;
    let content = read_regular(&path)?;
    write_atomically(&directory.join(SCRIPT), |file| file.write_all(&content))?;
    let transitions = Transitions::new(dataset.train.segments().clone());
    let fraction = job.study().dynamics.validation_fraction;
    let data = Transitioning::new(dataset.train.states(), &transitions, fraction)?;
    write_residuals(directory, ModelKind::Torchscript, &data)
}

/// Writes the residuals of a network that was just written.
fn write_residuals(
    directory: &Path,
    kind: ModelKind,
    data: &Transitioning<'_>,
) -> Result<(), StepError> {
    let residuals = Residuals::of(&*open(directory, kind, data.columns())?, data)?;
    Ok(write_tensors(&directory.join(RESIDUALS), &residuals.to_tensors())?)
}

/// Opens the residuals that [`write_residuals`] wrote.
pub(crate) fn open_residuals(directory: &Path, columns: usize) -> Result<Residuals, StepError> {
    Ok(Residuals::from_tensors(&read_tensors(&directory.join(RESIDUALS))?, columns)?)
}

/// Reports the training that begins.
pub(crate) fn announce(study: &Study, dataset: &Dataset, printer: &Printer) {
    let config = &study.dynamics;
    let columns = dataset.train.states().columns();
    printer.say(&format!(
        "{} rows x {columns} columns in {}; {} with {} x {} units, {} epochs of mini-batches of {}; \
         expecting {} of memory",
        count(dataset.train.rows()),
        counted(dataset.train.segments().len(), "segment"),
        study.model_name(),
        config.hidden_layers,
        count(config.hidden_units),
        count(config.epochs),
        count(config.batch_size),
        bytes(training_bytes(study, dataset)),
    ));
}

/// Returns the memory for training on the processor: the states twice, copies of the weights, and a
/// mini-batch.
fn training_bytes(study: &Study, dataset: &Dataset) -> u64 {
    let columns = dataset.train.states().columns();
    let states = 8 * (dataset.train.rows() * columns) as u64;
    states.saturating_add(network_bytes(study, columns))
}

/// Returns the memory for training without the states.
fn network_bytes(study: &Study, columns: usize) -> u64 {
    let config = &study.dynamics;
    match study.model.kind {
        ModelKind::Nn => calib_nn::training_bytes(&layer_sizes(config, columns), config.batch_size),
        ModelKind::Gru => calib_dynamics::recurrent_training_bytes(config, columns),
        ModelKind::Knn | ModelKind::Torchscript | ModelKind::None => 0,
    }
}

/// Returns the number of units of each layer of a feed-forward network for states of `columns` columns.
fn layer_sizes(config: &DynamicsConfig, columns: usize) -> Vec<usize> {
    let layers = std::iter::repeat_n(config.hidden_units, config.hidden_layers);
    [columns].into_iter().chain(layers).chain([columns]).collect()
}

/// A step size with which no training diverges while it is timed.
const SMALL_LEARNING_RATE: f64 = 1e-6;
/// Largest number of products of weights and states of a timed mini-batch: some tenths of a second with the gradients.
const MOST_WORK: usize = 2_000_000_000;

/// Returns the settings of a training that can be timed. Its epochs take about as long as those of `config`, whose
/// mini-batches may be larger.
fn timeable(kind: ModelKind, config: &DynamicsConfig, columns: usize) -> DynamicsConfig {
    let sizes = layer_sizes(config, columns);
    let products = sizes.windows(2).map(|layer| layer[0] * layer[1]).sum::<usize>();
    let of_item = match kind {
        // Three gates, each of the inputs and of the hidden state, for each state of a sequence.
        ModelKind::Gru => products.saturating_mul(6 * config.sequence_length),
        _ => products,
    };
    let batch_size = (MOST_WORK / of_item.max(1)).max(2).min(config.batch_size);
    DynamicsConfig { batch_size, learning_rate: SMALL_LEARNING_RATE, ..config.clone() }
}

/// Returns the expected cost of training the network on this processor, from some updates of one like it. `None` if it
/// is trained elsewhere, does not fit into memory, or makes no update while it is timed.
pub(super) fn cost(
    study: &Study,
    dataset: &Dataset,
    monitor: &dyn Monitor,
) -> Result<Option<StepCost>, StepError> {
    let memory = training_bytes(study, dataset);
    if !memory::fits(memory) {
        return Ok(None);
    }
    let states = dataset.train.states();
    let config = timeable(study.model.kind, &study.dynamics, states.columns());
    let transitions = Transitions::new(dataset.train.segments().clone());
    let data = Transitioning::new(states, &transitions, config.validation_fraction)?;
    let seed = Seed::new(study.seed).child("dynamics");
    let mut trainer: Box<dyn Trainer + '_> = match study.model.kind {
        ModelKind::Nn => Box::new(FeedForwardTrainer::new(&data, &config, seed)),
        ModelKind::Gru => Box::new(RecurrentTrainer::new(&data, &config, seed)?),
        ModelKind::Knn | ModelKind::Torchscript | ModelKind::None => return Ok(None),
    };
    // The weights, and the checkpoint until the end.
    let arrays = [trainer.weights()?, trainer.checkpoint()?];
    let values = arrays.iter().flat_map(|arrays| &arrays.tensors).map(|array| array.values.len());
    let disk = 4 * values.sum::<usize>() as u64;
    let epoch = processor_secs(monitor, |monitor| {
        monitor.begin("training", trainer.updates_per_epoch() as u64);
        trainer.epoch(monitor)
    })?;
    Ok(epoch.map(|secs| StepCost { processor_secs: secs * config.epochs as f64, memory, disk }))
}

/// Returns a network of the study's shape for states of `columns` columns, which has learned nothing. `None` if the
/// study does not give its shape, or its training does not fit into memory.
pub(crate) fn untrained(
    study: &Study,
    columns: usize,
) -> Result<Option<Box<dyn Dynamics>>, StepError> {
    let needed = network_bytes(study, columns);
    if !memory::fits(needed) {
        return Ok(None);
    }
    let config = &study.dynamics;
    let seed = Seed::new(study.seed).child("dynamics");
    let network: Box<dyn Dynamics> = match study.model.kind {
        ModelKind::Nn => Box::new(FeedForward::new(Mlp::new(&layer_sizes(config, columns), seed))?),
        ModelKind::Gru => {
            let DynamicsConfig { hidden_units, hidden_layers, sequence_length, .. } = *config;
            let history = sequence_length.saturating_sub(1);
            Box::new(Recurrent::random(columns, hidden_units, hidden_layers, history, seed))
        }
        ModelKind::Knn | ModelKind::Torchscript | ModelKind::None => return Ok(None),
    };
    Ok(Some(network))
}

/// Refuses training that does not fit in memory. The memory of libtorch depends on the device.
fn check_memory(study: &Study, dataset: &Dataset, device: Option<Device>) -> Result<(), StepError> {
    let is_native = matches!(study.model.kind, ModelKind::Nn | ModelKind::Gru) && device.is_none();
    if !is_native {
        return Ok(());
    }
    Ok(memory::require(
        training_bytes(study, dataset),
        "training the network",
        "lower dynamics.hidden_units, dynamics.hidden_layers or dynamics.batch_size",
    )?)
}

/// Trains the network of the study, resuming from a checkpoint if there is one, and writes its
/// weights.
pub(crate) fn train(
    study: &Study,
    dataset: &Dataset,
    key: &str,
    directory: &Path,
    device: Option<Device>,
    printer: &Printer,
) -> Result<TrainingSummary, StepError> {
    check_memory(study, dataset, device)?;
    let transitions = Transitions::new(dataset.train.segments().clone());
    let config = &study.dynamics;
    let fraction = config.validation_fraction;
    let data = Transitioning::new(dataset.train.states(), &transitions, fraction)?;
    let seed = Seed::new(study.seed).child("dynamics");
    let checkpoint = CheckpointFile::new(directory.join(CHECKPOINT), key.to_owned());
    let found = checkpoint.read();
    let (mut trainer, backend): (Box<dyn Trainer + '_>, String) = match (study.model.kind, device) {
        (ModelKind::Nn, None) => {
            let trainer = match &found {
                Some(found) => FeedForwardTrainer::new(&data, config, seed).resumed(found)?,
                None => FeedForwardTrainer::new(&data, config, seed),
            };
            (Box::new(trainer), NATIVE.to_owned())
        }
        (ModelKind::Gru, None) => {
            let trainer = match &found {
                Some(found) => RecurrentTrainer::new(&data, config, seed)?.resumed(found)?,
                None => RecurrentTrainer::new(&data, config, seed)?,
            };
            (Box::new(trainer), NATIVE.to_owned())
        }
        (kind, device) => {
            let device = device.unwrap_or(Device::Auto);
            torch::trainer(kind, &data, config, seed, device, found.as_ref())?
        }
    };
    let done = trainer.record().epochs.len();
    if done > 0 {
        printer.say(&format!("going on after epoch {} of {}", count(done), count(config.epochs)));
    }
    run_epochs(&mut *trainer, config, &checkpoint, printer)?;
    write_tensors(&directory.join(WEIGHTS), &trainer.weights()?)?;
    write_json(&directory.join(TRAINING), trainer.record())?;
    write_residuals(directory, study.model.kind, &data)?;
    remove_checkpoint(directory)?;
    summary(trainer.record(), &data, backend)
}

/// Runs all remaining epochs.
fn run_epochs(
    trainer: &mut dyn Trainer,
    config: &DynamicsConfig,
    checkpoint: &CheckpointFile,
    printer: &Printer,
) -> Result<(), StepError> {
    let progress = printer.progress();
    let left = config.epochs.saturating_sub(trainer.record().epochs.len());
    progress.begin("training", (left * trainer.updates_per_epoch()) as u64);
    let mut since_checkpoint = Stopwatch::start();
    let mut cost = Duration::ZERO;
    while !trainer.record().is_complete(config) {
        trainer.epoch(&progress)?;
        // Checkpoints take at most a few per cent of the time.
        if since_checkpoint.elapsed() > cost * 30 {
            let clock = Stopwatch::start();
            checkpoint.write(trainer.checkpoint()?)?;
            cost = clock.elapsed();
            since_checkpoint = Stopwatch::start();
        }
    }
    Ok(())
}

fn summary(
    record: &TrainingRecord,
    data: &Transitioning<'_>,
    backend: String,
) -> Result<TrainingSummary, StepError> {
    let kept = record.epochs.get(record.kept.wrapping_sub(1)).context("no epoch was run")?;
    Ok(TrainingSummary {
        backend,
        epochs: record.epochs.len(),
        updates: record.updates,
        kept_epoch: record.kept,
        training_loss: kept.training,
        validation_loss: kept.validation,
        persistence_loss: data.persistence_loss(),
    })
}

/// Removes the checkpoint of interrupted training.
pub(crate) fn remove_checkpoint(directory: &Path) -> Result<(), StepError> {
    Ok(remove_file(&directory.join(CHECKPOINT))?)
}

/// Opens the network in a model directory, for states of `columns` values.
pub(crate) fn open(
    directory: &Path,
    kind: ModelKind,
    columns: usize,
) -> Result<Box<dyn Dynamics>, StepError> {
    let weights = directory.join(WEIGHTS);
    Ok(match kind {
        ModelKind::Nn => Box::new(FeedForward::from_tensors(&read_tensors(&weights)?)?),
        ModelKind::Gru => Box::new(Recurrent::from_tensors(&read_tensors(&weights)?)?),
        ModelKind::Torchscript => torch::open_script(&directory.join(SCRIPT), columns)?,
        ModelKind::Knn | ModelKind::None => bail!("only a network has weights"),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the size of the mini-batches that are timed for states of five columns.
    fn timed_batch(kind: ModelKind, config: &DynamicsConfig) -> usize {
        timeable(kind, config, 5).batch_size
    }

    #[test]
    fn large_mini_batches_are_cut() {
        let config = DynamicsConfig {
            hidden_layers: 1,
            hidden_units: 1_000,
            batch_size: 1 << 20,
            sequence_length: 10,
            ..DynamicsConfig::default()
        };
        // Two layers of 5 x 1000 weights.
        assert_eq!(timed_batch(ModelKind::Nn, &config), 200_000);
        assert_eq!(timed_batch(ModelKind::Gru, &config), 3_333);
        let small = DynamicsConfig { batch_size: 1, ..config };
        assert_eq!(timed_batch(ModelKind::Nn, &small), 1);
    }
}
