//! Campaigns against the binary: damage, failures and kills at every disk operation, odd logs, odd values.
//!  Some cases of each run with the other tests. `bash scripts/torture.sh` runs all of them, and prints the
//! tables of docs/reliability.md.
//!
//! A program of its own: that script runs it by this name for hours, on one thread and with all of its output.

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
