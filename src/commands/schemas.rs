//! What `--json` of each command prints, as JSON Schema.

use std::collections::BTreeMap;

use calib_data::Imported;
use calib_pipeline::{Inspection, JsonDocuments};
use schemars::Schema;

use super::{dtw::Results, explain::Explained};

/// The schemas of what all commands print, by command. `cargo run --example json_schemas -- FOLDER` writes them.
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
