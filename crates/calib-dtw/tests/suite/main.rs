//! Tests the public interface against brute force, the whole matrix, and the reference package.

mod brute_force;
mod errors;
mod golden;
mod oracle;
mod properties;
mod time_warp_edit;
mod whole_matrix;
