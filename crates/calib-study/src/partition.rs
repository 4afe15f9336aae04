use calib_data::TimeRange;
use serde::Serialize;

use crate::Study;

/// Which part of the training range the calibration model is built from, and which one is for pre-training.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub enum Partition {
    /// No agent is pre-trained: all of the training range, or this part of it, is for the model.
    Model(Option<TimeRange>),
    /// Agents are pre-trained on one part, and the model is built from another.
    Divided {
        /// Share of the time span for pre-training, unless periods are given.
        fraction: f64,
        /// For pre-training.
        pretrain: Option<TimeRange>,
        /// For the calibration model.
        model: Option<TimeRange>,
    },
}

impl Study {
    /// How the training range is divided.
    pub fn partition(&self) -> Partition {
        let on_its_clock =
            |period: &Option<TimeRange>| period.as_ref().map(|range| self.data.on_its_clock(range));
        let model = on_its_clock(&self.model.period);
        if self.pretrain.is_on() {
            let pretrain = on_its_clock(&self.pretrain.period);
            Partition::Divided { fraction: self.pretrain.fraction, pretrain, model }
        } else {
            Partition::Model(model)
        }
    }
}
