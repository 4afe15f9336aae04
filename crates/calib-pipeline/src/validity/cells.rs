//! Cells of the tables of results.

use calib_base::output::percent;
use calib_report::{Cell, Table};
use calib_stats::Interval;

/// Formats an upper bound of a share.
pub(super) fn at_most(upper: Option<f64>) -> Cell {
    upper.map_or(Cell::Missing, |upper| Cell::Text(format!("up to {}", percent(upper))))
}

pub(super) fn quotient(value: Option<f64>) -> Cell {
    value.map_or(Cell::Missing, |value| Cell::Text(format!("{value:.3}")))
}

pub(super) fn quotients(interval: Option<Interval>) -> Cell {
    interval.map_or(Cell::Missing, |interval| {
        Cell::Text(format!("{:.3} to {:.3}", interval.low, interval.high))
    })
}

pub(super) fn count(number: usize) -> Cell {
    Cell::Count(number as u64)
}

pub(super) fn table(title: &str, caption: &str, columns: &[&str], rows: Vec<Vec<Cell>>) -> Table {
    Table {
        title: title.to_owned(),
        caption: caption.to_owned(),
        columns: columns.iter().map(|&name| name.to_owned()).collect(),
        rows,
        best: None,
    }
}
