//! Command lines for a shell.

use std::borrow::Cow;

/// Joins words into a command line, with the quotes that a shell needs.
pub fn shell_words<I: IntoIterator<Item: AsRef<str>>>(words: I) -> String {
    let quoted = words.into_iter().map(|word| {
        // Quoting fails only for a word with a null character, which no command line can contain.
        shlex::try_quote(word.as_ref()).map_or_else(|_| word.as_ref().to_owned(), Cow::into_owned)
    });
    quoted.collect::<Vec<_>>().join(" ")
}
