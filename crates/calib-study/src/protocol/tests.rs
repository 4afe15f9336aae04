use std::fs;

use super::*;

impl DrawnStudy {
    fn table(&self) -> Table {
        toml::from_str(&self.text).expect("TOML")
    }
}

const STUDY: &str = "output = \"out\"\n[simulate]\ndays = 2\n[data]\npath = \"logs\"\n[agent]\nhidden_units = 64\n\
     [sweep]\nsensors = [\"A\"]\n";

const PROTOCOL: &str = r#"
[validity]
seed = 7
[[validity.plants]]
study = "simulated.toml"
repeat = 3
[validity.plants.draw]
"simulate.drift" = { from = 0.3, to = 3, scale = "log" }
"simulate.start" = [2022-03-01, 2022-09-01]
[[validity.plants]]
study = "real.toml"
[validity.plants.draw]
"sweep.steps" = [300]
[validity.task.draw]
"agent.optimiser" = ["adam", "sgd"]
"agent.batch_size" = { from = 4, to = 64, scale = "log" }
"sweep.steps" = { from = 800, to = 4000, whole = true }
agent = [{ value_function = "linear" }, { hidden_units = 16 }]
"#;

fn place() -> tempfile::TempDir {
    let place = tempfile::tempdir().expect("a directory");
    let real = "[data]\npath = [\"logs/a\", \"${CALIB_DATA}/b\"]\n[sweep]\nsensors = [\"A\"]\n";
    for (name, text) in [("simulated.toml", STUDY), ("real.toml", real)] {
        fs::write(place.path().join(name), text).expect("writable");
    }
    place
}

fn drawn(place: &Path, protocol: &str, overrides: &[&str]) -> Result<Vec<DrawnStudy>, StudyError> {
    let path = place.join("protocol.toml");
    fs::write(&path, protocol).expect("writable");
    let overrides: Vec<String> = overrides.iter().map(|&text| text.to_owned()).collect();
    let found = Protocol::find(&path)?.expect("a protocol");
    found.draw(&path, &place.join("results/draw-7/studies"), &overrides)
}

fn named<'a>(all: &'a [DrawnStudy], plant: &str) -> &'a DrawnStudy {
    all.iter().find(|drawn| drawn.plant == plant).expect("it is drawn")
}

/// Returns the number of different values of a key.
fn different(all: &[DrawnStudy], key: &str) -> usize {
    let values = all.iter().map(|drawn| drawn.table()[key].to_string());
    values.collect::<BTreeSet<String>>().len()
}

#[test]
fn studies_are_drawn_whole() {
    let place = place();
    let all = drawn(place.path(), PROTOCOL, &[]).expect("valid");
    let names: Vec<&str> = all.iter().map(|drawn| drawn.plant.as_str()).collect();
    assert_eq!(names, ["simulated-01", "simulated-02", "simulated-03", "real"]);
    for drawn in &all[..3] {
        let job = drawn.job(Path::new("studies")).expect("a study");
        let study = job.study().clone();
        assert_eq!(
            job.layout().root(),
            Path::new("studies").join(format!("{}-results", drawn.plant))
        );
        let simulate = study.simulate.expect("simulated");
        assert!((0.3..=3.0).contains(&simulate.drift) && simulate.days == 2.0);
        assert_eq!(study.data.path.0, [format!("data/{}", drawn.plant)]);
        assert!((4..=64).contains(&study.agent.batch_size));
        assert!((800..=4000).contains(&study.sweep.steps));
        assert_eq!(study.output, None);
    }
    assert_eq!(different(&all, "seed"), 4);
    assert!(different(&all, "agent") > 2);
    let real = named(&all, "real");
    assert_eq!(real.table()["sweep"]["steps"].as_integer(), Some(300), "its own draw counts");
    let real = real.table();
    let paths = real["data"]["path"].as_array().expect("a list");
    assert_eq!(paths[0].as_str(), Some("../../../logs/a"), "from where the study will be");
    assert_eq!(paths[1].as_str(), Some("${CALIB_DATA}/b"));
    // The text must equal the study and list the drawn values.
    let text = &named(&all, "simulated-02").text;
    assert_eq!(toml::from_str::<Table>(text).expect("TOML"), all[1].table());
    assert!(text.starts_with(
        "# Drawn from simulated.toml by `calib validity protocol.toml` with the seed 7"
    ));
    assert!(text.contains("#     agent.optimiser = \""), "{text}");
}

#[test]
fn a_draw_depends_on_seed_plant_and_key_alone() {
    let place = place();
    let before = drawn(place.path(), PROTOCOL, &[]).expect("valid");
    // This adds a key, adds plants before and after, and changes the order of the keys.
    let entry = "[[validity.plants]]\nstudy = \"other.toml\"\n[[validity.plants]]\nstudy = \"simulated.toml\"";
    fs::write(place.path().join("other.toml"), STUDY).expect("writable");
    let more = PROTOCOL
        .replacen("[[validity.plants]]\nstudy = \"simulated.toml\"", entry, 1)
        .replace("repeat = 3", "repeat = 12")
        .replace("[validity.task.draw]", "[validity.task.draw]\n\"agent.gamma\" = [0.5, 0.6]");
    let after = drawn(place.path(), &more, &[]).expect("valid");
    assert_eq!(after.len(), 14);
    for drawn in &before {
        let mut again = named(&after, &drawn.plant).table().clone();
        let agent = again["agent"].as_table_mut().expect("a section");
        assert!(agent.remove("gamma").is_some());
        assert_eq!(again, drawn.table(), "{}", drawn.plant);
    }
    let other = drawn(place.path(), &PROTOCOL.replace("seed = 7", "seed = 8"), &[]).expect("valid");
    assert!(before.iter().zip(&other).all(|(a, b)| a.table()["seed"] != b.table()["seed"]));
}

#[test]
fn sections_are_laid_before_the_keys_in_them_and_overrides_last() {
    let place = place();
    let protocol = PROTOCOL
        .replace("\"agent.optimiser\"", "\"agent.hidden_units\" = [48]\n\"agent.optimiser\"")
        .replace("agent = [", "agent = [{ hidden_units = 8 }, ");
    let all = drawn(place.path(), &protocol, &["agent.optimiser=sgd", "sweep.steps=99"]);
    for drawn in &all.expect("valid") {
        let job = drawn.job(Path::new("")).expect("a study");
        let study = job.study();
        assert_eq!((study.agent.hidden_units, study.sweep.steps), (48, 99));
        assert_eq!(drawn.table()["agent"]["optimiser"].as_str(), Some("sgd"));
    }
    // Nested sections mean the same as dotted keys.
    let nested =
        PROTOCOL.replace("\"agent.optimiser\" = [", "data.path = [\"x\"]\n\"agent.optimiser\" = [");
    let all = drawn(place.path(), &nested, &[]).expect("valid");
    assert_eq!(named(&all, "real").table()["data"]["path"].as_str(), Some("x"));
}

/// Returns why the protocol is refused with `to` in place of `from`.
fn refused(from: &str, to: &str) -> String {
    let text = PROTOCOL.replacen(from, to, 1);
    assert_ne!(text, PROTOCOL);
    drawn(place().path(), &text, &[]).expect_err("refused").to_string()
}

#[test]
fn what_is_no_protocol_is_left_to_others_and_mistakes_are_named() {
    let place = place();
    let path = place.path().join("simulated.toml");
    assert_eq!(Protocol::find(&path).expect("a study"), None);
    assert_eq!(Protocol::find(&place.path().join("none.toml")).expect("nothing"), None);
    let key = refused("seed = 7", "sed = 7");
    assert!(key.contains("protocol.toml:3:1") && key.contains("did you mean `seed`"), "{key}");
    assert!(refused("\"real.toml\"", "\"reel.toml\"").contains("reel.toml"));
    assert!(refused("repeat = 3", "repeat = 0").contains("repeat must be from 1 to 10000"));
    let again = refused("study = \"real.toml\"", "study = \"real.toml\"\nrepeat = 2");
    assert!(again.contains("repeat requires a study with [simulate]"), "{again}");
    let twice = refused(
        "study = \"real.toml\"",
        "study = \"real.toml\"\n[[validity.plants]]\nstudy = \"real.toml\"",
    );
    assert!(twice.contains("two plants are called real"), "{twice}");
    let list = refused("[\"adam\", \"sgd\"]", "\"adam\"");
    assert!(list.contains("agent.optimiser") && list.contains("expected a list"), "{list}");
    let range = refused("from = 4, to = 64", "from = 64, to = 4");
    assert!(
        range.contains("agent.batch_size cannot be drawn: from must be below to, got 64 and 4"),
        "{range}"
    );
    let none = drawn(place.path(), "[validity]\nseed = 1\n", &[]).expect_err("no plants");
    assert!(none.to_string().contains("a protocol wants plants"));
    let all = drawn(place.path(), &PROTOCOL.replace("agent.optimiser", "agent.optimise"), &[]);
    let error = all.expect("drawn")[0].job(Path::new("")).expect_err("no such key");
    assert_eq!(
        error.place().map(|place| place.file.as_path()),
        Some(Path::new("simulated-01.toml"))
    );
    let error = Problem::from(error).to_string();
    assert!(
        error.contains("simulated-01 as the protocol draws it") && error.contains("`optimise`"),
        "{error}"
    );
}
