use calib_core::Monitor;

use crate::{ClosedClasses, Ends, KnnError, KnnModel, Weights, recurrence};

/// Returns the closed classes of a member with this many candidates, under the weights that its steps use, and where its rollouts end.
///
/// # Errors
/// If the monitor interrupts.
pub fn closed_classes(
    model: &KnnModel,
    member: usize,
    weights: Weights,
    candidates: usize,
    monitor: &dyn Monitor,
) -> Result<(ClosedClasses, Ends), KnnError> {
    let dropped = model.blocks().dropped(member);
    recurrence::closed_classes(model.table(member), dropped, weights, candidates, monitor)
}
