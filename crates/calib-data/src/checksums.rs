//! Checks the checksums of Parquet pages.
//!
//! The reader ignores the CRC that writers may store in a page header, and the CRC at the end of gzip data, so damage
//! on disk would change values. This module checks both before the reader sees the pages. Pages with neither cannot be
//! checked.

use std::{
    io::{self, BufReader, Read, Seek as _},
    path::Path,
};

use calib_files::{FileError, HeldFile, HeldReader};
use flate2::read::MultiGzDecoder;
use polars::prelude as pl;
use polars_parquet_format::{
    CompressionCodec, PageHeader, PageType, thrift::protocol::TCompactInputProtocol,
};
use rayon::prelude::*;

use crate::catch_panic::catch_panic;

/// Number of bytes that are read at a time where only headers are needed.
const WINDOW: usize = 1 << 14;

/// A run of pages: one column in one row group.
struct Chunk {
    column: String,
    row_group: usize,
    /// First byte and the byte after the last.
    bytes: [u64; 2],
    values: i64,
    /// Uncompressed bytes of all pages.
    unpacked: i64,
    is_gzip: bool,
    /// Whether a value is either present or missing: no lists, no structs.
    is_optional: bool,
}

/// Checks every page of the columns for which `is_wanted` is true, in the file that `metadata` describes.
///
/// # Errors
/// The first damage, in words; or an error if the file cannot be read.
pub(crate) fn verify(
    path: &Path,
    file: &HeldFile,
    metadata: &pl::FileMetadata,
    is_wanted: impl Fn(&str) -> bool,
) -> Result<Result<(), String>, FileError> {
    // The offsets of damaged chunks may overflow, which makes the reader's library panic.
    let chunks = match catch_panic(|| Ok(chunks(metadata, is_wanted))) {
        Ok(chunks) => chunks,
        Err(reason) => return Ok(Err(reason)),
    };
    let found: Vec<Option<String>> = chunks
        .par_iter()
        .map(|chunk| damage_of(chunk, path, file))
        .collect::<Result<Vec<_>, FileError>>()?;
    Ok(found.into_iter().flatten().next().map_or(Ok(()), Err))
}

/// Returns the damage of a chunk in words; `None` if it is intact.
fn damage_of(chunk: &Chunk, path: &Path, file: &HeldFile) -> Result<Option<String>, FileError> {
    match chunk.check(file.reader(chunk.bytes[0])?) {
        Ok(damage) => Ok(damage.map(|damage| chunk.told(&damage))),
        // The reader reports in its own words what it cannot read.
        Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => {
            Ok(Some(chunk.told("is cut off")))
        }
        Err(error) => Err(FileError::io("read", path, error)),
    }
}

fn chunks(metadata: &pl::FileMetadata, is_wanted: impl Fn(&str) -> bool) -> Vec<Chunk> {
    let mut chunks = Vec::new();
    for (row_group, group) in metadata.row_groups.iter().enumerate() {
        for column in group.parquet_columns() {
            let path = &column.descriptor().path_in_schema;
            let Some(name) = path.first().filter(|name| is_wanted(name.as_str())) else { continue };
            let range = column.byte_range();
            let levels = &column.descriptor().descriptor;
            chunks.push(Chunk {
                is_optional: levels.max_def_level == 1 && levels.max_rep_level == 0,
                column: name.to_string(),
                row_group,
                bytes: [range.start, range.end],
                values: column.num_values(),
                unpacked: column.uncompressed_size(),
                is_gzip: CompressionCodec::from(column.compression()) == CompressionCodec::GZIP,
            });
        }
    }
    chunks
}

impl Chunk {
    /// Checks the pages in order and returns the damage of the first damaged one.
    fn check(&self, file: HeldReader) -> io::Result<Option<String>> {
        // Each page is read into memory as a whole. None may be larger than the file.
        if self.bytes[1] > file.len()? {
            return Ok(Some("is cut off".to_owned()));
        }
        let mut reader = BufReader::with_capacity(WINDOW, file);
        let mut seen = 0_i64;
        let mut place = self.bytes[0];
        let mut content = Vec::new();
        while seen < self.values && place < self.bytes[1] {
            let left = (self.bytes[1] - place) as usize;
            let Ok(header) = header(&mut reader, left) else {
                return Ok(Some("has a page whose header is damaged".to_owned()));
            };
            if !self.is_possible(&header, self.values - seen) {
                return Ok(Some("has a page whose header holds impossible numbers".to_owned()));
            }
            seen += values(&header);
            let Ok(size) = usize::try_from(header.compressed_page_size) else {
                return Ok(Some("has a page of negative size".to_owned()));
            };
            place = reader.stream_position()?;
            if size as u64 > self.bytes[1].saturating_sub(place) {
                return Ok(Some("has a page that is longer than its column".to_owned()));
            }
            if header.crc.is_some() || self.is_gzip {
                content.resize(size, 0);
                reader.read_exact(&mut content)?;
                if let Some(damage) = Self::damage(&header, &content) {
                    return Ok(Some(damage));
                }
                if self.is_optional && !counts_its_nulls(&header, &content) {
                    return Ok(Some(
                        "has a page with another number of nulls than it says".to_owned(),
                    ));
                }
            } else {
                reader.seek_relative(size as i64)?;
            }
            place += size as u64;
        }
        Ok((seen != self.values).then(|| "has fewer values than the file says".to_owned()))
    }

    /// Whether the numbers in a header agree with those in the footer. No checksum covers a header, and the reader
    /// allocates as much memory as it asks for.
    fn is_possible(&self, header: &PageHeader, left: i64) -> bool {
        let [packed, unpacked] = [header.compressed_page_size, header.uncompressed_page_size];
        let sizes = packed >= 0 && unpacked >= 0 && i64::from(unpacked) <= self.unpacked;
        let of_data = values(header);
        let of_dictionary =
            header.dictionary_page_header.as_ref().map_or(0, |page| page.num_values);
        let v2 = header.data_page_header_v2.as_ref().is_none_or(|v2| {
            let counts = 0..=v2.num_values;
            let lengths = [v2.definition_levels_byte_length, v2.repetition_levels_byte_length];
            counts.contains(&v2.num_nulls)
                && counts.contains(&v2.num_rows)
                && lengths.iter().all(|length| (0..=packed).contains(length))
        });
        sizes && v2 && (0..=left).contains(&of_data) && (0..=unpacked).contains(&of_dictionary)
    }

    /// Returns the damage of a page's content.
    fn damage(header: &PageHeader, content: &[u8]) -> Option<String> {
        if let Some(written) = header.crc {
            let whole = crc32fast::hash(content) == written.cast_unsigned();
            return (!whole).then(|| "has a page whose CRC does not fit its content".to_owned());
        }
        let packed = &content[levels(header).min(content.len())..];
        let stored =
            header.data_page_header_v2.as_ref().is_some_and(|v2| v2.is_compressed == Some(false));
        if stored || packed.is_empty() {
            return None;
        }
        let unpacked = io::copy(&mut MultiGzDecoder::new(packed), &mut io::sink());
        let expected = u64::try_from(header.uncompressed_page_size).ok();
        let expected = expected.and_then(|size| size.checked_sub(levels(header) as u64));
        match unpacked {
            Ok(size) if Some(size) == expected => None,
            Ok(_) => Some("has a page of another size than its header says".to_owned()),
            Err(error) => Some(format!("has a page that cannot be unpacked ({error})")),
        }
    }

    fn told(&self, damage: &str) -> String {
        format!("column {} in row group {} {damage}", self.column, self.row_group + 1)
    }
}

/// Whether the number of nulls in the header of a v2 page matches its definition levels. The reader trusts the header,
/// and values would move to other rows.
fn counts_its_nulls(header: &PageHeader, content: &[u8]) -> bool {
    let Some(v2) = &header.data_page_header_v2 else { return true };
    let length = usize::try_from(v2.definition_levels_byte_length).unwrap_or(usize::MAX);
    let expected = v2.num_values - v2.num_nulls;
    content.get(..length).and_then(|levels| ones(levels, v2.num_values)) == Some(expected)
}

/// Counts the ones among `count` levels, which are encoded as run lengths and packed bits (Parquet's hybrid encoding).
fn ones(mut levels: &[u8], count: i32) -> Option<i32> {
    let mut left = count;
    let mut ones = 0;
    while left > 0 {
        let mut head = 0_u32;
        for shift in (0..).step_by(7) {
            let (&byte, rest) = levels.split_first()?;
            levels = rest;
            head |= u32::from(byte & 0x7f).checked_shl(shift)?;
            if byte < 0x80 {
                break;
            }
        }
        let run = i32::try_from(head >> 1).ok()?;
        if head & 1 == 0 {
            let (&value, rest) = levels.split_first()?;
            levels = rest;
            ones += if value == 1 { run.min(left) } else { 0 };
            left -= run.min(left);
        } else {
            for _ in 0..run {
                let (&bits, rest) = levels.split_first()?;
                levels = rest;
                let inside = left.min(8);
                ones += (u32::from(bits) & ((1 << inside) - 1)).count_ones() as i32;
                left -= inside;
            }
        }
        if run == 0 {
            return None;
        }
    }
    Some(ones)
}

/// Reads the header of the next page and nothing after it.
fn header(reader: &mut BufReader<HeldReader>, most: usize) -> Result<PageHeader, String> {
    // The numbers of a damaged header can ask for any amount of memory.
    let most = most.min(1 << 26);
    let mut protocol = TCompactInputProtocol::new(reader.by_ref(), most);
    PageHeader::read_from_in_protocol(&mut protocol).map_err(|error| error.to_string())
}

/// Returns the number of values in a page; 0 for dictionaries and indices.
fn values(header: &PageHeader) -> i64 {
    let of_data = header.data_page_header.as_ref().map(|page| page.num_values);
    let of_data = of_data.or(header.data_page_header_v2.as_ref().map(|page| page.num_values));
    match header.type_ {
        PageType::DATA_PAGE | PageType::DATA_PAGE_V2 => of_data.map_or(0, i64::from),
        _ => 0,
    }
}

/// Returns the number of bytes at the beginning of a page that are never compressed.
fn levels(header: &PageHeader) -> usize {
    let Some(v2) = &header.data_page_header_v2 else { return 0 };
    [v2.definition_levels_byte_length, v2.repetition_levels_byte_length]
        .into_iter()
        .map(|bytes| usize::try_from(bytes).unwrap_or(0))
        .sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_are_counted() {
        // A run of five ones, then eight packed levels of which three count.
        assert_eq!(ones(&[10, 1, 3, 0b1010_0101], 8), Some(5 + 2));
        assert_eq!(ones(&[0xc8, 0x01, 0], 100), Some(0));
        assert_eq!(ones(&[0xc8, 0x01, 1], 100), Some(100));
        for damaged in [&[][..], &[0, 1], &[10], &[0xff; 9], &[3]] {
            assert_eq!(ones(damaged, 100), None, "{damaged:?}");
        }
    }
}
