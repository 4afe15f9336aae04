//! Typesetting of sentences on the page.

use maud::{Markup, html};

/// Typesets `text`: words between backticks become code, and percentages and numbers such as 1e-4 stay on one line.
/// Browsers would break such numbers at their sign.
pub(super) fn prose(text: &str) -> Markup {
    let parts: Vec<&str> = text.split('`').collect();
    // An unpaired backtick at the end opens nothing.
    let closed = parts.len() - usize::from(parts.len().is_multiple_of(2));
    let (parts, rest) = parts.split_at(closed);
    html! {
        @for (place, part) in parts.iter().enumerate() {
            @if place % 2 == 1 { code { (part) } } @else { (unbroken(part)) }
        }
        @for part in rest { (unbroken(part)) }
    }
}

/// Longest name, in bytes, that stays on one line. Longer names break between their parts, and not within one.
const LONG_NAME: usize = 16;

fn unbroken(text: &str) -> Markup {
    let text = text.replace(" %", "\u{a0}%");
    html! {
        @for (place, word) in text.split(' ').enumerate() {
            @if place > 0 { " " }
            @if is_small_number(word) {
                span.nowrap { (word) }
            } @else if word.len() >= LONG_NAME {
                @for (place, part) in word.split_inclusive(['_', '/', '-']).enumerate() {
                    @if place > 0 { wbr; }
                    (part)
                }
            } @else {
                (word)
            }
        }
    }
}

/// Whether a word is a number such as 1e-4, at whose hyphen a line must not end.
fn is_small_number(word: &str) -> bool {
    word.split_once("e-").is_some_and(|(mantissa, exponent)| {
        mantissa.ends_with(|c: char| c.is_ascii_digit())
            && exponent.starts_with(|c: char| c.is_ascii_digit())
    })
}

#[cfg(test)]
mod tests {
    use super::prose;

    fn shown(text: &str) -> String {
        prose(text).into_string()
    }

    #[test]
    fn backticks_become_code() {
        assert_eq!(
            shown("use `sweep.steps`, 5 % of 1e-4"),
            "use <code>sweep.steps</code>, 5\u{a0}% of <span class=\"nowrap\">1e-4</span>"
        );
        assert_eq!(shown("`a` and `b`"), "<code>a</code> and <code>b</code>");
        assert_eq!(shown("Lagging_Current_Power"), "Lagging_<wbr>Current_<wbr>Power");
        assert_eq!(shown("one ` alone"), "one  alone");
        assert_eq!(shown("`<b>`"), "<code>&lt;b&gt;</code>");
    }
}
