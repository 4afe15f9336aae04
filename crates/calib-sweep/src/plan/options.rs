use calib_agent::Part;
use calib_core::Seed;

use crate::Span;

/// Options for every unit of a plan.
#[derive(Clone, Copy, Debug)]
pub struct PlanOptions {
    /// The part of a run whose error decides which settings a race drops.
    pub part: Part,
    /// Length of streams. With several groups of sensors, the longest.
    pub span: Span,
    /// Points per learning curve.
    pub curve_points: usize,
    /// Root of the agents' seeds.
    pub seed: Seed,
}
