//! Tests on logs of real plants, if the environment variable `CALIB_DATA` names the folder that
//! holds them.

use std::path::PathBuf;

use calib_core::Silent;
use calib_data::{DataConfig, PreprocessConfig, Profile, load};

use crate::support::{assert_refused, profile};

#[expect(clippy::print_stderr, reason = "a skipped test must say so")]
fn folder(name: &str) -> Option<PathBuf> {
    let folder = std::env::var_os("CALIB_DATA").map(|root| PathBuf::from(root).join(name));
    let found = folder.filter(|folder| folder.exists());
    if found.is_none() {
        eprintln!("skipped: set CALIB_DATA to a folder that holds {name}");
    }
    found
}

fn whole(path: PathBuf) -> DataConfig {
    DataConfig { train_fraction: 1.0, ..DataConfig::at(path) }
}

fn count(profile: &Profile, kind: &str) -> usize {
    let reasons = profile.channels.iter().filter_map(|channel| channel.dropped.as_ref());
    reasons.filter(|reason| reason.to_string().contains(kind)).count()
}

#[test]
fn three_hours_of_three_wells() {
    let Some(path) = folder("fixture-3h20") else { return };
    let profile = profile(&whole(path.clone()));
    assert_eq!((profile.rows, profile.files, profile.channels.len()), (12_000, 2, 24));
    assert_eq!((profile.period_secs, profile.gaps.count), (1.0, 0));
    assert_eq!((count(&profile, "constant"), count(&profile, "no value")), (3, 9));
    assert_eq!(profile.kept().count(), 12);
    let dataset =
        load(&DataConfig::at(path), &PreprocessConfig::default(), &Silent).expect("a log");
    assert_eq!(dataset.normaliser.len(), dataset.profile.columns);
    let values = dataset.train.states().as_slice();
    assert!(values.iter().all(|value| (0.0..=1.0).contains(value)));
}

#[test]
fn a_historian_extract() {
    let Some(path) = folder("petrobras-historian/2017-12-24_2018-01-04.parquet") else { return };
    let profile = profile(&whole(path));
    assert_eq!((profile.rows, profile.channels.len(), profile.period_secs), (3_169, 108, 300.0));
    assert_eq!(profile.gaps.count, 0);
    assert_eq!(count(&profile, "constant"), 14);
}

#[test]
fn twelve_sessions_with_schema_drift() {
    let Some(path) = folder("solarmed-med") else { return };
    let profile = profile(&whole(path));
    assert_eq!((profile.files, profile.rows, profile.period_secs), (12, 17_528, 5.0));
    assert_eq!(profile.overlapping_files, 0);
    assert!(profile.gaps.count >= 11 && profile.train.segments > 11);
    assert_eq!(count(&profile, "constant"), 9);
    let drifting = profile.channel("CT-DES-003").expect("a channel of the later files");
    assert!(drifting.missing > 0);
}

#[test]
fn a_month_with_seventeen_gaps() {
    let Some(path) = folder("mbr-mines") else { return };
    let profile = profile(&whole(path));
    assert_eq!((profile.rows, profile.period_secs), (43_552, 60.0));
    assert_eq!(profile.gaps.count, 17);
    assert!((profile.gaps.longest_secs / 3_600.0 - 15.9).abs() < 0.1);
    assert_eq!(profile.train.segments, 18);
    assert_eq!(profile.train.transitions, 43_552 - 18);
    assert_eq!(count(&profile, "constant"), 6);
}

#[test]
fn a_well_whose_clock_goes_back() {
    let name = "3w-wells/well=WELL-00001/20170218T010146.parquet";
    let Some(path) = folder(name) else { return };
    let profile = profile(&whole(path));
    assert_eq!(profile.backward_steps.count, 1);
    assert!(profile.backward_steps.examples[0].file.ends_with("20170218T010146.parquet"));
    let duplicates = &profile.duplicates;
    assert_eq!(duplicates.identical + duplicates.conflicting, 2_390);
    assert_eq!(profile.rows + 2_390, profile.file_rows);
}

#[test]
fn one_well_of_several() {
    let Some(path) = folder("3w-wells") else { return };
    let mut data = whole(path);
    data.partitions.insert("well".to_owned(), "WELL-00001".to_owned());
    let profile = profile(&data);
    assert_eq!((profile.files, profile.period_secs), (11, 1.0));
    assert_eq!(profile.backward_steps.count, 1);
    assert_eq!(profile.overlapping_files, 0);
    assert!(profile.kept().count() >= 4);
}

#[test]
fn wells_do_not_mix() {
    let Some(path) = folder("3w-wells") else { return };
    assert_refused(&whole(path), &["partitions = { well ="]);
}
