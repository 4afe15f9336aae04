//! Tests the figures and the page that they stand in.
#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod figures;
mod fixture;
mod report;
