#![doc = include_str!("../README.md")]

mod alignment;
mod distance;
mod dtw;
mod error;
mod kernel;
mod path;
mod pattern;
mod pattern_set;
mod role;
mod series;
mod settings;
mod time_warp_edit;
mod window;

pub use alignment::Alignment;
pub use distance::Distance;
pub use dtw::Dtw;
pub use error::{DtwError, NoPath};
pub use kernel::dispatch::InstructionSet;
pub use pattern::{
    Branch, Cell, LONGEST_BRANCH, Normalisation, ParsePatternError, PatternError, RabinerJuangType,
    Recursion, SlopeWeighting, Smoothing, Step, StepPattern,
};
pub use pattern_set::{ByPattern, PatternSet};
pub use role::Role;
pub use series::Series;
pub use settings::{Ends, LocalDistance, ParseSettingError, Settings};
pub use time_warp_edit::TimeWarpEdit;
pub use window::{ParseWindowError, Window};
