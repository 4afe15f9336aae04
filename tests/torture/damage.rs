//! Damage to every file that calib writes: what is read again afterwards is what was written, or is refused and made
//! again; never something else.
//!
//! A slice runs with the other tests. More by hand, with another seed:
//!
//!     CALIB_DAMAGES=2000 CALIB_SEED=7 cargo test --release --test torture damage -- --nocapture

use std::{
    fs,
    path::{Path, PathBuf},
};

use crate::{
    campaign::{Draws, everything, number, on_all_cores},
    faults::copied,
    harness::{Content, Place},
};

/// Ways to damage a file.
const KINDS: [&str; 8] =
    ["bit", "cut", "swap", "zeros", "longer", "empty", "gone", "another study's"];
/// Damages with the other tests.
const SLICE: u64 = 32;

/// `whole` with one damage; the same where that changes nothing, such as zeros over zeros. None: no file any more.
fn damaged(
    whole: &[u8],
    other: Option<&Vec<u8>>,
    kind: &str,
    draws: &mut Draws,
) -> Option<Vec<u8>> {
    let mut bytes = whole.to_vec();
    let place = draws.below(whole.len());
    match kind {
        "bit" => bytes[place] ^= 1 << draws.below(8),
        "cut" => bytes.truncate(place),
        "swap" => {
            let length = (1 + draws.below(64)).min(whole.len() / 2);
            let first = draws.below(whole.len() - 2 * length + 1);
            let second = first + length + draws.below(whole.len() - first - 2 * length + 1);
            for offset in 0..length {
                bytes.swap(first + offset, second + offset);
            }
        }
        "zeros" => {
            let end = (place + 1 + draws.below(4096)).min(whole.len());
            bytes[place..end].fill(0);
        }
        "longer" => bytes.extend((0..=draws.below(64)).map(|byte| byte as u8)),
        "empty" => bytes.clear(),
        "gone" => return None,
        _ => bytes = other.cloned().unwrap_or_default(),
    }
    Some(bytes)
}

/// What a study made: relative path → content.
fn results(place: &Place) -> Content {
    let mut content = place.content("study-results");
    content.retain(|path, _| !path.ends_with(".lock"));
    content
}

/// What became of a damage.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Outcome {
    /// Nothing was changed by it.
    None,
    /// `check` named it, and the study made it again.
    Found,
    /// The study made it again; a file that is missing, or whole and another study's, is none of `check`'s.
    MadeAgain,
}

fn try_one(
    base: &Place,
    whole: &Content,
    other: &Content,
    name: &Path,
    kind: &str,
    draws: &mut Draws,
) -> Result<Outcome, String> {
    let bytes = damaged(&whole[name], other.get(name), kind, draws);
    if bytes.as_ref() == Some(&whole[name]) {
        return Ok(Outcome::None);
    }
    let place = copied(base);
    let path = place.path().join("study-results").join(name);
    match bytes {
        Some(bytes) => fs::write(&path, bytes).expect("writable"),
        None => fs::remove_file(&path).expect("removed"),
    }
    let checked = place.calib(&["check", "study-results"]);
    let found = checked.code() == 1 && checked.stdout().contains("makes it again");
    if !found && !matches!(kind, "gone" | "another study's") {
        return Err(format!("was not found: {}", checked.stdout()));
    }
    let again = place.calib(&["run", "study.toml", "-q"]);
    if !matches!(again.code(), 0 | 1) {
        return Err(format!("exit code {}: {}", again.code(), again.stderr()));
    }
    let after = results(&place);
    let differs = whole.iter().find(|(path, bytes)| after.get(*path) != Some(*bytes));
    match differs {
        Some((path, _)) => Err(format!("{} differs afterwards", path.display())),
        None if found => Ok(Outcome::Found),
        None => Ok(Outcome::MadeAgain),
    }
}

/// Damage files that are read again, run the study again, and count.
#[test]
fn damage() {
    let base = everything();
    base.calib(&["run", "study.toml", "-q"]).ends(&[0, 1]);
    let whole = results(&base);
    let another = everything();
    another.calib(&["run", "study.toml", "-q", "--set", "seed=4"]).ends(&[0, 1]);
    let other = results(&another);
    let names: Vec<&PathBuf> = whole.keys().collect();
    assert!(names.len() > 40, "{names:?}");
    let seed = number("CALIB_SEED", 1);
    let count = number("CALIB_DAMAGES", SLICE) as usize;
    let outcomes = on_all_cores(count, |case| {
        let mut draws = Draws(seed << 32 | case as u64);
        let kind = KINDS[case % KINDS.len()];
        let name = if count < names.len() {
            *draws.of(&names)
        } else {
            names[case / KINDS.len() % names.len()]
        };
        (kind, name, try_one(&base, &whole, &other, name, kind, &mut draws))
    });
    println!(
        "{:<20} {:>8} {:>8} {:>14} {:>18}",
        "damage", "made", "found", "made again", "silently different"
    );
    let mut wrong = Vec::new();
    for kind in KINDS {
        let of_kind = || outcomes.iter().filter(|(tried, ..)| *tried == kind);
        let count = |wanted| of_kind().filter(|(.., outcome)| *outcome == Ok(wanted)).count();
        let errors = of_kind().filter_map(|(_, name, outcome)| {
            let error = outcome.as_ref().err()?;
            Some(format!("{kind} in {}: {error}", name.display()))
        });
        let before = wrong.len();
        wrong.extend(errors);
        let made = of_kind().count() - count(Outcome::None);
        println!(
            "{kind:<20} {made:>8} {:>8} {:>14} {:>18}",
            count(Outcome::Found),
            count(Outcome::MadeAgain),
            wrong.len() - before
        );
    }
    assert!(wrong.is_empty(), "seed {seed}, {} of {count}:\n{}", wrong.len(), wrong.join("\n"));
}
