use std::fmt::Write as _;

use crate::written::comment;

/// Column in which comments begin, if the line is shorter.
const COMMENTS: usize = 44;
/// Numbers from here on have an exponent. Our choice, within the 64 bits of TOML integers.
const LARGE: f64 = 1e15;
/// Numbers below this one have an exponent. Our choice.
const SMALL: f64 = 1e-5;

/// Text that is built line by line.
#[derive(Default)]
pub(crate) struct Lines(pub(crate) String);

impl Lines {
    pub(crate) fn line(&mut self, line: &str) {
        self.0.push_str(line);
        self.0.push('\n');
    }

    pub(crate) fn comment(&mut self, text: &str) {
        self.line(&format!("# {}", comment(text)));
    }

    pub(crate) fn section(&mut self, name: &str) {
        self.line("");
        self.line(&format!("[{name}]"));
    }

    pub(crate) fn key(&mut self, key: &str, value: &str, comment: &str) {
        self.comment_after(&format!("{key} = {value}"), comment);
    }

    pub(crate) fn comment_after(&mut self, before: &str, after: &str) {
        if after.is_empty() {
            return self.line(before);
        }
        let width = COMMENTS.max(before.chars().count() + 2);
        // Writing to memory cannot fail.
        let _ = writeln!(self.0, "{before:width$}# {}", comment(after));
    }
}

/// Formats a number as TOML; whole numbers have no fraction. Large and small numbers have an exponent: TOML integers have at most
/// 64 bits, and long rows of zeros are hard to read.
pub(crate) fn number(value: f64) -> String {
    let size = value.abs();
    if size >= LARGE || (size > 0.0 && size < SMALL) {
        format!("{value:e}")
    } else {
        value.to_string()
    }
}

/// Formats a list of values that are TOML already.
pub(crate) fn list(values: &[String]) -> String {
    format!("[{}]", values.join(", "))
}

/// Formats a list of numbers.
pub(crate) fn numbers(values: impl IntoIterator<Item = f64>) -> String {
    list(&values.into_iter().map(number).collect::<Vec<_>>())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn any_number_is_one_of_toml() {
        for (value, written) in [
            (0.0, "0"),
            (-200.0, "-200"),
            (0.037, "0.037"),
            (0.000_01, "0.00001"),
            (0.000_009, "9e-6"),
            (1e-42, "1e-42"),
            (1e14, "100000000000000"),
            (1e15, "1e15"),
            (1.2e30, "1.2e30"),
            (-3e150, "-3e150"),
        ] {
            assert_eq!(number(value), written);
            let read: toml::Table = toml::from_str(&format!("a = {written}")).expect("TOML");
            let whole = read["a"].as_integer().map(|whole| whole as f64);
            assert_eq!(read["a"].as_float().or(whole), Some(value), "{written}");
        }
    }
}
