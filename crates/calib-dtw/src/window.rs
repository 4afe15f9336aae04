//! Windows: the cells (i, j) in which a path may start or end a branch.

use std::{fmt, ops::Range, str::FromStr};

/// The cells that are open to a warping path, for a query of N and a reference of M samples.
///
/// As in the reference package, the window applies to the cells where branches begin and end. A
/// cell in the middle of a branch may lie outside it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Window {
    /// Every cell.
    #[default]
    None,
    /// |i − j| ≤ radius. There is no path if the lengths differ by more than the radius.
    SakoeChiba {
        /// Half-width of the band in samples.
        radius: usize,
    },
    /// |j − i (M−1)/(N−1)| ≤ radius: a band around the diagonal of the rectangle.
    Slanted {
        /// Half-width of the band in reference samples.
        radius: usize,
    },
    /// The parallelogram of slopes 1/2 to 2 from both corners:
    /// j ≤ 2i, i ≤ 2j + 1, N−1−i ≤ 2(M−1−j) + 1, M−1−j ≤ 2(N−1−i).
    Itakura,
}

impl Window {
    /// Returns the open reference samples of query sample `row`, for `query` × `reference` cells.
    /// The ends of the range never decrease with `row`. The range may be empty.
    pub fn columns(self, row: usize, query: usize, reference: usize) -> Range<usize> {
        let last_row = query - 1;
        let last_column = reference - 1;
        let range = match self {
            Self::None => 0..reference,
            Self::SakoeChiba { radius } => {
                row.saturating_sub(radius)..row.saturating_add(radius).saturating_add(1)
            }
            // A single row has no slope, so all of it is on the diagonal.
            Self::Slanted { .. } if last_row == 0 => 0..reference,
            Self::Slanted { radius } => {
                let diagonal = row * last_column;
                let low = diagonal.div_ceil(last_row).saturating_sub(radius);
                low..(diagonal / last_row + 1).saturating_add(radius)
            }
            Self::Itakura => {
                let rest = last_row - row;
                let low = (row / 2).max(last_column.saturating_sub(2 * rest));
                let high = (2 * row + 1).min((last_column + 1).saturating_sub(rest / 2));
                low..high
            }
        };
        range.start..range.end.min(reference)
    }
}

impl fmt::Display for Window {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::None => f.write_str("none"),
            Self::SakoeChiba { radius } => write!(f, "sakoeChiba:{radius}"),
            Self::Slanted { radius } => write!(f, "slanted:{radius}"),
            Self::Itakura => f.write_str("itakura"),
        }
    }
}

/// A text that is not a window.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("unknown window `{text}`: expected none, sakoeChiba:RADIUS, slanted:RADIUS or itakura")]
pub struct ParseWindowError {
    /// The text that was given.
    pub text: String,
}

impl FromStr for Window {
    type Err = ParseWindowError;

    /// Reads `none`, `sakoeChiba:10`, `slanted:10` or `itakura`. Case is ignored, and hyphens are
    /// allowed: `sakoe-chiba:10`.
    fn from_str(text: &str) -> Result<Self, Self::Err> {
        parsed(text).ok_or_else(|| ParseWindowError { text: text.to_owned() })
    }
}

/// Returns the window that a text names, if it names one.
fn parsed(text: &str) -> Option<Window> {
    let lower = text.trim().to_ascii_lowercase().replace('-', "");
    let (name, radius) = match lower.split_once(':') {
        Some((name, radius)) => (name, Some(radius.parse().ok()?)),
        None => (lower.as_str(), None),
    };
    match (name, radius) {
        ("none", None) => Some(Window::None),
        ("itakura", None) => Some(Window::Itakura),
        ("sakoechiba", Some(radius)) => Some(Window::SakoeChiba { radius }),
        ("slanted", Some(radius)) => Some(Window::Slanted { radius }),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whether a cell satisfies the defining inequality of the window.
    fn open(window: Window, i: usize, j: usize, query: usize, reference: usize) -> bool {
        let i = i as i64;
        let j = j as i64;
        let n = query as i64 - 1;
        let m = reference as i64 - 1;
        match window {
            Window::None => true,
            Window::SakoeChiba { radius } => (i - j).abs() <= radius as i64,
            Window::Slanted { radius } => (j * n - i * m).abs() <= radius as i64 * n,
            Window::Itakura => {
                j <= 2 * i && i <= 2 * j + 1 && n - i <= 2 * (m - j) + 1 && m - j <= 2 * (n - i)
            }
        }
    }

    #[test]
    fn ranges_are_the_cells_of_the_definition_and_never_step_back() {
        for (query, reference) in [(1, 1), (1, 7), (7, 1), (6, 6), (8, 5), (5, 9), (13, 20)] {
            for window in [
                Window::None,
                Window::SakoeChiba { radius: 0 },
                Window::SakoeChiba { radius: 4 },
                Window::Slanted { radius: 0 },
                Window::Slanted { radius: 2 },
                Window::Itakura,
            ] {
                let mut before = 0..0;
                for row in 0..query {
                    let columns = window.columns(row, query, reference);
                    for column in 0..reference {
                        assert_eq!(
                            columns.contains(&column),
                            open(window, row, column, query, reference),
                            "{window:?} {query}x{reference} at {row},{column}"
                        );
                    }
                    assert!(columns.start >= before.start && columns.end >= before.end);
                    before = columns;
                }
            }
        }
    }

    #[test]
    fn a_radius_beyond_all_lengths_is_no_window() {
        let radius = usize::MAX;
        for window in [Window::SakoeChiba { radius }, Window::Slanted { radius }] {
            assert_eq!(window.columns(3, 7, 5), 0..5);
        }
    }

    #[test]
    fn names_read_back() {
        for window in [
            Window::None,
            Window::SakoeChiba { radius: 10 },
            Window::Slanted { radius: 3 },
            Window::Itakura,
        ] {
            assert_eq!(window.to_string().parse::<Window>().unwrap(), window);
        }
        let hyphen = "sakoe-chiba:5".parse::<Window>().unwrap();
        assert_eq!(hyphen, Window::SakoeChiba { radius: 5 });
        for text in ["sakoeChiba", "slanted:x", "itakura:3", "band", ""] {
            assert!(text.parse::<Window>().is_err(), "{text}");
        }
    }
}
