use proptest::prelude::*;

use super::*;

fn with_point(text: &str) -> Option<f64> {
    parse_number(text, Decimal::Point)
}

fn with_comma(text: &str) -> Option<f64> {
    parse_number(text, Decimal::Comma)
}

fn with_either(text: &str) -> Option<f64> {
    parse_number(text, Decimal::Unknown)
}

#[test]
fn numbers_of_both_kinds_are_read() {
    assert_eq!(with_point("-1.5e-3"), Some(-1.5e-3));
    assert_eq!(with_point("1,234.5"), Some(1234.5));
    assert_eq!(with_point("1,23.5"), None);
    assert_eq!(with_point("TRUE"), Some(1.0));
    assert_eq!(with_comma("-1,5E-3"), Some(-1.5e-3));
    assert_eq!(with_comma("1.234,5"), Some(1234.5));
    assert_eq!(with_comma("1.234"), Some(1234.0));
    assert_eq!(
        (with_comma("1.5"), with_comma("1,2,3"), with_comma("17")),
        (None, None, Some(17.0))
    );
    assert_eq!(
        (with_either("1,5"), with_either("1.5"), with_either("15")),
        (Some(1.5), Some(1.5), Some(15.0))
    );
    assert_eq!(with_either("1,234"), None, "a fraction or a thousand");
    assert_eq!(with_either("1,234,567"), Some(1_234_567.0), "two fractions there are not");
    assert_eq!((with_either("1.234.567"), with_either("1.2.3")), (Some(1_234_567.0), None));
}

fn plain_with_point(text: &str) -> Option<f64> {
    plain_decimal(text.as_bytes(), Decimal::Point)
}

#[test]
fn most_numbers_are_plain_decimals() {
    assert_eq!(plain_with_point("1532.125"), Some(1532.125));
    assert_eq!(plain_with_point("-0").map(f64::to_bits), Some((-0.0_f64).to_bits()));
    assert_eq!(plain_with_point("0.1"), Some(0.1));
    assert_eq!(plain_with_point("999999999999999"), Some(999_999_999_999_999.0));
    assert_eq!(plain_decimal(b"7,25", Decimal::Comma), Some(7.25));
    for other in ["", "-", ".5", "5.", "1,5", "1.2.3", "1e3", " 1", "+1", "1234567890123456"] {
        assert_eq!(plain_with_point(other), None, "{other}");
    }
    assert_eq!(plain_decimal(b"1.234", Decimal::Comma), None);
    assert_eq!(plain_decimal(b"1,234", Decimal::Unknown), None);
}

#[test]
fn cells_tell_the_decimal_sign() {
    let cells =
        ["1.5", "1,5", "1,234", "0,234", "1.234,5", "1,234.5", "1.234.567", "12", "Bad, off"];
    let signs = cells.map(sign_of);
    let expected = [
        Sign::Point,
        Sign::Comma,
        Sign::Either,
        Sign::Comma,
        Sign::Comma,
        Sign::Point,
        Sign::Comma,
        Sign::Nothing,
        Sign::Nothing,
    ];
    assert_eq!(signs, expected);
}

/// Returns the decimal sign of files with one cell each.
fn told(cells: &[&str]) -> Result<Decimal, String> {
    let mut signs = Signs::default();
    for (file, cell) in cells.iter().enumerate() {
        let mut later = Signs::default();
        later.note(cell, Path::new(["a.csv", "b.csv"][file % 2]));
        signs.adopt(later);
    }
    signs.decimal().map_err(|error| error.to_string())
}

#[test]
fn a_decimal_sign_that_nothing_tells_is_asked_for() {
    assert_eq!(told(&["1", "2", "off"]), Ok(Decimal::Unknown));
    let either = told(&["1,234", "2,500"]).expect_err("asked");
    assert!(either.contains("a.csv") && either.contains("1,234 is a fraction if"), "{either}");
    assert_eq!(told(&["1,234", "2,5"]), Ok(Decimal::Comma));
    assert_eq!(told(&["1,234", "2.5"]), Ok(Decimal::Point));
    assert_eq!(told(&["1,234", "2,345,678"]), Ok(Decimal::Point));
    assert_eq!(told(&["1'234,5", "2'000,125"]), Ok(Decimal::Comma));
    let files = told(&["1.210,5", "1.310"]).expect_err("a thousandth of the other");
    assert!(files.contains("it has 1.310 and a.csv has 1.210,5"), "{files}");
    let one = told(&["1,5", "7", "2.5"]).expect_err("asked");
    assert!(one.contains("it has 2.5 and 1,5: set data.decimal"), "{one}");
}

/// Returns the decimal sign of a file whose columns have these cells.
fn told_by_columns(columns: &[&[&str]], separator: u8) -> Result<Decimal, String> {
    let mut signs = Signs::default();
    for cells in columns {
        signs.note_column(cells, separator, Path::new("a.csv"));
    }
    signs.decimal().map_err(|error| error.to_string())
}

#[test]
fn points_that_may_be_of_thousands_are_asked_about() {
    let flow: &[&str] = &["1.001", "998", "12.500", "n.a.", "997"];
    let asked = told_by_columns(&[flow, &["434"]], b';').expect_err("asked");
    let told =
        "1.001 is a fraction if data.decimal = \".\" and above a thousand if data.decimal = \",\"";
    assert!(asked.contains(told), "{asked}");
    assert_eq!(told_by_columns(&[flow, &["434,5"]], b';'), Ok(Decimal::Comma));
    assert_eq!(told_by_columns(&[flow, &["434.5"]], b';'), Ok(Decimal::Point));
    assert_eq!(told_by_columns(&[flow], b','), Ok(Decimal::Point), "commas separate cells");
    for fractions in [
        ["1.001", "998.5", "998", "997"],
        ["0.123", "1.250", "120", "130"],
        ["1.001", "1.002", "12", "13"],
        ["1.00", "1.001", "998", "997"],
        ["21.503", "22.018", "100", "100"],
        ["21.503", "22.018", "-999", "999"],
    ] {
        assert_eq!(told_by_columns(&[&fractions], b';'), Ok(Decimal::Point), "{fractions:?}");
    }
    // A number with two points has no decimal point, whatever the other cells are.
    let millions: &[&str] = &["1.234.567", "1.001", "998", "997"];
    assert_eq!(told_by_columns(&[millions], b';'), Ok(Decimal::Comma));
}

#[test]
fn points_and_commas_that_may_both_be_of_thousands_are_asked_about() {
    let amount: &[&str] = &["3.611", "3.622", "3.645"];
    for separator in [b';', b'\t'] {
        let asked = told_by_columns(&[amount, &["10,710", "11,246"]], separator);
        let asked = asked.expect_err("asked");
        assert!(asked.contains("a.csv: it has 3.611 and 10,710: set data.decimal"), "{asked}");
        assert_eq!(told_by_columns(&[amount], separator), Ok(Decimal::Point));
    }
    // Where commas separate cells, those in quotes separate thousands.
    assert_eq!(told_by_columns(&[amount, &["5,284"]], b','), Ok(Decimal::Point));
    assert!(told_by_columns(&[amount, &["5,28"]], b',').is_err());
    // Other numbers of decimals, and leading zeros, settle it.
    for settled in [&["3.61", "3.622"][..], &["0.611", "3.622"]] {
        assert_eq!(told_by_columns(&[settled, &["10,710"]], b';'), Ok(Decimal::Point));
    }
    let both: &[&str] = &["3.611", "1,234.567"];
    assert_eq!(told_by_columns(&[both, &["10,710"]], b';'), Ok(Decimal::Point));
    assert!(told_by_columns(&[amount, &["10,71"]], b';').is_err(), "3.611 is above a thousand?");
    assert_eq!(told_by_columns(&[&["1.210,5"], &["10,710"]], b';'), Ok(Decimal::Comma));
}

#[test]
fn thousands_may_be_set_apart_by_spaces_and_apostrophes() {
    for (cell, value) in [
        ("2 044,722", 2044.722),
        ("-12\u{202F}044,5", -12_044.5),
        ("1\u{A0}002\u{A0}044", 1_002_044.0),
        ("2'044,7e1", 20_447.0),
        ("2\u{2019}044", 2044.0),
    ] {
        assert_eq!(with_comma(cell), Some(value), "{cell}");
    }
    assert_eq!(with_point("2'044.7"), Some(2044.7));
    assert_eq!(with_either("2 044,722"), Some(2044.722), "no comma is between thousands here");
    for word in ["20 44", "2 044 12", "2 044'722", "2024-01-01 00:00", "1 Bad", " 044", "R 200"] {
        assert_eq!((with_comma(word), with_point(word)), (None, None), "{word}");
    }
}

#[test]
fn what_is_no_number_is_a_word() {
    let mut words = Words::default();
    let cells = [" 7 ", "", "inf", "Bad"]
        .map(|text| cell_of(text, Decimal::Point, &mut words).expect("certain"));
    assert_eq!(cells, [Cell::Number(7.0), Cell::Missing, Cell::NonFinite, Cell::Word(0)]);
    assert_eq!(cell_of("1,234", Decimal::Unknown, &mut words), None);
    assert_eq!(words.word(0), "Bad");
}

proptest! {
    #[test]
    fn a_comma_changes_no_number(value in -1e6_f64..1e6) {
        let text = value.to_string();
        prop_assert_eq!(parse_number(&text, Decimal::Point), Some(value));
        prop_assert_eq!(parse_number(&text.replace('.', ","), Decimal::Comma), Some(value));
    }

    #[test]
    fn a_plain_decimal_has_the_bits_that_any_number_has(text in "-?[0-9]{0,9}[.,]?[0-9]{0,9}") {
        for decimal in [Decimal::Point, Decimal::Comma, Decimal::Unknown] {
            if let Some(value) = plain_decimal(text.as_bytes(), decimal) {
                prop_assert_eq!(parse_number(&text, decimal).map(f64::to_bits), Some(value.to_bits()));
            }
        }
    }
}
