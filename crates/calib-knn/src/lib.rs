//! Leave-one-block-out k-nearest-neighbour calibration models.
//!
//! - [`Blocks`]: which transitions each member of the ensemble contains.
//! - [`Exclusion`]: which sources may not be neighbours of a recorded row.
//! - [`NeighborIndex`], [`KdTree`], [`Join`], [`Scan`]: exact search. Every structure finds the same lists.
//! - [`build_tables`], [`NeighborTable`]: the `k` nearest source states to the next state `s'_i`, for each member and transition `i`.
//! - [`Workplace`], [`Parts`], [`MemoryNeed`]: large builds on disk, resumption of interrupted builds, and memory prediction.
//! - [`write_table`], [`open_table`]: the files `neighbors.npy` and `distances.npy`, which are mapped and checked.
//! - [`KnnModel`], [`Member`], [`Weights`]: the model. A step draws a neighbour. Other states are searched exactly, and have expected
//!   next states.
//! - [`Points`]: the same search over points without time.
//! - [`verify`]: compares tables with brute force. [`Shortcuts`] make a search faster and its tables approximate; [`recall`] measures
//!   the loss.
//!
//! ```
//! use calib_core::{Seed, Segments, Silent, States, TransitionIndex, Transitions};
//! use calib_knn::{KnnModel, ModelConfig, Weights};
//!
//! // A sawtooth of period 7: every state recurs.
//! let states = States::new((0..70_u8).map(|row| f32::from(row % 7)).collect(), 70, 1).unwrap();
//! let transitions = Transitions::new(Segments::from_lengths([70]).unwrap());
//! let model = KnnModel::build(states, transitions, &ModelConfig::default(), &Silent).unwrap();
//! let member = model.member(0);
//! let from = TransitionIndex(20);
//! let to = member.draw(from, Weights::Linear, &mut Seed::new(1).rng());
//! let (next, source) = (model.transitions().next(from), model.transitions().source(to));
//! assert_eq!(model.states().row(next.get()), model.states().row(source.get()));
//! ```

mod approximation;
mod bits;
mod blocks;
mod candidate_mask;
mod candidates;
mod choice;
mod class_lists;
mod classes;
mod closed_classes;
mod components;
mod config;
mod definition;
mod distance;
mod error;
mod excluded;
mod exclusion;
mod expectation;
mod groups;
mod index;
mod lists;
mod memory;
mod model;
mod nearest;
mod parts;
mod points;
mod prototypes;
mod recall;
mod recurrence;
mod store;
mod table;
mod table_check;
mod verify;
mod weights;

pub use approximation::{PrototypeKind, Shortcuts};
pub use blocks::Blocks;
pub use choice::{IndexChoice, Reason};
pub use closed_classes::closed_classes;
pub use config::{IndexKind, ModelConfig, WeightsKind};
pub use error::KnnError;
pub use excluded::LeftOut;
pub use exclusion::{Exclusion, SelfMatch};
pub use index::{Join, KdTree, NeighborIndex, NeighborLists, Planned, Queries, Scan, Sources};
pub(crate) use lists::{Lists, MemberLists};
pub use memory::MemoryNeed;
pub use model::{Built, KnnModel, Member, Neighbor};
pub use parts::{PART_QUERIES, Parts, SEARCH_VERSION};
pub use points::{PointNeighbors, Points};
pub use recall::{Recall, recall};
pub use recurrence::{ClosedClasses, Ends, Recurrence};
pub use store::{open_table, write_table};
pub use table::{NeighborTable, Workplace, build_tables};
pub use table_check::{Fault, faults};
pub use verify::{Verification, verify};
pub use weights::Weights;
