//! Splits a text file into blocks of whole records.

use std::{io::Read as _, ops::Range, path::PathBuf};

use calib_text::Marks;

use super::input::{Input, fill, unreadable};
use crate::DataError;

/// Bytes of a block, and the maximum when it grows to hold one record.
const BLOCK: usize = 16 << 20;
const LONGEST_RECORD: usize = 256 << 20;

pub(crate) struct Blocks {
    input: Input,
    path: PathBuf,
    marks: Marks,
    rest: Vec<u8>,
    ended: bool,
    /// Number of lines before the next block.
    line: u64,
    size: usize,
}

/// A block of whole records.
pub(crate) struct Block {
    pub(crate) bytes: Vec<u8>,
    /// Parts of whole records, for reading in parallel, and the number of lines before each.
    pub(crate) parts: Vec<(Range<usize>, u64)>,
}

impl Blocks {
    /// Reads what follows the first `skip` bytes of `input`, which are `lines` lines.
    pub(crate) fn new(
        mut input: Input,
        path: PathBuf,
        marks: Marks,
        (skip, lines): (u64, u64),
    ) -> Result<Self, DataError> {
        std::io::copy(&mut (&mut input).take(skip), &mut std::io::sink())
            .map_err(|error| unreadable(&path, &error))?;
        Ok(Self { input, path, marks, rest: Vec::new(), ended: false, line: lines, size: BLOCK })
    }

    /// Returns the next block, in about `parts` parts.
    pub(crate) fn next(&mut self, parts: usize) -> Result<Option<Block>, DataError> {
        let mut bytes = std::mem::take(&mut self.rest);
        loop {
            self.read_to(self.size.max(bytes.len() + self.size / 2 + 1), &mut bytes)?;
            if bytes.is_empty() {
                return Ok(None);
            }
            let ends = record_ends(&bytes, self.marks, bytes.len() / parts.max(1) + 1);
            // The last record needs no line break.
            let end = if self.ended { Some(bytes.len()) } else { ends.last().copied() };
            if let Some(end) = end {
                self.rest = bytes.split_off(end);
                let parts = self.parts(&bytes, &ends);
                return Ok(Some(Block { bytes, parts }));
            }
            if bytes.len() > LONGEST_RECORD {
                return Err(DataError::NotText {
                    path: self.path.clone(),
                    reason: format!(
                        "line {} has no end: a quote is never closed, or it is no text",
                        self.line + 1
                    ),
                });
            }
        }
    }

    fn read_to(&mut self, size: usize, bytes: &mut Vec<u8>) -> Result<(), DataError> {
        if self.ended {
            return Ok(());
        }
        let start = bytes.len();
        bytes.resize(size.max(start), 0);
        let read = fill(&mut self.input, &mut bytes[start..])
            .map_err(|error| unreadable(&self.path, &error))?;
        self.ended = start + read < bytes.len();
        bytes.truncate(start + read);
        Ok(())
    }

    fn parts(&mut self, bytes: &[u8], ends: &[usize]) -> Vec<(Range<usize>, u64)> {
        let mut parts = Vec::with_capacity(ends.len() + 1);
        let mut start = 0;
        for &end in ends.iter().chain([&bytes.len()]) {
            if end > start {
                parts.push((start..end, self.line));
                self.line += memchr::memchr_iter(b'\n', &bytes[start..end]).count() as u64;
                start = end;
            }
        }
        parts
    }
}

/// Returns the ends of records about `every` bytes apart, and the end of the last record.
fn record_ends(bytes: &[u8], marks: Marks, every: usize) -> Vec<usize> {
    let mut ends = Vec::new();
    let mut at = 0;
    let mut next = every;
    let mut last = 0;
    if memchr::memchr(marks.quote, bytes).is_none() {
        while let Some(step) = memchr::memchr(b'\n', &bytes[next.min(bytes.len())..]) {
            let end = next + step + 1;
            ends.push(end);
            next = end + every;
        }
        last = memchr::memrchr(b'\n', bytes).map_or(0, |at| at + 1);
    } else {
        // A quote counts at the beginning of a cell; the cell then ends at a quote that is not
        // doubled.
        while let Some(step) = memchr::memchr2(marks.quote, b'\n', &bytes[at..]) {
            let found = at + step;
            at = found + 1;
            if bytes[found] == b'\n' {
                last = at;
                if at >= next {
                    ends.push(at);
                    next = at + every;
                }
                continue;
            }
            let begins = found == 0 || [marks.separator, b'\n', b'\r'].contains(&bytes[found - 1]);
            if begins {
                let Some(end) = end_of_quoted(bytes, at, marks.quote) else { break };
                at = end;
            }
        }
    }
    if last > ends.last().copied().unwrap_or(0) {
        ends.push(last);
    }
    ends
}

/// Returns the position after the quote that ends the cell whose text begins at `at`.
fn end_of_quoted(bytes: &[u8], mut at: usize, quote: u8) -> Option<usize> {
    loop {
        at += memchr::memchr(quote, &bytes[at..])? + 1;
        if bytes.get(at) != Some(&quote) {
            return Some(at);
        }
        at += 1;
    }
}

#[cfg(test)]
mod tests {
    use std::{io::Cursor, path::Path};

    use proptest::prelude::*;

    use super::*;
    use crate::text::RecordReader;

    const MARKS: Marks = Marks { separator: b',', quote: b'"' };

    fn blocks(text: &[u8], size: usize, parts: usize) -> Vec<(String, u64)> {
        let input = Box::new(Cursor::new(text.to_vec()));
        let mut blocks =
            Blocks::new(input, Path::new("a.csv").to_owned(), MARKS, (0, 0)).expect("readable");
        blocks.size = size;
        let mut all = Vec::new();
        while let Some(block) = blocks.next(parts).expect("readable") {
            for (range, line) in block.parts {
                all.push((String::from_utf8_lossy(&block.bytes[range]).into_owned(), line));
            }
        }
        all
    }

    #[test]
    fn records_are_never_cut() {
        let text = "a,\"x\ny\",1\nb,5\",2\nc,\"\"\"\n\",3\nd";
        for (size, parts) in [(4, 1), (6, 2), (100, 1), (100, 3)] {
            let all = blocks(text.as_bytes(), size, parts);
            let joined: String = all.iter().map(|(part, _)| part.as_str()).collect();
            assert_eq!(joined, text);
            for (part, _) in &all[1..] {
                assert!(["b", "c", "d"].iter().any(|first| part.starts_with(first)), "{part:?}");
            }
        }
        assert!(blocks(b"", 8, 2).is_empty());
    }

    fn records(text: &str) -> Vec<Vec<Vec<u8>>> {
        let mut reader = RecordReader::new(text.as_bytes(), MARKS);
        let mut all = Vec::new();
        while reader.advance() {
            all.push(reader.cells().map(<[u8]>::to_vec).collect());
        }
        all
    }

    proptest! {
        #[test]
        fn any_text_is_read_once_in_order(text in "[ab,\"\n]{0,60}", size in 1_usize..30, parts in 1_usize..4) {
            let all = blocks(text.as_bytes(), size, parts);
            let joined: String = all.iter().map(|(part, _)| part.as_str()).collect();
            prop_assert_eq!(&joined, &text);
            let mut seen = 0;
            for (part, line) in &all {
                prop_assert_eq!(*line, seen);
                seen += part.matches('\n').count() as u64;
            }
            // The parts give the same records as the whole text, record by record.
            let apart: Vec<_> = all.iter().flat_map(|(part, _)| records(part)).collect();
            prop_assert_eq!(apart, records(&text));
        }
    }
}
