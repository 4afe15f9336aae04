//! Writes the JSON Schemas of the `--json` output of all commands: `cargo run --example json_schemas -- FOLDER`.

use std::{error::Error, fs, path::PathBuf};

fn main() -> Result<(), Box<dyn Error>> {
    let folder = PathBuf::from(std::env::args_os().nth(1).ok_or("name a folder")?);
    fs::create_dir_all(&folder)?;
    for (command, schema) in calib::json_schemas() {
        let text = serde_json::to_string_pretty(&schema)? + "\n";
        fs::write(folder.join(format!("{}.schema.json", command.replace(' ', "-"))), text)?;
    }
    Ok(())
}
