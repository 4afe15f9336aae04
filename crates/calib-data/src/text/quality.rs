//! Quality codes of historians: which values count.

use std::collections::BTreeMap;

use crate::DataConfig;

/// Which codes are good.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Quality {
    /// Those that the study names.
    Given(Vec<String>),
    /// Words such as `Good`, and yes or no.
    Words,
    /// OPC Classic: the two highest bits of the low byte are set, 192 to 255.
    OpcClassic,
    /// OPC UA: the two highest of 32 bits are clear; 0 is good.
    OpcUa,
    /// Nothing, or nothing but 0, which is good in OPC UA and bad in OPC Classic: as OPC UA, unless another file of the log tells.
    Zeros,
}

impl Quality {
    /// Told by the study, or by the first codes of a log.
    pub(crate) fn of(codes: &[&str], data: &DataConfig) -> Result<Self, String> {
        if !data.good_quality.is_empty() {
            return Ok(Self::Given(data.good_quality.iter().map(|code| lower(code)).collect()));
        }
        let numbers: Option<Vec<u64>> = codes.iter().map(|code| number(code)).collect();
        let Some(numbers) = numbers else { return Self::of_words(codes) };
        if numbers.iter().any(|code| (192..256).contains(code)) {
            return Ok(Self::OpcClassic);
        }
        match numbers.iter().find(|&&code| code > 0 && code < UA_UNCERTAIN) {
            None if numbers.iter().all(|&code| code == 0) => Ok(Self::Zeros),
            None => Ok(Self::OpcUa),
            Some(code) => Err(unknown(&code.to_string())),
        }
    }

    /// Words of which one at least is known: that none is good would make all values missing.
    fn of_words(codes: &[&str]) -> Result<Self, String> {
        let first = |code: &str| first_word(&lower(code));
        let mut unknown: BTreeMap<&str, usize> = BTreeMap::new();
        for code in codes.iter().map(|code| code.trim()).filter(|code| !code.is_empty()) {
            if is_good_word(&first(code)) {
                return Ok(Self::Words);
            }
            if !is_bad_word(&first(code)) {
                *unknown.entry(code).or_default() += 1;
            }
        }
        match unknown.into_iter().max_by_key(|(_, count)| *count) {
            None => Ok(Self::Words),
            Some((code, _)) => Err(format!(
                "no code is known to be good; name those that are with data.good_quality, such as [{code:?}]"
            )),
        }
    }

    /// Read zeros as the other files of the log have them.
    pub(crate) fn agree<'q>(all: impl Iterator<Item = &'q mut Self>) {
        let all: Vec<&mut Self> = all.collect();
        if all.iter().any(|other| **other == Self::OpcClassic) {
            for quality in all.into_iter().filter(|other| **other == Self::Zeros) {
                *quality = Self::OpcClassic;
            }
        }
    }

    /// Whether a value with this code counts. An empty code says nothing against it.
    pub(crate) fn is_good(&self, code: &str) -> Result<bool, String> {
        let code = code.trim();
        if code.is_empty() {
            return Ok(true);
        }
        match (self, number(code)) {
            (Self::Given(good), _) => Ok(good.contains(&lower(code))),
            (Self::Words, _) => Ok(is_good_word(&first_word(&lower(code)))),
            (Self::OpcClassic, Some(code)) => Ok(code & 0xC0 == 0xC0),
            (Self::OpcUa | Self::Zeros, Some(code)) if code == 0 || code >= UA_UNCERTAIN => {
                Ok(code >> 30 == 0)
            }
            _ => Err(unknown(code)),
        }
    }
}

/// The least OPC UA code that is not good.
const UA_UNCERTAIN: u64 = 1 << 30;

fn unknown(code: &str) -> String {
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

/// Words that begin a good code, in small letters.
const GOOD: [&str; 27] = [
    "good", "g", "ok", "true", "yes", "valid", "normal", "gut", "gültig", "gueltig", "ja", "bon",
    "bonne", "valide", "oui", "bueno", "buena", "válido", "valido", "buono", "buona", "goed",
    "geldig", "bom", "boa", "giltig", "dobry",
];
/// Words that begin a bad code, in small letters.
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

fn first_word(code: &str) -> String {
    code.split(|c: char| !c.is_alphanumeric()).next().unwrap_or_default().to_owned()
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
        Quality::of(codes, &DataConfig::default()).expect("known")
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
        let asked = Quality::of(&["BRA", "BRA", "FEL", "bad"], &DataConfig::default());
        let asked = asked.expect_err("no code is good");
        assert!(asked.contains("data.good_quality, such as [\"BRA\"]"), "{asked}");
        let quality = Quality::of(&["0", "1"], &DataConfig::default()).expect_err("unknown");
        assert!(quality.contains("data.good_quality"), "{quality}");
        let given = DataConfig { good_quality: vec!["0".to_owned()], ..DataConfig::default() };
        let quality = Quality::of(&["0", "1"], &given).expect("given");
        assert_eq!((quality.is_good("0"), quality.is_good("1")), (Ok(true), Ok(false)));
        // Zeros alone are good in OPC UA and bad in OPC Classic: the first code that decides is refused.
        let quality = Quality::of(&["0"], &DataConfig::default()).expect("zeros");
        assert!(quality.is_good("192").is_err());
    }

    #[test]
    fn zeros_are_what_they_are_in_the_other_files() {
        let mut all = [quality(&["0", "0"]), quality(&["192", "0"]), quality(&["Good"])];
        Quality::agree(all.iter_mut());
        assert_eq!(all, [Quality::OpcClassic, Quality::OpcClassic, Quality::Words]);
        // Nor does a file tell whose first codes are missing.
        let mut empty = [quality(&["192"]), quality(&[])];
        Quality::agree(empty.iter_mut());
        assert_eq!(empty[1].is_good("0"), Ok(false));
        let mut alone = [quality(&["0"]), quality(&["0", "2147483648"]), quality(&[])];
        Quality::agree(alone.iter_mut());
        assert_eq!(alone[0].is_good("0"), Ok(true));
    }
}
