//! The calibration model of a study, of whatever kind.

use calib_core::{Monitor, RowIndex, Seed};
use calib_dynamics::{Dynamics, predict};
use calib_knn::KnnModel;
use calib_rollout::rollouts;

use super::{model_files::OpenModel, starts::Starts, trajectory::Trajectory};
use crate::study::Study;

/// A model that can be rolled out.
pub(super) enum Model {
    /// An ensemble whose rollouts visit recorded rows.
    Knn(KnnModel),
    /// One network whose rollouts are predictions.
    Parametric(Box<dyn Dynamics>),
}

impl Model {
    /// Number of members; a network is an ensemble of one.
    pub(super) fn members(&self) -> usize {
        match self {
            Self::Knn(knn) => knn.members(),
            Self::Parametric(_) => 1,
        }
    }
}

/// The rollouts of each member, as the study asks for them.
pub(super) fn roll_out(
    model: &OpenModel,
    study: &Study,
    starts: &Starts<'_>,
    monitor: &dyn Monitor,
) -> anyhow::Result<Vec<Vec<Trajectory>>> {
    let config = &study.rollout;
    let seed = Seed::new(study.seed).child("rollout");
    match &model.model {
        Model::Knn(knn) => {
            let weights = study.model.weights()?;
            let member = |number| {
                let member = knn.member(number);
                let starts = starts.of_member(&member, config.rollouts)?;
                let all = rollouts(&member, &starts, config.steps, weights, seed, monitor)?;
                Ok(all.into_iter().map(Trajectory::Recorded).collect())
            };
            (0..knn.members()).map(member).collect()
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
