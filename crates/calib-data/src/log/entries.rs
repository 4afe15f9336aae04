//! Entries of a study that assign numbers to channels, by name or by pattern.

use std::slice::from_ref;

use crate::{names::Names, similar_names::hint};

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

    /// Returns the first entry that names none of `channels`, and the reason for its rejection.
    pub(super) fn unused<'b>(
        &self,
        channels: impl Iterator<Item = &'b str> + Clone,
    ) -> Option<(&'a str, String)> {
        let unused = self.0.iter().find(|entry| !entry.names.unused(&channels).is_empty())?;
        let reason = format!("it names no channel{}", hint(unused.written, channels));
        Some((unused.written.as_str(), reason))
    }

    /// Returns the number for the channel with these names, if an entry assigns one. An entry equal to a name decides;
    /// otherwise all patterns that match must agree.
    ///
    /// # Errors
    /// Two entries that disagree.
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
