//! Compares the values that were read with the statistics in the footer of a Parquet file.
//!
//! Most writers store no checksums in pages. Almost all of them store the smallest and the largest value and the number
//! of nulls of each column in the footer. If the values that were read differ, either the pages or the footer are
//! damaged.

use std::ops::Range;

use polars::prelude as pl;

/// Checks the values that were read of column `name` in `rows` of the file that `metadata` describes.
///
/// # Errors
/// The first row group that contradicts the footer, in words.
pub(crate) fn verify(
    metadata: &pl::FileMetadata,
    name: &str,
    rows: &Range<usize>,
    column: &pl::Column,
) -> Result<(), String> {
    let mut start = 0;
    for (number, group) in metadata.row_groups.iter().enumerate() {
        let all = start..start + group.num_rows();
        start = all.end;
        let inside = all.start.max(rows.start)..all.end.min(rows.end);
        if inside.is_empty() {
            continue;
        }
        let mut chunks = group.columns_under_root_iter(name).into_iter().flatten();
        let (Some(chunk), None) = (chunks.next(), chunks.next()) else { continue };
        if chunk.descriptor().path_in_schema.len() != 1 {
            continue;
        }
        let Some(Ok(said)) = chunk.statistics(&metadata.footer_buf) else { continue };
        let column = column.slice((inside.start - rows.start) as i64, inside.len());
        let is_whole = inside == all;
        if let (true, Some(nulls)) = (is_whole, said.null_count())
            && nulls != column.null_count() as i64
        {
            let missing = column.null_count();
            let what = format!("{missing} values are missing, and the footer says {nulls}");
            return Err(damaged(name, number, &what));
        }
        let range = if let Some(said) = said.as_double() {
            RangeComparison::of_floats(&column, said.min_value, said.max_value)
        } else if let Some(said) = said.as_float() {
            RangeComparison::of_floats(
                &column,
                said.min_value.map(f64::from),
                said.max_value.map(f64::from),
            )
        } else if let Some(said) = said.as_int64() {
            RangeComparison::of_integers(&column, said.min_value.zip(said.max_value))
        } else if let Some(said) = said.as_int32() {
            RangeComparison::of_integers(
                &column,
                said.min_value.zip(said.max_value).map(|(min, max)| (min.into(), max.into())),
            )
        } else if let Some(said) = said.as_binary() {
            RangeComparison::of_text(&column, said.min_value.as_deref(), said.max_value.as_deref())
        } else {
            None
        };
        if let Some(range) = range.filter(|range| !range.fits(is_whole)) {
            let what = format!(
                "its values are from {} to {}, and the footer says from {} to {}",
                range.read[0], range.read[1], range.said[0], range.said[1]
            );
            return Err(damaged(name, number, &what));
        }
    }
    Ok(())
}

/// Returns the message that a column in row group `number`, from 0, contradicts the footer.
fn damaged(name: &str, number: usize, what: &str) -> String {
    format!("column {name} in row group {}: {what}; one of the two is damaged", number + 1)
}

/// The smallest and the largest value, as read and as stated in the footer.
struct RangeComparison {
    read: [String; 2],
    said: [String; 2],
    is_same: bool,
    /// Whether the read range lies within the stated range.
    is_within: bool,
}

impl RangeComparison {
    /// Whether the ranges agree. A partly read row group may have a smaller range.
    fn fits(&self, is_whole: bool) -> bool {
        self.is_same || self.is_within && !is_whole
    }

    fn of_floats(column: &pl::Column, min: Option<f64>, max: Option<f64>) -> Option<Self> {
        if !column.dtype().is_float() {
            return None;
        }
        let said = [min?, max?];
        let numbers = column.cast(&pl::DataType::Float64).ok()?;
        let mut read = [f64::INFINITY, f64::NEG_INFINITY];
        for number in numbers.f64().ok()?.iter().flatten().filter(|number| !number.is_nan()) {
            read = [read[0].min(number), read[1].max(number)];
        }
        // Writers may state zeros of either sign, and need not state anything if there are no values.
        let is_empty = read[0] > read[1];
        Some(Self {
            is_same: is_empty || read == said,
            is_within: is_empty || said[0] <= read[0] && read[1] <= said[1],
            read: read.map(|number| format!("{number:?}")),
            said: said.map(|number| format!("{number:?}")),
        })
    }

    fn of_integers(column: &pl::Column, said: Option<(i64, i64)>) -> Option<Self> {
        use pl::DataType as D;
        let said = said?;
        let said = match column.dtype() {
            // Unsigned numbers are stored in the bits of signed ones.
            D::UInt64 => [said.0, said.1].map(|number| i128::from(number.cast_unsigned())),
            D::UInt8 | D::UInt16 | D::UInt32 => {
                [said.0, said.1].map(|number| i128::from((number as i32).cast_unsigned()))
            }
            D::Int8 | D::Int16 | D::Int32 | D::Int64 | D::Date | D::Datetime(..) => {
                [said.0, said.1].map(i128::from)
            }
            _ => return None,
        };
        let integers = column.to_physical_repr();
        let read = if let D::UInt64 = integers.dtype() {
            range_of(integers.u64().ok()?.iter().flatten().map(i128::from))
        } else {
            let integers = integers.cast(&D::Int64).ok()?;
            range_of(integers.i64().ok()?.iter().flatten().map(i128::from))
        };
        let read = read?;
        // Instants may be read in a finer unit than they are written in.
        let units: &[i128] =
            if let D::Datetime(..) = column.dtype() { &[1, 1_000, 1_000_000] } else { &[1] };
        let mut stated = units.iter().map(|unit| said.map(|number| number * unit));
        Some(Self {
            is_same: stated.clone().any(|stated| stated == read),
            is_within: stated.any(|[min, max]| min <= read[0] && read[1] <= max),
            read: read.map(|number| number.to_string()),
            said: said.map(|number| number.to_string()),
        })
    }

    /// The stated text may be cut off, so the values need only lie within the stated range.
    fn of_text(column: &pl::Column, min: Option<&[u8]>, max: Option<&[u8]>) -> Option<Self> {
        let min = min?;
        let max = max?;
        let text = column.cast(&pl::DataType::String).ok()?;
        let mut texts = text.str().ok()?.iter().flatten();
        let first = texts.next()?;
        let (least, most) =
            texts.fold((first, first), |(least, most), text| (least.min(text), most.max(text)));
        let is_within = min <= least.as_bytes() && most.as_bytes() <= max;
        Some(Self {
            read: [quoted(least), quoted(most)],
            said: [min, max].map(|bytes| quoted(&String::from_utf8_lossy(bytes))),
            is_same: is_within,
            is_within,
        })
    }
}

/// Returns the smallest and the largest of some numbers; `None` without any.
fn range_of(numbers: impl Iterator<Item = i128>) -> Option<[i128; 2]> {
    numbers.fold(None, |range, number| {
        let [min, max] = range.unwrap_or([number; 2]);
        Some([min.min(number), max.max(number)])
    })
}

/// Quotes the beginning of a text.
fn quoted(text: &str) -> String {
    format!("{:?}", text.chars().take(40).collect::<String>())
}
