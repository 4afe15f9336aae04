//! Makes outside text safe for a terminal. Names of sensors, words in logs and paths may hold escape sequences that a
//! terminal obeys, or line breaks that forge a line of calib's output. All printed text passes through here.

use std::{borrow::Cow, fmt::Write as _};

/// The source of the line breaks in a text.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Lines {
    /// A single line of calib's. Any line break in it comes from outside.
    One,
    /// Calib's own line breaks, as in a table.
    Several,
}

/// Returns `text` with every character that a terminal obeys replaced by its code: `\u{1b}`, `\n`.
pub fn harmless(text: &str, lines: Lines) -> Cow<'_, str> {
    let obeyed =
        |character: char| obeys(character) && !(lines == Lines::Several && character == '\n');
    if !text.contains(obeyed) {
        return Cow::Borrowed(text);
    }
    let mut safe = String::with_capacity(text.len() + 8);
    for character in text.chars() {
        if obeyed(character) {
            safe.extend(character.escape_default());
        } else {
            safe.push(character);
        }
    }
    Cow::Owned(safe)
}

/// Returns the same JSON with control characters, which JSON itself permits, escaped in the manner of JSON.
pub fn harmless_json(json: &str) -> Cow<'_, str> {
    if !json.contains(is_obeyed_in_json) {
        return Cow::Borrowed(json);
    }
    let mut safe = String::with_capacity(json.len() + 8);
    for character in json.chars() {
        if is_obeyed_in_json(character) {
            // Writing to a string cannot fail. All these characters have at most four digits.
            let _ = write!(safe, "\\u{:04x}", u32::from(character));
        } else {
            safe.push(character);
        }
    }
    Cow::Owned(safe)
}

/// Whether a terminal obeys a character of JSON, whose line breaks are calib's own.
fn is_obeyed_in_json(character: char) -> bool {
    obeys(character) && character != '\n'
}

/// Whether a character is a control character (C0, DEL and C1), a line separator, or a mark that changes the text
/// direction.
fn obeys(character: char) -> bool {
    (character.is_control() && character != '\t')
        || matches!(
            character,
            '\u{61c}' | '\u{2028}' | '\u{2029}' | '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}'
        )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_that_a_terminal_obeys_is_left() {
        let clipboard = "E\u{1b}]52;c;aGk=\u{7}";
        assert_eq!(harmless(clipboard, Lines::One), "E\\u{1b}]52;c;aGk=\\u{7}");
        assert_eq!(harmless("a\nerror: forged", Lines::One), "a\\nerror: forged");
        assert_eq!(harmless("a\nb\u{9b}2J", Lines::Several), "a\nb\\u{9b}2J");
        assert_eq!(harmless("温度 → °C", Lines::One), "温度 → °C");
        for code in 0..0x0011_0000 {
            let Some(character) = char::from_u32(code) else { continue };
            let shown = harmless(character.encode_utf8(&mut [0; 4]), Lines::One).into_owned();
            assert!(character == '\t' || !shown.chars().any(char::is_control), "{code:x}");
        }
    }

    #[test]
    fn json_keeps_its_content() {
        let name = "a\u{9b}b\u{7f}\n\u{202e}";
        let json = serde_json::to_string(&name).expect("JSON");
        let safe = harmless_json(&json);
        assert!(!safe.contains(obeys), "{safe}");
        assert_eq!(serde_json::from_str::<String>(&safe).expect("JSON"), name);
    }
}
