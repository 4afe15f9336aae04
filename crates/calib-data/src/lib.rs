//! Plant logs in, tidy tables out: Parquet, cleaning, segments, normalisation. The only crate that names polars.

pub mod table;
