#![doc = include_str!("../README.md")]

mod distance;
mod dtw;
mod error;
mod kernel;
mod path;
mod pattern;
mod pattern_set;
mod series;
mod settings;
mod time_warp_edit;
mod window;

pub use distance::Distance;
pub use dtw::{Alignment, Dtw};
pub use error::{DtwError, NoPath};
pub use kernel::dispatch::InstructionSet;
pub use pattern::{
    Branch, Cell, LONGEST_BRANCH, Normalisation, ParsePatternError, PatternError, RabinerJuangType,
    Recursion, SlopeWeighting, Smoothing, Step, StepPattern,
};
pub use pattern_set::{ByPattern, PatternSet};
pub use series::{Role, Series};
pub use settings::{Ends, LocalDistance, ParseSettingError, Settings};
pub use time_warp_edit::TimeWarpEdit;
pub use window::{ParseWindowError, Window};
