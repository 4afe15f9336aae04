//! Records of text that is in memory.

use csv_core::{ReadRecordResult, Reader, ReaderBuilder};

use super::blocks::Marks;

/// Goes from record to record; empty lines are none. Its memory is used again for each.
pub(crate) struct RecordReader<'a> {
    reader: Reader,
    text: &'a [u8],
    read: usize,
    /// The cells of the record without their quotes, one after the other, and where each ends.
    cells: Vec<u8>,
    ends: Vec<usize>,
    count: usize,
    line: u64,
}

impl<'a> RecordReader<'a> {
    pub(crate) fn new(text: &'a [u8], marks: Marks) -> Self {
        let reader = ReaderBuilder::new().delimiter(marks.separator).quote(marks.quote).build();
        Self {
            reader,
            text,
            read: 0,
            cells: vec![0; 1 << 10],
            ends: vec![0; 64],
            count: 0,
            line: 0,
        }
    }

    /// Go to the next record; false if there is none.
    pub(crate) fn advance(&mut self) -> bool {
        let (mut written, mut count) = (0, 0);
        loop {
            let (result, read, more_text, more_cells) = self.reader.read_record(
                &self.text[self.read..],
                &mut self.cells[written..],
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
                // Without text left, the next call ends the last record.
                ReadRecordResult::InputEmpty => {}
                ReadRecordResult::OutputFull => self.cells.resize(2 * self.cells.len(), 0),
                ReadRecordResult::OutputEndsFull => self.ends.resize(2 * self.ends.len(), 0),
                ReadRecordResult::End => return false,
            }
        }
    }

    /// Number of cells of the record.
    pub(crate) fn len(&self) -> usize {
        self.count
    }

    /// A cell of the record.
    pub(crate) fn cell(&self, position: usize) -> &[u8] {
        let start = if position == 0 { 0 } else { self.ends[position - 1] };
        &self.cells[start..self.ends[position]]
    }

    pub(crate) fn cells(&self) -> impl Iterator<Item = &[u8]> {
        (0..self.count).map(|position| self.cell(position))
    }

    /// The line that the record ends in, from 1.
    pub(crate) fn line(&self) -> u64 {
        self.line
    }

    /// Bytes up to the next record, with the end of the line.
    pub(crate) fn position(&self) -> usize {
        let at = self.read;
        // The reader stops before the line feed of CR LF.
        let is_half = at > 0 && self.text[at - 1] == b'\r' && self.text.get(at) == Some(&b'\n');
        at + usize::from(is_half)
    }
}

#[cfg(test)]
mod tests {
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
        assert_eq!((records.len(), records.cell(299)), (300, &b"7"[..]));
    }
}
