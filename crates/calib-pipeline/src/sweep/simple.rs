//! The errors of simple predictors over the windows of a sweep, in a file beside its tables.

use std::{collections::BTreeMap, path::Path};

use calib_files::{read_sealed_json, write_sealed_json};
use calib_sweep::{Baselines, Environment, SimpleScore, simple_scores};
use serde::{Deserialize, Serialize};

use crate::{StepError, sweep::setting::Setting};

/// Where they are.
pub(crate) const FILE: &str = "simple.json";

/// What simple predictors came to.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(crate) struct SimpleErrors {
    /// What a normalised return is multiplied by to give a discounted mean of the sensor, in its own unit.
    pub(crate) units: BTreeMap<String, f64>,
    pub(crate) scores: Vec<SimpleScore>,
}

impl SimpleErrors {
    /// Fit and score every simple predictor over every recorded window.
    pub(crate) fn measure(
        setting: &Setting,
        environments: &[Box<dyn Environment + '_>],
        baselines: &Baselines<'_>,
    ) -> Result<Self, StepError> {
        let environments: Vec<&dyn Environment> =
            environments.iter().map(|environment| &**environment).collect();
        let gamma = setting.candidates[0].agent.gamma;
        let span = setting.streams.demand.span;
        let scores = simple_scores(baselines, &environments, &setting.sensors, gamma, span)?;
        let columns = setting.dataset.normaliser.columns();
        let unit = |(sensor, column): &(String, usize)| {
            (sensor.clone(), columns[*column].bounds.scale * (1.0 - gamma))
        };
        Ok(Self { units: setting.sensors.iter().map(unit).collect(), scores })
    }

    pub(crate) fn write(&self, directory: &Path) -> Result<(), StepError> {
        Ok(write_sealed_json(&directory.join(FILE), self)?)
    }

    pub(crate) fn read(directory: &Path) -> Result<Self, StepError> {
        Ok(read_sealed_json(&directory.join(FILE))?)
    }
}
