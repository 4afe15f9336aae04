//! The log in its files: rows in time order, channels, ranges.

mod alike_names;
mod angles;
mod assemble;
mod bad_rows;
mod bad_rows_found;
mod cause;
mod clock;
mod clock_resets;
mod column_aliases;
mod column_pairs;
mod columns;
mod contradiction_cause;
mod declared;
mod dedup;
mod entries;
mod export_pairs;
mod file;
mod filename_tag;
mod gaps;
mod head;
mod long;
mod max_ages;
mod memory_limit;
mod open;
mod partitioned_file;
mod plant_log;
mod read;
mod resample;
mod rows;
mod series;
mod shape;
mod shared_times;
mod side_labels;
mod source;
mod sparse;
mod split;
mod store;
mod tag_words;
mod times;
mod union;
mod values;

pub use self::{
    bad_rows_found::BadRowsFound,
    contradiction_cause::ContradictionCause,
    declared::{Declared, log_files},
    source::text_left_alone,
};
pub(crate) use self::{
    column_aliases::{TAGS, plain},
    dedup::Contradicting,
    file::{FieldKind, classify},
    gaps::{detect_period, inside, inside_both, interval},
    memory_limit::MemoryLimit,
    plant_log::{Channel, Log},
    read::{Batch, ChannelValues, Codes},
    rows::EXAMPLES,
    sparse::{Neighbourhood, SparseValues},
};
