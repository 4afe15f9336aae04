//! JSON files with a checksum: their last entry is the fingerprint of all before it.

use std::{io, path::Path};

use serde::{Serialize, de::DeserializeOwned};

use crate::{FileError, Fingerprint, read_regular, write_atomically, write_new};

const OPENS: &str = ",\n  \"fingerprint\": \"";
const CLOSES: &str = "\"\n}\n";
/// The end of a file without its fingerprint.
const END: &str = "\n}\n";
/// Hexadecimal digits of a fingerprint.
const DIGITS: usize = 64;

/// Writes `value` as [`crate::write_json`] does, with a last entry `fingerprint`: that of the file's bytes before that
/// entry.
///
/// # Errors
/// If the file cannot be written, or `value` is no object with entries.
pub fn write_sealed_json<T: Serialize>(path: &Path, value: &T) -> Result<(), FileError> {
    let text = sealed(path, value)?;
    write_atomically(path, |file| io::Write::write_all(file, text.as_bytes()))
}

/// Writes a new file as [`write_sealed_json`] does.
///
/// # Errors
/// As [`write_sealed_json`], and [`FileError::Occupied`] if it exists.
pub fn write_new_sealed_json<T: Serialize>(path: &Path, value: &T) -> Result<(), FileError> {
    let text = sealed(path, value)?;
    write_new(path, |file| io::Write::write_all(file, text.as_bytes()))
}

/// Returns the text of the file.
fn sealed<T: Serialize>(path: &Path, value: &T) -> Result<String, FileError> {
    let text = serde_json::to_string_pretty(value)
        .map_err(|error| FileError::io("write", path, error.into()))?
        + "\n";
    let body = text.strip_suffix(END).ok_or_else(|| {
        let reason = "only an object with entries has room for its fingerprint";
        FileError::io("write", path, io::Error::other(reason))
    })?;
    let seal = Fingerprint::of(body.as_bytes());
    Ok(format!("{body}{OPENS}{seal}{CLOSES}"))
}

/// Reads a file that [`write_sealed_json`] wrote.
///
/// # Errors
/// If it cannot be read, one byte of it has changed, or it does not have the form of `T`.
pub fn read_sealed_json<T: DeserializeOwned>(path: &Path) -> Result<T, FileError> {
    let bytes = read_regular(path)?;
    let length = OPENS.len() + DIGITS + CLOSES.len();
    let (body, seal) = bytes
        .len()
        .checked_sub(length)
        .map(|place| bytes.split_at(place))
        .filter(|(_, seal)| seal.starts_with(OPENS.as_bytes()) && seal.ends_with(CLOSES.as_bytes()))
        .ok_or_else(|| FileError::Damaged {
            path: path.to_owned(),
            reason: "it does not end with its fingerprint: it is cut off, or another version wrote it",
        })?;
    let digits = &seal[OPENS.len()..OPENS.len() + DIGITS];
    if Fingerprint::of(body).as_str().as_bytes() != digits {
        let reason = "its content does not have the fingerprint at its end";
        return Err(FileError::Damaged { path: path.to_owned(), reason });
    }
    let text = [body, END.as_bytes()].concat();
    serde_json::from_slice(&text)
        .map_err(|source| FileError::Json { path: path.to_owned(), source })
}

#[cfg(test)]
mod tests {
    use std::{collections::BTreeMap, fs};

    use super::*;

    type Map = BTreeMap<String, Vec<f64>>;

    fn written() -> (tempfile::TempDir, std::path::PathBuf, Map) {
        let directory = tempfile::tempdir().expect("a directory");
        let path = directory.path().join("a.json");
        let value =
            Map::from([("a \"b\"\n".to_owned(), vec![0.1, -2e300]), ("c".to_owned(), vec![])]);
        write_sealed_json(&path, &value).expect("written");
        (directory, path, value)
    }

    #[test]
    fn comes_back_and_stays_json() {
        let (_directory, path, value) = written();
        assert_eq!(read_sealed_json::<Map>(&path).expect("whole"), value);
        let json: serde_json::Value = crate::read_json(&path).expect("JSON");
        assert_eq!(json["fingerprint"].as_str().expect("a text").len(), DIGITS);
        assert!(
            write_sealed_json(&path, &3).is_err() && write_sealed_json(&path, &Map::new()).is_err()
        );
        assert_eq!(read_sealed_json::<Map>(&path).expect("untouched"), value);
    }

    #[test]
    fn no_byte_can_change() {
        let (_directory, path, _) = written();
        let whole = fs::read(&path).expect("readable");
        for place in 0..whole.len() {
            let mut other = whole.clone();
            other[place] ^= 1 << (place % 8);
            fs::write(&path, &other).expect("written");
            assert!(read_sealed_json::<Map>(&path).is_err(), "byte {place}");
            fs::write(&path, &whole[..place]).expect("written");
            assert!(read_sealed_json::<Map>(&path).is_err(), "cut at {place}");
        }
        fs::write(&path, [&whole[..], b"\n"].concat()).expect("written");
        assert!(read_sealed_json::<Map>(&path).is_err(), "longer");
    }
}
