//! Names in a sentence, of which there may be many.

/// Maximum number of channels that one sentence names.
const NAMED: usize = 5;

/// Lists the first few of `all` and the number of further ones; `None` if `all` is empty.
pub(crate) fn first_few(all: &[String]) -> Option<String> {
    let (named, more) = all.split_at(all.len().min(NAMED));
    let more = if more.is_empty() { String::new() } else { format!(" and {} more", more.len()) };
    (!named.is_empty()).then(|| format!("{}{more}", named.join(", ")))
}
