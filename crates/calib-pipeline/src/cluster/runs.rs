//! The runs that shards have made so far.

use std::path::Path;

use calib_base::StepError;
use calib_sweep::{Unit, UnitRuns};
use calib_sweep_steps::sweep::planned::PlannedSweep;

use super::{
    inputs,
    plan_file::OpenedPlan,
    results::{self, UnitsInOrder},
    status::Status,
};

/// The runs of one model and deployment.
pub(crate) struct PartRuns {
    names: [Option<String>; 2],
    pub(crate) planned: PlannedSweep,
    units: UnitsInOrder,
}

impl PartRuns {
    pub(crate) fn model(&self) -> Option<&str> {
        self.names[0].as_deref()
    }

    pub(crate) fn deployment(&self) -> Option<&str> {
        self.names[1].as_deref()
    }

    /// The runs of a unit that are there.
    pub(crate) fn get(&self, unit: &Unit, key: &str) -> Option<UnitRuns> {
        self.units.get(&(unit.clone(), key.to_owned())).cloned()
    }
}

/// How the plan in `directory` stands, and the runs of each part of which shards make something. Of a shard whose file is
/// not what it should be there are none.
///
/// # Errors
/// If there is no plan, or it is damaged.
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
    for (number, part) in std::mem::take(&mut opened.plan.parts).into_iter().enumerate() {
        let Some(sweep) = part.sweep else { continue };
        let mut units = inputs::stored(&opened.inputs(number)).unwrap_or_default();
        results::add(&mut units, made.values().cloned());
        let names = [part.model, part.deployment];
        parts.push(PartRuns { names, planned: sweep.planned, units });
    }
    Ok((status, parts))
}
