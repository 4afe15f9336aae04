use std::time::Duration;

use calib_core::{number, rounded};
use comfy_table::{CellAlignment, ContentArrangement, Table, presets};

use super::escape::{Lines, harmless};

/// Formats `1234567` as `1,234,567`.
pub fn count(number: usize) -> String {
    calib_core::count(number as u64)
}

/// Formats `1536` as `1.5 KiB`.
pub fn bytes(bytes: u64) -> String {
    const UNITS: [&str; 5] = ["B", "KiB", "MiB", "GiB", "TiB"];
    let mut size = bytes as f64;
    let mut unit = 0;
    // A size that would be shown as 1024.0 gets the next unit.
    while size >= 1023.95 && unit + 1 < UNITS.len() {
        size /= 1024.0;
        unit += 1;
    }
    if unit == 0 { format!("{bytes} B") } else { format!("{size:.1} {}", UNITS[unit]) }
}

/// Formats a span of time in the largest two units.
pub fn duration(span: Duration) -> String {
    let exact = span.as_secs_f64();
    // Rounded before they are divided: 2 h 59.7 min are 3 h 0 min, and not 2 h 60 min.
    let (secs, mins) = (exact.round(), (exact / 60.0).round());
    if exact < 9.95 {
        format!("{exact:.1} s")
    } else if secs < 60.0 {
        format!("{secs} s")
    } else if secs < 3600.0 {
        format!("{} min {} s", (secs / 60.0).floor(), secs % 60.0)
    } else if mins < 1440.0 {
        format!("{} h {} min", (mins / 60.0).floor(), mins % 60.0)
    } else {
        format!("{:.1} days", exact / 86_400.0)
    }
}

/// Formats seconds as [`duration`] does. A number that is too large counts as the longest duration.
pub fn duration_of_secs(secs: f64) -> String {
    duration(Duration::try_from_secs_f64(secs.max(0.0)).unwrap_or(Duration::MAX))
}

/// Formats a span of the log in the largest two units, with whole numbers where possible:
/// `5 d 10 h`, `1 min`, `0.5 s`.
pub fn span(secs: f64) -> String {
    const UNITS: [(f64, &str); 4] = [(86_400.0, "d"), (3_600.0, "h"), (60.0, "min"), (1.0, "s")];
    let secs = if secs < 60.0 { secs } else { secs.round() };
    let Some(largest) = UNITS.iter().position(|(size, _)| secs >= *size) else {
        return format!("{} s", number(secs));
    };
    let (size, unit) = UNITS[largest];
    let Some(&(smaller, smaller_unit)) = UNITS.get(largest + 1) else {
        let text = format!("{secs:.2}");
        return format!("{} {unit}", text.trim_end_matches('0').trim_end_matches('.'));
    };
    // Ten days of rows a minute apart end a minute before the tenth day does.
    let parts = (secs / smaller).round();
    if largest > 0 && parts * smaller >= UNITS[largest - 1].0 {
        return span(parts * smaller);
    }
    let per_size = size / smaller;
    let whole = (parts / per_size).floor();
    let rest = parts - whole * per_size;
    if rest > 0.0 {
        format!("{whole} {unit} {rest} {smaller_unit}")
    } else {
        format!("{whole} {unit}")
    }
}

/// Formats a number with its noun: "1 segment", "2 segments".
pub fn counted(number: usize, noun: &str) -> String {
    format!("{} {noun}{}", count(number), if number == 1 { "" } else { "s" })
}

/// Formats a number of which only the first two digits are known: `12518` as `13,000`.
pub fn about(value: f64) -> String {
    let value = rounded(value, 2);
    if value < 100.0 { number(value) } else { count(value as usize) }
}

/// Formats a table for a terminal: the first column is text, the others are numbers.
pub fn table(header: &[&str], rows: &[Vec<String>]) -> String {
    let mut table = Table::new();
    table.load_style(presets::NOTHING).set_content_arrangement(ContentArrangement::Disabled);
    table.set_header(header.iter().copied());
    for row in rows {
        table.add_row(row.iter().map(|cell| harmless(cell, Lines::One)));
    }
    for (position, column) in table.column_iter_mut().enumerate() {
        if position > 0 {
            column.set_cell_alignment(CellAlignment::Right);
        }
    }
    table.lines().map(|line| line.trim_end().to_owned()).collect::<Vec<_>>().join("\n")
}

/// Formats a table of results for a terminal, without its title and caption.
pub fn results(shown: &calib_report::Table) -> String {
    let header: Vec<&str> = shown.columns.iter().map(String::as_str).collect();
    let rows: Vec<Vec<String>> =
        shown.rows.iter().map(|row| row.iter().map(ToString::to_string).collect()).collect();
    table(&header, &rows)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_written_for_people() {
        assert_eq!(count(1_234_567), "1,234,567");
        assert_eq!(count(12), "12");
        assert_eq!([1023, 1536, 1_048_575].map(bytes), ["1023 B", "1.5 KiB", "1.0 MiB"]);
        assert_eq!([1, 2].map(|number| counted(number, "plant")), ["1 plant", "2 plants"]);
        let durations =
            [0.04, 9.94, 9.96, 59.6, 119.7, 3_599.7, 3_725.0, 10_790.0, 86_390.0, 200_000.0];
        assert_eq!(
            durations.map(duration_of_secs),
            [
                "0.0 s",
                "9.9 s",
                "10 s",
                "1 min 0 s",
                "2 min 0 s",
                "1 h 0 min",
                "1 h 2 min",
                "3 h 0 min",
                "1.0 days",
                "2.3 days"
            ]
        );
        let spans = [0.0, 0.5, 1.25, 59.9, 60.0, 90.0, 3_599.7, 468_012.0, 86_400.0].map(span);
        assert_eq!(
            spans,
            ["0 s", "0.5 s", "1.25 s", "59.9 s", "1 min", "1 min 30 s", "1 h", "5 d 10 h", "1 d"]
        );
        let short_of_whole = [863_940.0, 86_390.0, 100_000.0, 172_790.0].map(span);
        assert_eq!(short_of_whole, ["10 d", "1 d", "1 d 4 h", "2 d"]);
        assert_eq!([12_518.3, 4096.0, 99.6, 0.0].map(about), ["13,000", "4,100", "100", "0"]);
    }

    #[test]
    fn tables_align() {
        let text = table(
            &["name", "n"],
            &[vec!["a".into(), "1".into()], vec!["bcd".into(), "200".into()]],
        );
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines.len(), 3);
        assert!(lines[1].ends_with('1') && lines[2].ends_with("200"), "{text}");
    }
}
