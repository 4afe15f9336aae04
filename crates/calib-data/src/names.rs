//! Channels by name or pattern.

use crate::DataError;

/// Names of channels, some of them patterns.
pub(crate) struct Names<'a>(&'a [String]);

impl<'a> Names<'a> {
    pub(crate) fn new(names: &'a [String]) -> Self {
        Self(names)
    }

    /// The first entry that is `channel`, or a pattern that matches it.
    pub(crate) fn matching(&self, channel: &str) -> Option<&'a str> {
        self.0.iter().find(|pattern| matches(pattern, channel)).map(String::as_str)
    }

    /// The entries that match none of `channels`.
    pub(crate) fn unused<'b>(
        &self,
        channels: &(impl Iterator<Item = &'b str> + Clone),
    ) -> Vec<&'a str> {
        self.0
            .iter()
            .filter(|pattern| !channels.clone().any(|channel| matches(pattern, channel)))
            .map(String::as_str)
            .collect()
    }

    /// Refuse entries that match none of `channels`.
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

/// Tag names may hold brackets: a name that is equal matches, whatever it means as a pattern.
fn matches(pattern: &str, channel: &str) -> bool {
    pattern == channel || glob::Pattern::new(pattern).is_ok_and(|pattern| pattern.matches(channel))
}

/// `; did you mean A or B?`, or nothing.
pub(crate) fn hint<'a>(name: &str, channels: impl Iterator<Item = &'a str>) -> String {
    let wanted = name.to_lowercase();
    let mut similar: Vec<(f64, &str)> = channels
        .map(|channel| {
            let candidate = channel.to_lowercase();
            let contains = candidate.contains(&wanted) || wanted.contains(&candidate);
            let likeness = strsim::jaro_winkler(&wanted, &candidate);
            (if contains { likeness + 1.0 } else { likeness }, channel)
        })
        .filter(|&(likeness, _)| likeness > 0.8)
        .collect();
    similar.sort_by(|left, right| right.0.total_cmp(&left.0).then(left.1.cmp(right.1)));
    let names: Vec<&str> = similar.into_iter().take(3).map(|(_, name)| name).collect();
    if names.is_empty() { String::new() } else { format!("; did you mean {}?", names.join(" or ")) }
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
    fn misspelt_names_get_a_hint() {
        let channels = ["ZW_PIT300.DATA", "ZW_PIT301.DATA", "ZW_TIT101.DATA"];
        assert_eq!(hint("pit300", channels.into_iter()), "; did you mean ZW_PIT300.DATA?");
        assert_eq!(hint("qqq", channels.into_iter()), "");
        let names = ["ZW_PIT30.DATA".to_owned()];
        let error = Names::new(&names).check(channels.into_iter()).expect_err("misspelt");
        assert!(error.to_string().starts_with(
            "data.include has \"ZW_PIT30.DATA\", which names no channel; did you mean ZW_PIT300.DATA"
        ));
    }
}
