//! Tests the public interface: every search structure, models and their files, and the memory that they take.

mod classes;
mod data_sets;
mod memory;
mod model;
mod recurrence;
mod resume;
mod shortcuts;
mod tables;
