//! A model of neighbours as others than the steps use it: looked at, asked and walked through.

use std::{
    fmt,
    path::{Path, PathBuf},
};

use calib_base::{StepError, bail};
use calib_core::{Frames, Normaliser, Period, States};
use calib_knn::{KnnModel, Weights};
use calib_study::{Job, Study};

use crate::model::model_files::{self, OpenModel};

/// A calibration model of neighbours that `build-model` wrote; its states and tables are mapped.
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
    /// The model of a study.
    ///
    /// # Errors
    /// If it was not built, was built of another study, is damaged, or is a network, which has no neighbours.
    pub fn of_job(job: &Job) -> Result<Self, StepError> {
        Self::new(&job.layout().model(), model_files::open(job)?)
    }

    /// The model in a folder, whatever study it is of.
    ///
    /// # Errors
    /// If there is none, it is damaged, or it is a network.
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

    /// The folder that it lies in.
    pub fn directory(&self) -> &Path {
        &self.directory
    }

    /// The study that it was built of, as it was resolved.
    pub fn study(&self) -> &Study {
        &self.opened.manifest.study
    }

    /// Its rows: times, segments and normalised states.
    pub fn frames(&self) -> &Frames {
        &self.opened.frames
    }

    /// The ensemble. The states of it are what distances are measured in.
    pub fn knn(&self) -> &KnnModel {
        let neighbors = self.opened.model.tables();
        neighbors.unwrap_or_else(|| unreachable!("others are refused when they are opened"))
    }

    /// The columns of the states, with the maps to the units of the sensors.
    pub fn normaliser(&self) -> &Normaliser {
        &self.opened.manifest.normaliser
    }

    /// Time from one row to the next.
    pub fn period(&self) -> Period {
        self.opened.manifest.period
    }

    /// How a step draws its neighbour.
    pub fn weights(&self) -> Weights {
        self.weights
    }

    /// Normalised states from elsewhere as distances to them are measured: themselves, or their representation.
    ///
    /// # Errors
    /// If neighbours are searched in a representation that was imported without an encoder.
    pub fn in_metric(&self, states: &States) -> Result<States, StepError> {
        self.opened.in_metric(states)
    }
}
