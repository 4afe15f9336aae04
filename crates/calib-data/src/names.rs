//! Selects channels by name or pattern.

use std::collections::{HashMap, HashSet};

use glob::Pattern;

use crate::{DataConfig, DataError, similar_names::hint};

/// Names of channels, some of which are patterns.
pub(crate) struct Names<'a> {
    entries: &'a [String],
    /// The first entry for each of these names: the literal entry, or a pattern that matches only this name.
    literal: HashMap<String, usize>,
    /// Entries that may match other names too.
    patterns: Vec<(usize, Pattern)>,
}

impl<'a> Names<'a> {
    pub(crate) fn new(entries: &'a [String]) -> Self {
        let mut literal = HashMap::new();
        let mut patterns = Vec::new();
        for (position, entry) in entries.iter().enumerate() {
            // Tag names may contain brackets: an equal name matches, whatever it means as a pattern.
            literal.entry(entry.clone()).or_insert(position);
            if let Some(name) = literally(entry) {
                literal.entry(name).or_insert(position);
            } else if let Ok(pattern) = Pattern::new(entry) {
                patterns.push((position, pattern));
            }
        }
        Self { entries, literal, patterns }
    }

    /// Returns the first entry that equals `channel`, or is a pattern that matches it.
    pub(crate) fn matching(&self, channel: &str) -> Option<&'a str> {
        let named = self.literal.get(channel).copied();
        let mut before =
            self.patterns.iter().take_while(|(at, _)| named.is_none_or(|named| *at < named));
        let matched = before.find(|(_, pattern)| pattern.matches(channel));
        let position = matched.map(|(at, _)| *at).or(named)?;
        Some(&self.entries[position])
    }

    /// Returns the first entry that equals or matches one of `names` of a channel. The first name with an entry
    /// decides.
    pub(crate) fn matching_any<'b>(
        &self,
        mut names: impl Iterator<Item = &'b str>,
    ) -> Option<&'a str> {
        names.find_map(|name| self.matching(name))
    }

    /// Returns the entries that match none of `channels`.
    pub(crate) fn unused<'b>(
        &self,
        channels: &(impl Iterator<Item = &'b str> + Clone),
    ) -> Vec<&'a str> {
        let names: HashSet<&str> = channels.clone().collect();
        let mut unused: Vec<bool> = self
            .entries
            .iter()
            .map(|entry| {
                let plain = literally(entry);
                !names.contains(entry.as_str())
                    && !plain.is_some_and(|plain| names.contains(plain.as_str()))
            })
            .collect();
        for (position, pattern) in &self.patterns {
            unused[*position] &= !names.iter().any(|channel| pattern.matches(channel));
        }
        let unused = self.entries.iter().zip(unused).filter(|(_, unused)| *unused);
        unused.map(|(entry, _)| entry.as_str()).collect()
    }

    /// Rejects entries that match none of `channels`.
    pub(crate) fn check<'b>(
        &self,
        channels: impl Iterator<Item = &'b str> + Clone,
    ) -> Result<(), DataError> {
        match self.unused(&channels).first() {
            None => Ok(()),
            Some(&pattern) => Err(DataError::NoSuchPattern {
                pattern: pattern.to_owned(),
                hint: hint(pattern, channels),
            }),
        }
    }
}

/// The channels that a study selects.
pub(crate) struct Chosen<'a> {
    /// Included names; `None` for all.
    include: Option<Names<'a>>,
    exclude: Names<'a>,
}

impl<'a> Chosen<'a> {
    pub(crate) fn of(data: &'a DataConfig) -> Self {
        let include = (!data.include.is_empty()).then(|| Names::new(&data.include));
        Self { include, exclude: Names::new(&data.exclude) }
    }

    /// Whether the channel with these names is selected.
    pub(crate) fn has<'b>(&self, names: &(impl Iterator<Item = &'b str> + Clone)) -> bool {
        self.include.as_ref().is_none_or(|include| include.matching_any(names.clone()).is_some())
            && self.exclude.matching_any(names.clone()).is_none()
    }
}

/// Returns the only name that a pattern matches, if there is only one: `T [[]°C]` matches only `T [°C]`.
fn literally(pattern: &str) -> Option<String> {
    let mut name = String::with_capacity(pattern.len());
    let mut rest = pattern.chars();
    while let Some(letter) = rest.next() {
        name.push(match letter {
            '*' | '?' => return None,
            '[' => {
                let inside = rest.next().filter(|inside| *inside != '!')?;
                (rest.next() == Some(']')).then_some(inside)?
            }
            letter => letter,
        });
    }
    Some(name)
}

/// Returns an entry for `data.include` or `data.exclude` that matches only the channel called `name`. `is_channel`
/// tells whether a name is a channel of the log. Names may contain special characters of patterns.
pub fn entry_of(name: &str, is_channel: impl Fn(&str) -> bool) -> String {
    if !name.contains(['*', '?', '[']) {
        return name.to_owned();
    }
    // Another channel may have the pattern as its name, and an equal name matches: `[**]` matches a star as `[*]` does.
    let mut times = 1;
    loop {
        let entry = bracketed(name, times);
        if !is_channel(&entry) {
            return entry;
        }
        times += 1;
    }
}

/// Puts brackets around each special character of patterns in a name, and repeats the character `times` times.
fn bracketed(name: &str, times: usize) -> String {
    name.chars()
        .map(|letter| match letter {
            '*' | '?' | '[' => format!("[{}]", letter.to_string().repeat(times)),
            letter => letter.to_string(),
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_and_patterns_match() {
        let names = ["PIT300".to_owned(), "T[1]".to_owned(), "FLOW_*".to_owned()];
        let names = Names::new(&names);
        assert_eq!(names.matching("PIT300"), Some("PIT300"));
        assert_eq!(names.matching("FLOW_IN"), Some("FLOW_*"));
        assert_eq!(names.matching("T[1]"), Some("T[1]"));
        assert_eq!(names.matching("PIT301"), None);
        let channels = ["PIT300", "T[1]", "FLUX"];
        assert_eq!(names.unused(&channels.into_iter()), ["FLOW_*"]);
    }

    #[test]
    fn an_entry_is_one_channel_whatever_it_is_called() {
        let channels =
            ["T [°C]", "T °", "*", "a*", "a[*]", "a[**]", "P?", "Px", "[!x]", "[", "]", "T[[]1"];
        for name in channels {
            let entry = [entry_of(name, |other| channels.contains(&other))];
            let names = Names::new(&entry);
            let matched: Vec<&str> =
                channels.into_iter().filter(|channel| names.matching(channel).is_some()).collect();
            assert_eq!(matched, [name], "{entry:?}");
            assert!(names.unused(&channels.into_iter()).is_empty(), "{entry:?}");
        }
        assert_eq!(entry_of("PIT300", |_| false), "PIT300");
        assert_eq!(entry_of("T [°C]", |_| false), "T [[]°C]");
    }

    #[test]
    fn a_misspelt_entry_gets_a_hint() {
        let channels = ["ZW_PIT300.DATA", "ZW_PIT301.DATA", "ZW_TIT101.DATA"];
        let names = ["ZW_PIT30.DATA".to_owned()];
        let error = Names::new(&names).check(channels.into_iter()).expect_err("misspelt");
        assert!(error.to_string().starts_with(
            "data.include has \"ZW_PIT30.DATA\", which names no channel; did you mean ZW_PIT300.DATA"
        ));
    }
}
