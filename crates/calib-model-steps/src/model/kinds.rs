//! The calibration model of a study, of any kind. Only this module and the build steps distinguish kinds.

use std::{ops::Deref, path::Path};

use calib_base::{StepError, memory};
use calib_core::{Frames, States, Transitions};
use calib_files::ScratchPlace;
use calib_knn::{KnnModel, ModelConfig};
use calib_model::{CalibrationModel, ModelFamily, NeighborModel, NetworkModel};
use calib_study::Study;

use crate::model::train_model;

/// An opened model, by family. It is used as any [`CalibrationModel`].
pub enum OpenedModel {
    /// Tables of neighbours.
    Neighbors(NeighborModel),
    /// A network.
    Network(NetworkModel),
}

impl OpenedModel {
    /// Returns the tables, if it has any.
    pub(crate) fn tables(&self) -> Option<&KnnModel> {
        match self {
            Self::Neighbors(model) => Some(model.knn()),
            Self::Network(_) => None,
        }
    }
}

impl Deref for OpenedModel {
    type Target = dyn CalibrationModel;

    fn deref(&self) -> &Self::Target {
        match self {
            Self::Neighbors(model) => model,
            Self::Network(model) => model,
        }
    }
}

/// Opens the model in `directory` of the recorded `frames`. Neighbours are searched in `metric`; only `members` are
/// opened, or all.
///
/// # Errors
/// If a file does not exist or is damaged, or does not fit the states.
pub fn open(
    directory: &Path,
    study: &Study,
    frames: &Frames,
    metric: States,
    members: Option<&[usize]>,
) -> Result<OpenedModel, StepError> {
    let settings: &ModelConfig = &study.model;
    let recorded = frames.states().clone();
    if study.model.kind.family() == ModelFamily::Network {
        let network = train_model::open(directory, study.model.kind, recorded.columns())?;
        let model = NetworkModel::new(network, frames)?;
        let Some(noise) = study.rollout_noise() else { return Ok(OpenedModel::Network(model)) };
        let residuals = train_model::open_residuals(directory, recorded.columns())?;
        return Ok(OpenedModel::Network(model.with_noise(noise, residuals)));
    }
    let transitions = Transitions::new(frames.segments().clone());
    let count = settings.members;
    let exclusion = settings.exclusion();
    let knn = match members {
        Some(members) => {
            KnnModel::open_some(directory, metric, transitions, count, exclusion, members)
        }
        None => KnnModel::open(directory, metric, transitions, count, exclusion),
    };
    Ok(OpenedModel::Neighbors(NeighborModel::new(knn?, recorded)))
}

/// Returns the place of the large arrays of a search for start states: memory if they fit, otherwise files in
/// `directory`.
pub fn search_place(model: &dyn CalibrationModel, directory: &Path) -> ScratchPlace {
    let needed = model.search_bytes(rayon::current_num_threads());
    let fits = needed == 0 || memory::fits(needed);
    if fits { ScratchPlace::Memory } else { ScratchPlace::Disk(directory.to_owned()) }
}
