//! Peculiarities of loggers: words for missing values, times in two columns, angles.

use std::fmt::Write as _;

use crate::harness::{Place, Ran};

/// Returns a typical logger file: dates and times in two columns, decimal commas, -200 for "no value", a clock that restarts at midnight,
/// a wind direction, a sensor that was added later, and a damaged line.
fn loggers() -> String {
    let mut text = String::from("Date;Time;CO;NOx;T;NSM;Wind;Late\r\n");
    let mut noise = 1_u32;
    for row in 0..2_400_u32 {
        noise = noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        let rough = f64::from(noise >> 16) / 65_536.0;
        let at = f64::from(row);
        let wind = (at * 2.3 + 40.0 * rough).rem_euclid(360.0);
        let values = [
            2.0 + 1.5 * (at / 5.0).sin() + 0.2 * rough,
            300.0 + 200.0 * (at / 5.0 + 0.4).sin() + 9.0 * rough,
            15.0 + 8.0 * (at / 30.0).cos() + 0.4 * rough,
        ];
        let values: Vec<String> = values
            .iter()
            .map(|value| {
                if row % 90 == 11 {
                    "-200".to_owned()
                } else {
                    format!("{value:.2}").replace('.', ",")
                }
            })
            .collect();
        let late = if row < 1_100 {
            String::new()
        } else {
            format!("{:.2}", 5.0 + (at / 7.0).sin()).replace('.', ",")
        };
        if row == 700 {
            text.push_str("14/03/2024;0\r\n");
        }
        let minute = 2 * row % 1_440;
        let day = 13 + 2 * row / 1_440;
        writeln!(
            text,
            "{day}/3/2024;{:02}.{:02}.00;{};{};{};{late}\r",
            minute / 60,
            minute % 60,
            values.join(";"),
            minute * 60,
            format!("{wind:.1}").replace('.', ",")
        )
        .expect("memory");
    }
    text
}

fn init(place: &Place, more: &[&str]) -> Ran {
    let args = ["init", "log.csv", "--force", "--within=1s", "--set=data.bad_rows=skip"];
    place.calib(&[&args[..], more].concat())
}

#[test]
fn what_a_logger_wrote_goes_to_a_verdict_with_what_was_said() {
    let place = Place::new();
    place.write("log.csv", &loggers());
    place
        .calib(&["init", "log.csv", "--within=1s"])
        .fails_with(2, &["log.csv, line 702: 2 cells", "data.bad_rows = \"skip\""]);
    let skip = "--set=data.bad_rows=skip";
    let shown = place.calib(&["inspect", "log.csv", skip]);
    assert!(shown.stdout().contains("1: lines that cannot be read (left out), such as"));
    assert!(shown.stderr().contains("set data.missing_values = [-200]"), "{}", shown.stderr());
    let init = place.calib(&["init", "log.csv", "--within=1s", skip]);
    init.succeeds();
    assert!(init.stderr().contains("-200 stands 81 times"), "{}", init.stderr());
    assert!(init.stderr().contains("angles: Wind (a turn is 360)"), "{}", init.stderr());
    assert!(init.stdout().contains("5 of 7 channels"), "both count: {}", init.stdout());
    let study = place.read("study.toml");
    for line in [
        "missing_values = [-200]",
        "bad_rows = \"skip\"  # given",
        "a clock: it counts on evenly",
        "[data.angles]\nWind = 360 ",
        "Wind_sin and Wind_cos are channels in its place",
        "can be computed from the other channels: ",
    ] {
        assert!(study.contains(line), "{line} in {study}");
    }
    let ran = place.calib(&["run", "study.toml", "-q"]).ends(&[0, 1]);
    assert!(ran.contains("CO") || ran.contains("NOx"), "{ran}");
}

#[test]
fn what_was_asked_for_is_taken_or_refused() {
    let place = Place::new();
    place.write("log.csv", &loggers());
    let late = init(&place, &["--sensor", "Late", "--horizon", "20m"]);
    late.succeeds();
    let said = late.stderr();
    assert!(said.contains("Late complete from 2024-03-14"), "{said}");
    assert!(said.contains("data.train and data.held_out take this stretch"), "{said}");
    let study = place.read("study.toml");
    assert!(study.contains("sensors = [\"Late\"]") && study.contains("Named with --sensor"));
    assert!(study.contains("as asked for with --horizon"), "{study}");
    init(&place, &["--sensor", "NSM"])
        .fails_with(2, &["NSM: a clock: it counts on evenly, so it cannot be"]);
    init(&place, &["--sensor", "Wind"]).fails_with(
        2,
        &["--sensor Wind: it is an angle; data.angles makes Wind_sin and Wind_cos of it: name one"],
    );
    init(&place, &["--set=data.train_fraction=0.5"])
        .fails_with(2, &["has no effect on `calib init`"]);
    let fraction = place.calib(&["run", "study.toml", "--set=data.train_fraction=0.5"]).fails(2);
    assert!(fraction.contains("has no effect, because data.train says"), "{fraction}");
}

/// The times of the log are local times, and the study uses the same time zone.
#[test]
fn the_stretch_of_a_sensor_is_printed_on_the_clock_of_the_time_zone() {
    let place = Place::new();
    place.write("log.csv", &loggers());
    let [in_tokyo, in_utc] = [&["--set=data.time_zone=Asia/Tokyo"][..], &[]].map(|zone| {
        let late = init(&place, &[&["--sensor", "Late", "--horizon", "20m"], zone].concat());
        late.succeeds();
        let said = late.stderr();
        let line = said.lines().find(|line| line.contains("Late complete from 2024-03-14"));
        line.unwrap_or_else(|| panic!("{said}")).to_owned()
    });
    assert_eq!(in_tokyo, in_utc);
}

/// Proposes a study, and returns the JSON that is printed and the study.
fn said_and_written(place: &Place, more: &[&str]) -> (serde_json::Value, toml::Table) {
    let said = init(place, &[&["--json"], more].concat()).json(&[0]);
    (said, toml::from_str(&place.read("study.toml")).expect("TOML"))
}

/// The wind is an input through its sine and cosine. On request it is predicted or left out.
#[test]
fn an_angle_becomes_its_sine_and_its_cosine() {
    let place = Place::new();
    place.write("log.csv", &loggers());
    let (said, study) = said_and_written(&place, &[]);
    assert_eq!(said["angles"], serde_json::json!({ "Wind": 360.0 }));
    assert_eq!(study["data"]["angles"]["Wind"].as_integer(), Some(360));
    let sensors = said["sensors"].as_array().expect("sensors");
    assert!(sensors.iter().all(|name| !name.as_str().unwrap_or("Wind").starts_with("Wind")));
    assert!(!place.read("study.toml").contains("could be as well: \"Wind"));
    place
        .calib(&["inspect", "study.toml"])
        .succeeds_with(&["Wind_sin: sine of Wind (recorded from ", ", a turn is 360)"]);
    let shown = place.calib(&["inspect", "study.toml", "--json"]).json(&[0]);
    let cosine = shown["channels"].as_array().expect("channels").iter();
    let cosine = cosine.filter(|channel| channel["name"] == "Wind_cos").collect::<Vec<_>>()[0];
    assert_eq!(
        (&cosine["angle"]["channel"], &cosine["angle"]["part"]),
        (&"Wind".into(), &"cosine".into())
    );
    assert!(cosine["dropped"].is_null());

    let (said, _) = said_and_written(&place, &["--sensor", "Wind_sin"]);
    assert_eq!(said["sensors"], serde_json::json!(["Wind_sin"]));
    let (said, study) = said_and_written(&place, &["--set=data.angles={}"]);
    assert!(
        said.get("angles").is_none()
            && study["data"]["angles"].as_table().expect("given").is_empty()
    );
    let left_out = said["left_out"].as_array().expect("channels");
    let wind = left_out.iter().find(|channel| channel[0] == "Wind").expect("left out");
    assert!(wind[1].as_str().is_some_and(|why| why.contains("an entry of data.angles")), "{wind}");
    let (_, study) = said_and_written(&place, &["--set=data.angles.Wind=360"]);
    assert_eq!(study["data"]["angles"]["Wind"].as_integer(), Some(360), "as it was given");
}

#[test]
fn mistakes_about_angles_are_those_of_the_user() {
    let place = Place::new();
    place.write("log.csv", &loggers());
    let inspect = ["inspect", "log.csv", "--set=data.bad_rows=skip"];
    for (set, expected) in [
        (
            &["--set=data.angles={ Wnid = 360 }"][..],
            "data.angles, \"Wnid\": it names no channel; did you mean Wind?",
        ),
        (&["--set=data.angles.Wind=-360"], "data.angles.Wind = -360: expected a positive number"),
        (&["--set=data.angles.Wind=north"], "expected a number"),
        (
            &["--set=data.angles.Wind=360", "--set=preprocess.one_hot=Wind"],
            "preprocess.one_hot names Wind, and data.angles makes Wind_sin and Wind_cos",
        ),
        (
            &["--set=data.angles.Wind=360", "--set=sweep.sensors=[\"Wind\"]"],
            "sweep.sensors names Wind, and data.angles makes Wind_sin and Wind_cos of it: name one",
        ),
        (
            &["--set=data.angles.Wind=360", "--set=sensors.Wind.unit=deg"],
            "sensors names Wind, and data.angles",
        ),
    ] {
        let error = place.calib(&[&inspect[..], set].concat()).fails(2);
        assert!(error.contains(expected), "{error}\n{expected}");
    }
    // The matches of a pattern are known only with the log.
    let pattern = "--set=data.angles={ \"W*\" = 6.283 }";
    let described = place.calib(&[&inspect[..], &[pattern]].concat());
    let said = described.stderr();
    assert!(
        said.contains("turns of 6.283: give data.angles a full turn in the unit of the channel"),
        "{said}"
    );
    described.succeeds();
    place.write(
        "study.toml",
        "[data]\npath = \"log.csv\"\nbad_rows = \"skip\"\nangles = { \"W*\" = 360 }\n[sweep]\nsensors = [\"Wind\"]\n",
    );
    let error = place.calib(&["build-model", "study.toml", "-q"]).fails(2);
    assert!(error.contains("sensor \"Wind\" is not a channel of the log; data.angles makes Wind_sin and Wind_cos of it"), "{error}");
}
