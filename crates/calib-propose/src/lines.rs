use std::fmt::Write as _;

use crate::written::comment;

/// The column in which comments begin, where there is room.
const COMMENTS: usize = 44;
/// Numbers from here on are written with an exponent. Our choice, within the 64 bits that whole numbers of TOML may have.
const LARGE: f64 = 1e15;
/// Numbers below this one are written with an exponent. Our choice.
const SMALL: f64 = 1e-5;

/// Text that grows by lines.
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

/// As TOML, without a fraction where there is none. Large and small numbers have an exponent: whole numbers of TOML have at most 64 bits,
/// and nobody counts zeros.
pub(crate) fn number(value: f64) -> String {
    let size = value.abs();
    if size >= LARGE || (size > 0.0 && size < SMALL) {
        format!("{value:e}")
    } else {
        value.to_string()
    }
}

/// A list of values that are written already.
pub(crate) fn list(values: &[String]) -> String {
    format!("[{}]", values.join(", "))
}

/// A list of numbers.
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
