//! The domain types, shared by every other package: no I/O, no clock, no ambient randomness.
//!
//! Data flows through these types in this order:
//!
//! - [`Timestamp`], [`Period`]: instants and spans in microseconds.
//! - [`Segment`], [`Segments`]: maximal runs of rows without a gap. Nothing crosses their ends.
//! - [`Column`], [`Normaliser`]: the meaning of a number in a state, in normalised and physical
//!   units.
//! - [`States`], [`Frames`]: normalised states `[n, d]`, and their timestamps and segments.
//! - [`Transitions`], [`TransitionIndex`], [`RowIndex`]: pairs of successive rows of one segment.
//! - [`Seed`], [`Rng`]: named, derived randomness that is stable across platforms and releases.
//! - [`Monitor`], [`Cancelled`]: progress and cancellation, seen from inside long work.
//! - [`locked()`]: a lock that a panic of another thread does not close.
//! - [`Stream`], [`RowStream`]: the states that an agent sees. Replay and rollout look the same to
//!   it.
//! - [`number()`], [`setting`], [`percent`], [`count`], [`exact`]: numbers formatted for readers.
//! - [`abridged_list()`]: the first of many names in a sentence.
//!
//! ```
//! use calib_core::{RowIndex, Seed, Segments, Transitions};
//!
//! // Three rows, a gap, two rows: nothing leads over the gap.
//! let transitions = Transitions::new(Segments::from_lengths([3, 2])?);
//! assert_eq!(transitions.len(), 3);
//! assert_eq!(transitions.starting_at(RowIndex(2)), None);
//! // What is drawn follows from names and numbers, not from the order of work.
//! let seed = Seed::new(7).child("rollout");
//! assert_eq!(seed.number(3).rng().bits(), seed.number(3).rng().bits());
//! assert_eq!(calib_core::percent(0.217), "22 %");
//! # Ok::<(), calib_core::SegmentError>(())
//! ```

mod abridged_list;
mod column;
mod frames;
mod index;
mod locked;
mod monitor;
mod number;
mod seed;
mod segment;
mod states;
mod stream;
mod time;
mod transition;

pub use abridged_list::abridged_list;
pub use column::{Bounds, Column, ColumnKind, Normalised, Normaliser, Physical};
pub use frames::{Frames, FramesError};
pub use index::{RowIndex, TransitionIndex};
pub use locked::locked;
pub use monitor::{Cancelled, Monitor, Silent};
pub use number::{
    count, exact, factor, is_many_times, number, numbers_apart, percent, rounded, setting, whole,
};
pub use seed::{Rng, Seed};
pub use segment::{Segment, SegmentError, Segments};
pub use states::{States, StatesError};
pub use stream::{RowStream, Stream};
pub use time::{Period, Timestamp};
pub use transition::Transitions;
