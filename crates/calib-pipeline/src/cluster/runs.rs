//! The runs that shards have made so far.

use std::path::Path;

use calib_base::StepError;
use calib_sweep::{Unit, UnitRuns};
use calib_sweep_steps::sweep::planned::PlannedSweep;

use super::{
    inputs,
    plan_file::{OpenedPlan, PlannedPart},
    results::{self, UnitsInOrder},
    status::Status,
};

/// The runs of one model in one deployment.
pub(crate) struct PartRuns {
    pub(crate) model: Option<String>,
    pub(crate) deployment: Option<String>,
    pub(crate) planned: PlannedSweep,
    units: UnitsInOrder,
}

impl PartRuns {
    pub(crate) fn get(&self, unit: &Unit, key: &str) -> Option<UnitRuns> {
        self.units.get(&(unit.clone(), key.to_owned())).cloned()
    }
}

/// Returns the status of the plan in `directory`, and the runs of each part that shards work on. A shard with an
/// invalid file has no runs.
///
/// # Errors
/// Returns an error if the plan is missing or damaged.
pub(crate) fn standing(directory: &Path) -> Result<(Status, Vec<PartRuns>), StepError> {
    let mut opened = OpenedPlan::of(directory)?;
    let status = Status::of(&opened);
    let mut made = UnitsInOrder::new();
    for number in 0..opened.plan.shards.len() {
        if let Ok(Some(results)) = opened.read(number) {
            results::add(&mut made, results.units.into_values());
        }
    }
    let mut parts = Vec::new();
    let planned = std::mem::take(&mut opened.plan.parts).into_iter().enumerate();
    for (number, PlannedPart { model, deployment, sweep }) in planned {
        let Some(sweep) = sweep else { continue };
        let mut units = inputs::stored(&opened.inputs(number)).unwrap_or_default();
        results::add(&mut units, made.values().cloned());
        parts.push(PartRuns { model, deployment, planned: sweep.planned, units });
    }
    Ok((status, parts))
}
