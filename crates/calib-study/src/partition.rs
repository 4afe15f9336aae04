use calib_data::TimeRange;
use serde::Serialize;

use crate::Study;

/// Division of the training range between the calibration model and pre-training.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub enum Partition {
    /// No pre-training. The model uses the whole training range, or this part.
    Model(Option<TimeRange>),
    /// Agents are pre-trained on one part, and the model is built from another part.
    Divided {
        /// Share of the time span for pre-training, unless periods are given.
        fraction: f64,
        /// Period for pre-training.
        pretrain: Option<TimeRange>,
        /// Period for the calibration model.
        model: Option<TimeRange>,
    },
}

impl Study {
    /// Returns the division of the training range.
    pub fn partition(&self) -> Partition {
        let model = self.model.period.as_ref().map(|range| self.data.on_its_clock(range));
        if self.pretrain.is_on() {
            let pretrain = self.pretrain.period.as_ref();
            let pretrain = pretrain.map(|range| self.data.on_its_clock(range));
            Partition::Divided { fraction: self.pretrain.fraction, pretrain, model }
        } else {
            Partition::Model(model)
        }
    }
}
