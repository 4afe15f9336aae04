//! Does calib choose well? Regret of its choices over plants and sensors, beside what one would do without it.
//!
//! - [`Pair`]: a sensor of a plant whose truth is known, with what each model chose and how well it predicts.
//! - [`Method`]: a way to choose a value: a model, a default, log replay, chance.
//! - [`judge`]: all pairs → [`Validity`]: summaries with intervals over plants, comparisons two by two, agreement of rankings,
//!   and whether the more accurate model is the one that chooses better.
//!
//! Sensors of one plant are not independent, so the plant is the unit of every interval.
//!
//! ```
//! use calib_validity::{Options, Pair, judge};
//!
//! // Two plants with one sensor each; no model, so the defaults are compared with chance.
//! let pair = |plant: &str, online: [f64; 3]| Pair {
//!     plant: plant.to_owned(),
//!     sensor: "pressure".to_owned(),
//!     online: online.to_vec(),
//!     default: Some(2),
//!     log_replay: None,
//!     models: Vec::new(),
//! };
//! let values = ["1e-4", "1e-3", "1e-2"].map(str::to_owned).to_vec();
//! let pairs = vec![pair("a", [0.2, 0.1, 0.3]), pair("b", [0.4, 0.5, 0.6])];
//! let validity = judge(values, pairs, &Options::default())?;
//! assert_eq!(validity.best_default, 1); // regret 0 and 25 %: less on average than the others
//! # Ok::<(), calib_validity::ValidityError>(())
//! ```

mod accuracy;
mod comparison;
mod error;
mod method;
mod over_plants;
mod pair;
mod summary;
mod validity;

pub use accuracy::{Accuracy, Outcome, Predictor};
pub use comparison::Comparison;
pub use error::ValidityError;
pub use method::Method;
pub use pair::{ModelPair, Pair, Rule};
pub use summary::{GOOD, MethodSummary, RankAgreement};
pub use validity::{Options, PairRegret, Validity, judge};
