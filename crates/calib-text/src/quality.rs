//! Quality codes of historians, which decide whether values count.

use std::collections::BTreeMap;

/// The meaning of quality codes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Quality {
    /// The good codes in the study.
    Given(Vec<String>),
    /// Words such as `Good`, and yes or no.
    Words,
    /// Words of which the first rows have none that is known, and what to say if no other file of the log has one.
    UnknownWords(String),
    /// OPC Classic: the two highest bits of the low byte are set, 192 to 255.
    OpcClassic,
    /// OPC UA: the two highest of 32 bits are clear; 0 is good.
    OpcUa,
    /// No code, or only 0, which is good in OPC UA and bad in OPC Classic. Read as OPC UA, unless another file of the
    /// log shows otherwise.
    Zeros,
}

impl Quality {
    /// Determines the meaning from the `good` codes of the study if it names some, or from the first codes of a log.
    ///
    /// # Errors
    /// If a code is not known: the reason, in words.
    pub fn of(codes: &[&str], good: &[String]) -> Result<Self, String> {
        if !good.is_empty() {
            return Ok(Self::Given(good.iter().map(|code| lower(code)).collect()));
        }
        let numbers: Option<Vec<u64>> = codes.iter().map(|code| number(code)).collect();
        let Some(numbers) = numbers else { return Self::of_words(codes) };
        if numbers.iter().any(|code| (192..256).contains(code)) {
            return Ok(Self::OpcClassic);
        }
        match numbers.iter().find(|&&code| code > 0 && code < UA_UNCERTAIN) {
            None if numbers.iter().all(|&code| code == 0) => Ok(Self::Zeros),
            None => Ok(Self::OpcUa),
            Some(code) => Err(unknown_code(&code.to_string())),
        }
    }

    /// Words, one of which is known: a bad one is enough, for a sensor may have been off in all of these rows. Numbers among words without a
    /// good one are refused, because all of them would be bad.
    fn of_words(codes: &[&str]) -> Result<Self, String> {
        let mut unknown: BTreeMap<&str, usize> = BTreeMap::new();
        let mut has_bad_word = false;
        for code in codes.iter().map(|code| code.trim()).filter(|code| !code.is_empty()) {
            let lowered = lower(code);
            let first = first_word(&lowered);
            if is_good_word(first) {
                return Ok(Self::Words);
            }
            has_bad_word |= is_bad_word(first);
            *unknown.entry(code).or_default() += 1;
        }
        if let Some(code) = unknown.keys().find(|code| number(code).is_some()) {
            return Err(unknown_code(code));
        }
        match unknown.into_iter().max_by_key(|(_, count)| *count) {
            Some((code, _)) if !has_bad_word => Ok(Self::UnknownWords(format!(
                "no word of the quality is known in any file, such as {code:?}; name those that mean good with data.good_quality"
            ))),
            _ => Ok(Self::Words),
        }
    }

    /// Read zeros, and words that are not known, as the other files of the log have them.
    ///
    /// # Errors
    /// If no file has a word that is known.
    pub fn agree<'q>(all: impl Iterator<Item = &'q mut Self>) -> Result<(), String> {
        let all: Vec<&mut Self> = all.collect();
        let are_classic = all.iter().any(|other| **other == Self::OpcClassic);
        let are_words = all.iter().any(|other| **other == Self::Words);
        for quality in all {
            match quality {
                Self::Zeros if are_classic => *quality = Self::OpcClassic,
                Self::UnknownWords(_) if are_words => *quality = Self::Words,
                Self::UnknownWords(reason) => return Err(std::mem::take(reason)),
                _ => {}
            }
        }
        Ok(())
    }

    /// Whether a value with this code counts. An empty code counts as good.
    ///
    /// # Errors
    /// If the code is not known: the reason, in words.
    pub fn is_good(&self, code: &str) -> Result<bool, String> {
        let code = code.trim();
        if code.is_empty() {
            return Ok(true);
        }
        match (self, number(code)) {
            (Self::Given(good), _) => Ok(good.contains(&lower(code))),
            (Self::Words, _) => Ok(is_good_word(first_word(&lower(code)))),
            (Self::OpcClassic, Some(code)) => Ok(code & 0xC0 == 0xC0),
            (Self::OpcUa | Self::Zeros, Some(code)) if code == 0 || code >= UA_UNCERTAIN => {
                Ok(code >> 30 == 0)
            }
            _ => Err(unknown_code(code)),
        }
    }
}

/// The smallest OPC UA code that is not good.
const UA_UNCERTAIN: u64 = 1 << 30;

fn unknown_code(code: &str) -> String {
    format!(
        "the meaning of the quality {code} is not known; name the good codes with data.good_quality, such as [\"192\"]"
    )
}

fn number(code: &str) -> Option<u64> {
    let code = code.trim();
    match code.strip_prefix("0x").or(code.strip_prefix("0X")) {
        Some(hexadecimal) => u64::from_str_radix(hexadecimal, 16).ok(),
        None => code.parse().ok().or_else(|| {
            code.parse::<f64>()
                .ok()
                .filter(|code| code.fract() == 0.0 && (0.0..1e15).contains(code))
                .map(|code| code as u64)
        }),
    }
}

/// First words of a good code, in lower case.
const GOOD: [&str; 27] = [
    "good", "g", "ok", "true", "yes", "valid", "normal", "gut", "gültig", "gueltig", "ja", "bon",
    "bonne", "valide", "oui", "bueno", "buena", "válido", "valido", "buono", "buona", "goed",
    "geldig", "bom", "boa", "giltig", "dobry",
];
/// First words of a bad code, in lower case.
const BAD: [&str; 26] = [
    "bad",
    "b",
    "uncertain",
    "questionable",
    "substituted",
    "invalid",
    "false",
    "no",
    "fault",
    "error",
    "schlecht",
    "ungültig",
    "ungueltig",
    "unsicher",
    "fehler",
    "gestört",
    "nein",
    "mauvais",
    "mauvaise",
    "malo",
    "mala",
    "cattivo",
    "slecht",
    "ongeldig",
    "ogiltig",
    "zły",
];

fn first_word(code: &str) -> &str {
    code.split(|c: char| !c.is_alphanumeric()).next().unwrap_or_default()
}

fn is_good_word(first: &str) -> bool {
    GOOD.contains(&first)
}

fn is_bad_word(first: &str) -> bool {
    BAD.contains(&first)
}

fn lower(code: &str) -> String {
    code.trim().to_lowercase()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn quality(codes: &[&str]) -> Quality {
        Quality::of(codes, &[]).expect("known")
    }

    fn good(codes: &[&str], all: &[&str]) -> Vec<bool> {
        let quality = quality(codes);
        all.iter().map(|code| quality.is_good(code).expect("known")).collect()
    }

    #[test]
    fn codes_of_opc_and_words_are_known() {
        assert_eq!(
            good(&["192", "0"], &["192", "216", "0", "64", ""]),
            [true, true, false, false, true]
        );
        assert_eq!(good(&["192.0"], &["192.0"]), [true]);
        assert_eq!(
            good(&["0", "2147483648"], &["0", "0x40920000", "2150891520"]),
            [true, false, false]
        );
        assert_eq!(
            good(&["Good", "Bad"], &["GOOD", "Good, local override", "Bad", "Uncertain"]),
            [true, true, false, false]
        );
        assert_eq!(good(&["GUT", "SCHLECHT"], &["GUT", "gut", "SCHLECHT"]), [true, true, false]);
        assert_eq!(good(&["Bad"], &["Bad"]), [false]);
        // A sensor that was off at first.
        assert_eq!(good(&["Bad", "Comm Fail"], &["Comm Fail", "Good"]), [false, true]);
        let asked = Quality::of(&["192", "192", "Bad"], &[]);
        let asked = asked.expect_err("a number among words");
        assert!(asked.contains("data.good_quality, such as [\"192\"]"), "{asked}");
        let quality = Quality::of(&["0", "1"], &[]).expect_err("unknown");
        assert!(quality.contains("data.good_quality"), "{quality}");
        let quality = Quality::of(&["0", "1"], &["0".to_owned()]).expect("given");
        assert_eq!((quality.is_good("0"), quality.is_good("1")), (Ok(true), Ok(false)));
        // Zeros alone are good in OPC UA and bad in OPC Classic: the first code that decides is rejected.
        let quality = Quality::of(&["0"], &[]).expect("zeros");
        assert!(quality.is_good("192").is_err());
    }

    #[test]
    fn zeros_are_what_they_are_in_the_other_files() {
        let mut all = [quality(&["0", "0"]), quality(&["192", "0"]), quality(&["Good"])];
        assert_eq!(Quality::agree(all.iter_mut()), Ok(()));
        assert_eq!(all, [Quality::OpcClassic, Quality::OpcClassic, Quality::Words]);
        // A file whose first codes are missing does not decide either.
        let mut empty = [quality(&["192"]), quality(&[])];
        assert_eq!(Quality::agree(empty.iter_mut()), Ok(()));
        assert_eq!(empty[1].is_good("0"), Ok(false));
        let mut alone = [quality(&["0"]), quality(&["0", "2147483648"]), quality(&[])];
        assert_eq!(Quality::agree(alone.iter_mut()), Ok(()));
        assert_eq!(alone[0].is_good("0"), Ok(true));
    }

    #[test]
    fn words_are_known_if_one_file_has_a_known_one() {
        let mut all = [quality(&["Comm Fail"]), quality(&["Good"]), quality(&["Comm Fail"])];
        assert_eq!(Quality::agree(all.iter_mut()), Ok(()));
        assert_eq!(all, [Quality::Words, Quality::Words, Quality::Words]);
        let mut unknown = [quality(&["FEL", "BRA", "BRA"]), quality(&["192"])];
        let asked = Quality::agree(unknown.iter_mut()).expect_err("no word is known");
        assert!(asked.contains("\"BRA\"") && asked.contains("data.good_quality"), "{asked}");
    }
}
