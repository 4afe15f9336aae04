//! Plan, run and aggregate hyperparameter sweeps.
