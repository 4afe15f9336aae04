//! Measures how well calib chooses: the regret of its choices over plants and sensors, beside alternatives without it.
//!
//! - [`Pair`]: a sensor of a plant with known held-out data, the task of its agent, the choice of each model, and its
//!   prediction errors.
//! - [`Method`]: a way to choose a value: a model, a rule, log replay, a default or chance. Two methods see held-out
//!   data: the best constant value, which is a lower bound on regret, and another window.
//! - [`judge`]: all pairs → [`Validity`]: summaries with intervals over plants, pairwise [`Comparison`]s with their
//!   [`Power`], the [`Test`]s of the claims, comparisons of rules, groups of tasks, and whether the more accurate model
//!   chooses better.
//!
//! Sensors of one plant are not independent, so the plant is the unit of every interval.
//!
//! ```
//! use calib_validity::{Pair, judge};
//!
//! // Two plants with one sensor each; no model, so the defaults are compared with chance.
//! let plants = [("a", [1.0, 0.0, 2.0]), ("b", [0.0, 0.25, 0.5])];
//! let pairs = plants.map(|(plant, regrets)| Pair {
//!     plant: plant.to_owned(),
//!     sensor: "pressure".to_owned(),
//!     optimiser: "adam".to_owned(),
//!     online: vec![0.5; 3],
//!     skill: Some(0.5),
//!     regrets: Some(regrets.to_vec()),
//!     default: Some(2),
//!     ..Pair::default()
//! });
//! let values = ["1e-4", "1e-3", "1e-2"].map(str::to_owned).to_vec();
//! let validity = judge(values, pairs.into(), &[])?;
//! assert_eq!(validity.best_default, 1); // regrets 0 and 25 %: typically less than the others
//! # Ok::<(), calib_validity::ValidityError>(())
//! ```

mod accuracy;
mod choices;
mod claims;
mod comparison;
mod defaults;
mod error;
mod groups;
mod method;
mod over_plants;
mod pair;
mod power;
mod summary;
mod validity;

pub use accuracy::{Accuracy, Badness, Predictor};
pub use claims::{Claim, Outcome, Test};
pub use comparison::{Comparison, Finding, MARGIN};
pub use defaults::OptimiserDefault;
pub use error::ValidityError;
pub use groups::GroupSummary;
pub use method::Method;
pub use over_plants::FEWEST_PLANTS;
pub use pair::{CAP, ModelPair, Pair, RuleChoice, TaskValue};
pub use power::{DIFFERENCES, Power};
pub use summary::{GOOD, MethodSummary, RankAgreement};
pub use validity::{PairRegret, Validity, judge};
