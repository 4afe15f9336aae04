//! Numbers formatted for readers, alike on the terminal, in messages and in reports.

/// Formats `value` with three significant digits: `0.0123`, `1.5`, `28,800`, `3.16e-4`; `diverged` if it is not finite.
pub fn number(value: f64) -> String {
    significant(value, 1e-3)
}

/// Formats two values as [`number`] does. If both texts would be the same, the values get as many more digits as tell
/// them apart: `500.4` and `500`.
pub fn numbers_apart(values: [f64; 2]) -> [String; 2] {
    let texts =
        (4..=MOST_DIGITS).map(|digits| values.map(|value| rounded(value, digits).to_string()));
    let mut texts = std::iter::once(values.map(number)).chain(texts);
    texts.find(|[one, other]| one != other).unwrap_or_else(|| values.map(number))
}

/// Number of significant digits that tells all values of double precision apart.
const MOST_DIGITS: usize = 17;

/// Formats a hyperparameter value as it is typed: `1e-4`, `0.05`, `256`, `3.16e-4`.
///
/// Powers of ten below 0.01 have an exponent, and whole numbers up to a million are written in full.
pub fn setting(value: f64) -> String {
    if value.fract() == 0.0 && value.abs() < 1e6 {
        return format!("{value:.0}");
    }
    significant(value, 1e-2)
}

/// Multiples above this limit are not given as a number.
const MANY_TIMES: f64 = 1_000.0;

/// Formats a share as a percentage: `3.1 %`, `24 %`, `<0.1 %`, `180 times`, `more
/// than 1,000 times`; `diverged` if it is not finite.
pub fn percent(share: f64) -> String {
    let percent = share * 100.0;
    match percent.abs() {
        size if !size.is_finite() => "diverged".to_owned(),
        0.0 => "0 %".to_owned(),
        size if size < 0.1 => "<0.1 %".to_owned(),
        size if size < 9.95 => format!("{} %", trimmed(format!("{percent:.1}"))),
        size if size < 1e4 => format!("{percent:.0} %"),
        _ => format!("{} times", factor(share)),
    }
}

/// Formats a ratio: `55`, `more than 1,000`; `diverged` if it is not finite.
pub fn factor(ratio: f64) -> String {
    if is_many_times(ratio) { format!("more than {}", number(MANY_TIMES)) } else { number(ratio) }
}

/// Whether a share is above the largest multiple that [`factor`] gives as a number.
pub fn is_many_times(share: f64) -> bool {
    share > MANY_TIMES && share.is_finite()
}

/// Formats a count with thousands separators: `30,000`.
pub fn count(value: u64) -> String {
    let digits = value.to_string();
    let mut out = String::with_capacity(digits.len() + digits.len() / 3);
    for (place, digit) in digits.chars().enumerate() {
        if place > 0 && (digits.len() - place).is_multiple_of(3) {
            out.push(',');
        }
        out.push(digit);
    }
    out
}

/// Rounds `value` to a whole number with thousands separators.
pub fn whole(value: f64) -> String {
    let whole = count(value.abs().round() as u64);
    if value < 0.0 { format!("-{whole}") } else { whole }
}

/// Formats a recorded value with all digits that it needs. If single precision holds it, as in most logs, these are the
/// digits of single precision: `0.28`, and not `0.2800000011920929`.
pub fn exact(value: f64) -> String {
    let single = value as f32;
    if f64::from(single) == value { single.to_string() } else { value.to_string() }
}

/// Rounds `value` to `digits` significant digits, at least one.
pub fn rounded(value: f64, digits: usize) -> f64 {
    format!("{value:.*e}", digits - 1).parse().unwrap_or(value)
}

fn significant(value: f64, smallest_plain: f64) -> String {
    if !value.is_finite() {
        return "diverged".to_owned();
    }
    if value == 0.0 {
        return "0".to_owned();
    }
    // Rounding comes first, so that 9.999e-4 counts as the 1e-3 that is shown.
    let scientific = format!("{value:.2e}");
    let (mantissa, exponent) = scientific.split_once('e').unwrap_or((&scientific, "0"));
    let exponent: i32 = exponent.parse().unwrap_or(0);
    let power = 10f64.powi(exponent);
    if power < smallest_plain * 0.999 || exponent >= 6 {
        return format!("{}e{exponent}", trimmed(mantissa.to_owned()));
    }
    if exponent >= 3 {
        return whole(value);
    }
    let decimals = (2 - exponent).max(0) as usize;
    trimmed(format!("{value:.decimals$}"))
}

fn trimmed(text: String) -> String {
    if text.contains('.') {
        text.trim_end_matches('0').trim_end_matches('.').to_owned()
    } else {
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn three_significant_digits() {
        let cases = [
            (0.0, "0"),
            (0.012_345, "0.0123"),
            (0.1, "0.1"),
            (1.0, "1"),
            (12.345, "12.3"),
            (-123.45, "-123"),
            (999.6, "1,000"),
            (28_800.0, "28,800"),
            (-28_800.4, "-28,800"),
            (1.234e7, "1.23e7"),
            (1e-4, "1e-4"),
            (3.162_277e-4, "3.16e-4"),
            (9.999e-4, "0.001"),
            (f64::INFINITY, "diverged"),
            (f64::NAN, "diverged"),
        ];
        for (value, expected) in cases {
            assert_eq!(number(value), expected, "{value}");
        }
    }

    #[test]
    fn numbers_that_differ_look_different() {
        assert_eq!(numbers_apart([7.0, 500.0]), ["7", "500"]);
        assert_eq!(numbers_apart([500.4, 500.0]), ["500.4", "500"]);
        assert_eq!(numbers_apart([28_800.04, 28_800.0]), ["28800.04", "28800"]);
        assert_eq!(numbers_apart([-1.2342e-4, -1.2344e-4]), ["-0.00012342", "-0.00012344"]);
        assert_eq!(numbers_apart([2.0, 2.0]), ["2", "2"]);
        let next = f64::from_bits(0.1_f64.to_bits() + 1);
        let [one, other] = numbers_apart([next, 0.1]);
        assert_ne!(one, other);
    }

    #[test]
    fn settings_look_as_they_are_typed() {
        let cases = [
            (1e-3, "1e-3"),
            (1e-5, "1e-5"),
            (0.05, "0.05"),
            (0.01, "0.01"),
            (0.1, "0.1"),
            (1.0, "1"),
            (256.0, "256"),
            (65_536.0, "65536"),
            (0.99, "0.99"),
            (0.003, "3e-3"),
        ];
        for (value, expected) in cases {
            assert_eq!(setting(value), expected, "{value}");
        }
    }

    #[test]
    fn shares_as_percentages() {
        let cases = [
            (0.0, "0 %"),
            (0.0004, "<0.1 %"),
            (0.031, "3.1 %"),
            (0.02, "2 %"),
            (0.0999, "10 %"),
            (0.24, "24 %"),
            (-0.05, "-5 %"),
            (18.0, "1800 %"),
            (180.0, "180 times"),
            (2.71e19, "more than 1,000 times"),
            (f64::INFINITY, "diverged"),
        ];
        for (share, expected) in cases {
            assert_eq!(percent(share), expected, "{share}");
        }
    }

    #[test]
    fn counts_have_separators_and_recorded_values_their_digits() {
        assert_eq!([7, 1_000, 1_234_567].map(count), ["7", "1,000", "1,234,567"]);
        assert_eq!([f64::from(0.28_f32), 0.28, 2.0].map(exact), ["0.28", "0.28", "2"]);
        assert_eq!((rounded(0.253, 1), rounded(2_600.0, 1)), (0.3, 3000.0));
    }
}
