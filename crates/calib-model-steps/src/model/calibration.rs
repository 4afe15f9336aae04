//! A neighbour model for callers other than the steps: for inspection, queries and rollouts.

use std::{
    fmt,
    path::{Path, PathBuf},
};

use calib_base::{StepError, bail};
use calib_core::{Frames, Normaliser, Period, States};
use calib_knn::{KnnModel, Weights};
use calib_study::{Job, Study};

use crate::model::model_files::{self, OpenModel};

/// A neighbour model that `build-model` wrote. Its states and tables are mapped.
pub struct Calibration {
    directory: PathBuf,
    opened: OpenModel,
    weights: Weights,
}

impl fmt::Debug for Calibration {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Calibration").field("directory", &self.directory).finish_non_exhaustive()
    }
}

impl Calibration {
    /// Opens the model of a study.
    ///
    /// # Errors
    /// If it was not built, was built from another study, is damaged, or is a network, which has no neighbours.
    pub fn of_job(job: &Job) -> Result<Self, StepError> {
        Self::new(&job.layout().model(), model_files::open(job)?)
    }

    /// Opens the model in a folder, whatever its study.
    ///
    /// # Errors
    /// If there is no model, it is damaged, or it is a network.
    pub fn in_directory(directory: &Path) -> Result<Self, StepError> {
        Self::new(directory, model_files::open_directory(directory)?)
    }

    fn new(directory: &Path, opened: OpenModel) -> Result<Self, StepError> {
        let weights = opened.manifest.study.model.weights()?;
        if opened.model.tables().is_none() {
            bail!(
                "the model in {} is a network, which has no neighbours; set model.kind = \"knn\" and build it again",
                directory.display()
            );
        }
        Ok(Self { directory: directory.to_owned(), opened, weights })
    }

    /// Returns the folder of the model.
    pub fn directory(&self) -> &Path {
        &self.directory
    }

    /// Returns the resolved study that it was built from.
    pub fn study(&self) -> &Study {
        &self.opened.manifest.study
    }

    /// Returns its rows: times, segments and normalised states.
    pub fn frames(&self) -> &Frames {
        &self.opened.frames
    }

    /// Returns the ensemble. Its states are those in which distances are measured.
    pub fn knn(&self) -> &KnnModel {
        let neighbors = self.opened.model.tables();
        neighbors.unwrap_or_else(|| unreachable!("others are refused when they are opened"))
    }

    /// Returns the columns of the states, with the maps to the units of the sensors.
    pub fn normaliser(&self) -> &Normaliser {
        &self.opened.manifest.normaliser
    }

    /// Returns the sampling interval.
    pub fn period(&self) -> Period {
        self.opened.manifest.period
    }

    /// Returns the weights by which a step draws its neighbour.
    pub fn weights(&self) -> Weights {
        self.weights
    }

    /// Returns normalised states from elsewhere in the metric of the model: themselves, or their
    /// representation.
    ///
    /// # Errors
    /// If neighbours are searched in a representation that was imported without an encoder.
    pub fn in_metric(&self, states: &States) -> Result<States, StepError> {
        self.opened.in_metric(states)
    }
}
