use std::{
    fmt,
    fs::File,
    io::{self, Read as _},
    path::Path,
};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{FileError, open_regular};

/// The BLAKE3 hash of some content, as 64 hexadecimal digits.
#[derive(Clone, Debug, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(transparent)]
pub struct Fingerprint(String);

impl Fingerprint {
    /// Returns the fingerprint of these bytes.
    pub fn of(bytes: &[u8]) -> Self {
        Self(blake3::hash(bytes).to_hex().to_string())
    }

    /// Returns the first twelve digits, for people.
    pub fn short(&self) -> &str {
        &self.0[..self.0.len().min(12)]
    }

    /// Returns all digits.
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl fmt::Display for Fingerprint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

/// Builds one fingerprint from parts. Parts are length-prefixed, so that different splits give
/// different fingerprints.
#[derive(Debug, Default)]
pub struct Fingerprinter(blake3::Hasher);

impl Fingerprinter {
    /// Adds a part.
    pub fn add(&mut self, bytes: &[u8]) -> &mut Self {
        self.0.update(&(bytes.len() as u64).to_le_bytes()).update(bytes);
        self
    }

    /// Returns the fingerprint of all parts so far.
    pub fn finish(&self) -> Fingerprint {
        Fingerprint(self.0.finalize().to_hex().to_string())
    }
}

/// Bytes per read: a block that fits in the cache of a core, whose chunks are hashed side by side.
const READ_AT_ONCE: usize = 1 << 20;

/// Returns the fingerprint of a file's content. Large files are hashed on all threads.
///
/// # Errors
/// If the file cannot be read, or is not a regular file: a pipe cannot be read twice.
pub fn fingerprint_file(path: &Path) -> Result<Fingerprint, FileError> {
    let mut file = open_regular(path)?;
    fingerprint_rest(&mut file).map_err(|source| FileError::io("read", path, source))
}

/// Returns the fingerprint of the unread rest of a file.
fn fingerprint_rest(file: &mut File) -> io::Result<Fingerprint> {
    let size = usize::try_from(file.metadata()?.len()).unwrap_or(READ_AT_ONCE);
    let mut hasher = blake3::Hasher::new();
    let mut buffer = vec![0; size.clamp(1, READ_AT_ONCE)];
    loop {
        match file.read(&mut buffer)? {
            0 => return Ok(Fingerprint(hasher.finalize().to_hex().to_string())),
            read => hasher.update_rayon(&buffer[..read]),
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fingerprint_of_parts(parts: &[&str]) -> Fingerprint {
        let mut fingerprinter = Fingerprinter::default();
        for part in parts {
            fingerprinter.add(part.as_bytes());
        }
        fingerprinter.finish()
    }

    #[test]
    fn parts_do_not_run_together() {
        assert_ne!(fingerprint_of_parts(&["ab", "c"]), fingerprint_of_parts(&["a", "bc"]));
        assert_eq!(fingerprint_of_parts(&["ab", "c"]), fingerprint_of_parts(&["ab", "c"]));
    }

    #[test]
    fn a_file_has_the_fingerprint_of_its_bytes() {
        let file = tempfile::NamedTempFile::new().expect("a file");
        std::fs::write(file.path(), b"content").expect("written");
        assert_eq!(fingerprint_file(file.path()).expect("readable"), Fingerprint::of(b"content"));
        let long: Vec<u8> = (0..2 * READ_AT_ONCE + 77).map(|place| (place % 251) as u8).collect();
        std::fs::write(file.path(), &long).expect("written");
        assert_eq!(fingerprint_file(file.path()).expect("readable"), Fingerprint::of(&long));
    }
}
