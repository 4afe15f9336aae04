use std::fmt::Write as _;

use crate::written::comment;

/// The column in which comments begin, where there is room.
const COMMENTS: usize = 44;

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

/// Without a fraction where there is none.
pub(crate) fn number(value: f64) -> String {
    value.to_string()
}
