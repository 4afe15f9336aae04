//! Campaigns against the binary: damage, failures and kills at every operation on the disk, odd logs, odd values.
//!
//! A slice of each runs with the other tests; `bash scripts/torture.sh` runs all of it and prints the tables of
//! docs/reliability.md.

mod campaign;
mod damage;
mod faults;
mod foreign;
#[path = "../cli/harness.rs"]
#[expect(dead_code, reason = "shared with the tests of the command line")]
mod harness;
mod hostile;
mod limits;
mod odd_logs;
mod odd_texts;
mod odd_values;
mod parquet;
mod shapes;
mod texts;
mod times;
mod types;
