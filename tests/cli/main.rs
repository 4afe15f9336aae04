//! The command line as users meet it: one binary, so that it links once.

mod build;
mod chain;
mod change;
mod comparisons;
mod dataset;
mod deployments;
mod dtw;
mod errors;
mod formats;
mod harness;
mod hints;
mod init;
mod inputs;
mod interruption;
mod models;
mod networks;
mod paper;
mod pretrain;
mod real_data;
mod recorded;
mod recurrent;
mod represent;
mod studies;
mod sweeps;
mod trust;
mod validity;
