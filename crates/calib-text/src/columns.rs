//! Columns of numbers in a table that is no log: it needs no header, no times, and perhaps only one column.

use std::path::Path;

use thiserror::Error;

use crate::{
    Decimal, Dialect, RecordReader, decode,
    number::{Sign, parse_number, sign_of},
};

/// A column of a text table.
#[derive(Clone, Debug, PartialEq)]
pub struct NumberColumn {
    /// Name from the header; without a header the column's number, from 0.
    pub name: String,
    /// The numbers, NaN where a cell is empty; or the first cell that is not a number.
    pub numbers: Result<Vec<f64>, NotANumber>,
}

/// A cell that is not a number.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("expected numbers, got `{text}` in line {line}{}", hint(.text))]
pub struct NotANumber {
    /// Last line of the record, from 1.
    pub line: u64,
    /// The cell.
    pub text: String,
}

fn hint(text: &str) -> &'static str {
    match sign_of(text) {
        Sign::Either => ", a fraction or above a thousand; write it with a decimal point",
        _ => "",
    }
}

impl NumberColumn {
    /// Whether the column holds at least one number, and no other text.
    pub fn is_numeric(&self) -> bool {
        self.numbers.as_ref().is_ok_and(|numbers| !numbers.iter().all(|number| number.is_nan()))
    }

    fn push(&mut self, cell: &str, decimal: Decimal, line: u64) {
        let Ok(numbers) = &mut self.numbers else { return };
        let text = cell.trim();
        if text.is_empty() {
            numbers.push(f64::NAN);
        } else if let Some(number) = parse_number(text, decimal) {
            numbers.push(number);
        } else {
            self.numbers = Err(NotANumber { line, text: text.to_owned() });
        }
    }
}

/// Reads the columns of a table. Separator and decimal sign are recognised as those of logs are. The first row is a
/// header if it has a name above values, and the row below it may have units.
///
/// # Errors
/// If the text has no rows, rows of different lengths, or a header that does not fit: the reason, in words.
pub fn number_columns(text: &[u8]) -> Result<Vec<NumberColumn>, String> {
    let text = text.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(text);
    let dialect = Dialect::of_columns(text)?;
    // No column is of times. Without a sign for all numbers, each must show its own.
    let signs = dialect.signs(usize::MAX, Path::new(""));
    let decimal = signs.decimal().unwrap_or(Decimal::Unknown);
    let (bytes, lines) = dialect.skip;
    let mut records = RecordReader::new(&text[bytes as usize..], dialect.marks);
    let mut columns: Vec<NumberColumn> = dialect
        .columns
        .into_iter()
        .map(|column| NumberColumn { name: column.name, numbers: Ok(Vec::new()) })
        .collect();
    while records.advance() {
        let line = lines + records.line();
        let expected = columns.len();
        let got = records.count();
        let ends_with_separator =
            got == expected + 1 && records.cell(expected).trim_ascii().is_empty();
        if got != expected && !ends_with_separator {
            return Err(format!(
                "expected {expected} cells as in most of the first rows, got {got} in line {line}"
            ));
        }
        for (position, column) in columns.iter_mut().enumerate() {
            column.push(&decode(records.cell(position)), decimal, line);
        }
    }
    Ok(columns)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::most_cells;

    fn columns(text: &str) -> Vec<NumberColumn> {
        number_columns(text.as_bytes()).expect("a table")
    }

    fn refused(text: &str) -> String {
        number_columns(text.as_bytes()).expect_err("refused")
    }

    fn numbers(column: &NumberColumn) -> &[f64] {
        column.numbers.as_deref().expect("numbers")
    }

    #[test]
    fn headers_name_the_columns_and_without_one_they_have_numbers() {
        let named = columns("\u{feff}day,\"flow, total\",p\r\nmon,1.5,-2e-3\r\n\r\ntue,,4");
        let names: Vec<&str> = named.iter().map(|column| column.name.as_str()).collect();
        assert_eq!(names, ["day", "flow, total", "p"]);
        assert!(numbers(&named[1])[0] == 1.5 && numbers(&named[1])[1].is_nan());
        assert_eq!(numbers(&named[2]), [-2e-3, 4.0]);
        assert_eq!([0, 1, 2].map(|at: usize| named[at].is_numeric()), [false, true, true]);
        let cell = named[0].numbers.clone().expect_err("days");
        assert_eq!(cell.to_string(), "expected numbers, got `mon` in line 2");
        let bare = columns("1;2,5;\n3; 4 ;\n");
        assert_eq!((bare[0].name.as_str(), bare[1].name.as_str(), bare.len()), ("0", "1", 2));
        assert_eq!(numbers(&bare[1]), [2.5, 4.0]);
        assert_eq!(numbers(&columns("0\n2.5\n1\n")[0]), [0.0, 2.5, 1.0]);
    }

    #[test]
    fn no_sample_is_taken_for_units() {
        let units = columns("day,flow,level\n,[m3/h],-\nmon,1,3\ntue,2,4\n");
        assert_eq!(numbers(&units[1]), [1.0, 2.0]);
        assert_eq!(numbers(&columns("flow\nbar\n1\n2\n")[0]), [1.0, 2.0]);
        let failed = columns("flow\nERR\n1\n2\n")[0].numbers.clone().expect_err("an error");
        assert_eq!(failed.to_string(), "expected numbers, got `ERR` in line 2");
        for text in ["flow\nnan\n1\n2\n", "nan\n1\n2\n", "day,flow\nmon,\ntue,1\nwed,2\n"] {
            let all = columns(text);
            let flow = &all[all.len() - 1];
            let numbers = numbers(flow);
            assert!(numbers[0].is_nan() && numbers[1..] == [1.0, 2.0], "{text}: {numbers:?}");
            assert_eq!(flow.name, if text.starts_with("nan") { "0" } else { "flow" });
        }
        let failed = columns("ERR\n1\n2\n")[0].numbers.clone().expect_err("an error");
        assert_eq!(failed.to_string(), "expected numbers, got `ERR` in line 1");
        let second = columns("flow\nbar\ngauge\n1\n2\n3\n")[0].numbers.clone();
        assert_eq!(second.expect_err("one row of units").line, 3);
        let label = columns("day,flow\nmon,low\ntue,1\nwed,2\n")[1].numbers.clone();
        assert_eq!(label.expect_err("a word").line, 2, "days have no unit");
    }

    #[test]
    fn headers_may_have_numbers_for_names() {
        for (text, names) in [
            ("level,101,102\n1,2,3\n4,5,6\n", ["level", "101", "102"]),
            ("day,2023,2024\n1,5,6\n2,7,8\n", ["day", "2023", "2024"]),
            ("time,1,2\n2024-01-01,5,6\n2024-01-02,7,8\n", ["time", "1", "2"]),
        ] {
            let all = columns(text);
            let found: Vec<&str> = all.iter().map(|column| column.name.as_str()).collect();
            assert_eq!(found, names);
            assert_eq!(numbers(&all[1]).len(), 2, "{text}");
        }
        // The first row is a header or values.
        let either = refused("day,2023\nmon,1\ntue,2\n");
        assert!(either.contains("a header or values"), "{either}");
        let title = refused("mon,\ntue,1\nwed,2\n");
        assert!(title.contains("its header has 1 name, and most rows have 2 cells"), "{title}");
        let gap = columns("1,\n2,3\n4,5\n");
        assert_eq!(numbers(&gap[0]), [1.0, 2.0, 4.0]);
        assert!(numbers(&gap[1])[0].is_nan());
    }

    #[test]
    fn numbers_have_the_decimal_sign_of_the_file() {
        for text in ["a;b\n1,5;2\n1.234,5;3\n", "a\tb\n1,5\t2\n1.234,5\t3\n"] {
            assert_eq!(numbers(&columns(text)[0]), [1.5, 1234.5], "{text}");
        }
        assert_eq!(numbers(&columns("flow\n\"0,5\"\n\"1,25\"\n")[0]), [0.5, 1.25]);
        let either = columns("a;b\n1,234;2\n")[0].numbers.clone().expect_err("two readings");
        assert!(either.to_string().contains("line 2, a fraction or above a thousand"), "{either}");
        let split = refused("flow\n0,5\n1,5\n");
        assert!(split.contains("each of them became two cells"), "{split}");
    }

    #[test]
    fn cells_are_at_most_the_separators_and_line_ends() {
        for text in ["a\n0.123456789\n0.123456789", "a,b\r\n1,2\r\n", "\u{feff}sep=:\na:b\n1:2\n"] {
            let all = columns(text);
            let cells = all.len() * (1 + numbers(&all[0]).len());
            let most = most_cells(text.as_bytes());
            assert!((cells..=cells + 3).contains(&most), "{text}: {most} for {cells}");
        }
        assert_eq!([&b""[..], b"1\r2\r"].map(most_cells), [1, 3]);
    }

    #[test]
    fn records_are_equally_long() {
        let ragged = refused("a,b\n1,2\n3,4\n3\n");
        assert_eq!(ragged, "expected 2 cells as in most of the first rows, got 1 in line 4");
        assert!(number_columns(b"").is_err() && number_columns(b"\n\n").is_err());
    }
}
