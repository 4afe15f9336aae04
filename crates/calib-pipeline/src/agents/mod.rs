//! Pre-trained agents.

pub(crate) mod pretrain;
pub(crate) mod pretrain_files;
mod shares;
