//! Damage to every file that calib writes: what is read again afterwards is what was written, or is refused and made
//! again; never something else.
//!
//! A slice runs with the other tests. More by hand, with another seed:
//!
//!     CALIB_DAMAGES=40 CALIB_SEED=7 cargo test --release --test cli torture -- --nocapture

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
};

use crate::harness::Place;

/// Ways to damage a file.
const KINDS: [&str; 4] = ["bit", "cut", "swap", "zeros"];

/// A number from the environment.
fn number(name: &str, otherwise: u64) -> u64 {
    std::env::var(name).ok().and_then(|text| text.parse().ok()).unwrap_or(otherwise)
}

/// `SplitMix64`: which damage comes next follows from the seed alone.
struct Draws(u64);

impl Draws {
    fn below(&mut self, limit: usize) -> usize {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut mixed = self.0;
        mixed = (mixed ^ (mixed >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((mixed ^ (mixed >> 31)) % limit.max(1) as u64) as usize
    }
}

/// `whole` with one damage; the same where that changes nothing, such as zeros over zeros.
fn damaged(whole: &[u8], kind: &str, draws: &mut Draws) -> Vec<u8> {
    let mut other = whole.to_vec();
    let place = draws.below(whole.len());
    match kind {
        "bit" => other[place] ^= 1 << draws.below(8),
        "cut" => other.truncate(place),
        "swap" => {
            let length = (1 + draws.below(64)).min(whole.len() / 2);
            let first = draws.below(whole.len() - 2 * length + 1);
            let second = first + length + draws.below(whole.len() - first - 2 * length + 1);
            for offset in 0..length {
                other.swap(first + offset, second + offset);
            }
        }
        _ => {
            let end = (place + 1 + draws.below(4096)).min(whole.len());
            other[place..end].fill(0);
        }
    }
    other
}

/// Files that no command reads again: written anew each time.
fn is_output(path: &Path) -> bool {
    let mut parts = path.iter().map(|part| part.to_string_lossy());
    parts.any(|part| matches!(&*part, "evaluate" | "report.html" | "figures"))
}

/// What a study made: relative path → content.
fn results(place: &Place) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut content = place.content("study-results");
    content.retain(|path, _| !path.ends_with(".lock"));
    content
}

/// Damage each file that is read again, run the study again, and count.
#[expect(clippy::print_stdout, reason = "a campaign by hand says what it counted")]
fn torture(place: &Place, seed: u64) {
    place.calib(&["run", "study.toml", "-q"]).ends(&[0, 1]);
    let whole = results(place);
    let root = place.path().join("study-results");
    let read_again: Vec<&PathBuf> = whole.keys().filter(|path| !is_output(path)).collect();
    assert!(read_again.len() > 8, "{read_again:?}");
    let mut draws = Draws(seed);
    let rounds = number("CALIB_DAMAGES", 1) as usize;
    let (mut made, mut found) = (0, 0);
    for round in 0..rounds {
        for (number, name) in read_again.iter().enumerate() {
            let kind = KINDS[(round + number) % KINDS.len()];
            let other = damaged(&whole[*name], kind, &mut draws);
            if other == whole[*name] {
                continue;
            }
            fs::write(root.join(name), &other).expect("writable");
            made += 1;
            let checked = place.calib(&["check", "study-results"]);
            assert!(checked.code() == 1, "{kind} in {} was not found, seed {seed}", name.display());
            let told = checked.stdout();
            found += usize::from(told.contains("makes it again"));
            place.calib(&["run", "study.toml", "-q"]).ends(&[0, 1]);
            for (path, content) in &whole {
                let again = fs::read(root.join(path)).expect("there");
                assert!(
                    again == *content,
                    "{} differs after {kind} in {}, seed {seed}",
                    path.display(),
                    name.display()
                );
            }
        }
    }
    println!("seed {seed}: {made} damages, {found} found, none silently different");
    assert_eq!(made, found);
}

/// A small plant, with runs as short as they can be.
fn small() -> Place {
    let place = Place::with_study();
    place.edit_study("sensors = [\"PIT300\", \"TIT101\"]", "sensors = [\"PIT300\"]");
    place.edit_study("steps = 800", "steps = 240");
    place.edit_study("online_runs = 3", "online_runs = 1");
    place.edit_study("member_runs = 2", "member_runs = 1");
    place.edit_study("log_replay_runs = 2", "log_replay_runs = 1");
    place.edit_study("members = 3", "members = 2");
    place
}

#[test]
fn neighbours() {
    torture(&small(), number("CALIB_SEED", 1));
}

#[test]
fn networks_agents_and_representations() {
    let place = small();
    let path = place.path().join("study.toml");
    let study = fs::read_to_string(&path).expect("readable");
    let further = "\n[pretrain]\nepochs = 2\n\n[representation]\nkind = \"laplacian\"\nsteps = 60\ndimension = 4\n\
                   hidden_units = 16\nbatch_size = 32\n\n[dynamics]\nhidden_units = 8\nepochs = 2\n\n\
                   [models.near]\n[models.net.model]\nkind = \"nn\"\n";
    fs::write(&path, study + further).expect("writable");
    torture(&place, number("CALIB_SEED", 2));
}
