use super::*;

fn notation(cells: &[&str]) -> Vec<String> {
    Candidates::of(cells, None).left.iter().map(Notation::name).collect()
}

fn unreadable(candidates: &Candidates) -> &str {
    assert!(candidates.left.is_empty());
    match &candidates.unreadable {
        Some(Unreadable::Cell(cell)) => cell,
        other => panic!("{other:?}"),
    }
}

fn reading(pattern: &str, text: &str) -> Option<String> {
    let stamp = Notation::Pattern(pattern.to_owned()).read(text)?;
    let (ParsedTime::Instant(micros) | ParsedTime::Wall(micros)) = stamp;
    Some(format_time(calib_core::Timestamp::from_micros(micros)))
}

#[test]
fn times_that_name_utc_are_instants() {
    for cell in ["2024-03-01 06:00:00 UTC", "01-Mar-24 06:00 GMT", "2024/03/01 06:00:00 Z"] {
        let candidates = Candidates::of(&[cell], None);
        let [one] = &candidates.left[..] else { panic!("{cell}: {:?}", candidates.left) };
        assert!(
            matches!(one.read(cell), Some(ParsedTime::Instant(1_709_272_800_000_000))),
            "{cell}"
        );
    }
    let wall = Notation::Pattern("%d.%m.%Y %H:%M".to_owned()).read("01.03.2024 06:00");
    assert!(matches!(wall, Some(ParsedTime::Wall(1_709_272_800_000_000))));
}

#[test]
fn notations_are_told_by_their_cells() {
    assert_eq!(notation(&["2024-03-01 06:00", "2024-03-01T06:01:00.5Z"]), ["ISO 8601"]);
    assert_eq!(notation(&["1709272800", "1709272860"]), ["numbers of seconds"]);
    assert_eq!(notation(&["1709272800000"]), ["numbers of milliseconds"]);
    assert_eq!(notation(&["01-Mar-24 06:00:00.500"]), ["%d-%b-%y %H:%M:%S%.f"]);
    assert_eq!(notation(&["2024/03/01 06:00"]), ["%Y/%m/%d %H:%M"]);
    assert_eq!(notation(&["3/13/2024 6:00:00 PM"]), ["%m/%d/%Y %I:%M:%S%.f %p"]);
    assert_eq!(notation(&["13.03.2024 06:00:00,25"]), ["%d.%m.%Y %H:%M:%S%.f"]);
    assert_eq!(notation(&["March 1, 2024 06:00:00"]), ["%B %d, %Y %H:%M:%S%.f"]);
    assert_eq!(notation(&["20240301 06:00:00"]), ["ISO 8601"], "its basic form");
    assert_eq!(notation(&["20240301", "20240302"]), ["%Y%m%d"]);
    assert_eq!(notation(&["202403010600"]), ["%Y%m%d%H%M"]);
    assert_eq!(notation(&["20240301060000", "20240301235959"]), ["%Y%m%d%H%M%S"]);
    assert_eq!(notation(&["2024030106", "2024030107"]), ["%Y%m%d%H"]);
    assert_eq!(notation(&["20240301060000.5", "20240301060001"]), ["%Y%m%d%H%M%S%.f"]);
    assert_eq!(notation(&["20240301060000", "20240301060000,25"]), ["%Y%m%d%H%M%S%.f"]);
    assert_eq!(notation(&["20240301060000123"]), ["%Y%m%d%H%M%S%f"]);
    assert_eq!(notation(&["20240301", "20240332"]), ["numbers of seconds"], "no such day");
    assert_eq!(notation(&["20240301", "99991231", "20240303"]), ["%Y%m%d"]);
    let one_is_none = Candidates::of(&["0", "20240301", "20240302", "20240303"], None);
    assert_eq!(unreadable(&one_is_none), "0");
    let unit = Some(TimestampUnit::Seconds);
    let told = Candidates::of(&["20240301"], unit).left;
    assert_eq!(told, [Notation::Number(TimestampUnit::Seconds)], "as the study says");
    assert_eq!(notation(&["2024-03-01 06:00:00 UTC"]), ["%Y-%m-%d %H:%M:%S%.f UTC"]);
    assert_eq!(notation(&["01.03.2024", "13.03.2024"]), ["%d.%m.%Y"]);
    assert!(notation(&["yesterday"]).is_empty());
    assert_eq!(unreadable(&Candidates::of(&["yesterday"], None)), "yesterday");
}

#[test]
fn a_day_that_may_be_a_month_has_two_readings() {
    let mut candidates = Candidates::of(&["03/04/2024 10:00", "04/04/2024 10:00"], None);
    assert!(candidates.is_ambiguous());
    let readings = candidates.readings();
    assert!(
        readings.contains("2024-04-03 10:00:00 with data.timestamp_format = \"%d/%m/%Y %H:%M\"")
    );
    assert!(
        readings.contains("2024-03-04 10:00:00 with data.timestamp_format = \"%m/%d/%Y %H:%M\"")
    );
    candidates.note("13/04/2024 10:00");
    assert_eq!(candidates.left, [Notation::Pattern("%d/%m/%Y %H:%M".to_owned())]);
    candidates.note("04/13/2024 10:00");
    assert_eq!(unreadable(&candidates), "04/13/2024 10:00");
    let same = Candidates::of(&["01/01/2024 10:00", "02/01/2024 10:00"], None);
    assert_eq!(same.example, "02/01/2024 10:00", "the first that shows a difference");
    assert_eq!(notation(&["01/02/03"]).len(), 3, "the year may be anywhere");
}

#[track_caller]
fn assert_read(pattern: &str, text: &str, expected: &str) {
    assert_eq!(reading(pattern, text).as_deref(), Some(expected), "{pattern} {text}");
}

#[test]
fn patterns_are_read() {
    assert_read("%d-%b-%y %H:%M:%S%.f", "01-MAR-24 06:00:00.5", "2024-03-01 06:00:00.5");
    assert_read("%d.%m.%Y %H:%M:%S%.f", "13.03.2024 06:00:00,25", "2024-03-13 06:00:00.25");
    assert_read("%m/%d/%Y %I:%M:%S%.f %p", "3/13/2024 12:00:01 AM", "2024-03-13 00:00:01");
    assert_read("%d/%m/%Y %H:%M %z", "13/03/2024 06:00 +0200", "2024-03-13 04:00:00");
    assert_read("%d.%m.%Y", "13.03.2024", "2024-03-13 00:00:00");
    assert_read("%Y%m%d%H%M%S", "20240313060001", "2024-03-13 06:00:01");
    assert_read("%Y%m%d%H", "2024031306", "2024-03-13 06:00:00");
    assert_read("%Y%m%d%H%M%S%f", "20240313060001250", "2024-03-13 06:00:01.25");
    assert_read("%Y%m%d%H%M%S%.f", "20240313060001,25", "2024-03-13 06:00:01.25");
    assert_eq!(reading("%d.%m.%Y", "03/04/2024"), None);
    let number = Notation::Number(TimestampUnit::Nanoseconds).read("1709272800000000123");
    assert_eq!(number, Some(ParsedTime::Instant(1_709_272_800_000_000)));
}

#[test]
fn midnight_may_lack_its_clock_or_end_the_day_before() {
    assert_read("%d.%m.%Y %H:%M", "11.03.2024", "2024-03-11 00:00:00");
    assert_read("%m/%d/%Y %I:%M:%S%.f %p", "3/11/2024", "2024-03-11 00:00:00");
    assert_read("%d.%m.%Y %H:%M", "31.12.2023 24:00", "2024-01-01 00:00:00");
    let end = Notation::Iso.read("2024-02-28 24:00:00");
    assert_eq!(end, Some(ParsedTime::Wall(1_709_164_800_000_000)), "the 29th");
    assert_eq!(reading("%d.%m.%Y %H:%M", "31.12.2023 24:01"), None);
    assert_eq!(reading("%d/%m/%Y %H:%M %z", "13/03/2024"), None, "of which zone");
    assert_eq!(reading("%Y%m%d%H%M", "20240311"), None, "a number that is cut");
    let cells = ["10.03.2024 23:00", "11.03.2024", "11.03.2024 01:00", "13.03.2024 24:00"];
    assert_eq!(notation(&cells), ["%d.%m.%Y %H:%M"]);
}

#[test]
fn text_of_any_language_may_stand_before_a_colon() {
    for cell in ["Durchfluß: P", "温度: °C", "ß:", "é1:00", "1\u{a0}:", "\u{301}:1"] {
        assert!(Candidates::of(&[cell], None).left.is_empty(), "{cell}");
        assert!(!is_time_of_day(cell), "{cell}");
    }
    let spaces = ["01.03.2024\u{a0}06:00", "13.03.2024\u{a0}07:00"];
    let found = Candidates::of(&spaces, None).left;
    assert_eq!(found.len(), 1, "{found:?}");
    assert_eq!(found[0].read(spaces[0]), Some(ParsedTime::Wall(1_709_272_800_000_000)));
}

#[test]
fn the_year_9999_is_a_time_that_is_none() {
    for never in
        ["9999-12-31 23:59:59", "9999-12-31T23:59:59Z", "9999-12-31", "9999-12-31T00:00:00+01:00"]
    {
        assert_eq!(Notation::Iso.read(never), Some(NEVER), "{never}");
    }
    assert_eq!(notation(&["2024-03-01", "9999-12-31"]), ["ISO 8601"]);
    assert_eq!(notation(&["13.03.2024", "31.12.9999"]), ["%d.%m.%Y"]);
    let wall = Notation::Pattern("%d.%m.%Y %H:%M".to_owned());
    assert_eq!(wall.read("31.12.9999 23:59"), Some(NEVER));
    let with_offset = Notation::Pattern("%d.%m.%Y %H:%M %z".to_owned());
    assert_eq!(with_offset.read("31.12.9999 23:59 +0000"), Some(NEVER));
    assert_eq!(Notation::Iso.read("10000-01-01"), None);
}

#[test]
fn days_of_a_spreadsheet_are_asked_for_and_read_when_told() {
    for cells in [["45292.5", "45292.75"], ["45292,5", "45292,75"]] {
        let found = Candidates::of(&cells, None);
        assert!(found.is_ambiguous());
        assert!(found.readings().contains("2024-01-01 12:00:00"), "{}", found.readings());
        let told = Candidates::of(&cells, Some(TimestampUnit::Excel)).left;
        let noon = ParsedTime::Wall(1_704_110_400_000_000);
        assert_eq!(told[0].read(cells[0]), Some(noon), "on the clock of the log");
    }
    let excel = Notation::Number(TimestampUnit::Excel);
    let rounded = excel.read("45292.0006944444");
    assert_eq!(rounded, Some(ParsedTime::Wall(1_704_067_260_000_000)), "a minute");
}

/// Returns the notation chosen for `cells`, each of another day, and what is told of it.
fn likely(cells: &[&str]) -> Option<[String; 2]> {
    let days: Vec<String> = cells.iter().map(|&cell| cell.to_owned()).collect();
    let likely = Candidates::of(cells, None).likely(cells, &days)?;
    Some([likely.notation.name(), likely.told])
}

#[test]
fn dates_with_points_and_two_digits_of_the_year_follow_each_other() {
    for cells in [["11.03.24", "12.03.24", "13.03.24"], ["01.03.24", "02.03.24", "03.03.24"]] {
        let [name, told] = likely(&cells).expect("day first");
        assert_eq!(name, "%d.%m.%y");
        assert!(told.contains("are read as day, month, year"), "{told}");
    }
    for cells in [["10.01.04", "10.01.05", "10.01.06"], ["24.03.16", "24.03.15", "24.03.14"]] {
        let [name, told] = likely(&cells).expect("year first");
        assert_eq!(name, "%y.%m.%d");
        let other = "year, month, day: set data.timestamp_format = \"%d.%m.%y\" if the day";
        assert!(told.contains(other), "{told}");
    }
    // One day, and one day of each month, have the same steps in both orders.
    assert_eq!(likely(&["24.03.16", "24.03.16"]), None);
    assert_eq!(likely(&["15.01.24", "15.02.24", "15.03.24"]), None);
}
