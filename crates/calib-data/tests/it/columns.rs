//! Tests of the columns of the states and their values.

use std::fmt::Write as _;

use calib_core::{Bounds, ColumnKind, Silent};
use calib_data::{
    Contradictions, DataConfig, Dataset, DropReason, Normalisation, PreprocessConfig, Reduce,
    inspect, table::Table,
};

use crate::support::{
    Folder, NAN, assert_refused, assert_refused_with, kept, load_with, log, log_at, one_hot,
    seconds, segment_lengths, train_seconds, train_values, values_of_contradicting,
};

fn rising(rows: u8) -> Vec<f64> {
    (0..rows).map(f64::from).collect()
}

#[test]
fn every_dropped_channel_has_its_reason() {
    let mut gappy = rising(10);
    gappy[3..6].fill(NAN);
    let channels: [(&str, &[f64]); 6] = [
        ("FIT1", &rising(10)),
        ("FIT2", &rising(10)),
        ("constant", &[2.0; 10]),
        ("dead", &[NAN; 10]),
        ("gappy", &gappy),
        ("other", &rising(10)),
    ];
    let folder = Folder::of("a.parquet", &log(0, &channels));
    let data = DataConfig {
        include: ["FIT*", "constant", "dead", "gappy"].map(str::to_owned).to_vec(),
        exclude: ["*2", "nothing"].map(str::to_owned).to_vec(),
        ..folder.data()
    };
    let dataset = load_with(&data, &PreprocessConfig::default());
    let profile = &dataset.profile;
    for (name, reason) in [
        ("FIT1", None),
        ("FIT2", Some(DropReason::Excluded { pattern: "*2".to_owned() })),
        ("constant", Some(DropReason::Constant { value: 2.0, word: None })),
        ("dead", Some(DropReason::AllMissing)),
        ("other", Some(DropReason::NotIncluded)),
    ] {
        assert_eq!(profile.channel(name).expect("a channel").dropped, reason, "{name}");
    }
    let gappy = &profile.channel("gappy").expect("a channel").dropped;
    assert!(matches!(gappy, Some(DropReason::Missing { limit: 0.1, .. })));
    assert_eq!(profile.unused_excludes, ["nothing"]);
    assert_eq!(profile.kept().count(), 1);
    assert_eq!((profile.columns, profile.state_bytes), (1, 40));

    profile.require_sensor("FIT1").expect("kept");
    let error = profile.require_sensor("constant").expect_err("dropped").to_string();
    assert_eq!(
        error,
        "sensor \"constant\" is needed but was dropped: constant at 2 in the training range; `calib inspect` shows every sensor: choose another, or other data"
    );
    let error = profile.require_sensor("FIT3").expect_err("unknown").to_string();
    assert!(
        error.starts_with("sensor \"FIT3\" is not a channel of the log; did you mean FIT1"),
        "{error}"
    );

    let misspelt = DataConfig { include: vec!["FTI1".to_owned()], ..folder.data() };
    assert_refused(&misspelt, &["\"FTI1\", which names no channel"]);
}

#[test]
fn selection_and_bounds_come_from_the_training_range() {
    let mut late = vec![1.0; 8];
    late.extend([5.0, 6.0]);
    let mut spike = rising(8);
    spike.extend([100.0, -100.0]);
    let folder = Folder::of("a.parquet", &log(0, &[("late", &late), ("spike", &spike)]));
    let data = DataConfig { train_fraction: 0.8, ..folder.data() };
    let dataset = load_with(&data, &PreprocessConfig::default());
    let late = dataset.profile.channel("late").expect("a channel");
    assert_eq!(late.dropped, Some(DropReason::Constant { value: 1.0, word: None }));
    assert!(!late.values.as_ref().expect("values").constant);
    let column = &dataset.normaliser.columns()[0];
    assert_eq!(column.bounds, Bounds { offset: 0.0, scale: 7.0 });
    let held_out = dataset.held_out.as_ref().expect("a held-out range");
    assert!(held_out.states().as_slice()[0] > 10.0, "values outside the bounds stay outside");
    let clipped = PreprocessConfig { clip: true, ..PreprocessConfig::default() };
    let dataset = load_with(&data, &clipped);
    let held_out = dataset.held_out.as_ref().expect("a held-out range");
    assert_eq!(held_out.states().as_slice(), [1.0, 0.0]);
}

#[test]
fn normalisation_has_three_forms() {
    let folder = Folder::of("a.parquet", &log(0, &[("a", &rising(11))]));
    let min_max = Bounds { offset: 0.0, scale: 10.0 };
    let inner = Bounds { offset: 1.0, scale: 8.0 };
    let standard = Bounds { offset: 5.0, scale: 10.0_f64.sqrt() };
    for (normalise, quantiles, expected) in [
        (Normalisation::MinMax, [0.0, 1.0], min_max),
        (Normalisation::Quantile, [0.0, 1.0], min_max),
        (Normalisation::Quantile, [0.1, 0.9], inner),
        (Normalisation::Standard, [0.0, 1.0], standard),
    ] {
        let preprocess = PreprocessConfig { normalise, quantiles, ..PreprocessConfig::default() };
        let dataset = load_with(&folder.data(), &preprocess);
        let bounds = dataset.normaliser.columns()[0].bounds;
        assert_eq!(bounds, expected, "{normalise:?} {quantiles:?}");
    }
}

#[test]
fn stuck_and_quantised_channels_show() {
    let a = [0.0, 0.25, 0.25, 0.25, 0.25, 0.5, 0.25, 0.0, 0.5, 0.5];
    let folder = Folder::of("a.parquet", &log_at([0, 1, 2, 3, 4, 5, 6, 7, 50, 51], &[("a", &a)]));
    let profile = folder.inspect();
    let values = profile.channel("a").expect("a channel").values.clone().expect("values");
    assert_eq!(values.longest_stuck_secs, 3.0);
    assert_eq!(values.smallest_change, Some(0.25));
    assert_eq!(values.distinct, Some(3));
    assert_eq!(values.unchanged, 0.5);
    assert!((values.mean - 0.275).abs() < 1e-12 && !values.constant);
}

#[test]
fn features_follow_the_sensors() {
    let table = log_at([0, 1, 2, 60, 61, 62], &[("a", &[0.0, 4.0, 4.0, 2.0, 4.0, 4.0])])
        .with("mode", vec![13_i64, 31, 13, 13, 4, 13]);
    let folder = Folder::of("a.parquet", &table);
    let preprocess = PreprocessConfig {
        traces: vec![0.5],
        time_of_day: true,
        one_hot: Some("mode".to_owned()),
        ..PreprocessConfig::default()
    };
    let dataset = load_with(&folder.data(), &preprocess);
    let names: Vec<&str> =
        dataset.normaliser.columns().iter().map(|column| column.name.as_str()).collect();
    let expected =
        ["a", "trace(0.5) a", "time_of_day_sin", "time_of_day_cos", "mode=4", "mode=13", "mode=31"];
    assert_eq!(names, expected);
    assert_eq!(dataset.profile.columns, 7);
    assert_eq!(dataset.normaliser.columns()[1].kind, ColumnKind::Feature);
    assert_eq!(train_values(&dataset, "trace(0.5) a"), [0.0, 2.0, 3.0, 2.0, 3.0, 3.5]);
    assert_eq!(train_values(&dataset, "mode=13"), [1.0, 0.0, 1.0, 1.0, 0.0, 1.0]);
    assert_eq!(train_values(&dataset, "mode=4"), [0.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
    assert!(train_values(&dataset, "time_of_day_cos").iter().all(|&cos| cos > 0.99));
    let mode = dataset.profile.channel("mode").expect("a channel");
    let columns = ["mode=4", "mode=13", "mode=31"].map(str::to_owned).to_vec();
    assert_eq!(mode.dropped, Some(DropReason::OneHot { columns }));
}

#[test]
fn modes_may_be_text_missing_or_new() {
    let modes = ["run", "run", "", "stop", "run", "stop", "run", "run", "clean", "clean"];
    let table = Table::new()
        .with("timestamp", seconds(0..10))
        .with("a", rising(10))
        .with("mode", modes.map(str::to_owned).to_vec());
    let folder = Folder::of("a.parquet", &table);
    let preprocess = one_hot("mode");
    let data = DataConfig { train_fraction: 0.8, ..folder.data() };
    let dataset = load_with(&data, &preprocess);
    assert_eq!(train_values(&dataset, "mode=run"), [1.0, 1.0, 1.0, 0.0, 1.0, 0.0, 1.0, 1.0]);
    assert_eq!(dataset.profile.unseen_modes, 2);
    assert_eq!(dataset.profile.channel("mode").expect("a channel").imputed, 1);
    let held_out = dataset.held_out.as_ref().expect("a held-out range");
    assert_eq!(held_out.states().row(0)[1..], [0.0, 0.0]);

    assert_refused_with(&data, &one_hot("mod"), &["not a channel of the log; did you mean mode?"]);
}

fn modes(modes: [&str; 6]) -> Table {
    let modes = modes.map(str::to_owned).to_vec();
    Table::new().with("timestamp", seconds(0..6)).with("mode", modes)
}

#[test]
fn modes_may_lie_in_a_file_of_their_own_and_contradict_each_other() {
    let folder = Folder::of("a.parquet", &log(0, &[("a", &rising(6))]));
    folder.write("b.parquet", &modes(["run", "run", "stop", "", "run", "run"]));
    let preprocess = one_hot("mode");
    let alone = values_of_contradicting(&folder, Contradictions::Refuse, &preprocess, "mode=stop");
    assert_eq!(alone, [0.0, 0.0, 1.0, 1.0, 0.0, 0.0]);
    folder.write("c.parquet", &modes(["run", "", "run", "stop", "run", "run"]));
    let data = DataConfig { contradictions: Contradictions::Refuse, ..folder.data() };
    assert_refused_with(&data, &preprocess, &["00:00:02 mode is \"stop\" and \"run\""]);
    let [first, last] = [Contradictions::First, Contradictions::Last].map(|contradictions| {
        values_of_contradicting(&folder, contradictions, &preprocess, "mode=stop")
    });
    assert_eq!(first, [0.0, 0.0, 1.0, 1.0, 0.0, 0.0]);
    assert_eq!(last, [0.0, 0.0, 0.0, 1.0, 0.0, 0.0]);
}

#[test]
fn modes_that_are_numbers_contradict_each_other_as_well() {
    let folder =
        Folder::of("a.parquet", &log(0, &[("a", &rising(4)), ("mode", &[1.0, 1.0, 2.0, 2.0])]));
    folder.write("b.parquet", &log(0, &[("mode", &[1.0, NAN, 1.0, 2.0])]));
    let preprocess = one_hot("mode");
    assert_refused_with(
        &folder.data(),
        &preprocess,
        &["1 values: at 1970-01-01 00:00:02 mode is \"2\" and \"1\""],
    );
    let [first, last] = [Contradictions::First, Contradictions::Last].map(|contradictions| {
        values_of_contradicting(&folder, contradictions, &preprocess, "mode=2")
    });
    assert_eq!(first, [0.0, 0.0, 1.0, 1.0]);
    assert_eq!(last, [0.0, 0.0, 0.0, 1.0]);
    // The same for samples.
    let long = "time,tag,value\n2024-01-01,a,1\n2024-01-01,mode,1\n2024-01-01,mode,2\n2024-01-02,a,3\n2024-01-02,mode,2\n";
    let folder = Folder::of_text("a.csv", long);
    assert_refused_with(&folder.data(), &preprocess, &["mode is \"1\" and \"2\""]);
}

fn sub_sampled(folder: &Folder, subsample: usize, reduce: Reduce) -> Dataset {
    let preprocess = PreprocessConfig { subsample, reduce, ..PreprocessConfig::default() };
    load_with(&folder.data(), &preprocess)
}

#[test]
fn sub_sampling_counts_from_each_segment() {
    let times: Vec<i64> = (0..7).chain(20..22).chain(30..35).collect();
    let folder = Folder::of("a.parquet", &log_at(times, &[("a", &rising(14))]));
    let kept = sub_sampled(&folder, 3, Reduce::Keep);
    assert_eq!(train_seconds(&kept), [0.0, 3.0, 6.0, 20.0, 30.0, 33.0]);
    assert_eq!(segment_lengths(&kept), [3, 1, 2]);
    assert_eq!((kept.period.as_secs(), kept.profile.train.transitions), (3.0, 3));
    assert_eq!(kept.profile.sampled_period_secs, 3.0);
    let mean = sub_sampled(&folder, 3, Reduce::Mean);
    assert_eq!(train_seconds(&mean), [2.0, 5.0, 32.0]);
    assert_eq!(train_values(&mean, "a"), [1.0, 4.0, 10.0]);
    let [mean, kept] =
        [Reduce::Mean, Reduce::Keep].map(|reduce| sub_sampled(&folder, 1, reduce).fingerprint);
    assert_eq!(mean, kept);
}

#[test]
fn wide_logs_are_read_in_batches() {
    let columns: Vec<Vec<f64>> = (0..150_u32)
        .map(|column| (0..40_u32).map(|row| f64::from((row * (column + 3)) % 41)).collect())
        .collect();
    let names: Vec<String> = (0..150).map(|column| format!("c{column:03}")).collect();
    let channels: Vec<(&str, &[f64])> = names
        .iter()
        .zip(&columns)
        .map(|(name, values)| (name.as_str(), values.as_slice()))
        .collect();
    let folder = Folder::of("a.parquet", &log(0, &channels));
    let dataset = folder.load();
    assert_eq!(dataset.normaliser.len(), 150 - 3, "c038, c079 and c120 are constant");
    for (name, values) in channels {
        if dataset.normaliser.position(name).is_some() {
            assert_eq!(train_values(&dataset, name), values, "{name}");
        }
    }
    let inspected = inspect(&folder.data(), &PreprocessConfig::default(), &Silent);
    assert_eq!(inspected.expect("a log"), dataset.profile);
}

#[test]
fn pairs_of_words_are_one_and_zero() {
    let mut wide = String::from("time,a,XV,STATUS\n");
    for row in 0..40 {
        let valve = ["OFF", "ON", "ON", ""][row % 4];
        let state = ["RUN", "CIP", "STANDBY"][row % 3];
        writeln!(wide, "2024-03-01 00:00:{row:02},{},{valve},{state}", row % 7).expect("memory");
    }
    let wide = Folder::of_text("a.csv", &wide);
    let preprocess = PreprocessConfig { max_missing: 0.5, ..PreprocessConfig::default() };
    let found = inspect(&wide.data(), &preprocess, &Silent).expect("a log");
    assert_eq!(kept(&found), ["a", "XV"]);
    let told = found.clock_doubts().join("\n");
    assert!(told.contains("words are read as 1 and 0: XV (\"ON\" and \"OFF\");"), "{told}");
    let valve = found.channels.iter().find(|channel| channel.name == "XV");
    let values = valve.and_then(|channel| channel.values.as_ref()).expect("values");
    assert_eq!((values.min, values.max), (0.0, 1.0));
    // The same in a long table, and with a third word.
    let both = (0..40).map(|row| {
        let valve = ["closed", "open"][row / 10 % 2];
        format!("2024-03-01 00:00:{row:02},a,{row}\n2024-03-01 00:00:{row:02},XV,{valve}\n")
    });
    let long = format!("time,tag,value\n{}", both.collect::<Vec<String>>().concat());
    assert_eq!(kept(&Folder::of_text("a.csv", &long).inspect()), ["XV", "a"]);
    let other = long.replace(":07,XV,closed", ":07,XV,Bad");
    assert_eq!(kept(&Folder::of_text("a.csv", &other).inspect()), ["a"]);
}

#[test]
fn a_long_table_in_which_a_switch_is_on_and_off_at_once_is_refused() {
    let later = (1..20).map(|minute| {
        let valve = ["OFF", "ON"][minute / 5 % 2];
        format!("2024-03-01 00:{minute:02},XV,{valve}\n")
    });
    let later: String = later.collect();
    let at_once = "2024-03-01 00:00,XV,ON\n2024-03-01 00:00,XV,OFF\n";
    let folder = Folder::of_text("a.csv", &format!("time,tag,value\n{at_once}{later}"));
    assert_refused(
        &folder.data(),
        &["contradict each other in 1 values", "at 2024-03-01 00:00:00 XV is 1 and 0"],
    );
    assert_eq!(folder.inspect().contradictions.count, 1, "to be looked at");
    let kept = [Contradictions::First, Contradictions::Last].map(|contradictions| {
        let preprocess = PreprocessConfig::default();
        values_of_contradicting(&folder, contradictions, &preprocess, "XV")[0]
    });
    assert_eq!(kept, [1.0, 0.0]);
    // The word that is not kept counts too: with a third one it is text.
    let third = later.replace("OFF", "ON");
    let folder = Folder::of_text("a.csv", &format!("time,tag,value\n{at_once}{third}"));
    assert_refused(&folder.data(), &["XV is 1 and 0"]);
}

#[test]
fn several_switches_of_several_files_keep_their_own_values() {
    let folder = Folder::new();
    for file in 0..2 {
        let mut text = String::from("time,pump,a,valve\n");
        for minute in 0..60 {
            let [first, second] =
                [["OFF", "ON"][minute / 5 % 2], ["closed", "open"][minute / 4 % 2]];
            writeln!(text, "2024-03-01 0{file}:{minute:02},{first},{},{second}", minute % 7)
                .expect("memory");
        }
        folder.write_file(&format!("{file}.csv"), &text);
    }
    let dataset = folder.load();
    for (name, every) in [("pump", 5), ("valve", 4)] {
        let minutes = 0..120_u32;
        let switched = minutes.map(|minute| f64::from(minute % 60 / every % 2));
        assert_eq!(train_values(&dataset, name), switched.collect::<Vec<f64>>(), "{name}");
    }
}
