//! Pairs of words for the state of a switch, which are read as 1 and 0.

/// The word for 1 and the word for 0, in lower case. Our choice: pairs without another meaning in a log.
const PAIRS: [[&str; 2]; 24] = [
    ["on", "off"],
    ["open", "closed"],
    ["open", "close"],
    ["opened", "closed"],
    ["yes", "no"],
    ["true", "false"],
    ["running", "stopped"],
    ["run", "stop"],
    ["active", "inactive"],
    ["enabled", "disabled"],
    ["high", "low"],
    ["ein", "aus"],
    ["an", "aus"],
    ["auf", "zu"],
    ["offen", "geschlossen"],
    ["ja", "nein"],
    ["wahr", "falsch"],
    ["aktiv", "inaktiv"],
    ["marche", "arrêt"],
    ["ouvert", "fermé"],
    ["oui", "non"],
    ["abierto", "cerrado"],
    ["aperto", "chiuso"],
    ["open", "dicht"],
];

/// The word for 1 and the word for 0, as a channel writes them. One is `None` in a log in which a switch never moved: a
/// later log has both.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Switch {
    on: Option<String>,
    off: Option<String>,
}

impl Switch {
    /// Recognises the pair of a channel that has only these words, in capital letters or not; `None` if they are
    /// neither a pair nor one word of a pair.
    pub fn of<'a>(words: impl Iterator<Item = &'a str>) -> Option<Self> {
        let mut distinct: Vec<&str> = Vec::new();
        for word in words {
            if !distinct.iter().any(|known| is_same(known, word)) {
                distinct.push(word);
            }
            if distinct.len() > 2 {
                return None;
            }
        }
        match distinct[..] {
            [one] => {
                match [0_usize, 1].map(|side| PAIRS.iter().any(|pair| is_same(pair[side], one))) {
                    [true, false] => Some(Self { on: Some(one.to_owned()), off: None }),
                    [false, true] => Some(Self { on: None, off: Some(one.to_owned()) }),
                    _ => None,
                }
            }
            [one, other] => [[one, other], [other, one]].into_iter().find_map(|[on, off]| {
                PAIRS
                    .iter()
                    .any(|pair| is_same(pair[0], on) && is_same(pair[1], off))
                    .then(|| Self { on: Some(on.to_owned()), off: Some(off.to_owned()) })
            }),
            _ => None,
        }
    }

    /// Returns 1 or 0; `None` for another word.
    pub fn value(&self, word: &str) -> Option<f64> {
        [(&self.on, 1.0), (&self.off, 0.0)]
            .into_iter()
            .find(|(known, _)| known.as_deref().is_some_and(|known| is_same(known, word)))
            .map(|(_, value)| value)
    }

    /// Returns the word that is read as this value.
    pub fn word(&self, value: f64) -> Option<&str> {
        let words = [self.on.as_deref(), self.off.as_deref()];
        words.into_iter().flatten().find(|word| self.value(word) == Some(value))
    }

    /// Describes a channel and its words, if it has both.
    pub fn told(&self, channel: &str) -> Option<String> {
        let (on, off) = self.on.as_ref().zip(self.off.as_ref())?;
        Some(format!("{channel} ({on:?} and {off:?})"))
    }
}

/// Whether two words differ in nothing but capital letters.
fn is_same(one: &str, other: &str) -> bool {
    // Most words are ASCII, and cells are many.
    one.eq_ignore_ascii_case(other) || !one.is_ascii() && one.to_lowercase() == other.to_lowercase()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn switch(words: &[&str]) -> Option<Switch> {
        Switch::of(words.iter().copied())
    }

    fn told(words: &[&str]) -> Option<String> {
        switch(words).and_then(|switch| switch.told("XV"))
    }

    #[test]
    fn pairs_of_words_are_one_and_zero() {
        assert_eq!(told(&["OFF", "ON"]).as_deref(), Some("XV (\"ON\" and \"OFF\")"));
        assert_eq!(told(&["Ein", "Aus"]).as_deref(), Some("XV (\"Ein\" and \"Aus\")"));
        let valve = switch(&["closed", "open"]).expect("a pair");
        assert_eq!((valve.value("open"), valve.value("closed")), (Some(1.0), Some(0.0)));
        assert_eq!(valve.value("opened"), None);
        let pump = switch(&["OFF", "ON", "Off", "On"]).expect("a pair");
        assert_eq!(["on", "ON", "Off"].map(|word| pump.value(word)), [1.0, 1.0, 0.0].map(Some));
        let others: [&[&str]; 5] = [
            &["CIP"],
            &["ON", "AUS"],
            &["RUN", "CIP"],
            &["ON", "OFF", "Bad"],
            &["ON", "On", "Bad"],
        ];
        for others in others {
            assert_eq!(switch(others), None, "{others:?}");
        }
    }

    #[test]
    fn a_switch_that_never_moves_has_its_value() {
        let [on, off] = ["ON", "OFF"].map(|word| switch(&[word]).expect("of a pair"));
        assert_eq!((on.value("ON"), on.value("OFF")), (Some(1.0), None));
        assert_eq!((on.word(1.0), on.word(0.0), off.word(0.0)), (Some("ON"), None, Some("OFF")));
        assert_eq!((off.value("OFF"), off.told("XV")), (Some(0.0), None));
    }
}
