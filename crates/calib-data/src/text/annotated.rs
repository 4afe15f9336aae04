//! Reads annotated CSV of InfluxDB: several tables in one file, each with its own annotations and header.
//!
//! See <https://docs.influxdata.com/influxdb/v2/reference/syntax/annotated-csv/>. For each column, `#datatype` gives
//! the type, `#group` tells whether it is part of the key of a series, and `#default` gives the value of an empty cell.

use std::{
    collections::{BTreeMap, HashMap, HashSet},
    path::{Path, PathBuf},
};

use calib_core::Monitor;
use calib_text::{ParsedTime, parse_stamp};

use super::{
    Cell, Decimal, Marks, RecordReader, Words,
    blocks::Blocks,
    cell_of, decode,
    input::{self, unreadable},
    shown,
};
use crate::DataError;

const MARKS: Marks = Marks { separator: b',', quote: b'"' };

/// Columns that describe the query and not the series.
const OF_THE_QUERY: [&str; 4] = ["result", "table", "_start", "_stop"];

/// Whether a file begins with an annotation.
pub(crate) fn is_annotated(path: &Path) -> Result<bool, DataError> {
    let (mut input, _) = input::open(path)?;
    let mut head = [0; 64];
    let length = input::fill(&mut input, &mut head).map_err(|error| unreadable(path, &error))?;
    let head = head[..length].trim_ascii_start();
    Ok([&b"#datatype"[..], b"#group", b"#default"].iter().any(|mark| head.starts_with(mark)))
}

/// The key of a series: columns and their values.
pub(crate) type Key = BTreeMap<String, String>;

pub(crate) struct Sample<'a> {
    pub(crate) key: &'a Key,
    pub(crate) time: Option<ParsedTime>,
    pub(crate) cell: Cell,
}

/// The tables of a file.
pub(crate) struct Annotated {
    blocks: Blocks,
    path: PathBuf,
    table: Table,
}

/// The annotations and the header of the following rows.
#[derive(Default)]
struct Table {
    groups: Vec<String>,
    types: Vec<String>,
    defaults: Vec<String>,
    names: Vec<String>,
}

impl Annotated {
    pub(crate) fn open(path: &Path) -> Result<Self, DataError> {
        let (input, _) = input::open(path)?;
        let blocks = Blocks::new(input, path.to_owned(), MARKS, (0, 0))?;
        Ok(Self { blocks, path: path.to_owned(), table: Table::default() })
    }

    /// Reads all samples, in order.
    pub(crate) fn read(
        &mut self,
        words: &mut Words,
        mut each: impl FnMut(Sample<'_>, &Words) -> Result<(), DataError>,
        monitor: &dyn Monitor,
    ) -> Result<(), DataError> {
        while let Some(block) = self.blocks.next(1)? {
            monitor.check()?;
            for (range, line) in block.parts {
                let mut records = RecordReader::new(&block.bytes[range], MARKS);
                while records.advance() {
                    let cells: Vec<String> =
                        records.cells().map(|cell| decode(cell).into_owned()).collect();
                    self.record(&cells, line + records.line(), words, &mut each)?;
                }
            }
        }
        Ok(())
    }

    fn record(
        &mut self,
        cells: &[String],
        line: u64,
        words: &mut Words,
        each: &mut impl FnMut(Sample<'_>, &Words) -> Result<(), DataError>,
    ) -> Result<(), DataError> {
        if cells.first().is_some_and(|cell| cell.trim().starts_with('#')) {
            self.table.annotate(cells);
            Ok(())
        } else if self.table.names.is_empty() {
            self.table.names = cells.to_vec();
            self.check_header(line)
        } else {
            self.row(line, cells, words, each)
        }
    }

    fn check_header(&self, line: u64) -> Result<(), DataError> {
        if self.table.position("error").is_some() && self.table.position("_time").is_none() {
            return Err(
                self.refused(line, "the query ended with an error; export it again".to_owned())
            );
        }
        if self.table.position("_time").is_none() || self.table.values().is_empty() {
            let reason = "expected a table with _time and _value, or columns of numbers".to_owned();
            return Err(self.refused(line, reason));
        }
        Ok(())
    }

    fn row(
        &self,
        line: u64,
        cells: &[String],
        words: &mut Words,
        each: &mut impl FnMut(Sample<'_>, &Words) -> Result<(), DataError>,
    ) -> Result<(), DataError> {
        let table = &self.table;
        if cells.len() != table.names.len() {
            let reason =
                format!("{} cells, and the header names {}", cells.len(), table.names.len());
            return Err(self.refused(line, reason));
        }
        let time = table.position("_time").map_or("", |column| table.text(cells, column));
        let time = match time {
            "" => None,
            time => Some(parse_stamp(time).ok_or_else(|| {
                self.refused(
                    line,
                    format!("{} is no time of RFC 3339; export it again", shown(time)),
                )
            })?),
        };
        let key = table.key(cells);
        for column in table.values() {
            let mut key = key.clone();
            if table.names[column] != "_value" {
                key.insert("column".to_owned(), table.names[column].clone());
            }
            let cell = cell_of(table.text(cells, column), Decimal::Point, words);
            let cell = cell.unwrap_or(Cell::Missing);
            each(Sample { key: &key, time, cell }, words)?;
        }
        Ok(())
    }

    fn refused(&self, line: u64, reason: String) -> DataError {
        DataError::Record { path: self.path.clone(), line, reason }
    }
}

impl Table {
    fn annotate(&mut self, cells: &[String]) {
        // The first annotation after rows begins another table.
        if !self.names.is_empty() {
            *self = Self::default();
        }
        let kind = cells[0].trim();
        // The annotation is in the first column, which holds nothing else.
        let cells = cells.to_vec();
        match kind {
            "#group" => self.groups = cells,
            "#datatype" => self.types = cells,
            "#default" => {
                self.defaults =
                    std::iter::once(String::new()).chain(cells.into_iter().skip(1)).collect();
            }
            _ => {}
        }
    }

    fn position(&self, name: &str) -> Option<usize> {
        self.names.iter().position(|known| known == name)
    }

    fn is_key(&self, column: usize) -> bool {
        let name = self.names[column].as_str();
        if name.is_empty() || name == "_time" || name == "_value" || OF_THE_QUERY.contains(&name) {
            return false;
        }
        match self.groups.get(column).map(|group| group.trim()) {
            Some("true") => true,
            Some("false") => false,
            _ => !self.is_number(column),
        }
    }

    fn is_number(&self, column: usize) -> bool {
        let kind = self.types.get(column).map_or("", |kind| kind.trim());
        ["double", "long", "unsignedLong", "boolean"].contains(&kind)
    }

    /// Returns the cell of a column, or the default if it is empty.
    fn text<'a>(&'a self, cells: &'a [String], column: usize) -> &'a str {
        let cell = cells[column].trim();
        if cell.is_empty() {
            self.defaults.get(column).map_or("", |default| default.trim())
        } else {
            cell
        }
    }

    fn key(&self, cells: &[String]) -> Key {
        let columns = (0..self.names.len()).filter(|&column| self.is_key(column));
        columns
            .map(|column| (self.names[column].clone(), self.text(cells, column).to_owned()))
            .collect()
    }

    /// Returns the columns of values: `_value`, or all numbers of a pivoted table.
    fn values(&self) -> Vec<usize> {
        match self.position("_value") {
            Some(value) => vec![value],
            None => (0..self.names.len())
                .filter(|&column| {
                    self.is_number(column)
                        && !self.is_key(column)
                        && !OF_THE_QUERY.contains(&self.names[column].as_str())
                })
                .collect(),
        }
    }
}

/// The values of one part in all keys.
struct PartOfKeys<'a> {
    /// Number of keys that have the part.
    keys: usize,
    first: &'a str,
    differs: bool,
}

/// Returns a name for each key: its values, without those that all keys share.
pub(crate) fn names(keys: &[Key]) -> Vec<String> {
    let mut parts: HashMap<&str, PartOfKeys<'_>> = HashMap::new();
    for (part, value) in keys.iter().flatten() {
        let known =
            parts.entry(part).or_insert(PartOfKeys { keys: 0, first: value, differs: false });
        known.keys += 1;
        known.differs |= known.first != value;
    }
    let short: Vec<String> = keys
        .iter()
        .map(|key| {
            let values = key.iter().filter(|(part, value)| {
                let PartOfKeys { keys: having, first, differs } = parts[part.as_str()];
                // A part that a key lacks counts as empty.
                let tells = differs || having < keys.len() && !first.is_empty();
                tells && !value.is_empty()
            });
            values.map(|(_, value)| value.as_str()).collect::<Vec<_>>().join(".")
        })
        .collect();
    let distinct: HashSet<&String> = short.iter().collect();
    if distinct.len() == keys.len() && short.iter().all(|name| !name.is_empty()) {
        return short;
    }
    match keys {
        [only] => vec![only.get("_field").cloned().unwrap_or_else(|| pairs(only))],
        _ => keys.iter().map(pairs).collect(),
    }
}

/// Lists all parts of a key with their values.
fn pairs(key: &Key) -> String {
    let pairs = key.iter().map(|(part, value)| format!("{part}={value}"));
    pairs.collect::<Vec<_>>().join(",")
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    const TWO_TABLES: &str = "\
#group,false,false,true,true,false,false,true,true,true\r
#datatype,string,long,dateTime:RFC3339,dateTime:RFC3339,dateTime:RFC3339,double,string,string,string\r
#default,_result,,,,,,,,\r
,result,table,_start,_stop,_time,_value,_field,_measurement,unit\r
,,0,2024-03-01T00:00:00Z,2024-03-02T00:00:00Z,2024-03-01T06:00:00Z,1.5,level,tank,A\r
,,0,2024-03-01T00:00:00Z,2024-03-02T00:00:00Z,2024-03-01T06:01:00Z,,level,tank,A\r
,,1,2024-03-01T00:00:00Z,2024-03-02T00:00:00Z,2024-03-01T06:00:00Z,2.5,level,tank,B\r
\r
#group,false,false,true,true,false,false,true,true\r
#datatype,string,long,dateTime:RFC3339,dateTime:RFC3339,dateTime:RFC3339,boolean,string,string\r
#default,_result,,,,,,pump,\r
,result,table,_start,_stop,_time,_value,_field,_measurement\r
,,2,2024-03-01T00:00:00Z,2024-03-02T00:00:00Z,2024-03-01T06:00:00Z,true,,plant\r
";

    fn read(text: &str) -> Result<Vec<(Key, Option<ParsedTime>, Cell)>, DataError> {
        let directory = tempfile::tempdir().expect("a directory");
        let path = directory.path().join("a.csv");
        fs::write(&path, text).expect("written");
        assert!(is_annotated(&path)?);
        let mut all = Vec::new();
        Annotated::open(&path)?.read(
            &mut Words::default(),
            |sample, _| {
                all.push((sample.key.clone(), sample.time, sample.cell));
                Ok(())
            },
            &calib_core::Silent,
        )?;
        Ok(all)
    }

    #[test]
    fn tables_have_headers_of_their_own() {
        let all = read(TWO_TABLES).expect("readable");
        let cells: Vec<Cell> = all.iter().map(|(_, _, cell)| *cell).collect();
        assert_eq!(cells, [Cell::Number(1.5), Cell::Missing, Cell::Number(2.5), Cell::Number(1.0)]);
        let keys: Vec<Key> = [0, 2, 3].map(|row| all[row].0.clone()).into();
        assert_eq!(names(&keys), ["level.tank.A", "level.tank.B", "pump.plant"]);
        assert_eq!(names(&keys[..2]), ["A", "B"]);
        assert_eq!(names(&keys[..1]), ["level"]);
        assert_eq!(all[0].1, parse_stamp("2024-03-01T06:00:00Z"));
    }

    #[test]
    fn pivoted_tables_and_errors_are_told_apart() {
        let pivoted = "#group,false,false,false,false,false\n#datatype,string,long,dateTime:RFC3339,double,double\n#default,,,,,\n,result,table,_time,T1,P1\n,,0,2024-03-01T06:00:00Z,1,2\n";
        let all = read(pivoted).expect("readable");
        let keys: Vec<Key> = all.iter().map(|(key, _, _)| key.clone()).collect();
        assert_eq!(names(&keys), ["T1", "P1"]);
        let error = "#datatype,string,string\n#group,true,true\n#default,,\n,error,reference\n,query failed,897\n";
        assert!(read(error).expect_err("an error").to_string().contains("ended with an error"));
        let short = "#datatype,string,dateTime:RFC3339,double\n,result,_time,_value\n,,2024-03-01T06:00:00Z\n";
        assert!(
            read(short).expect_err("short").to_string().contains("line 3"),
            "the line is named"
        );
    }
}
