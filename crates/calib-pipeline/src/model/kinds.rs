//! The calibration model of a study, of whatever kind.

use std::path::Path;

use calib_core::{Monitor, RowIndex, Seed};
use calib_dynamics::{Dynamics, predict};
use calib_files::ScratchPlace;
use calib_knn::KnnModel;
use calib_rollout::{StartState, rollouts};
use calib_study::Study;

use crate::{
    base::memory,
    model::{model_files::OpenModel, starts::Starts, trajectory::Trajectory},
};

/// A model that can be rolled out.
pub(crate) enum Model {
    /// An ensemble whose rollouts visit recorded rows.
    Knn(Box<KnnModel>),
    /// One network whose rollouts are predictions.
    Parametric(Box<dyn Dynamics>),
}

impl Model {
    /// Number of members; a network is an ensemble of one.
    pub(crate) fn members(&self) -> usize {
        match self {
            Self::Knn(knn) => knn.members(),
            Self::Parametric(_) => 1,
        }
    }
}

/// Where a search for as many of the model's states as are in a row of its tables has its large arrays: in memory if they
/// fit, else in files in `directory`. In networks nothing is searched.
pub(crate) fn search_place(model: &Model, directory: &Path) -> ScratchPlace {
    let fits = |knn: &KnnModel| {
        let need = knn.search_need(knn.k(), rayon::current_num_threads());
        memory::available().is_none_or(|available| need.working <= available)
    };
    match model {
        Model::Knn(knn) if !fits(knn) => ScratchPlace::Disk(directory.to_owned()),
        Model::Knn(_) | Model::Parametric(_) => ScratchPlace::Memory,
    }
}

/// The rollouts of each member, as the study asks for them. Searches for start states have their large arrays in `place`.
pub(crate) fn roll_out(
    model: &OpenModel,
    study: &Study,
    starts: &Starts<'_>,
    place: &ScratchPlace,
    monitor: &dyn Monitor,
) -> anyhow::Result<Vec<Vec<Trajectory>>> {
    let config = &study.rollout;
    let seed = Seed::new(study.seed).child("rollout");
    match &model.model {
        Model::Knn(knn) => {
            let weights = study.model.weights()?;
            let starts = starts.of_members(knn, config.rollouts, place, monitor)?;
            let member = |(number, starts): (usize, &Vec<StartState>)| {
                let member = knn.member(number);
                let all = rollouts(&member, starts, config.steps, weights, seed, monitor)?;
                Ok(all.into_iter().map(Trajectory::Recorded).collect())
            };
            starts.iter().enumerate().map(member).collect()
        }
        Model::Parametric(network) => {
            let starts = starts.of_network(config.rollouts)?;
            let rows: Vec<RowIndex> = starts.iter().map(|start| start.row).collect();
            let (states, segments) = (model.frames.states(), model.frames.segments());
            let all = predict(&**network, states, segments, &rows, config.steps, monitor)?;
            let trajectories = all.into_iter().zip(starts);
            let trajectories =
                trajectories.map(|(prediction, start)| Trajectory::Predicted { prediction, start });
            Ok(vec![trajectories.collect()])
        }
    }
}
