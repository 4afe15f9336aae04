//! Damage to every file that calib writes. Later reads return the written content, or refuse the file and make it
//! again. They never return something else.
//!
//! Some cases run with the other tests. To run more, with another seed:
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

/// Kinds of damage.
const KINDS: [&str; 8] =
    ["bit", "cut", "swap", "zeros", "longer", "empty", "gone", "another study's"];
/// Cases that run with the other tests.
const SLICE: u64 = 32;

/// Applies one kind of damage to `whole`. The result is equal if that changes nothing, such as zeros over zeros.
/// `None`: the file is deleted.
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

/// Returns the results of a study: relative path → content.
fn results(place: &Place) -> Content {
    let mut content = place.content("study-results");
    content.retain(|path, _| !path.ends_with(".lock"));
    content
}

/// Outcome of a damage.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Outcome {
    /// The damage changed nothing.
    None,
    /// `check` named the file, and the study made it again.
    Found,
    /// The study made the file again. `check` does not report it: it is missing, or an intact file of another study.
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

/// Damages files that are read again, runs the study again, and counts the outcomes.
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
        let own: Vec<_> = outcomes.iter().filter(|(tried, ..)| *tried == kind).collect();
        let made = own.len();
        let [harmless, found, made_again] = [Outcome::None, Outcome::Found, Outcome::MadeAgain]
            .map(|wanted| own.iter().filter(|(.., outcome)| *outcome == Ok(wanted)).count());
        let errors = own.into_iter().filter_map(|(_, name, outcome)| {
            let error = outcome.as_ref().err()?;
            Some(format!("{kind} in {}: {error}", name.display()))
        });
        let before = wrong.len();
        wrong.extend(errors);
        println!(
            "{kind:<20} {:>8} {found:>8} {made_again:>14} {:>18}",
            made - harmless,
            wrong.len() - before
        );
    }
    assert!(wrong.is_empty(), "seed {seed}, {} of {count}:\n{}", wrong.len(), wrong.join("\n"));
}
