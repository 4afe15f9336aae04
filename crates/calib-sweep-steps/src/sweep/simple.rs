//! Simple predictors of a sweep's sensors, in a file beside its tables.

use std::{collections::BTreeMap, path::Path};

use calib_agent::{AgentConfig, SimplePredictor};
use calib_base::StepError;
use calib_core::{Monitor, Normaliser};
use calib_files::{Fingerprint, read_sealed_json, write_sealed_json};
use calib_sweep::{
    Baselines, FittedSimple, FittingRows, RecordedWindow, SimpleScore, Span, simple_scores,
};
use serde::{Deserialize, Serialize};

/// Where they are.
pub(crate) const FILE: &str = "simple.json";

/// What simple predictors came to, and those of them that can be deployed.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct SimpleErrors {
    /// The table of runs that they stand beside; none where a manifest says so.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) runs: Option<Fingerprint>,
    /// What a normalised return is multiplied by to give a discounted mean of the sensor, in its own unit.
    pub(crate) units: BTreeMap<String, f64>,
    /// Fitted on all of the training range.
    pub(crate) fitted: Vec<FittedSimple>,
    /// Which of them `agent.baseline = "best"` is, by sensor.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub(crate) best: BTreeMap<String, SimplePredictor>,
    pub(crate) scores: Vec<SimpleScore>,
}

impl SimpleErrors {
    /// Fit and score every simple predictor of these sensors over recorded windows.
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

    /// Add what they came to for other sensors.
    pub(crate) fn add(&mut self, others: Self) {
        self.units.extend(others.units);
        self.fitted.extend(others.fitted);
        self.best.extend(others.best);
        self.scores.extend(others.scores);
    }

    /// What agents with `agent.baseline = "best"` start from, as a line; none where no agent does.
    pub(crate) fn starts(&self) -> Option<String> {
        (!self.best.is_empty()).then(|| {
            format!(
                "agents start from {}: the best by cross-validation in the training range",
                self.best_told()
            )
        })
    }

    /// What agents with `agent.baseline = "best"` start from, in words.
    pub fn best_told(&self) -> String {
        let told = self.best.iter().map(|(sensor, best)| format!("{} for {sensor}", best.label()));
        told.collect::<Vec<_>>().join(", ")
    }

    pub(crate) fn write(&self, directory: &Path) -> Result<(), StepError> {
        Ok(write_sealed_json(&directory.join(FILE), self)?)
    }

    /// Those that were written into the directory of a sweep.
    ///
    /// # Errors
    /// If they are not there, or damaged.
    pub fn read(directory: &Path) -> Result<Self, StepError> {
        Ok(read_sealed_json(&directory.join(FILE))?)
    }
}
