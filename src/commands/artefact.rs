//! Results that are made once: a directory counts only with a manifest that names its inputs.

use std::path::Path;

use anyhow::Context as _;
use calib_files::{Fingerprint, Fingerprinter, read_json, write_json};
use serde::{Serialize, de::DeserializeOwned};

/// Version of calib that wrote a file.
pub(super) const TOOL: &str = concat!("calib ", env!("CARGO_PKG_VERSION"));

/// File that completes a directory; written last, removed first.
pub(super) const MANIFEST: &str = "manifest.json";

/// What a manifest must tell about the inputs of its directory.
pub(super) trait Manifest: Serialize + DeserializeOwned {
    /// Version of the directory's format; another version is another artefact.
    const FORMAT: u32;

    /// Fingerprint of the inputs.
    fn key(&self) -> &str;

    /// Version that was written.
    fn format(&self) -> u32;
}

/// The manifest of `directory` if it is complete and of this format.
pub(super) fn read<M: Manifest>(directory: &Path) -> Option<M> {
    let manifest: M = read_json(&directory.join(MANIFEST)).ok()?;
    (manifest.format() == M::FORMAT).then_some(manifest)
}

/// The manifest of `directory`, or why there is none and which `command` makes it.
pub(super) fn require<M: Manifest>(directory: &Path, command: &str) -> anyhow::Result<M> {
    let path = directory.join(MANIFEST);
    if !path.exists() {
        anyhow::bail!("{} does not exist; run `calib {command}` first", path.display());
    }
    let manifest: M = read_json(&path)
        .with_context(|| format!("run `calib {command} --force` to make it again"))?;
    anyhow::ensure!(
        manifest.format() == M::FORMAT,
        "{} has format {}, this calib reads format {}; run `calib {command} --force`",
        path.display(),
        manifest.format(),
        M::FORMAT
    );
    Ok(manifest)
}

/// Begin to write `directory`: from here until [`complete`] it does not count.
pub(super) fn begin(directory: &Path) -> anyhow::Result<()> {
    calib_files::create_directory(directory)?;
    match std::fs::remove_file(directory.join(MANIFEST)) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
            Err(error).with_context(|| format!("cannot write {}", directory.display()))
        }
        _ => Ok(()),
    }
}

/// Complete `directory` with its manifest.
pub(super) fn complete<M: Manifest>(directory: &Path, manifest: &M) -> anyhow::Result<()> {
    Ok(write_json(&directory.join(MANIFEST), manifest)?)
}

/// Fingerprint of some inputs.
pub(super) fn key(inputs: &impl Serialize) -> anyhow::Result<String> {
    let text = serde_json::to_vec(inputs)?;
    let fingerprint: Fingerprint = Fingerprinter::default().add(&text).finish();
    Ok(fingerprint.to_string())
}
