//! Escaping of foreign text in a study file: the name of a channel may contain any character, and must not become a key.

use std::borrow::Cow;

use toml_writer::{ToTomlValue as _, TomlStringBuilder};

/// Formats any text as a TOML string on one line.
pub(crate) fn quoted(text: &str) -> String {
    let quoted = TomlStringBuilder::new(text).as_basic().to_toml_value();
    escaped(&quoted, |letter| format!("\\u{:04X}", u32::from(letter)))
}

/// Formats any text as a TOML key on one line, with quotes if needed.
pub(crate) fn key(text: &str) -> Cow<'_, str> {
    if !text.is_empty()
        && text.chars().all(|letter| letter.is_ascii_alphanumeric() || matches!(letter, '_' | '-'))
    {
        Cow::Borrowed(text)
    } else {
        Cow::Owned(quoted(text))
    }
}

/// Formats text as a comment, which ends with its line.
pub(crate) fn comment(text: &str) -> String {
    escaped(text, |letter| letter.escape_unicode().to_string())
}

/// Escapes the characters of `text` that would break out of a line.
fn escaped(text: &str, escape: impl Fn(char) -> String) -> String {
    let letters = text.chars();
    letters.map(|c| if breaks_out(c) { escape(c) } else { c.to_string() }).collect()
}

/// Whether a character is a control character, a line separator, or a mark that changes the direction of text. Their codes
/// all have at most four digits.
fn breaks_out(letter: char) -> bool {
    letter.is_control()
        || matches!(
            letter,
            '\u{61c}' | '\u{2028}' | '\u{2029}' | '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}'
        )
}

#[cfg(test)]
mod tests {
    use toml::Table;

    use super::*;

    #[test]
    fn any_text_is_one_string_on_one_line() {
        let mut texts: Vec<String> = (0..0x3000)
            .chain(0xfe00..0x1_0100)
            .filter_map(char::from_u32)
            .map(|letter| format!("a{letter}b"))
            .collect();
        let tricks = [
            "",
            "wind-1_a",
            "\n[evaluate]\nresamples = 0 #",
            "\"\"\"\n",
            "'''\n",
            "\\",
            "\\u000a",
            "a = \"\r\n",
        ];
        texts.extend(tricks.map(str::to_owned));
        for text in texts {
            let line = format!("a = {} # {}", quoted(&text), comment(&text));
            assert!(!line.contains(breaks_out), "{line:?}");
            let read: Table = toml::from_str(&line).expect("TOML");
            assert_eq!(read.len(), 1);
            assert_eq!(read["a"].as_str(), Some(text.as_str()));
            let read: Table = toml::from_str(&format!("{} = 1", key(&text))).expect("TOML");
            assert_eq!(read.keys().collect::<Vec<_>>(), [&text]);
        }
    }
}
