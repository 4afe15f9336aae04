//! Laplacian representations of a plant's states: training, scores and selection.
//!
//! ψ maps a state to `d` numbers, such that successive states are near each other and other states are far
//! apart. Then the plant continues in a similar way from the nearest neighbours of a state.
//!
//! - [`RepresentationConfig`]: the section of a study, with lists of values to try.
//! - [`LaplacianConfig`], [`LossConfig`]: hyperparameters, and the second moments that follow from them.
//! - [`Split`]: the states for training, and the later ones for scoring.
//! - [`PairSampler`]: pairs of states a truncated-geometric time apart.
//! - [`laplacian_loss`]: both published forms, with a hand-written gradient.
//! - [`Training`]: one update. [`train`]: all updates, with a learning curve, checkpoints and a check for
//!   divergence. [`Stepper`], [`train_with`]: the same with updates by another backend.
//! - [`encode`], [`write_encoder`], [`read_encoder`]: ψ of every state, and weights in PyTorch's format.
//! - [`score`], [`select`]: dynamics awareness, uniqueness and live dimensions, and the rule for the choice.
//!
//! ```
//! use calib_core::{Seed, Segments, Silent, States};
//! use calib_represent::{LaplacianConfig, Split, Task, encode, score, train};
//!
//! let angles = (0..500_u16).map(|row| f32::from(row) * 0.05);
//! let values = angles.flat_map(|angle| [angle.cos(), angle.sin()]).collect();
//! let states = States::new(values, 500, 2).unwrap();
//! let segments = Segments::from_lengths([500]).unwrap();
//! let split = Split::in_time(&segments).unwrap();
//! let seed = Seed::new(1);
//! let task = Task { states: &states, segments: &segments, split: &split, seed };
//! let config = LaplacianConfig {
//!     dimension: 4, hidden_units: 16, batch_size: 32, learning_rate: 3e-3, steps: 500, ..Default::default()
//! };
//! let trained = train(&config, task, None, &Silent).unwrap();
//! let psi = encode(&trained.encoder, &states).unwrap();
//! assert!(score(&states, &psi, &segments, &split.validation, seed).dynamics_awareness > 0.5);
//! ```

mod checkpoint;
mod config;
mod distinct;
mod eigen;
mod encoder;
mod error;
mod loss;
mod one_or_more;
mod pairs;
mod point;
mod scores;
mod section;
mod selection;
mod split;
mod stepper;
mod train;
mod training;

pub use config::{LaplacianConfig, LossConfig, LossForm, RepresentConfigError};
pub use eigen::symmetric_eigenvalues;
pub use encoder::{encode, read_encoder, write_encoder};
pub use error::RepresentError;
pub use loss::{Loss, LossBuffers, laplacian_loss};
pub use one_or_more::OneOrMore;
pub use pairs::PairSampler;
pub use point::Point;
pub use scores::{Scores, TOLERANCE, score};
pub use section::{RepresentationConfig, RepresentationKind};
pub use selection::{LEAST_UNIQUENESS, select};
pub use split::Split;
pub use stepper::Stepper;
pub use train::{CURVE_POINTS, Divergence, SCORED_PAIRS, Task, Trained, train, train_with};
pub use training::{Batch, Training};
