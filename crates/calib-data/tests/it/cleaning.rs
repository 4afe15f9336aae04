//! Tests of duplicates, steps back, gaps and missing values.

use std::fmt::Write as _;

use calib_core::Silent;
use calib_data::{
    Contradictions, DataConfig, Missing, PreprocessConfig, Resample, ShownClock, sketch,
};

use crate::support::{
    Folder, NAN, assert_refused, kept, load_with, log, log_at, profile, refused, seconds,
    segment_lengths, train_seconds, train_values,
};

fn load_keeping_the_first(folder: &Folder) -> calib_data::Dataset {
    assert_refused(&folder.data(), &["contradict each other"]);
    let data = DataConfig { contradictions: Contradictions::First, ..folder.data() };
    load_with(&data, &PreprocessConfig::default())
}

#[test]
fn repeated_rows_keep_the_first() {
    let times = [0, 1, 1, 2, 2, 3];
    let folder = Folder::of(
        "a.parquet",
        &log_at(
            times,
            &[("a", &[1.0, 2.0, 2.0, 3.0, 9.0, 4.0]), ("b", &[5.0, 6.0, NAN, 7.0, 7.0, 8.0])],
        ),
    );
    let dataset = load_keeping_the_first(&folder);
    assert_eq!(train_values(&dataset, "a"), [1.0, 2.0, 3.0, 4.0]);
    let duplicates = &dataset.profile.duplicates;
    assert_eq!((duplicates.identical, duplicates.conflicting), (1, 1));
    assert_eq!(duplicates.examples, seconds([1, 2]));
    assert_eq!(dataset.profile.backward_steps.count, 0);
}

#[test]
fn the_end_of_daylight_saving_is_merged_and_reported() {
    // The clock goes from 5 back to 3; the hour is logged again.
    let times = [0, 1, 2, 3, 4, 5, 3, 4, 5, 6, 7];
    let values: Vec<f64> = (0..11_u8).map(f64::from).collect();
    let folder = Folder::of("a.parquet", &log_at(times, &[("a", &values)]));
    let dataset = load_keeping_the_first(&folder);
    assert_eq!(train_values(&dataset, "a"), [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 9.0, 10.0]);
    let profile = &dataset.profile;
    assert_eq!((profile.duplicates.conflicting, profile.duplicates.identical), (3, 0));
    // The 6 was recorded after the second 5, not after the first one, which is kept.
    let lengths: Vec<usize> =
        dataset.train.segments().iter().map(calib_core::Segment::len).collect();
    assert_eq!(lengths, [6, 2]);
    let steps = &profile.backward_steps;
    assert_eq!(steps.count, 1);
    assert!(steps.examples[0].file.ends_with("a.parquet"));
    assert_eq!(steps.examples[0].from.micros_since(steps.examples[0].to), 2_000_000);
}

#[test]
fn overlapping_files_are_merged_by_time() {
    let folder = Folder::of("a.parquet", &log(0, &[("a", &[0.0, 1.0, 2.0, 3.0])]));
    folder.write("b.parquet", &log(2, &[("a", &[2.0, 30.0, 4.0, 5.0])]));
    let dataset = load_keeping_the_first(&folder);
    assert_eq!(train_values(&dataset, "a"), [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]);
    let profile = &dataset.profile;
    assert_eq!(profile.overlapping_files, 1);
    assert_eq!((profile.duplicates.identical, profile.duplicates.conflicting), (1, 1));
}

#[test]
fn gaps_end_segments() {
    let values: Vec<f64> = (0..7_u8).map(f64::from).collect();
    let folder = Folder::of("a.parquet", &log_at([0, 1, 2, 4, 5, 60, 61], &[("a", &values)]));
    let dataset = folder.load();
    assert_eq!(segment_lengths(&dataset), [3, 2, 2]);
    let gaps = &dataset.profile.gaps;
    assert_eq!((gaps.count, gaps.longest_secs, gaps.total_secs), (2, 55.0, 57.0));
    assert_eq!(dataset.profile.train.transitions, 4);
    let tolerant = DataConfig { gap_tolerance: 2.5, ..folder.data() };
    let dataset = load_with(&tolerant, &PreprocessConfig::default());
    assert_eq!(segment_lengths(&dataset), [5, 2]);
    let slow = DataConfig { period_secs: Some(60.0), ..folder.data() };
    let dataset = load_with(&slow, &PreprocessConfig::default());
    assert_eq!(segment_lengths(&dataset), [7]);
    assert_eq!(dataset.profile.short_steps, 5);
}

fn clock_doubts(folder: &Folder, period_secs: Option<f64>) -> Vec<String> {
    profile(&DataConfig { period_secs, ..folder.data() }).clock_doubts()
}

#[test]
fn a_clock_that_is_not_as_meant_is_doubted() {
    let start = 1_700_000_000;
    let values: Vec<f64> = (0..20).map(f64::from).collect();
    let seconds = (0..20).map(|row| start + 10 * row);
    let folder = Folder::of("a.parquet", &log_at(seconds, &[("x", &values)]));
    assert_eq!(clock_doubts(&folder, None), Vec::<String>::new());
    assert_eq!(clock_doubts(&folder, Some(10.0)), Vec::<String>::new());
    let [short] = &clock_doubts(&folder, Some(1.0))[..] else { panic!("one doubt") };
    let told = "the rows are recorded every 10 s, and data.period_secs asks for one every 1 s: \
        set data.period_secs = 10, or set data.resample to put them on the other clock";
    assert_eq!(short, told);
    let too_short = DataConfig { period_secs: Some(1.0), ..folder.data() };
    let refusal = refused(&too_short, &PreprocessConfig::default()).to_string();
    assert_eq!(refusal, told, "and nothing of missing values");
    let on_a_clock = DataConfig { resample: Some(Resample::Last), ..too_short };
    let dataset = load_with(&on_a_clock, &PreprocessConfig::default());
    assert_eq!(dataset.profile.clock_doubts(), Vec::<String>::new());
    // A step of 10 s is not a gap for 7 s, and not short for 12 s. Still all times would be wrong.
    for period in [7.0, 12.0, 60.0] {
        let [told] = &clock_doubts(&folder, Some(period))[..] else { panic!("one doubt") };
        let both = format!("every 10 s, and data.period_secs asks for one every {period} s");
        assert!(told.contains(&both), "{told}");
        assert_refused(&DataConfig { period_secs: Some(period), ..folder.data() }, &[&both]);
    }
    assert_eq!(clock_doubts(&folder, Some(9.5)), Vec::<String>::new(), "clocks drift");
    // Rows are recorded when values change: any period may be intended.
    let seconds = [0, 3, 10, 25, 31, 60, 61].map(|second| start + second);
    let uneven = Folder::of("a.parquet", &log_at(seconds, &[("x", &values[..7])]));
    let short = DataConfig { period_secs: Some(1.0), ..uneven.data() };
    assert_eq!(load_with(&short, &PreprocessConfig::default()).profile.train.transitions, 1);
    let long = DataConfig { period_secs: Some(60.0), ..uneven.data() };
    let [told] = &profile(&long).clock_doubts()[..] else { panic!("one doubt") };
    assert!(told.starts_with("6 of 6 steps in time are shorter than the sample period of 60 s"));

    let sensor = Folder::of("a.parquet", &log_at(0..20, &[("x", &values)]));
    let [early] = &sensor.inspect().clock_doubts()[..] else { panic!("one doubt") };
    assert!(early.starts_with("the log starts at 1970-01-01"), "{early}");
}

/// Returns the number of filled and unfilled values of `a`, and of dropped rows.
fn counts(dataset: &calib_data::Dataset) -> (u64, u64, u64) {
    let channel = dataset.profile.channel("a").expect("a channel");
    (channel.imputed, channel.unfilled, dataset.profile.train.dropped_rows)
}

fn filled(folder: &Folder, missing: Missing, fill_limit: usize) -> calib_data::Dataset {
    let preprocess =
        PreprocessConfig { max_missing: 0.5, missing, fill_limit, ..PreprocessConfig::default() };
    load_with(&folder.data(), &preprocess)
}

#[test]
fn missing_values_are_filled_or_split() {
    let a: Vec<f64> = (0..30_i32)
        .map(|i| if (5..8).contains(&i) || (15..20).contains(&i) { NAN } else { f64::from(i) })
        .collect();
    let b: Vec<f64> = (0..30_i32).map(|i| f64::from(i % 4)).collect();
    let folder = Folder::of("a.parquet", &log(0, &[("a", &a), ("b", &b)]));
    let dropped = filled(&folder, Missing::DropRow, 10);
    assert_eq!(segment_lengths(&dropped), [5, 7, 10]);
    assert_eq!(counts(&dropped), (0, 8, 8));
    let forward = filled(&folder, Missing::ForwardFill, 3);
    assert_eq!(segment_lengths(&forward), [18, 10]);
    assert_eq!(counts(&forward), (6, 2, 2));
    assert_eq!(train_values(&forward, "a")[4..9], [4.0, 4.0, 4.0, 4.0, 8.0]);
    let linear = filled(&folder, Missing::Linear, 3);
    assert_eq!(segment_lengths(&linear), [15, 10]);
    assert_eq!(counts(&linear), (3, 5, 5));
    assert_eq!(train_values(&linear, "a")[4..9], [4.0, 5.0, 6.0, 7.0, 8.0]);
}

#[test]
fn nothing_is_filled_across_a_gap() {
    let folder = Folder::of(
        "a.parquet",
        &log_at([0, 1, 2, 3, 50, 51, 52], &[("a", &[1.0, 2.0, 3.0, NAN, NAN, 5.0, 6.0])]),
    );
    for missing in [Missing::ForwardFill, Missing::Linear] {
        let preprocess =
            PreprocessConfig { max_missing: 0.5, missing, ..PreprocessConfig::default() };
        let dataset = load_with(&folder.data(), &preprocess);
        let expected: &[f64] = match missing {
            Missing::ForwardFill => &[0.0, 1.0, 2.0, 3.0, 51.0, 52.0],
            _ => &[0.0, 1.0, 2.0, 51.0, 52.0],
        };
        assert_eq!(train_seconds(&dataset), expected);
    }
}

#[test]
fn a_log_of_which_nothing_is_left_is_refused_with_the_channels_to_blame() {
    let a = [1.0, NAN, 2.0, NAN, 3.0, NAN];
    let b = [NAN, 1.0, NAN, 2.0, NAN, 3.0];
    let folder = Folder::of("a.parquet", &log(0, &[("a", &a), ("b", &b)]));
    let preprocess = PreprocessConfig {
        max_missing: 0.9,
        missing: Missing::DropRow,
        ..PreprocessConfig::default()
    };
    let error = refused(&folder.data(), &preprocess).to_string();
    assert_eq!(
        error,
        "data.train has no two successive rows left: 6 rows, 6 of them dropped for missing values, 0 segments. \
         a misses 3 values, b misses 3 values: leave such channels out with data.exclude, lower preprocess.max_missing, or raise preprocess.fill_limit"
    );
    let error = refused(&folder.data(), &PreprocessConfig::default()).to_string();
    assert_eq!(
        error,
        "no channel is left of 2 in the training range: 2 missing too often. `calib inspect` shows every channel; \
         data.train or data.train_fraction says which rows are for training"
    );
}

/// Inputs can cause errors in the held-out period as well as the predicted sensor.
#[test]
fn inputs_that_change_in_the_held_out_period_are_told() {
    let mut rows = String::from("time,level,height,pump\n");
    for row in 0..1_000 {
        let unit = if row < 800 { 1 } else { 1_000 };
        let pump = if row < 900 { 0 } else { 6 };
        writeln!(rows, "{},{},{},{pump}", 1_704_067_200 + row, row % 11, row % 7 * unit)
            .expect("memory");
    }
    let folder = Folder::of_text("a.csv", &rows);
    let profile = profile(&DataConfig { train_fraction: 0.8, ..folder.data() });
    let [far, late] = &profile.held_out_doubts(&["level".to_owned()])[..] else {
        panic!("two doubts: {:?}", profile.held_out_doubts(&[]))
    };
    assert!(far.contains("period: height (172 values, up to 999 widths above it). "), "{far}");
    assert!(late.contains("period: pump (100 values differ). "), "{late}");
    let predicted = profile.held_out_doubts(&["height".to_owned()]);
    assert_eq!(predicted, std::slice::from_ref(late), "it is told with its verdict");
    let both = ["level", "height"].map(str::to_owned);
    assert_eq!(profile.held_out_doubts(&both).len(), 2, "the agent of the other reads it");
    assert!(profile.has_inputs_elsewhere("level") && !profile.has_inputs_elsewhere("height"));
}

/// Whether an input counts as elsewhere that is higher by `held_out` in the held-out period.
fn is_elsewhere(held_out: f64) -> bool {
    let mut rows = String::from("time,level,height\n");
    for row in 0..1_000_i32 {
        // The training range is 6 wide. Five held-out values are 99 widths beyond it.
        let added = if row < 800 { 0.0 } else { held_out };
        let is_far = (985..990).contains(&row);
        let height = if is_far { 600.0 } else { added + f64::from(row % 7) };
        writeln!(rows, "{},{},{height}", 1_704_067_200 + row, row % 11).expect("memory");
    }
    let folder = Folder::of_text("a.csv", &rows);
    let profile = profile(&DataConfig { train_fraction: 0.8, ..folder.data() });
    profile.has_inputs_elsewhere("level")
}

#[test]
fn a_few_values_far_away_do_not_put_an_input_elsewhere() {
    assert!(!is_elsewhere(30.0), "all others are 5 widths away");
    assert!(is_elsewhere(300.0));
}

/// A unit that changes inside the training range spoils all that is learned from it.
#[test]
fn a_unit_that_changes_in_the_training_range_is_told() {
    let mut rows = String::from("time,level,height\n");
    for row in 0..1_000 {
        let unit = if row < 400 { 1 } else { 100 };
        writeln!(rows, "{},{},{}", 1_704_067_200 + row, row % 11, (10 + row % 7) * unit)
            .expect("memory");
    }
    let folder = Folder::of_text("a.csv", &rows);
    let profile = profile(&folder.data());
    let doubts = profile.value_doubts(&ShownClock::default());
    let [(name, doubt)] = &doubts[..] else { panic!("one doubt: {doubts:?}") };
    assert_eq!(*name, "height");
    let told = "two ranges that do not overlap, mostly 10 to 16 before 2024-01-01 00:06:40 and 1,000 to 1,600 from then on";
    assert!(doubt.starts_with(told), "{doubt}");
    let data = DataConfig { time_zone: Some("Europe/Berlin".to_owned()), ..folder.data() };
    let clock = ShownClock::of(&data, true);
    let [of_inputs] = &profile.unit_doubts(&["level".to_owned()], &clock)[..] else {
        panic!("one doubt")
    };
    assert!(of_inputs.starts_with("height has two ranges"), "{of_inputs}");
    assert!(of_inputs.contains("2024-01-01 01:06:40 (Europe/Berlin) and"), "{of_inputs}");
    assert_eq!(profile.unit_doubts(&["height".to_owned()], &clock), Vec::<String>::new());
    let sketched = sketch(&data, &Silent).expect("a log").unit_doubts();
    assert_eq!(sketched, std::slice::from_ref(of_inputs));
}

/// A channel without values in the whole held-out period leaves no row of it.
#[test]
fn a_held_out_period_without_a_row_is_told_with_the_channel_to_blame() {
    let mut rows = String::from("time,flow,level\n");
    for row in 0..1_000 {
        let flow = if row < 800 { (row % 7).to_string() } else { String::new() };
        writeln!(rows, "{},{flow},{}", 1_704_067_200 + row, row % 11).expect("memory");
    }
    let folder = Folder::of_text("a.csv", &rows);
    let held_out = profile(&DataConfig { train_fraction: 0.8, ..folder.data() });
    let told = held_out.nothing_to_score().expect("a doubt");
    assert!(
        told.contains("(200 rows, 200 of them dropped for missing values). flow misses 200 "),
        "{told}"
    );
    assert_eq!(
        profile(&DataConfig { train_fraction: 0.7, ..folder.data() }).nothing_to_score(),
        None
    );
    assert_eq!(folder.inspect().nothing_to_score(), None);
}

/// 2024-01-01 in seconds. A log that begins in 1970 is doubted.
const START: i64 = 1_704_067_200;

#[test]
fn files_of_two_periods_are_told_to_go_on_one_clock() {
    let folder = Folder::new();
    let slow: Vec<f64> = (0..60).map(|row| f64::from(row % 7)).collect();
    let fast: Vec<f64> = (0..600).map(|row| f64::from(row % 11)).collect();
    folder.write("a.parquet", &log(START, &[("level", &fast), ("power", &fast)]));
    let times = (0..60).map(|row| START + 10 * row);
    folder.write("b.parquet", &log_at(times, &[("flow", &slow)]));
    let found = folder.inspect();
    assert_eq!(kept(&found), ["level", "power"]);
    let told = found.clock_doubts().join("\n");
    assert!(
        told.contains("flow has no value in most rows") && told.contains("data.resample"),
        "{told}"
    );
    // One file may have a sensor that was rarely on.
    let mut gappy = fast.clone();
    gappy[100..].fill(f64::NAN);
    let one = Folder::of("a.parquet", &log(START, &[("level", &fast), ("flow", &gappy)]));
    assert_eq!(one.inspect().clock_doubts(), Vec::<String>::new());
    // Files of one logger follow each other, and a sensor was installed late.
    let days = Folder::of("a.parquet", &log(START, &[("level", &fast)]));
    days.write("b.parquet", &log(START + 600, &[("level", &fast), ("flow", &fast)]));
    days.write("c.parquet", &log(START + 1_200, &[("level", &fast)]));
    assert_eq!(days.inspect().clock_doubts(), Vec::<String>::new());
    // They may share the row at midnight.
    let later: Vec<f64> = (599..1_200).map(|row| f64::from(row % 11)).collect();
    days.write("c.parquet", &log(START + 1_199, &[("level", &later)]));
    let shared = days.inspect();
    assert_eq!((shared.overlapping_files, shared.clock_doubts()), (1, Vec::new()));
    let [of_days, of_folder] = [&days, &folder]
        .map(|folder| sketch(&folder.data(), &Silent).expect("a log").seldom_doubt());
    assert_eq!(of_days, None);
    assert!(of_folder.is_some_and(|told| told.contains("flow has no value in most rows")));
}

/// Returns a log with a row for each minute of some hours of a day.
fn minutes_of(day: &str, hours: &[u32]) -> String {
    let each = hours.iter().flat_map(|hour| (0..60).map(move |minute| (hour, minute)));
    let rows = each
        .enumerate()
        .map(|(row, (hour, minute))| format!("{day} {hour:02}:{minute:02}:00,{row}\n"));
    format!("time,a\n{}", rows.collect::<String>())
}

#[test]
fn changes_of_european_clocks_are_named() {
    let autumn = Folder::of_text("a.csv", &minutes_of("2024-10-27", &[0, 1, 2, 2, 3]));
    assert_refused(
        &autumn.data(),
        &["The hour from 02:00 on 2024-10-27 comes twice", "Europe/Berlin"],
    );
    let zone = Some("Europe/Berlin".to_owned());
    let data = DataConfig { time_zone: zone.clone(), ..autumn.data() };
    assert_eq!(profile(&data).gaps.count, 0);
    let other = Folder::of_text("a.csv", &minutes_of("2024-10-20", &[0, 1, 2, 2, 3]));
    assert_refused(&other.data(), &["If a clock was set back"]);
    let spring = Folder::of_text("a.csv", &minutes_of("2024-03-31", &[0, 1, 3, 4]));
    let told = spring.inspect().clock_doubts().join("\n");
    assert!(told.contains("the hour from 02:00 on 2024-03-31 is missing"), "{told}");
    let data = DataConfig { time_zone: zone, ..spring.data() };
    assert_eq!(profile(&data).clock_doubts(), Vec::<String>::new());
}

#[test]
fn names_that_differ_in_capital_letters_are_told() {
    let values: Vec<f64> = (0..20).map(f64::from).collect();
    let folder = Folder::of("a.parquet", &log(START, &[("FT101", &values)]));
    folder.write("b.parquet", &log(START + 20, &[("ft101", &values)]));
    let told = folder.inspect().clock_doubts().join("\n");
    assert!(told.contains("differ only in capital letters: \"FT101\" and \"ft101\"."), "{told}");
    let one = DataConfig { exclude: vec!["ft101".to_owned()], ..folder.data() };
    assert_eq!(profile(&one).clock_doubts(), Vec::<String>::new());
    let mut long = String::from("time,tag,value\n");
    for second in 0..20 {
        let time = format!("2024-03-01 00:00:{second:02}");
        writeln!(long, "{time},FT101,{second}\n{time},ft101,{}", second % 7).expect("memory");
    }
    let long = Folder::of_text("a.csv", &long);
    assert_eq!(long.inspect().clock_doubts(), Vec::<String>::new());
    let both = Folder::of("a.parquet", &log(START, &[("FT101", &values), ("ft101", &values)]));
    assert_eq!(both.inspect().clock_doubts(), Vec::<String>::new());
}
