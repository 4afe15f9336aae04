use std::{io::Read as _, path::Path};

use crate::{FileError, npy_header::NpyHeader, open_regular, read_regular};

/// An array of numbers, as `f64`, row-major.
#[derive(Clone, Debug, PartialEq)]
pub struct Array {
    /// Length of each dimension; empty for a single number.
    pub shape: Vec<usize>,
    /// The values, last dimension fastest.
    pub values: Vec<f64>,
}

/// Reads a NumPy file of any shape and any real number type up to 64 bits, in either byte order, row- or column-major.
///
/// # Errors
/// If the file cannot be read, is not NumPy's, is truncated, or holds anything but numbers.
pub fn read_array(path: &Path) -> Result<Array, FileError> {
    let bytes = read_regular(path)?;
    parse(&bytes).map_err(|reason| FileError::npy(path, reason))
}

/// Returns the memory that [`read_array`] takes for a file, in bytes, from its header alone.
///
/// # Errors
/// As [`read_array`].
pub fn array_bytes(path: &Path) -> Result<u64, FileError> {
    let file = open_regular(path)?;
    let length = file.metadata().map_err(|source| FileError::io("read", path, source))?.len();
    let mut begin = Vec::new();
    file.take(LONGEST_HEADER)
        .read_to_end(&mut begin)
        .map_err(|source| FileError::io("read", path, source))?;
    let numbers = NpyHeader::parse(&begin).and_then(|header| {
        let size = Kind::of(header.description)?.size;
        count(&header, size, length.saturating_sub(header.data as u64))
    });
    let bytes = numbers.map(|count| length.saturating_add(8_u64.saturating_mul(count)));
    bytes.map_err(|reason| FileError::npy(path, reason))
}

/// Bytes at the start of a file in which its header is searched. NumPy itself writes headers of some hundred bytes.
const LONGEST_HEADER: u64 = 1 << 20;

/// Returns the number of values of `size` bytes in `bytes` of data, which must match the shape.
fn count(header: &NpyHeader<'_>, size: usize, bytes: u64) -> Result<u64, String> {
    let expected = header.bytes(size);
    if expected.map(|expected| expected as u64) == Some(bytes) {
        return Ok(bytes / size as u64);
    }
    Err(format!(
        "expected {} bytes of data for the shape {:?}, got {bytes}: the file is truncated or damaged",
        expected.map_or_else(|| "more".to_owned(), |expected| expected.to_string()),
        header.shape,
    ))
}

fn parse(bytes: &[u8]) -> Result<Array, String> {
    let header = NpyHeader::parse(bytes)?;
    let kind = Kind::of(header.description)?;
    let data = &bytes[header.data..];
    let count = count(&header, kind.size, data.len() as u64)? as usize;
    let NpyHeader { shape, is_column_major, .. } = header;
    let mut values = room(count)?;
    match *shape.as_slice() {
        [rows, columns] if is_column_major => {
            values.resize(count, 0.0);
            read_transposed(&kind, data, rows, columns, &mut values);
        }
        _ => {
            values.extend(data.chunks_exact(kind.size).map(|chunk| kind.read(chunk)));
            if is_column_major {
                values = row_major(&values, &shape, room(count)?);
            }
        }
    }
    Ok(Array { shape, values })
}

/// Reads a column-major matrix into a row-major one, in blocks: numbers that are far apart in one layout are adjacent
/// in the other.
fn read_transposed(kind: &Kind, data: &[u8], rows: usize, columns: usize, values: &mut [f64]) {
    const BLOCK: usize = 64;
    for first_row in (0..rows).step_by(BLOCK) {
        for first_column in (0..columns).step_by(BLOCK) {
            for column in first_column..columns.min(first_column + BLOCK) {
                for row in first_row..rows.min(first_row + BLOCK) {
                    let place = (column * rows + row) * kind.size;
                    values[row * columns + column] = kind.read(&data[place..place + kind.size]);
                }
            }
        }
    }
}

/// Allocates memory for `count` numbers.
fn room(count: usize) -> Result<Vec<f64>, String> {
    let mut values = Vec::new();
    let reserved = values.try_reserve_exact(count);
    reserved.map_err(|_| format!("its {count} numbers do not fit into memory; take fewer"))?;
    Ok(values)
}

/// The storage format of a number.
struct Kind {
    letter: char,
    size: usize,
    big_endian: bool,
}

impl Kind {
    fn of(name: &str) -> Result<Self, String> {
        let mut characters = name.chars();
        let (Some(order), Some(letter)) = (characters.next(), characters.next()) else {
            return Err(unknown_type(name));
        };
        let size = characters.as_str().parse().map_err(|_| unknown_type(name))?;
        let known = match letter {
            'f' => matches!(size, 4 | 8),
            'i' | 'u' => matches!(size, 1 | 2 | 4 | 8),
            'b' => size == 1,
            _ => false,
        };
        if !known || !matches!(order, '<' | '>' | '|' | '=') {
            return Err(unknown_type(name));
        }
        Ok(Self { letter, size, big_endian: order == '>' })
    }

    fn read(&self, chunk: &[u8]) -> f64 {
        let mut bytes = [0; 8];
        bytes[..self.size].copy_from_slice(chunk);
        if self.big_endian {
            bytes[..self.size].reverse();
        }
        let bits = u64::from_le_bytes(bytes);
        // Signed numbers are shifted left and back, which extends the sign.
        let unused = 64 - 8 * self.size as u32;
        match (self.letter, self.size) {
            ('f', 4) => f64::from(f32::from_bits(bits as u32)),
            ('f', _) => f64::from_bits(bits),
            ('i', _) => ((bits << unused) as i64 >> unused) as f64,
            ('b', _) => f64::from(u8::from(bits != 0)),
            _ => bits as f64,
        }
    }
}

/// Returns why numbers of a type cannot be read.
fn unknown_type(name: &str) -> String {
    format!("expected real numbers of at most 64 bits, got type '{name}'")
}

/// Returns column-major values in row-major order.
fn row_major(values: &[f64], shape: &[usize], mut ordered: Vec<f64>) -> Vec<f64> {
    let mut index = vec![0; shape.len()];
    for _ in 0..values.len() {
        let place = index.iter().zip(shape).rev().fold(0, |place, (i, length)| place * length + i);
        ordered.push(values[place]);
        for (i, length) in index.iter_mut().zip(shape).rev() {
            *i += 1;
            if *i < *length {
                break;
            }
            *i = 0;
        }
    }
    ordered
}

#[cfg(test)]
mod tests {
    use super::*;

    fn npy(version: u8, descr: &str, order: &str, shape: &str, data: &[u8]) -> Vec<u8> {
        let header =
            format!("{{'descr': '{descr}', 'fortran_order': {order}, 'shape': {shape}, }}\n");
        let mut bytes = b"\x93NUMPY".to_vec();
        bytes.extend([version, 0]);
        match version {
            1 => bytes.extend((header.len() as u16).to_le_bytes()),
            _ => bytes.extend((header.len() as u32).to_le_bytes()),
        }
        bytes.extend(header.as_bytes());
        bytes.extend(data);
        bytes
    }

    /// Returns the two numbers of a type that `data` holds.
    fn pair_of(descr: &str, data: &[u8]) -> Vec<f64> {
        parse(&npy(1, descr, "False", "(2,)", data)).expect(descr).values
    }

    #[test]
    fn every_number_type_is_read() {
        assert_eq!(pair_of("|i1", &[1, 0xff]), [1.0, -1.0]);
        assert_eq!(pair_of("|u1", &[1, 0xff]), [1.0, 255.0]);
        assert_eq!(pair_of("|b1", &[1, 0]), [1.0, 0.0]);
        assert_eq!(pair_of("|b1", &[7, 0]), [1.0, 0.0], "as NumPy has it");
        assert_eq!(pair_of("<i2", &[1, 0, 0xfe, 0xff]), [1.0, -2.0]);
        assert_eq!(pair_of(">i2", &[0, 1, 0xff, 0xfe]), [1.0, -2.0]);
        assert_eq!(pair_of(">u4", &[0, 0, 0, 1, 0xff, 0, 0, 0]), [1.0, 4_278_190_080.0]);
        assert_eq!(
            pair_of("<i8", &[7_i64.to_le_bytes(), (-7_i64).to_le_bytes()].concat()),
            [7.0, -7.0]
        );
        let floats = [1.5_f32.to_le_bytes(), (-0.25_f32).to_le_bytes()].concat();
        assert_eq!(pair_of("<f4", &floats), [1.5, -0.25]);
        let doubles = [0.1_f64.to_be_bytes(), f64::MAX.to_be_bytes()].concat();
        assert_eq!(pair_of(">f8", &doubles), [0.1, f64::MAX]);
    }

    #[test]
    fn shapes_and_orders() {
        let data = [0, 1, 2, 3, 4, 5];
        let array = parse(&npy(2, "|u1", "False", "(2, 3)", &data)).expect("valid");
        assert_eq!((array.shape, array.values[2]), (vec![2, 3], 2.0));
        let array = parse(&npy(3, "|u1", "True", "(2, 3)", &data)).expect("valid");
        assert_eq!(array.values, [0.0, 2.0, 4.0, 1.0, 3.0, 5.0]);
        let wide: Vec<u8> = (0..200_u8).collect();
        let array = parse(&npy(1, "|u1", "True", "(2, 100)", &wide)).expect("valid");
        assert_eq!((array.values[0], array.values[1], array.values[100]), (0.0, 2.0, 1.0));
        let array = parse(&npy(1, "|u1", "True", "(100, 2)", &wide)).expect("valid");
        assert_eq!((array.values[0], array.values[1], array.values[199]), (0.0, 100.0, 199.0));
        let array = parse(&npy(1, "|u1", "True", "(2, 1, 3)", &data)).expect("valid");
        assert_eq!(array.values, [0.0, 2.0, 4.0, 1.0, 3.0, 5.0]);
        let number = parse(&npy(1, "|u1", "False", "()", &[9])).expect("valid");
        assert_eq!((number.shape.len(), number.values), (0, vec![9.0]));
        let none = parse(&npy(1, "<f8", "False", "(0,)", &[])).expect("valid");
        assert_eq!((none.shape, none.values), (vec![0], vec![]));
    }

    #[test]
    fn what_calib_writes_is_read() {
        let directory = tempfile::tempdir().expect("a directory");
        let path = directory.path().join("a.npy");
        crate::write_npy(&path, &[1.0_f32, 2.0, 3.0, 4.0], 2, 2).expect("written");
        let array = read_array(&path).expect("readable");
        assert_eq!(array, Array { shape: vec![2, 2], values: vec![1.0, 2.0, 3.0, 4.0] });
    }

    #[test]
    fn what_a_file_would_take_is_known_from_its_header() {
        let directory = tempfile::tempdir().expect("a directory");
        let path = directory.path().join("a.npy");
        let whole = npy(1, "|u1", "True", "(2, 3)", &[0; 6]);
        std::fs::write(&path, &whole).expect("written");
        assert_eq!(array_bytes(&path).expect("whole"), whole.len() as u64 + 48);
        // The shape declares more data than the file holds.
        let header = npy(1, "<f8", "True", "(2000000, 500000)", &[]);
        std::fs::write(&path, &header).expect("written");
        assert!(array_bytes(&path).expect_err("cut").to_string().contains("truncated"));
        let file = std::fs::File::options().write(true).open(&path).expect("there");
        file.set_len(header.len() as u64 + 8_000_000_000_000).expect("a hole");
        assert_eq!(array_bytes(&path).expect("a hole"), header.len() as u64 + 16_000_000_000_000);
    }

    fn refusal(bytes: &[u8]) -> String {
        parse(bytes).expect_err("refused")
    }

    #[test]
    fn other_files_are_refused_with_the_reason() {
        assert!(refusal(b"PAR1").contains("does not begin"));
        assert!(refusal(b"\x93NUMPY\x01\x00\xff\xff{").contains("cut off"));
        assert!(refusal(&npy(1, "<c16", "False", "(1,)", &[0; 16])).contains("'<c16'"));
        assert!(refusal(&npy(1, "<U3", "False", "(1,)", &[0; 12])).contains("real numbers"));
        let short = refusal(&npy(1, "<f8", "False", "(3,)", &[0; 17]));
        assert!(short.contains("expected 24 bytes") && short.contains("got 17"), "{short}");
        let huge = "(18446744073709551615, 2)";
        assert!(refusal(&npy(1, "<f8", "False", huge, &[])).contains("truncated or damaged"));
    }
}
