//! `calib init`: a study of an unknown log.

mod loggers;
mod trials;

use std::{fmt::Write as _, fs};

use crate::harness::Place;

/// Returns a log with one row per two minutes: two levels, a flow, its total, and a dead channel.
fn log() -> String {
    log_of(2_400)
}

fn log_of(rows: u32) -> String {
    let mut text = String::from("time;LIT100;TIT200;FIT300;FQ300;XV400\n;kPa;°C;m3/h;m3;\n");
    let mut total = 0.0;
    let mut noise = 1_u32;
    for row in 0..rows {
        noise = noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        let rough = f64::from(noise >> 16) / 65_536.0;
        let at = f64::from(row);
        let flow = 10.0 + (at / 5.0).sin() + rough;
        total += flow / 30.0;
        let minute = 2 * row % 1_440;
        let day = 13 + 2 * row / 1_440;
        writeln!(
            text,
            "2024-03-{day} {:02}:{:02}:00;{:.3};{:.3};{flow:.3};{total:.3};1",
            minute / 60,
            minute % 60,
            150.0 + 20.0 * (at / 9.0).sin() + rough,
            20.0 + 5.0 * (at / 60.0).cos() + 0.2 * rough,
        )
        .expect("memory");
    }
    text
}

#[test]
fn a_study_is_proposed_and_runs_to_a_verdict() {
    let place = Place::new();
    place.write("log.csv", &log());
    let init = ["init", "log.csv", "--within", "5s", "--sensor", "LIT100", "--horizon", "20m"];
    place.calib(&init).succeeds_with(&["3 of 5 channels"]);
    let study = place.read("study.toml");
    for line in [
        "FQ300",
        "a total: nearly all of its changes go one way",
        "XV400",
        "never changes",
        "[sweep.grid]",
    ] {
        assert!(study.contains(line), "{line} in {study}");
    }
    assert!(study.contains("gamma = 0.9 "), "ten states of two minutes: {study}");
    place.calib(&init).fails_with(2, &["--force"]);
    // The lines of the grid that stand in comments are valid too.
    let varied = ["lambda", "halve_after", "replay"].iter().fold(study.clone(), |text, key| {
        text.replace(&format!("# {key} = ["), &format!("{key} = ["))
    });
    assert_ne!(varied, study);
    place.write("varied.toml", &varied);
    place.calib(&["run", "varied.toml", "--dry-run"]).succeeds();
    let ran = place.calib(&["run", "study.toml", "-q"]).ends(&[0, 1]);
    assert!(ran.contains("LIT100"), "{ran}");
    let page = place.read("study-results/report.html");
    assert!(page.contains("LIT100 (kPa)"), "the unit of the header stands along the axis");
    assert!(!page.contains("physical unit)"), "and nothing where there is none");
}

#[test]
fn what_was_given_holds_for_the_study() {
    let place = Place::new();
    place.write("log.csv", &log());
    let given = ["--set=data.time_zone=Europe/Paris", "--set=data.exclude=[\"FIT*\", \"FQ*\"]"];
    let init = ["init", "log.csv", "plant.toml", "--within=1s", "--json"];
    let json = place.calib(&[&init[..], &given].concat()).json(&[0]);
    assert_eq!(json["channels"], 2);
    assert_eq!(json["study"], "plant.toml");
    let study = place.read("plant.toml");
    assert!(study.contains("time_zone = \"Europe/Paris\"  # given"), "{study}");
    // Channels that calib leaves out stay out.
    let exclude = "exclude = [\"FIT*\", \"FQ*\", \"XV400\"]  # given";
    assert!(study.contains(exclude), "{study}");
    place.calib(&["run", "plant.toml", "-q"]).ends(&[0, 1]);
}

/// The ranges of a study use the same clock as the study does.
#[test]
fn ranges_are_written_on_the_clock_of_the_time_zone() {
    let with_offsets: String = log()
        .lines()
        .map(|line| line.replacen(' ', "T", 1).replacen(":00;", ":00+01:00;", 1) + "\n")
        .collect();
    for (zone, log, held_out) in [
        ("America/Los_Angeles", log(), "held_out = { start = 2024-03-15T00:00:00,"),
        ("Asia/Kolkata", log(), "held_out = { start = 2024-03-15T00:00:00,"),
        ("Asia/Kolkata", with_offsets, "held_out = { start = 2024-03-15T10:00:00,"),
    ] {
        let place = Place::new();
        place.write("log.csv", &log);
        let given = format!("--set=data.time_zone={zone}");
        let said = place.calib(&["init", "log.csv", "--within=1s", "--json", &given]).json(&[0]);
        let study = place.read("study.toml");
        assert!(study.contains(held_out), "{zone}: {study}");
        let read = place.calib(&["inspect", "study.toml", "--json"]).json(&[0]);
        let rows = [&read["train"]["log_rows"], &read["held_out"]["log_rows"]];
        assert_eq!(rows, [&said["rows"][0], &said["rows"][1]], "{zone}: {study}");
    }
}

/// Two days of rows at random times, with a median step of 42 s and a mean step of one minute.
#[test]
fn a_log_of_random_steps_is_not_told_to_be_shorter_than_it_is() {
    let mut log = String::from("time;LIT100;TIT200\n");
    let mut noise = 1_u32;
    let mut at = 0.0;
    for _ in 0..2_900 {
        noise = noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        let rough = f64::from(noise >> 16) / 65_536.0;
        at += 1.0 + (-59.0 * (1.0 - rough).ln()).floor();
        let time = 1_710_288_000 + at as i64;
        let level = 150.0 + 20.0 * (at / 1_200.0).sin() + rough;
        let temperature = 20.0 + 5.0 * (at / 7_000.0).cos() + 0.2 * rough;
        writeln!(log, "{time};{level:.3};{temperature:.3}").expect("memory");
    }
    let place = Place::new();
    place.write("log.csv", &log);
    let ran = place.calib(&["init", "log.csv", "--within=1s"]);
    ran.succeeds();
    let said = ran.stderr();
    assert!(!said.contains("A log of 1 d"), "the log has 2 d: {said}");
}

/// A level is constant in the last quarter of the log.
#[test]
fn frozen_sensors_are_told_as_inspect_tells_them() {
    let mut log = String::from("time;LIT100;TIT200\n");
    let mut level = 0.0;
    for row in 0..1_200_u32 {
        let at = f64::from(row);
        if row < 900 {
            level = 150.0 + 20.0 * (at / 9.0).sin();
        }
        let time = 1_710_288_000 + 60 * row;
        writeln!(log, "{time};{level:.3};{:.3}", 20.0 + 5.0 * (at / 40.0).cos()).expect("memory");
    }
    let place = Place::new();
    place.write("log.csv", &log);
    let told = "are constant for long: LIT100 for 5 h. If their instruments were frozen";
    for command in [&["init", "log.csv", "--within=1s"][..], &["inspect", "log.csv"]] {
        let ran = place.calib(command);
        ran.succeeds();
        assert!(ran.stderr().contains(told), "{}", ran.stderr());
    }
}

/// The names of channels look like keys, comments or patterns of a study.
#[test]
fn names_of_channels_are_nothing_but_names() {
    let place = Place::new();
    let names = [
        ("LIT100", "LIT\n[evaluate]\nresamples = 7\n#"),
        ("TIT200", "T °"),
        ("FIT300", "\"\"\"\r\nseed = 9"),
        ("FQ300", "T [°C]"),
        ("XV400", "*"),
    ];
    let (header, rows) = log()
        .split_once('\n')
        .map(|(header, rows)| (header.to_owned(), rows.to_owned()))
        .expect("rows");
    let header = names.iter().fold(header, |header, (plain, odd)| {
        header.replace(plain, &format!("\"{}\"", odd.replace('"', "\"\"")))
    });
    place.write("log.csv", &format!("{header}\n{rows}"));
    let said = place.calib(&["init", "log.csv", "--within=1s", "--json"]).json(&[0]);
    assert_eq!(said["channels"], 3, "a pattern leaves out no other: {said}");
    let study: toml::Table = toml::from_str(&place.read("study.toml")).expect("TOML");
    assert_eq!(study["seed"].as_integer(), Some(0));
    let judged: Vec<&str> =
        study["evaluate"].as_table().expect("a section").keys().map(String::as_str).collect();
    assert_eq!(judged, ["rule"]);
    let shown = place.calib(&["inspect", "study.toml", "--json"]).json(&[0]);
    assert_eq!(shown["unused_excludes"], serde_json::json!([]));
    let kept: Vec<&str> = shown["channels"]
        .as_array()
        .expect("channels")
        .iter()
        .filter(|channel| channel["dropped"].is_null())
        .filter_map(|channel| channel["name"].as_str())
        .collect();
    assert_eq!(kept, [names[0].1, names[1].1, names[2].1]);
}

/// Files that are not logs, and what to do about them.
#[test]
fn what_is_no_log_is_told_at_once() {
    let place = Place::new();
    for (name, content, expected) in [
        ("empty.csv", &b""[..], "empty.csv: it is empty"),
        ("empty.parquet", b"", "it is empty"),
        ("sheet.csv", b"PK\x03\x04\x14\0", "save each sheet as CSV"),
        ("noise.csv", b"\x7fELF\x02\x01\0\0", "export the log as CSV or Parquet"),
        ("cut.csv.gz", b"\x1f\x8b\x08\0\0\0\0\0\0\x03\x4b", "truncated or damaged?"),
        (
            "header.csv",
            b"time,a\n",
            "has no rows: the file has a header and no rows; check data.path",
        ),
        ("two.csv", b"time,a\n2024-01-01,1\n2024-01-02,2\n", "the log has 2 rows"),
    ] {
        fs::write(place.path().join(name), content).expect("written");
        place.calib(&["init", name, "study.toml"]).fails_with(2, &[expected]);
        if name != "two.csv" {
            place.calib(&["import", name, "wide.parquet"]).fails_with(2, &[expected]);
        }
    }
    let left: Vec<_> = fs::read_dir(place.path()).expect("readable").collect();
    assert_eq!(left.len(), 7, "nothing was written: {left:?}");
}

/// A folder of Parquet and text files: calib reports which files it reads.
#[test]
fn text_that_is_left_alone_is_named() {
    let place = Place::with_study();
    place.write("data/notes.csv", "time,a\n2024-01-01,1\n");
    for command in [&["inspect", "data"][..], &["import", "data", "wide.parquet"]] {
        let run = place.calib(command);
        let told = run.stderr();
        assert!(
            told.contains("1 file of text beside Parquet left alone: data/notes.csv"),
            "{told}"
        );
        run.succeeds();
    }
}

/// calib checks that it can write the study before it tries anything.
#[cfg(unix)]
#[test]
fn a_study_that_cannot_be_written_is_refused_before_the_trials() {
    let place = Place::new();
    place.write("log.csv", &log());
    place.write("taken", "a file");
    let error = place.calib(&["init", "log.csv", "taken/study.toml"]).fails(2);
    assert!(error.contains("taken"), "{error}");
    assert!(!error.contains("measuring"), "{error}");
}

#[test]
fn a_log_without_a_sensor_says_so() {
    let place = Place::new();
    let mut text = String::from("time,A\n");
    for row in 0..400 {
        writeln!(text, "2024-03-13 {:02}:{:02}:00,5", row / 60, row % 60).expect("memory");
    }
    place.write("log.csv", &text);
    place.calib(&["init", "log.csv"]).fails_with(2, &["A never changes"]);
    assert!(!place.path().join("study.toml").exists());
    let unknown = place.calib(&["init", "log.csv", "--within", "soon"]).fails(2);
    assert!(unknown.contains("expected a time with a unit, such as 90s"), "{unknown}");
}

/// Returns a log with some of its rows again, which differ.
fn with_contradictions(log: &str, count: usize) -> String {
    let again: Vec<String> =
        log.lines().skip(2).take(count).map(|row| row.replace(";1", ";0")).collect();
    format!("{log}{}\n", again.join("\n"))
}

/// Recordings that overlap by a few rows: other commands and `init` report the same.
#[test]
fn few_contradictions_are_told_as_they_are_resolved() {
    let place = Place::new();
    let rows = log();
    place.write("log.csv", &with_contradictions(&rows, 20));
    let shown = place.calib(&["inspect", "log.csv"]);
    assert!(shown.stderr().contains("`calib init` keeps the first"), "{}", shown.stderr());
    assert!(!shown.stderr().contains("would be refused"), "{}", shown.stderr());
    shown.succeeds();
    let init = place.calib(&["init", "log.csv", "--within=1s"]);
    assert!(
        init.stderr().contains("(data.where chooses one): the first of them is kept"),
        "{}",
        init.stderr()
    );
    init.succeeds();
    place.write("log.csv", &with_contradictions(&rows, 200));
    place
        .calib(&["inspect", "log.csv"])
        .fails_with(1, &["would be refused", "up to 1 % of the rows"]);
    place
        .calib(&["init", "log.csv", "--within=1s", "--force"])
        .fails_with(2, &["at most 1 % of the rows contradict another; here there are more"]);
}

/// A building was off for a day soon after its logger began, so sensors are complete in all but a small part of the log.
#[test]
fn an_outage_in_the_part_that_agents_are_tried_on_ends_nothing() {
    let place = Place::new();
    let text = log();
    let rows: Vec<String> = text
        .lines()
        .enumerate()
        .map(|(line, row)| {
            let time = row.split(';').next().unwrap_or_default();
            if (202..=352).contains(&line) { format!("{time};;;;;1") } else { row.to_owned() }
        })
        .collect();
    place.write("log.csv", &(rows.join("\n") + "\n"));
    let init = place.calib(&["init", "log.csv", "--within=30s"]);
    init.succeeds();
    assert!(!init.stderr().contains("could not be compared"), "{}", init.stderr());
    assert!(place.read("study.toml").contains("of which `calib init` took"));
    place.calib(&["run", "study.toml", "-q"]).ends(&[0, 1]);
}

/// Reading the log takes longer than the limit, on any machine.
#[test]
fn nothing_is_compared_or_measured_once_the_time_is_over() {
    let place = Place::new();
    place.write("log.csv", &log());
    let init = place.calib(&["init", "log.csv", "--within=0.0001s"]);
    init.succeeds();
    let told = init.stderr();
    let compared = "agents could not be compared on the training range (half of the time of --within is over): a linear agent is proposed";
    assert!(told.contains(compared), "{told}");
    assert!(
        told.contains("ended before `calib init` could measure how long a study takes"),
        "{told}"
    );
    assert!(!told.contains("measuring how long"), "{told}");
    let study = place.read("study.toml");
    assert!(study.contains("half of the time of --within is over"), "{study}");
    assert!(study.contains("ended before it was measured how long a study takes"), "{study}");
    let again = ["init", "log.csv", "--within=0.0001s", "--force", "--json"];
    let said = place.calib(&again).json(&[0]);
    assert!(said["expected_secs"].is_null(), "{said}");
    place.calib(&["run", "study.toml", "-q"]).ends(&[0, 1]);
}

/// Everything else about such a log follows from the period.
#[test]
fn a_period_that_is_not_that_of_the_log_is_named_first() {
    let place = Place::new();
    place.write("log.csv", &log());
    // A period of ten seconds makes every step a gap. The other two are close enough to count a step as one period.
    for period in [10, 80, 140] {
        let expected = format!(
            "error: the rows are recorded every 120 s, and data.period_secs asks for one every {period} s: set data.period_secs = 120, or set data.resample"
        );
        let set = format!("--set=data.period_secs={period}");
        let init = ["init", "log.csv", "--within=1s", &set];
        for columns in [&[][..], &["--action=XV400", "--reward=FIT300"]] {
            let told = place.calib(&[&init[..], columns].concat()).fails(2);
            assert!(told.starts_with(&expected), "{told}");
        }
    }
    assert!(!place.path().join("study.toml").exists());
}

/// Proposes a study with this horizon, and returns what is printed and the study.
fn init_with_horizon(place: &Place, horizon: &str) -> (String, String) {
    let run = place.calib(&["init", "log.csv", "--force", "--within=1s", "--horizon", horizon]);
    run.succeeds();
    (run.stderr(), place.read("study.toml"))
}

/// A short log has four windows of short runs, or calib says what two windows can show. No horizon is lengthened silently.
#[test]
fn few_windows_and_short_horizons_are_told() {
    let place = Place::new();
    place.write("log.csv", &log_of(4_000));
    let (told, study) = init_with_horizon(&place, "8m");
    assert!(!told.contains("held-out windows"), "{told}");
    assert!(study.contains("4 windows fit beside each other"), "{study}");
    let (told, study) = init_with_horizon(&place, "20m");
    assert!(told.contains("2 held-out windows: hardly any difference can be shown"), "{told}");
    assert!(study.contains("hardly any difference can be shown with so few"), "{study}");
    let far = ["init", "log.csv", "far.toml", "--within", "5s", "--horizon", "400d"];
    let far = place.calib(&far).fails(2);
    assert_eq!(far.matches("400 d").count(), 1, "once: {far}");
    assert!(far.contains("too far for ") && far.contains("at most about "), "{far}");
    let (told, study) = init_with_horizon(&place, "30s");
    assert!(told.contains("--horizon 30 s is shorter than one state, which is 2 min"), "{told}");
    assert!(study.contains("subsample = 1 "), "{study}");
}

#[test]
fn steps_back_and_rows_without_values_are_said() {
    let place = Place::new();
    // Midnight has the date of the day that ends, and TIT200 has no value for eight hours.
    let mut text = String::new();
    for (row, line) in log().lines().enumerate() {
        let at = row.saturating_sub(2);
        let cells: Vec<&str> = line.split(';').collect();
        let day = 12 + 2 * at / 1_440;
        let is_midnight = row > 2 && 2 * at % 1_440 == 0;
        let time =
            if is_midnight { format!("2024-03-{day} 00:00:00") } else { cells[0].to_owned() };
        let missing = (400..640).contains(&at);
        let level = if missing { "" } else { cells[2] };
        writeln!(text, "{time};{};{level};{}", cells[1], cells[3..].join(";")).expect("memory");
    }
    place.write("log.csv", &text);
    let init = ["init", "log.csv", "--within", "5s", "--set", "data.contradictions=first"];
    let ran = place.calib(&init);
    let out = ran.succeeds();
    let warned = ran.stderr();
    assert!(out.contains("that lack \"TIT200\" for long)"), "{out}");
    assert!(!warned.contains("times go back"), "three nights are no rule: {warned}");
    let days = 9;
    let rows = (0..days * 96).map(|row| {
        let day = 1 + row / 96;
        let quarter = row % 96;
        let day = if quarter == 0 && day > 1 { day - 1 } else { day };
        let value = f64::from(row);
        format!(
            "2024-03-{day:02} {:02}:{:02};{:.3};{:.3}\n",
            quarter / 4,
            quarter % 4 * 15,
            (value / 7.0).sin() + 0.1 * (value * 1.7).cos(),
            (value / 11.0).cos()
        )
    });
    let rows: String = rows.collect();
    place.write("late.csv", &format!("time;A;B\n{rows}"));
    let late = ["init", "late.csv", "late.toml", "--within=5s", "--set=data.contradictions=first"];
    let ran = place.calib(&late);
    let warned = ran.stderr();
    assert!(warned.contains("times go back 8 times, first in"), "{warned}");
    assert!(warned.contains("from 2024-03-01 23:45:00 to 2024-03-01 00:00:00"), "{warned}");
}
