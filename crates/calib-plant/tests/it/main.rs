//! Tests the plant through its logs.

mod change;
mod plant;
