//! The `[data]` and `[preprocess]` sections of a study.

mod data;
mod max_age;
mod paths;
mod preprocess;
mod range;

pub use data::{BadRows, Contradictions, DataConfig, Resample, Shape};
pub use max_age::MaxAge;
pub use paths::Paths;
pub use preprocess::{Missing, Normalisation, Outliers, PreprocessConfig, Reduce};
pub use range::{Moment, TimeRange};
