//! Numbers that entries of a study give to channels, by name or by pattern.

use std::slice::from_ref;

use crate::names::{Names, hint};

pub(super) struct Entry<'a> {
    pub(super) written: &'a String,
    names: Names<'a>,
    pub(super) number: f64,
}

pub(super) struct Entries<'a>(Vec<Entry<'a>>);

impl<'a> Entries<'a> {
    pub(super) fn new(given: impl IntoIterator<Item = (&'a String, f64)>) -> Self {
        let entries = given.into_iter().map(|(written, number)| Entry {
            written,
            names: Names::new(from_ref(written)),
            number,
        });
        Self(entries.collect())
    }

    /// The first entry that names none of `channels`, and why it is refused.
    pub(super) fn unused<'b>(
        &self,
        channels: impl Iterator<Item = &'b str> + Clone,
    ) -> Option<(&'a str, String)> {
        let unused = self.0.iter().find(|entry| !entry.names.unused(&channels).is_empty())?;
        let reason = format!("it names no channel{}", hint(unused.written, channels));
        Some((unused.written.as_str(), reason))
    }

    /// The number of the channel that has these names, if an entry gives it one. An entry that is one of them decides; else all patterns that
    /// match it have to agree.
    ///
    /// # Errors
    /// Two that do not agree.
    pub(super) fn number<'b>(
        &self,
        names: &(impl Iterator<Item = &'b str> + Clone),
    ) -> Result<Option<f64>, [&Entry<'a>; 2]> {
        let own = names.clone().find_map(|name| self.0.iter().find(|entry| entry.written == name));
        if let Some(own) = own {
            return Ok(Some(own.number));
        }
        let mut matching =
            self.0.iter().filter(|entry| entry.names.matching_any(names.clone()).is_some());
        let Some(first) = matching.next() else { return Ok(None) };
        match matching.find(|other| other.number != first.number) {
            None => Ok(Some(first.number)),
            Some(other) => Err([first, other]),
        }
    }
}
