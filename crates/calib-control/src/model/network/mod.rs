//! A network as the model of a log: the baseline for models of neighbours.

mod config;
mod files;
mod train;

use std::sync::Arc;

use calib_core::{Monitor, Rng, Seed, States};
use calib_files::FileError;
use calib_knn::Blocks;
use calib_nn::{Mlp, Workspace};
use rayon::prelude::*;

use super::{ActionModel, ActionModelKind, Coverage, Ensemble, ModelEnvironment};
use crate::{ControlError, Decisions, Ending, Environment, Outcome};
pub use config::NetworkConfig;
use files::NetworkFile;
pub use files::NetworkFiles;
use train::{Scale, Scales, train};

/// Networks that predict (s, a) → (s', r, whether s' is terminal).
///
/// The input is the state, each column less its mean over the log and divided by its standard deviation, and a 1 in the place of the
/// action. The outputs are (s' − s) / σ, the reward less its mean in its standard deviations, and the log-odds of a terminal. A step takes
/// the mean, so it is deterministic. It is terminal where that is more likely than not. States and rewards are cut to the range of the log.
/// Ensemble member m does not train on block m, which selects its best network.
#[derive(Clone, Debug)]
pub struct NetworkModel {
    starts: States,
    scales: Scales,
    /// One network per ensemble member; `None` for members that were left out.
    networks: Vec<Option<Mlp>>,
    /// Why a trained network could not be stored.
    unstored: Option<Arc<FileError>>,
}

/// A network of an ensemble member, and why it could not be stored.
struct Trained {
    network: Mlp,
    unstored: Option<FileError>,
}

impl NetworkModel {
    /// Trains networks on `log`. Episodes begin in one of `starts`, chosen uniformly. The result does not depend on the number of threads.
    ///
    /// # Errors
    /// If a field is not valid, there are no starts, the log has too few transitions for its members, a network diverged, or the monitor
    /// interrupts.
    pub fn train(
        log: &Decisions,
        starts: States,
        config: &NetworkConfig,
        seed: Seed,
        monitor: &dyn Monitor,
    ) -> Result<Self, ControlError> {
        // `Blocks::new` refuses more members than transitions.
        let members: Vec<usize> = (0..config.members.min(log.len())).collect();
        Self::train_members(log, starts, config, &members, seed, None, monitor)
    }

    /// Trains the networks of these ensemble members alone. They equal those of [`train`](Self::train), because each has its own seed and
    /// its own part of the log. The other members have no network. Networks that are in `files` are read, and the others are written there.
    /// If that fails, [`unstored`](Self::unstored) says why.
    ///
    /// # Errors
    /// As [`train`](Self::train).
    ///
    /// # Panics
    /// If there is no such member.
    pub fn train_members(
        log: &Decisions,
        starts: States,
        config: &NetworkConfig,
        members: &[usize],
        seed: Seed,
        files: Option<&NetworkFiles>,
        monitor: &dyn Monitor,
    ) -> Result<Self, ControlError> {
        config.check()?;
        if starts.rows() == 0 {
            return Err(ControlError::NoStarts);
        }
        let blocks = Blocks::new(log.transitions(), config.members)?;
        let scales = Scales::new(log);
        monitor.begin("networks", (members.len() * config.updates) as u64);
        let trained = members
            .par_iter()
            .map(|&member: &usize| -> Result<Trained, ControlError> {
                let file = files.map(|files| files.of_member(member, config, seed));
                if let Some(network) = file.as_ref().and_then(NetworkFile::read) {
                    monitor.advance(config.updates as u64);
                    return Ok(Trained { network, unstored: None });
                }
                let seed = seed.child("network").number(member as u64);
                let network = train(log, &scales, (&blocks, member), config, seed, monitor)?;
                let unstored = file.and_then(|file| file.write(&network).err());
                Ok(Trained { network, unstored })
            })
            .collect::<Result<Vec<Trained>, ControlError>>()?;
        let mut networks = vec![None; config.members];
        let mut unstored = None;
        for (&member, trained) in members.iter().zip(trained) {
            networks[member] = Some(trained.network);
            unstored = unstored.or(trained.unstored);
        }
        Ok(Self { starts, scales, networks, unstored: unstored.map(Arc::new) })
    }

    /// Returns why trained networks could not be stored, such as a full disk. `None` if all were, if none were to be, or where nothing may
    /// be written.
    pub fn unstored(&self) -> Option<&FileError> {
        self.unstored.as_deref()
    }
}

/// Buffers for the steps of a network, which fit all ensemble members.
#[derive(Clone, Debug)]
pub struct NetworkWorkplace {
    workspace: Workspace,
    input: Vec<f32>,
}

impl NetworkModel {
    /// Returns buffers for steps.
    ///
    /// # Panics
    /// If no member has a network.
    pub fn workplace(&self) -> NetworkWorkplace {
        let Some(network) = self.networks.iter().flatten().next() else {
            panic!("no member has a network");
        };
        let input = vec![0.0; network.inputs()];
        NetworkWorkplace { workspace: Workspace::new(network, 1), input }
    }

    /// Takes `action` in ensemble member `member`. `state` becomes the next state.
    ///
    /// # Panics
    /// If there is no such member or action, or the member has no network.
    pub fn step(
        &self,
        member: usize,
        action: usize,
        place: &mut NetworkWorkplace,
        state: &mut [f32],
    ) -> Outcome {
        let scales = &self.scales;
        scales.put_input(state, action, &mut place.input);
        let Some(network) = &self.networks[member] else {
            panic!("member {member} has no network");
        };
        let output = network.forward(&place.input, &mut place.workspace);
        let (changes, rest) = output.split_at(state.len());
        for ((value, change), column) in state.iter_mut().zip(changes).zip(&scales.columns) {
            let Scale { lowest, highest, .. } = column.values;
            *value = (*value + change * column.change).clamp(lowest, highest);
        }
        let reward = &scales.reward;
        let got = (reward.mean + rest[0] * reward.std).clamp(reward.lowest, reward.highest);
        Outcome { reward: f64::from(got), ending: Ending::terminal_if(rest[1] > 0.0) }
    }
}

impl NetworkModel {
    /// Trains the networks that belong to a model of neighbours: on the same log, with as many members and the same starts. `seed`
    /// is the seed of all random numbers for agents in the model. Networks that are in `files` are read.
    ///
    /// # Errors
    /// As [`train_members`](Self::train_members).
    pub fn for_model(
        model: &ActionModel,
        seed: Seed,
        files: Option<&NetworkFiles>,
        monitor: &dyn Monitor,
    ) -> Result<Self, ControlError> {
        let members: Vec<usize> = (0..model.members()).collect();
        Self::for_members(model, &members, seed, files, monitor)
    }

    /// Trains the networks of these ensemble members alone, as [`train_members`](Self::train_members) does.
    ///
    /// # Errors
    /// As [`train_members`](Self::train_members).
    pub fn for_members(
        model: &ActionModel,
        members: &[usize],
        seed: Seed,
        files: Option<&NetworkFiles>,
        monitor: &dyn Monitor,
    ) -> Result<Self, ControlError> {
        let (config, seed) = training_for(model, seed);
        let starts = model.starts().clone();
        Self::train_members(model.log(), starts, &config, members, seed, files, monitor)
    }

    /// Returns how many of these ensemble members have no valid file, so that [`for_members`](Self::for_members) trains their networks.
    pub fn count_untrained(
        model: &ActionModel,
        members: &[usize],
        seed: Seed,
        files: &NetworkFiles,
    ) -> usize {
        let (config, seed) = training_for(model, seed);
        let files = members.iter().map(|&member| files.of_member(member, &config, seed));
        files.filter(|file| file.read().is_none()).count()
    }
}

/// Returns the training of the networks that belong to a model, and its seed. `seed` is that of all random numbers for agents in the model.
fn training_for(model: &ActionModel, seed: Seed) -> (NetworkConfig, Seed) {
    let config = NetworkConfig { members: model.members(), ..NetworkConfig::default() };
    (config, seed.child("networks"))
}

impl Ensemble for NetworkModel {
    type Rollout<'a> = NetworkRollout<'a>;

    fn kind(&self) -> ActionModelKind {
        ActionModelKind::Network
    }

    fn members(&self) -> usize {
        self.networks.len()
    }

    fn rollout(&self, member: usize) -> NetworkRollout<'_> {
        assert!(member < self.members(), "a member of the ensemble");
        NetworkRollout { model: self, member, place: self.workplace(), steps: 0 }
    }
}

/// An agent's rollout in a network.
#[derive(Clone, Debug)]
pub struct NetworkRollout<'a> {
    model: &'a NetworkModel,
    member: usize,
    place: NetworkWorkplace,
    steps: u64,
}

impl ModelEnvironment for NetworkRollout<'_> {
    /// A network cannot tell which steps the log covers, so no step counts as uncovered.
    fn coverage(&self) -> Coverage {
        Coverage { steps: self.steps, ..Coverage::default() }
    }
}

impl Environment for NetworkRollout<'_> {
    fn actions(&self) -> usize {
        self.model.scales.actions
    }

    fn columns(&self) -> usize {
        self.model.starts.columns()
    }

    fn start(&mut self, rng: &mut Rng, state: &mut [f32]) {
        state.copy_from_slice(self.model.starts.row(rng.below(self.model.starts.rows())));
    }

    fn step(&mut self, action: usize, _rng: &mut Rng, state: &mut [f32]) -> Outcome {
        self.steps += 1;
        self.model.step(self.member, action, &mut self.place, state)
    }
}

#[cfg(test)]
mod tests;
