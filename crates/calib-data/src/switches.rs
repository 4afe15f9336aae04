//! Words that say whether something is on: pairs that are read as 1 and 0.

/// The word for 1 and that for 0, in small letters. Our choice: pairs of which no word means anything else in a log.
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

/// The word for 1 and that for 0, as a channel writes them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Switch {
    pub(crate) on: String,
    pub(crate) off: String,
}

impl Switch {
    /// Of a channel that has these words and no others; none if they are no pair.
    pub(crate) fn of<'a>(words: impl Iterator<Item = &'a str>) -> Option<Self> {
        let mut distinct: Vec<&str> = words.take(3).collect();
        distinct.sort_unstable();
        let [one, other] = distinct[..] else { return None };
        let [small, other_small] = [one, other].map(str::to_lowercase);
        PAIRS
            .iter()
            .find_map(|[on, off]| match (small.as_str(), other_small.as_str()) {
                pair if pair == (*on, *off) => Some([one, other]),
                pair if pair == (*off, *on) => Some([other, one]),
                _ => None,
            })
            .map(|[on, off]| Self { on: on.to_owned(), off: off.to_owned() })
    }

    /// 1 or 0; none for another word.
    pub(crate) fn value(&self, word: &str) -> Option<f64> {
        match word {
            word if word == self.on => Some(1.0),
            word if word == self.off => Some(0.0),
            _ => None,
        }
    }

    /// A channel and its words.
    pub(crate) fn told(&self, channel: &str) -> String {
        format!("{channel} ({:?} and {:?})", self.on, self.off)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn switch(words: &[&str]) -> Option<[String; 2]> {
        Switch::of(words.iter().copied()).map(|Switch { on, off }| [on, off])
    }

    #[test]
    fn pairs_of_words_are_one_and_zero() {
        assert_eq!(switch(&["OFF", "ON"]), Some(["ON", "OFF"].map(str::to_owned)));
        assert_eq!(switch(&["Ein", "Aus"]), Some(["Ein", "Aus"].map(str::to_owned)));
        let valve = Switch::of(["closed", "open"].into_iter()).expect("a pair");
        assert_eq!((valve.value("open"), valve.value("closed")), (Some(1.0), Some(0.0)));
        assert_eq!(valve.value("Open"), None);
        for others in [&["ON"][..], &["ON", "AUS"], &["RUN", "CIP"], &["ON", "OFF", "Bad"]] {
            assert_eq!(switch(others), None, "{others:?}");
        }
    }
}
