//! Simple predictors of a sweep's sensors, stored in a file beside its tables.

use std::{collections::BTreeMap, path::Path};

use calib_agent::{AgentConfig, SimplePredictor};
use calib_base::StepError;
use calib_core::{Monitor, Normaliser};
use calib_files::{Fingerprint, read_sealed_json, write_sealed_json};
use calib_sweep::{
    Baselines, FittedSimple, FittingRows, RecordedWindow, SimpleScore, Span, simple_scores,
};
use serde::{Deserialize, Serialize};

/// The file name.
pub(crate) const FILE: &str = "simple.json";

/// Errors of simple predictors, and predictors that can be deployed.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct SimpleErrors {
    /// Fingerprint of the table of runs that they belong to. `None` if a manifest records it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) runs: Option<Fingerprint>,
    /// Factor from a normalised return to a discounted mean of the sensor, in its own unit.
    pub(crate) units: BTreeMap<String, f64>,
    /// Predictors that are fitted on the whole training range.
    pub(crate) fitted: Vec<FittedSimple>,
    /// The predictor that `agent.baseline = "best"` stands for, by sensor.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub(crate) best: BTreeMap<String, SimplePredictor>,
    pub(crate) scores: Vec<SimpleScore>,
}

impl SimpleErrors {
    /// Fits and scores every simple predictor of these sensors on recorded windows.
    pub(crate) fn measure(
        baselines: &Baselines<'_>,
        windows: &[RecordedWindow],
        (sensors, normaliser): (&[(String, usize)], &Normaliser),
        agent: &AgentConfig,
        span: Span,
        monitor: &dyn Monitor,
    ) -> Result<Self, StepError> {
        let gamma = agent.gamma;
        let scores = simple_scores(baselines, windows, sensors, gamma, span, monitor)?;
        let fitted = baselines.simple(sensors, gamma, &FittingRows::All, monitor)?;
        let best = match agent.baseline {
            Some(SimplePredictor::Best) => baselines.best(sensors, gamma, monitor)?,
            _ => BTreeMap::new(),
        };
        Ok(Self {
            runs: None,
            units: sensors
                .iter()
                .map(|(sensor, column): &(String, usize)| {
                    (sensor.clone(), normaliser.columns()[*column].bounds.scale * (1.0 - gamma))
                })
                .collect(),
            fitted,
            best,
            scores,
        })
    }

    /// Adds the results for other sensors.
    pub(crate) fn add(&mut self, others: Self) {
        self.units.extend(others.units);
        self.fitted.extend(others.fitted);
        self.best.extend(others.best);
        self.scores.extend(others.scores);
    }

    /// Returns a line on the predictors that agents with `agent.baseline = "best"` start from. `None` if
    /// there are no such agents.
    pub(crate) fn starts(&self) -> Option<String> {
        (!self.best.is_empty()).then(|| {
            format!(
                "agents start from {}: the best by cross-validation in the training range",
                self.best_told()
            )
        })
    }

    /// Returns the predictors that agents with `agent.baseline = "best"` start from, in words.
    pub fn best_told(&self) -> String {
        let told = self.best.iter().map(|(sensor, best)| format!("{} for {sensor}", best.label()));
        told.collect::<Vec<_>>().join(", ")
    }

    pub(crate) fn write(&self, directory: &Path) -> Result<(), StepError> {
        Ok(write_sealed_json(&directory.join(FILE), self)?)
    }

    /// Reads the file in the directory of a sweep.
    ///
    /// # Errors
    /// Returns an error if it is missing or damaged.
    pub fn read(directory: &Path) -> Result<Self, StepError> {
        Ok(read_sealed_json(&directory.join(FILE))?)
    }
}
