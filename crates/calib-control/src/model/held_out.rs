//! How far other states, such as those of a held-out period, lie from the log of a model.

use calib_core::{Monitor, States};
use calib_files::ScratchPlace;
use calib_knn::{IndexKind, NeighborLists, Queries, Sources};

use super::ActionModel;
use crate::ControlError;

impl ActionModel {
    /// Returns the share of `states` that the log does not cover: no recorded decision lies within the radius, whatever its action.
    /// `states` are in the model's metric, `[rows, d]`.
    ///
    /// The radius is that of decisions with the same action, so about [`coverage`](super::ActionModelConfig::coverage) or more of
    /// states like those of the log are covered.
    ///
    /// # Errors
    /// If the states have another number of columns than the metric, or the monitor interrupts.
    pub fn uncovered_share(
        &self,
        states: &States,
        monitor: &dyn Monitor,
    ) -> Result<f64, ControlError> {
        let sources = Sources::new(&self.metric, self.log.transitions(), &self.blocks)?;
        let queries = Queries::external(&sources, states, None)?;
        let place = ScratchPlace::Memory;
        let planned = sources.index(IndexKind::Auto, &queries, 1, &place, monitor)?;
        let members = self.blocks.members();
        let mut found = NeighborLists::new(planned.order.len(), members, 1);
        monitor.begin("held-out states", planned.order.len() as u64);
        planned.index.search(&queries, &planned.order, &mut found, monitor)?;
        let far = (0..planned.order.len())
            .filter(|&query| {
                (0..members).all(|member| found.list(query, member).1[0] > self.radius)
            })
            .count();
        Ok(far as f64 / states.rows().max(1) as f64)
    }
}
