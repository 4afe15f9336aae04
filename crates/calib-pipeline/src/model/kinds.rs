//! The calibration model of a study, of whatever kind: only here, and where it is built, it matters which.

use std::path::Path;

use calib_core::{Frames, States, Transitions};
use calib_files::ScratchPlace;
use calib_knn::{KnnModel, ModelConfig, ModelKind};
use calib_model::{CalibrationModel, NeighborModel, NetworkModel};

use crate::{base::memory, model::train_model};

/// Open the model in `directory` of what `frames` recorded. Neighbours are those of `metric`; of these `members` are opened,
/// or all.
pub(crate) fn open(
    directory: &Path,
    settings: &ModelConfig,
    frames: &Frames,
    metric: States,
    members: Option<&[usize]>,
) -> anyhow::Result<Box<dyn CalibrationModel>> {
    let recorded = frames.states().clone();
    if settings.kind != ModelKind::Knn {
        let network = train_model::open(directory, settings.kind, recorded.columns())?;
        return Ok(Box::new(NetworkModel::new(network, frames)?));
    }
    let transitions = Transitions::new(frames.segments().clone());
    let (count, exclusion) = (settings.members, settings.exclusion());
    let knn = match members {
        Some(members) => {
            KnnModel::open_some(directory, metric, transitions, count, exclusion, members)
        }
        None => KnnModel::open(directory, metric, transitions, count, exclusion),
    };
    Ok(Box::new(NeighborModel::new(knn?, recorded)))
}

/// Where a search for start states has its large arrays: in memory if they fit, else in files in `directory`.
pub(crate) fn search_place(model: &dyn CalibrationModel, directory: &Path) -> ScratchPlace {
    let needed = model.search_bytes(rayon::current_num_threads());
    let fits = needed == 0 || memory::available().is_none_or(|available| needed <= available);
    if fits { ScratchPlace::Memory } else { ScratchPlace::Disk(directory.to_owned()) }
}
