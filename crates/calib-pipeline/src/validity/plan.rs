//! The plan of `validity`: the work left to run.

use std::path::PathBuf;

use calib_base::{StepError, log::context::RunContext};

use super::{studies::Listing, task::Task};

/// Every plant with its task and remaining work.
#[derive(Debug)]
pub struct ValidityPlan {
    pub(super) plants: Vec<PlannedPlant>,
    /// Time of the finished sweeps, in seconds.
    pub(super) swept_secs: f64,
    /// The folder for the report.
    pub(super) directory: PathBuf,
}

#[derive(Debug)]
pub(super) struct PlannedPlant {
    pub(super) plant: String,
    pub(super) task: Task,
    pub(super) state: PlantState,
}

#[derive(Debug)]
pub(super) enum PlantState {
    /// The plant cannot be run, for this reason.
    LeftOut(String),
    /// Number of models and deployments to run.
    Left(usize),
    Swept,
}

impl ValidityPlan {
    pub(super) fn of(
        listing: &Listing,
        directory: PathBuf,
        context: &RunContext,
    ) -> Result<Self, StepError> {
        let mut plants = Vec::with_capacity(listing.studies.len());
        let mut swept_secs = 0.0;
        for study in &listing.studies {
            let state = match (study.out_of_reach()?, study.left(context)?) {
                (Some(reason), _) => PlantState::LeftOut(reason),
                (None, 0) => {
                    swept_secs += study.swept_secs()?;
                    PlantState::Swept
                }
                (None, left) => PlantState::Left(left),
            };
            let task = Task::of(study.study(), study.study().sweep.steps);
            plants.push(PlannedPlant { plant: study.plant.clone(), task, state });
        }
        Ok(Self { plants, swept_secs, directory })
    }

    /// Returns the plants with work left.
    pub fn left(&self) -> Vec<&str> {
        let left = self.plants.iter().filter(|plant| matches!(plant.state, PlantState::Left(_)));
        left.map(|plant| plant.plant.as_str()).collect()
    }

    pub(super) fn swept(&self) -> usize {
        self.plants.iter().filter(|plant| matches!(plant.state, PlantState::Swept)).count()
    }
}
