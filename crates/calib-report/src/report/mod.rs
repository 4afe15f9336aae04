//! Content of a report, before it becomes a page.

mod caveats;
mod content;
mod data;
mod parts;
mod plain;
mod reliance;
mod sentence;
mod simple;
mod simple_rows;
mod summary;
mod table;
mod verdict;

pub use calib_sweep::{ChoiceBaseline, Grade, Recommendation};
pub use caveats::caveats;
pub use content::Report;
pub use data::{Channel, ChannelStatus, DataProfile, JumpStatistics, Reproduction};
pub use sentence::{joined, listed};
pub use simple_rows::{SimpleRow, Simpler};
pub(crate) use summary::{are_of_several_models, summary};
pub use table::{Best, Cell, Table};
pub use verdict::{
    Alternative, HeldOutResult, PartRow, Reason, Separation, Sources, TopK, Verdict,
};
