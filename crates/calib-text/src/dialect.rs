//! Recognises from the first rows of a text file its separator, its header and its units.

use std::{
    collections::{BTreeMap, HashSet},
    path::Path,
};

use crate::{
    Candidates, Decimal, Marks, RecordReader, Signs,
    names::{are_values, is_name, is_written_time},
    parse_number,
    preamble::{preamble, separators},
    sample::Sample,
};

/// Number of rows that are examined.
const LOOKED_AT: usize = 400;
/// Rows between the header and the first time that may be units and descriptions.
const UNIT_ROWS: usize = 3;

/// The format of a text file.
#[derive(Clone, Debug)]
pub struct Dialect {
    /// Separator and quote.
    pub marks: Marks,
    /// The columns.
    pub columns: Vec<TextColumn>,
    /// Bytes and lines before the first row of values.
    pub skip: (u64, u64),
    /// Whether the first column holds row names and is missing from the header, as in tables of R.
    pub has_row_names: bool,
    /// The first rows of values.
    sample: Sample,
}

/// A column as described by the header.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct TextColumn {
    /// Name of the column.
    pub name: String,
    /// Unit of the values.
    pub unit: Option<String>,
    /// Description in words.
    pub label: Option<String>,
}

/// A record, with the bytes and lines before it (`begin`) and before the next record (`end`).
struct Row {
    cells: Vec<String>,
    begin: (u64, u64),
    end: (u64, u64),
}

/// The first rows of a table, and the number of cells that most of them have.
struct CutTable {
    marks: Marks,
    rows: Vec<Row>,
    width: usize,
}

impl CutTable {
    /// Cuts text by the separator that gives most rows the same number of cells; `None` if none gives more than one.
    fn of(head: &[u8], separator: Option<char>) -> Option<Self> {
        let start = preamble(head);
        let separators = match separator {
            Some(separator) => vec![separator as u8],
            None => separators(&head[..start]),
        };
        let tables = separators.into_iter().filter_map(|separator| {
            let marks = marks(separator);
            let rows = rows(head, start, marks);
            let width = usual_width(&rows)?;
            Some((agreement(&rows, width), Self { marks, rows, width }))
        });
        // Ties go to the first: a tab is more likely to separate cells than to be part of one, and so on.
        let best = tables.reduce(|best, other| if other.0 > best.0 { other } else { best });
        best.map(|(_, table)| table)
    }
}

/// A kind of table.
#[derive(Clone, Copy)]
enum TableKind {
    /// A log. It has a column of times, so that a row without values is not one of its rows.
    Log,
    /// Columns of numbers. Any row may be one of values, even if all of them are missing.
    Numbers,
}

impl Dialect {
    /// Recognises the format of a file that begins with `head`, which consists of whole records.
    ///
    /// # Errors
    /// If the text is not a table: the reason, in words.
    pub fn of(head: &[u8], separator: Option<char>) -> Result<Self, String> {
        let table = CutTable::of(head, separator).ok_or(
            "no character separates its cells; expected a comma, a semicolon, a tab or |, or data.separator",
        )?;
        Self::with_rows(table, TableKind::Log)
    }

    /// Recognises the format of a table that is no log. It may have only one column. Without a header, columns are called
    /// 0, 1 and so on. The first row is a header if it has a name above values. The row below may have units.
    pub(crate) fn of_columns(text: &[u8]) -> Result<Self, String> {
        let table = CutTable::of(text, None).unwrap_or_else(|| {
            let marks = marks(b',');
            CutTable { marks, rows: rows(text, preamble(text), marks), width: 1 }
        });
        // R writes no name for its first column, but one name over two cells may also be that of numbers with commas.
        let has_split_numbers = table.width == 2
            && table.marks.separator == b','
            && table.rows.windows(2).any(|pair| {
                let [name, values] = [&pair[0].cells, &pair[1].cells];
                name.len() == 1 && !is_data(name) && values.len() == 2 && is_data(values)
            });
        if has_split_numbers {
            return Err(misnamed(1, 2, b','));
        }
        Self::with_rows(table, TableKind::Numbers)
    }

    fn with_rows(table: CutTable, kind: TableKind) -> Result<Self, String> {
        let CutTable { marks, mut rows, width } = table;
        // Titles above the table have fewer cells than the table.
        let titles = rows
            .iter()
            .take_while(|row| {
                let may_be_title = match kind {
                    TableKind::Log => true,
                    TableKind::Numbers => !is_data(&row.cells),
                };
                may_be_title && width_of(&row.cells) < width
            })
            .count();
        let title = rows.drain(..titles).next_back();
        let title = title.map(|row| row.cells).filter(|cells| !is_data(cells));
        let [first, below @ ..] = rows.as_slice() else { return Err("it has no rows".to_owned()) };
        let row_names = title.as_deref().filter(|title| are_names_of_r(title, &first.cells));
        let has_header = match kind {
            TableKind::Log => !is_data(&first.cells),
            TableKind::Numbers => is_header(&first.cells, below),
        };
        let (mut skip, mut columns) = if has_header {
            (first.end, named(&first.cells)?)
        } else if let Some(names) = row_names {
            (first.begin, with_row_names(names)?)
        } else {
            let columns = match kind {
                TableKind::Log => unnamed(&first.cells, title.as_deref(), marks.separator),
                TableKind::Numbers => {
                    numbered(&first.cells, width, title.as_deref(), marks.separator)
                }
            };
            (first.begin, columns?)
        };
        let has_row_names = row_names.is_some();
        let mut above = Vec::new();
        let mut values = if has_header { below } else { &rows[..] };
        while let [row, next @ ..] = values
            && !is_data(&row.cells)
        {
            let has_descriptions = match kind {
                TableKind::Log => above.len() < UNIT_ROWS && is_about_columns(&row.cells),
                TableKind::Numbers => {
                    has_header && skip == first.end && are_units(&row.cells, next)
                }
            };
            if !has_descriptions {
                break;
            }
            skip = row.end;
            // An old header below a new one contains no units.
            if !are_all_names(&row.cells, &columns) {
                above.push(row.cells.clone());
            }
            values = next;
        }
        describe(&mut columns, &above);
        let first_value = rows.len() - values.len();
        let values = rows.into_iter().skip(first_value);
        let sample = Sample::of(values.map(|row| (row.end.1, row.cells)));
        Ok(Self { marks, columns, skip, has_row_names, sample })
    }

    /// Writes the result of `time` for a row into column `to`, and empties the columns `beside`.
    pub fn join(&mut self, to: usize, beside: &[usize], time: impl Fn(&[String]) -> String) {
        let last = beside.iter().copied().fold(to, usize::max);
        let mut rows = self.sample.rows();
        for row in rows.iter_mut().filter(|row| row.len() > last) {
            row[to] = time(row);
            for &column in beside {
                row[column].clear();
            }
        }
        let lines = std::mem::take(&mut self.sample.lines);
        self.sample = Sample::of(lines.into_iter().zip(rows));
    }

    /// Returns the line of the first row that has this cell in a column.
    pub fn line_of(&self, column: usize, cell: &str) -> Option<u64> {
        let row = self
            .sample
            .rows()
            .iter()
            .position(|row| row.get(column).is_some_and(|other| other == cell))?;
        self.sample.lines.get(row).copied()
    }

    /// Returns the non-empty cells of a column in the first rows.
    pub fn cells(&self, column: usize) -> Vec<&str> {
        self.sample.column(column).filter(|cell| !cell.is_empty()).collect()
    }

    /// The cells of two columns in the first rows in which neither is empty.
    pub fn pairs(&self, one: usize, other: usize) -> Vec<[&str; 2]> {
        let rows = self.sample.by_row(one).zip(self.sample.by_row(other));
        let pairs = rows.filter_map(|(one, other)| Some([one?, other?]));
        pairs.filter(|pair| pair.iter().all(|cell| !cell.is_empty())).collect()
    }

    /// What the cells of all columns but `time` say about the decimal sign, in the file at `path`.
    pub fn signs(&self, time: usize, path: &Path) -> Signs {
        let mut signs = Signs::default();
        for column in (0..self.columns.len()).filter(|&column| column != time) {
            signs.note_column(&self.cells(column), self.marks.separator, path);
        }
        signs
    }
}

/// Returns the marks for a separator with the usual quotes.
fn marks(separator: u8) -> Marks {
    Marks { separator, quote: b'"' }
}

fn rows(head: &[u8], start: usize, marks: Marks) -> Vec<Row> {
    let lines = memchr::memchr_iter(b'\n', &head[..start]).count() as u64;
    let mut records = RecordReader::new(&head[start..], marks);
    let mut rows = Vec::new();
    let mut begin = (start as u64, lines);
    while rows.len() < LOOKED_AT && records.advance() {
        let cells = records.cells().map(|cell| decode(cell).into_owned()).collect();
        let byte = start + records.position();
        let ended = memchr::memchr_iter(b'\n', &head[start..byte]).count() as u64;
        let end = (byte as u64, lines + ended);
        rows.push(Row { cells, begin, end });
        begin = end;
    }
    rows
}

/// Decodes text as UTF-8, or as Latin 1 if it is not valid UTF-8: old exports write the degree sign so.
pub fn decode(bytes: &[u8]) -> std::borrow::Cow<'_, str> {
    match std::str::from_utf8(bytes) {
        Ok(text) => text.into(),
        Err(_) => bytes.iter().map(|&byte| char::from(byte)).collect::<String>().into(),
    }
}

/// Counts the cells, without one empty cell after a last separator.
fn width_of(cells: &[String]) -> usize {
    cells.len() - usize::from(cells.last().is_some_and(|cell| cell.trim().is_empty()))
}

/// Returns the number of cells that most rows have, if it is more than one. On a tie, the wider rows are the table.
fn usual_width(rows: &[Row]) -> Option<usize> {
    let mut widths: BTreeMap<usize, usize> = BTreeMap::new();
    for row in rows {
        *widths.entry(row.cells.len()).or_default() += 1;
    }
    let (width, _) = widths
        .into_iter()
        .filter(|&(width, _)| width > 1)
        .max_by_key(|&(width, count)| (count, width))?;
    Some(
        width
            - usize::from(
                rows.iter().all(|row| row.cells.len() != width || width_of(&row.cells) < width),
            ),
    )
}

/// Returns the share of rows that have `width` cells (in percent), and `width`. The right separator gives all rows the
/// same number of cells.
fn agreement(rows: &[Row], width: usize) -> (usize, usize) {
    let agree = rows.iter().filter(|row| (width..=width + 1).contains(&row.cells.len())).count();
    // One percent more rows outweighs any number of cells.
    (agree * 100 / rows.len(), width)
}

/// Whether these cells are values: at least one is a time or a number.
fn is_data(cells: &[String]) -> bool {
    let mut cells = cells.iter().map(|cell| cell.trim()).filter(|cell| !cell.is_empty());
    cells.any(|cell| {
        let is_time = cell.len() >= 6 && !Candidates::of(&[cell], None).left.is_empty();
        is_time || is_finite_number(cell)
    })
}

/// Whether a cell is a finite number with either decimal sign. Columns may be called INF or NaN.
fn is_finite_number(cell: &str) -> bool {
    [Decimal::Point, Decimal::Comma]
        .iter()
        .any(|&decimal| parse_number(cell, decimal).is_some_and(f64::is_finite))
}

/// Whether the first row of a table of numbers is its header: it has a name above values. If nothing below is a value,
/// it is a header unless it has values itself.
fn is_header(first: &[String], below: &[Row]) -> bool {
    let mut columns = first.iter().enumerate();
    let is_above_values = columns.any(|(column, cell)| is_name(cell) && has_values(below, column));
    is_above_values
        || first.iter().any(|cell| is_name(cell))
            && !is_data(first)
            && (0..first.len()).all(|column| !has_values(below, column))
}

/// Whether a row without numbers has the units of a table of numbers, and not missing values: only columns of values
/// have a unit, and at least one column has one.
fn are_units(cells: &[String], below: &[Row]) -> bool {
    let mut has_unit = false;
    for (column, cell) in cells.iter().enumerate() {
        let cell = cell.trim();
        // A dash means that there is no unit.
        if cell == "-" {
            continue;
        }
        let is_above_values = has_values(below, column);
        // The cell is a missing value, a unit of what has no unit, or a value.
        if cell.is_empty() == is_above_values || is_above_values && !is_name(cell) {
            return false;
        }
        has_unit |= is_above_values;
    }
    has_unit
}

/// Whether a column has values in these rows.
fn has_values(rows: &[Row], column: usize) -> bool {
    are_values(rows.iter().filter_map(|row| row.cells.get(column)).map(String::as_str))
}

/// Whether a row without values may describe columns, with units or descriptions. An empty row does not.
fn is_about_columns(cells: &[String]) -> bool {
    cells.iter().any(|cell| !cell.trim().is_empty())
}

fn named(cells: &[String]) -> Result<Vec<TextColumn>, String> {
    let cells = &cells[..width_of(cells)];
    let mut columns: Vec<TextColumn> = Vec::with_capacity(cells.len());
    let mut known = HashSet::with_capacity(cells.len());
    for (position, cell) in cells.iter().enumerate() {
        let name = cell.trim();
        let name =
            if name.is_empty() { format!("column {}", position + 1) } else { name.to_owned() };
        if !known.insert(name.clone()) {
            return Err(format!("two columns are called {name:?}; rename one"));
        }
        columns.push(TextColumn { name, ..TextColumn::default() });
    }
    Ok(columns)
}

/// Whether `title` names all columns of the first row of values except the first, which holds row names. R writes
/// tables this way. A column of times without a name does not count.
fn are_names_of_r(title: &[String], first: &[String]) -> bool {
    title.len() + 1 == width_of(first)
        && title.iter().all(|name| !name.trim().is_empty())
        && !first.first().is_some_and(|cell| is_written_time(cell.trim()))
}

/// Returns the columns of a table of R, whose header does not name the first column.
fn with_row_names(names: &[String]) -> Result<Vec<TextColumn>, String> {
    let is_taken = names.iter().any(|name| name.trim() == "row");
    let own = if is_taken { "row name" } else { "row" };
    let all: Vec<String> = [own.to_owned()].into_iter().chain(names.iter().cloned()).collect();
    named(&all)
}

fn are_all_names(cells: &[String], columns: &[TextColumn]) -> bool {
    let mut cells = cells.iter().map(|cell| cell.trim()).filter(|cell| !cell.is_empty());
    cells.all(|cell| columns.iter().any(|column| column.name == cell))
}

/// Returns the columns of a file without a header. Only a time and a value are recognised, not more columns. `title` is
/// the row above, if it could be a header.
fn unnamed(
    cells: &[String],
    title: Option<&[String]>,
    separator: u8,
) -> Result<Vec<TextColumn>, String> {
    let width = width_of(cells);
    let named = title.map(|title| title.iter().filter(|cell| !cell.trim().is_empty()).count());
    // Above two columns, which are recognised, a single name may be a title.
    let has_cells = title.is_some_and(|title| title.len() > 1);
    if let Some(named) = named.filter(|named| *named > 1 || *named == 1 && has_cells && width != 2)
    {
        return Err(misnamed(named, width, separator));
    }
    if width != 2 {
        return Err(format!(
            "it has no header line: its first row is values. Put a line above it that names the {width} columns, such as time{}",
            (1..width).map(|column| format!(",channel_{column}")).take(3).collect::<String>()
        ));
    }
    let names = ["timestamp", "value"].map(str::to_owned);
    Ok(names.into_iter().map(|name| TextColumn { name, ..TextColumn::default() }).collect())
}

/// Returns the columns of a table that is no log and has no header. Names beside numbers are refused: the row may be a
/// header with numbers for names, or its names may be labels of rows.
fn numbered(
    cells: &[String],
    width: usize,
    title: Option<&[String]>,
    separator: u8,
) -> Result<Vec<TextColumn>, String> {
    if let Some(title) = title {
        return Err(misnamed(width_of(title), width, separator));
    }
    if let Some(name) = cells.iter().map(|cell| cell.trim()).find(|cell| is_name(cell)) {
        return Err(format!(
            "its first row may be a header or values: `{name}` is no number, and neither is what stands below it. \
             Give every column a name in the first row that is no number, such as {}",
            (0..width)
                .map(|column| format!("column_{column}"))
                .take(3)
                .collect::<Vec<_>>()
                .join(",")
        ));
    }
    let names = (0..width).map(|number| number.to_string());
    Ok(names.map(|name| TextColumn { name, ..TextColumn::default() }).collect())
}

/// Returns the message for a header that has fewer names than rows have cells.
fn misnamed(named: usize, width: usize, separator: u8) -> String {
    let cause = if (named > 1 || width == 2) && separator == b',' {
        "If the numbers have decimal commas, each of them became two cells: export the table again with semicolons between cells, with quotes around numbers, or with decimal points. \
         Else give every column a name"
    } else {
        "Give every column a name"
    };
    let names = if named == 1 { "name" } else { "names" };
    format!("its header has {named} {names}, and most rows have {width} cells. {cause}")
}

/// Takes units and descriptions from the rows below the header. If there are two rows, the shorter one has the units.
fn describe(columns: &mut [TextColumn], above: &[Vec<String>]) {
    let Some(units) = above.iter().min_by_key(|row| length(row)) else { return };
    let labels = above.iter().filter(|row| *row != units).max_by_key(|row| length(row));
    for (position, column) in columns.iter_mut().enumerate() {
        column.unit = description(units, position);
        column.label = labels.and_then(|labels| description(labels, position));
    }
}

/// Returns the total bytes of all cells of a row.
fn length(row: &[String]) -> usize {
    row.iter().map(String::len).sum()
}

/// Returns the description of a column in a row; `None` if the cell is empty or a dash.
fn description(row: &[String], column: usize) -> Option<String> {
    let text = unbracketed(row.get(column)?);
    (!text.is_empty() && text != "-").then(|| text.to_owned())
}

/// Strips brackets from a unit or a description, and the slash between a quantity and its unit: `[ / °C]`. The slash of
/// `/min` stays.
pub fn unbracketed(text: &str) -> &str {
    let text = text.trim().trim_start_matches(['[', '(']).trim_end_matches([']', ')']).trim();
    text.strip_prefix("/ ").unwrap_or(text).trim()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn dialect(text: &str) -> Dialect {
        Dialect::of(text.as_bytes(), None).expect("a table")
    }

    fn refused(text: &str) -> String {
        Dialect::of(text.as_bytes(), None).expect_err("refused")
    }

    fn names(dialect: &Dialect) -> Vec<&str> {
        dialect.columns.iter().map(|column| column.name.as_str()).collect()
    }

    fn decimal(dialect: &Dialect) -> Decimal {
        dialect.signs(0, Path::new("a.csv")).decimal().expect("told")
    }

    #[test]
    fn separators_are_told_by_rows_of_equal_length() {
        let comma = dialect("time,a,b\n2024-01-01 00:00:00,1.5,2\n2024-01-01 00:01:00,,3\n");
        assert_eq!((comma.marks.separator, names(&comma)), (b',', vec!["time", "a", "b"]));
        assert_eq!(decimal(&comma), Decimal::Point);
        assert_eq!(comma.sample.rows.len(), 2);
        let german = dialect("Zeit;a;b\r\n01.01.2024 00:00;1,5;2,25\r\n01.01.2024 00:01;1,5;\r\n");
        assert_eq!((german.marks.separator, decimal(&german)), (b';', Decimal::Comma));
        assert_eq!(german.skip, (10, 1));
        let tabs = dialect("time\ta, total\n2024-01-01\t1\n");
        assert_eq!((tabs.marks.separator, names(&tabs)), (b'\t', vec!["time", "a, total"]));
        let one = dialect("time;a\n2024-01-01;1,5\n2024-01-02;1,6\n");
        assert_eq!(one.marks.separator, b';');
        assert!(Dialect::of(b"time\n2024-01-01\n", None).is_err());
    }

    #[test]
    fn names_of_rows_are_known_by_a_header_that_is_one_name_short() {
        let table = "\"date\",\"T\",\"CO2\"\n\"140\",\"2015-02-02 14:19:00\",23.7,749.2\n\"141\",\"2015-02-02 14:19:59\",23.71,760.4\n";
        let of_r = dialect(table);
        assert!(of_r.has_row_names);
        assert_eq!(names(&of_r), ["row", "date", "T", "CO2"]);
        assert_eq!(of_r.cells(1), ["2015-02-02 14:19:00", "2015-02-02 14:19:59"]);
        let mended = dialect(&format!("no,date,T,CO2\n{table}"));
        assert!(!mended.has_row_names);
        assert_eq!(mended.columns[2].unit, None, "the old header is no row of units");
        assert_eq!(mended.cells(2), ["23.7", "23.71"]);
        let times = refused("a,b\n2024-01-01 00:00,1,2\n2024-01-01 00:01,3,4\n");
        assert!(times.contains("its header has 2 names, and most rows have 3 cells"), "{times}");
        let commas = refused("Date,T,RH\n10/03/2004,13,6,48,9\n10/03/2004,13,3,47,7\n");
        assert!(commas.contains("each of them became two cells"), "{commas}");
    }

    #[test]
    fn titles_comments_units_and_quotes_are_understood() {
        let text = "# exported\nsep=;\nPlant 7\n\"Time\";\"T, inlet\";P;\n;temperature of the inlet;pressure;\n-;°C;[kPa];\n01.02.2024 00:00;1;2;\n";
        let found = dialect(text);
        assert_eq!(names(&found), ["Time", "T, inlet", "P"]);
        assert_eq!(found.columns[1].unit.as_deref(), Some("°C"));
        assert_eq!(found.columns[1].label.as_deref(), Some("temperature of the inlet"));
        assert_eq!(found.columns[2].unit.as_deref(), Some("kPa"));
        assert_eq!(found.columns[0].unit, None);
        let (bytes, lines) = found.skip;
        assert_eq!((&text[bytes as usize..][..10], lines), ("01.02.2024", 6));
        let cells: Vec<&str> = (0..3).flat_map(|column| found.cells(column)).collect();
        assert_eq!(cells, ["01.02.2024 00:00", "1", "2"]);
        let units = ["[°C]", "[ / °C]", "/ °C", " °C "].map(unbracketed);
        assert_eq!((units, unbracketed("[/min]")), (["°C"; 4], "/min"));
        let latin = Dialect::of(b"time,T [\xB0C]\n2024-01-01,1\n", None).expect("a table");
        assert_eq!(names(&latin), ["time", "T [°C]"]);
    }

    #[test]
    fn headers_may_lack_and_must_be_clear() {
        let bare = dialect("2024-01-01 00:00:00,1.5\n2024-01-01 00:01:00,1.6\n");
        assert_eq!(
            (names(&bare), bare.skip, bare.sample.rows.len()),
            (vec!["timestamp", "value"], (0, 0), 2)
        );
        assert_eq!(names(&dialect("time,INF,EFF\n2024-01-01,1,2\n")), ["time", "INF", "EFF"]);
        assert!(refused("2024-01-01,1,2\n2024-01-02,1,2\n").contains("it has no header line"));
        let one_name = refused("Zeit;;\n2024-01-01;1;2\n2024-01-02;1;2\n");
        assert!(
            one_name.contains("its header has 1 name, and most rows have 3 cells"),
            "{one_name}"
        );
        assert!(refused("time,a,a\n2024-01-01,1,2\n").contains("two columns are called \"a\""));
    }
}
