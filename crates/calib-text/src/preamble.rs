//! The lines above a table, and the separator that they may declare.

/// Returns the offset of the table in bytes: it begins after comments, empty lines and Excel's `sep=;`.
pub(crate) fn preamble(head: &[u8]) -> usize {
    let mut start = 0;
    for line in head.split_inclusive(|&byte| byte == b'\n') {
        let text = line.trim_ascii();
        if !(text.is_empty() || text.starts_with(b"#") || declared(line).is_some()) {
            break;
        }
        start += line.len();
    }
    start
}

/// Returns the separators that a table below this preamble may have.
pub(crate) fn separators(preamble: &[u8]) -> Vec<u8> {
    declared(preamble).map_or(b"\t;,|".to_vec(), |separator| vec![separator])
}

/// Returns an upper bound on the number of cells in the text of a table.
pub fn most_cells(text: &[u8]) -> usize {
    let text = text.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(text);
    let separators = separators(&text[..preamble(text)]);
    let counts = separators.into_iter().map(|mark| memchr::memchr_iter(mark, text).count());
    let returns = memchr::memchr_iter(b'\r', text);
    let lines = memchr::memchr_iter(b'\n', text).count()
        + returns.filter(|at| text.get(at + 1) != Some(&b'\n')).count();
    // The last line may have no end.
    counts.max().unwrap_or(0) + lines + 1
}

/// Returns the separator that a line `sep=;` declares.
fn declared(preamble: &[u8]) -> Option<u8> {
    let line = preamble
        .split(|&byte| byte == b'\n')
        .map(<[u8]>::trim_ascii_end)
        .find(|line| line.len() == 5 && line[..4].eq_ignore_ascii_case(b"sep="))?;
    Some(line[4])
}
