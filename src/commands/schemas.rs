//! JSON Schemas of the output of each command with `--json`.

use std::collections::BTreeMap;

use calib_data::Imported;
use calib_pipeline::{Inspection, JsonDocuments};
use schemars::Schema;

use super::{dtw::Results, explain::Explained};

/// Returns the schemas by command. `cargo run --example json_schemas -- FOLDER` writes them.
pub fn json_schemas() -> BTreeMap<&'static str, Schema> {
    let own = [
        ("dtw", JsonDocuments::of::<Results>()),
        ("explain", JsonDocuments::of::<Explained>()),
        ("import", JsonDocuments::of::<Imported>()),
        ("inspect", JsonDocuments::of::<Inspection>()),
    ];
    let own = own.into_iter().map(|(command, documents)| (command, documents.schema(command)));
    calib_pipeline::json_schemas().into_iter().chain(own).collect()
}
