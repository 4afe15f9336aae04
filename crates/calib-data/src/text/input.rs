//! Reads the bytes of a text file with any supported compression.

use std::{
    fs::File,
    io::{BufReader, Cursor, Read},
    path::Path,
};

use calib_files::{FileError, open_regular};

use crate::DataError;

/// A text file that is being read.
pub(crate) type Input = Box<dyn Read + Send>;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Compression {
    Plain,
    Gzip,
    Zstandard,
}

/// Opens a text file, decompressed and without a byte order mark of UTF-8.
pub(crate) fn open(path: &Path) -> Result<(Input, Compression), DataError> {
    let mut file = open_regular(path)?;
    let mut magic = [0; 4];
    let length =
        fill(&mut file, &mut magic).map_err(|source| FileError::io("read", path, source))?;
    let file = Cursor::new(magic).take(length as u64).chain(file);
    let file = BufReader::with_capacity(1 << 18, file);
    let (mut input, compression): (Input, _) = match magic {
        [0x1F, 0x8B, ..] => {
            (Box::new(flate2::bufread::MultiGzDecoder::new(file)), Compression::Gzip)
        }
        [0x28, 0xB5, 0x2F, 0xFD] => {
            let decoder = zstd::Decoder::with_buffer(file)
                .map_err(|source| FileError::io("read", path, source))?;
            (Box::new(decoder), Compression::Zstandard)
        }
        _ => (Box::new(file), Compression::Plain),
    };
    let mut mark = [0; 3];
    let length = fill(&mut input, &mut mark).map_err(|error| unreadable(path, &error))?;
    match mark {
        [0xFF, 0xFE, _] | [0xFE, 0xFF, _] => Err(DataError::NotText {
            path: path.to_owned(),
            reason: "it is text in UTF-16; save or convert it as UTF-8".to_owned(),
        }),
        [0xEF, 0xBB, 0xBF] => Ok((input, compression)),
        _ => Ok((Box::new(Cursor::new(mark).take(length as u64).chain(input)), compression)),
    }
}

/// Returns the error for a damaged compressed file.
pub(crate) fn unreadable(path: &Path, error: &std::io::Error) -> DataError {
    let reason = format!(
        "it cannot be unpacked: {error} (truncated or damaged?); export it again, or leave it out"
    );
    DataError::NotText { path: path.to_owned(), reason }
}

/// Reads until `bytes` is full or the file ends.
pub(crate) fn fill(input: &mut dyn Read, bytes: &mut [u8]) -> std::io::Result<usize> {
    let mut length = 0;
    while length < bytes.len() {
        match input.read(&mut bytes[length..]) {
            Ok(0) => break,
            Ok(read) => length += read,
            Err(error) if error.kind() == std::io::ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
    }
    Ok(length)
}

/// Whether a text file is empty after decompression.
pub(crate) fn is_empty(path: &Path) -> Result<bool, DataError> {
    // A compressed empty file has some twenty bytes.
    if size(path)? > SMALL {
        return Ok(false);
    }
    let (mut input, _) = open(path)?;
    let length = fill(&mut input, &mut [0]).map_err(|error| unreadable(path, &error))?;
    Ok(length == 0)
}

/// A file of more bytes is not empty.
const SMALL: u64 = 1 << 10;

/// Returns the size of a file on the disk, in bytes.
pub(crate) fn size(path: &Path) -> Result<u64, DataError> {
    let file: File = open_regular(path)?;
    Ok(file.metadata().map_err(|source| FileError::io("read", path, source))?.len())
}

#[cfg(test)]
mod tests {
    use std::{fs, io::Write as _};

    use super::*;

    fn read(path: &Path) -> Result<String, DataError> {
        let (mut input, _) = open(path)?;
        let mut text = String::new();
        input.read_to_string(&mut text).map_err(|error| unreadable(path, &error))?;
        Ok(text)
    }

    #[test]
    fn packed_and_marked_files_are_the_same_text() {
        let directory = tempfile::tempdir().expect("a directory");
        let path = directory.path().join("a.csv");
        let mut gzip = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
        gzip.write_all(b"time,a\n").expect("memory");
        let gzip = gzip.finish().expect("memory");
        let two_members = [gzip.clone(), gzip.clone()].concat();
        let zstd = zstd::encode_all(&b"time,a\n"[..], 1).expect("memory");
        for bytes in [&b"time,a\n"[..], b"\xEF\xBB\xBFtime,a\n", &gzip, &zstd] {
            fs::write(&path, bytes).expect("written");
            assert_eq!(read(&path).expect("text"), "time,a\n");
        }
        fs::write(&path, two_members).expect("written");
        assert_eq!(read(&path).expect("text"), "time,a\ntime,a\n");
        for bytes in ["", "a", "ab"] {
            fs::write(&path, bytes).expect("written");
            assert_eq!(read(&path).expect("text"), bytes);
        }
        assert!(!is_empty(&path).expect("readable"));
        let packed = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
        for bytes in [packed.finish().expect("memory"), Vec::new()] {
            fs::write(&path, bytes).expect("written");
            assert!(is_empty(&path).expect("readable"));
        }
        fs::write(&path, b"\xFF\xFEt\0").expect("written");
        assert!(read(&path).expect_err("UTF-16").to_string().contains("UTF-16"));
        fs::write(&path, &gzip[..gzip.len() - 9]).expect("written");
        assert!(read(&path).is_err(), "a truncated file");
    }
}
