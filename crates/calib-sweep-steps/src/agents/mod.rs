//! Pre-trained agents.

pub mod pretrain;
pub mod pretrain_files;
mod shares;
mod train;
