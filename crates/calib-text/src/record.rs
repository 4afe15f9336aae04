//! Splits text in memory into records.
//!
//! Most logs have no quotes. Such text is cut at its separators in place. All other text goes through csv-core, which
//! copies each cell without its quotes and costs several times as much.

use csv_core::{ReadRecordResult, Reader, ReaderBuilder};

/// The characters that delimit cells.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Marks {
    /// The byte between two cells.
    pub separator: u8,
    /// The byte around a cell that contains a separator or a line break.
    pub quote: u8,
}

/// Iterates over records and skips empty lines. All records share one buffer.
pub struct RecordReader<'a> {
    reader: Reader,
    marks: Marks,
    text: &'a [u8],
    read: usize,
    source: CellText<'a>,
    /// End of each cell of the record in `source`, in bytes.
    ends: Vec<usize>,
    count: usize,
    line: u64,
}

/// The text of the cells of a record.
enum CellText<'a> {
    /// The record in the original text, with separators and without the line break.
    Text(&'a [u8]),
    /// A copy of the cells without quotes or separators.
    Copy(Vec<u8>),
}

/// Whether text can be cut at its separators and line feeds: it has no quote, and every carriage return precedes a line
/// feed.
fn is_unquoted(text: &[u8], quote: u8) -> bool {
    memchr::memchr(quote, text).is_none()
        && memchr::memchr_iter(b'\r', text).all(|at| text.get(at + 1) == Some(&b'\n'))
}

impl<'a> RecordReader<'a> {
    /// Creates a reader of the records of `text`.
    pub fn new(text: &'a [u8], marks: Marks) -> Self {
        let reader = ReaderBuilder::new().delimiter(marks.separator).quote(marks.quote).build();
        Self {
            reader,
            marks,
            text,
            read: 0,
            source: if is_unquoted(text, marks.quote) {
                CellText::Text(&[])
            } else {
                CellText::Copy(vec![0; 1 << 10])
            },
            ends: vec![0; 64],
            count: 0,
            line: 0,
        }
    }

    /// Moves to the next record; returns false at the end of the text.
    pub fn advance(&mut self) -> bool {
        let CellText::Copy(cells) = &mut self.source else { return self.advance_in_text() };
        let mut written = 0;
        let mut count = 0;
        loop {
            let (result, read, more_text, more_cells) = self.reader.read_record(
                &self.text[self.read..],
                &mut cells[written..],
                &mut self.ends[count..],
            );
            self.read += read;
            written += more_text;
            count += more_cells;
            match result {
                ReadRecordResult::Record => {
                    self.count = count;
                    let ended = self.read > 0 && self.text[self.read - 1] == b'\n';
                    self.line = self.reader.line() - u64::from(ended);
                    return true;
                }
                // With no text left, the next call ends the last record.
                ReadRecordResult::InputEmpty => {}
                ReadRecordResult::OutputFull => cells.resize(2 * cells.len(), 0),
                ReadRecordResult::OutputEndsFull => self.ends.resize(2 * self.ends.len(), 0),
                ReadRecordResult::End => return false,
            }
        }
    }

    /// Does the work of [`Self::advance`] for text without quotes.
    fn advance_in_text(&mut self) -> bool {
        while self.read < self.text.len() {
            let rest = &self.text[self.read..];
            let (line, length) = match memchr::memchr(b'\n', rest) {
                Some(end) => (&rest[..end], end + 1),
                None => (rest, rest.len()),
            };
            self.read += length;
            self.line += 1;
            let record = line.strip_suffix(b"\r").unwrap_or(line);
            if record.is_empty() {
                continue;
            }
            self.ends.clear();
            self.ends.extend(memchr::memchr_iter(self.marks.separator, record));
            self.ends.push(record.len());
            self.count = self.ends.len();
            self.source = CellText::Text(record);
            return true;
        }
        false
    }

    /// Returns the number of cells of the record.
    #[inline]
    pub fn count(&self) -> usize {
        self.count
    }

    /// Returns a cell of the record.
    #[inline]
    pub fn cell(&self, position: usize) -> &[u8] {
        let before = position.checked_sub(1).map(|before| self.ends[before]);
        match &self.source {
            CellText::Text(record) => &record[before.map_or(0, |end| end + 1)..self.ends[position]],
            CellText::Copy(cells) => &cells[before.unwrap_or(0)..self.ends[position]],
        }
    }

    /// Iterates over the cells of the record.
    #[inline]
    pub fn cells(&self) -> impl Iterator<Item = &[u8]> {
        (0..self.count).map(|position| self.cell(position))
    }

    /// Returns the line in which the record ends, from 1.
    pub fn line(&self) -> u64 {
        self.line
    }

    /// Whether the record is the last of the text and no line break follows it.
    pub fn lacks_line_break(&self) -> bool {
        self.read == self.text.len() && !matches!(self.text.last(), Some(b'\n' | b'\r'))
    }

    /// Returns the offset of the next record in bytes, after the line break.
    pub fn position(&self) -> usize {
        let at = self.read;
        // The reader stops before the line feed of CR LF.
        let is_half = at > 0 && self.text[at - 1] == b'\r' && self.text.get(at) == Some(&b'\n');
        at + usize::from(is_half)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn records_have_cells_lines_and_places() {
        let marks = Marks { separator: b';', quote: b'"' };
        let long = "x".repeat(5_000);
        let text = format!("a;\"b;\nc\"\r\n\r\n1;{long}\n;");
        let mut records = RecordReader::new(text.as_bytes(), marks);
        let mut all = Vec::new();
        while records.advance() {
            let cells: Vec<String> =
                records.cells().map(|cell| String::from_utf8_lossy(cell).into_owned()).collect();
            all.push((cells, records.line(), text[records.position()..].chars().next()));
        }
        assert_eq!(all[0], (vec!["a".to_owned(), "b;\nc".to_owned()], 2, Some('\r')));
        assert_eq!(all[1], (vec!["1".to_owned(), long], 4, Some(';')));
        assert_eq!(all[2], (vec![String::new(), String::new()], 5, None));
        assert_eq!(all.len(), 3);
        let wide = vec!["7"; 300].join(";");
        let mut records = RecordReader::new(wide.as_bytes(), marks);
        assert!(records.advance());
        assert_eq!((records.count(), records.cell(299)), (300, &b"7"[..]));
    }

    #[test]
    fn only_a_last_record_lacks_its_line_break() {
        // The second text has quotes, so the other code path reads it.
        for text in ["a;b\r\n1;2", "a;\"b\"\n1;2"] {
            assert_eq!(lack_line_breaks(text), [false, true]);
            for end in ["\n", "\r\n", "\n\n"] {
                let text = format!("{text}{end}");
                assert_eq!(lack_line_breaks(&text), [false, false], "{end:?}");
            }
        }
    }

    /// Returns for each record whether it lacks its line break.
    fn lack_line_breaks(text: &str) -> Vec<bool> {
        let marks = Marks { separator: b';', quote: b'"' };
        let mut records = RecordReader::new(text.as_bytes(), marks);
        let mut lacking = Vec::new();
        while records.advance() {
            lacking.push(records.lacks_line_break());
        }
        lacking
    }

    /// Returns for each record its cells, its line, and the offset of the next record.
    fn all_of(mut records: RecordReader<'_>) -> Vec<(Vec<Vec<u8>>, u64, usize)> {
        let mut all = Vec::new();
        while records.advance() {
            let cells = records.cells().map(<[u8]>::to_vec).collect();
            all.push((cells, records.line(), records.position()));
        }
        all
    }

    proptest! {
        #[test]
        fn text_without_quotes_is_cut_as_csv_core_cuts_it(text in "([ab7,]{0,3}(\n|\r\n)?){0,12}") {
            let marks = Marks { separator: b',', quote: b'"' };
            let cut = RecordReader::new(text.as_bytes(), marks);
            let mut copied = RecordReader::new(text.as_bytes(), marks);
            prop_assert!(matches!(cut.source, CellText::Text(_)));
            copied.source = CellText::Copy(vec![0; 1 << 10]);
            prop_assert_eq!(all_of(cut), all_of(copied));
        }
    }
}
