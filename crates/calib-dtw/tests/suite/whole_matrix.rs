//! Tests pairs long enough for many strips against the whole matrix. Results must be bit-identical.

use crate::oracle;
use calib_dtw::{
    Branch, Dtw, Ends, InstructionSet, LocalDistance, Normalisation, Series, Settings, Step,
    StepPattern, Window,
};
use proptest::prelude::*;

/// Compares distance and path with the oracle, for every instruction set.
fn compare(pattern: &StepPattern, settings: Settings, query: Series<'_>, reference: Series<'_>) {
    let plain = Dtw::with_settings(pattern.clone(), settings);
    let expected = oracle::distance(&plain, query, reference);
    let what = format!("{pattern} {}x{} {settings:?}", query.len(), reference.len());
    for set in InstructionSet::available() {
        let dtw = plain.clone().instruction_set(set).expect("available");
        assert_eq!(dtw.distance(query, reference).ok(), expected, "{what} {set}");
    }
    let Some(expected) = expected else { return };
    let alignment = plain.align(query, reference).expect("a path");
    assert_eq!(alignment.distance, expected);
    assert_path(pattern, settings, (query, reference), &alignment.path, expected.end, &what);
}

/// Checks that the path follows branches of the pattern from begin to end, and that its cost is the
/// distance.
fn assert_path(
    pattern: &StepPattern,
    settings: Settings,
    (query, reference): (Series<'_>, Series<'_>),
    path: &[(usize, usize)],
    end: usize,
    what: &str,
) {
    let local: Vec<f64> = path
        .iter()
        .map(|&(i, j)| settings.local_distance.between(query.sample(i), reference.sample(j)))
        .collect();
    assert_eq!(path.last(), Some(&(query.len() - 1, end)), "{what}");
    let g = oracle::cumulated(pattern, settings, query, reference);
    // The cost of each cell that branches can reach so far along the path. Branches list their
    // cells.
    let mut reached = vec![f64::INFINITY; path.len() + 1];
    reached[0] = 0.0;
    if !settings.ends.open_begin() {
        assert_eq!(path[0], (0, 0), "{what}");
        reached[1] = local[0];
    }
    for last in 0..path.len() {
        for branch in pattern.branches() {
            let to = path[last];
            let (a, b) = branch.origin();
            // An open begin has no cost in the virtual row above the first, and does not list it.
            let real = branch.cells().filter(|cell| cell.query <= to.0).count();
            let Some(first) = (last + 1).checked_sub(real) else { continue };
            let from = match (first, settings.ends.open_begin()) {
                (0, true) => None,
                (0, false) => continue,
                _ => Some(path[first - 1]),
            };
            let joined = match from {
                Some(from) => (from.0 + a, from.1 + b) == to,
                None => to.0 + 1 == a && to.1 >= b,
            };
            let cells = branch.cells().filter(|cell| cell.query <= to.0);
            let cells = cells.zip(&path[first..=last]);
            let same =
                cells.clone().all(|(cell, &at)| (at.0 + cell.query, at.1 + cell.reference) == to);
            if joined && same {
                let cost = cells.zip(&local[first..=last]);
                let cost = cost.map(|((cell, _), local)| cell.weight * local).reduce(|s, d| s + d);
                let total = reached[first] + cost.expect("steps");
                if total == g[to.0][to.1] {
                    reached[last + 1] = reached[last + 1].min(total);
                }
            }
        }
    }
    let last = path[path.len() - 1];
    assert_eq!(reached[path.len()], g[last.0][last.1], "{what}: {path:?}");
}

#[test]
fn every_pattern_agrees_over_several_strips() {
    let query = oracle::series(7, 150);
    let reference = oracle::series(8, 131);
    let query = Series::new(&query);
    let reference = Series::new(&reference);
    for pattern in StepPattern::all().chain(oracle::unusual_patterns()) {
        for window in [
            Window::None,
            Window::SakoeChiba { radius: 25 },
            Window::Slanted { radius: 6 },
            Window::Itakura,
        ] {
            let settings = Settings { window, ..Settings::default() };
            compare(&pattern, settings, query, reference);
        }
    }
}

#[test]
fn every_ends_agree_over_several_strips() {
    let query = oracle::series(9, 140);
    let reference = oracle::series(10, 333);
    let query = Series::new(&query);
    let reference = Series::new(&reference);
    for pattern in StepPattern::all().chain(oracle::unusual_patterns()) {
        for ends in [Ends::OpenEnd, Ends::OpenBegin, Ends::OpenBoth] {
            if ends.open_begin() && pattern.normalisation() != Normalisation::Query {
                continue;
            }
            for window in [Window::None, Window::Slanted { radius: 70 }] {
                let settings = Settings { window, ends, ..Settings::default() };
                compare(&pattern, settings, query, reference);
            }
        }
    }
}

#[test]
fn long_pairs_agree_with_paths_over_many_groups_of_strips() {
    let query = oracle::series(11, 1500);
    let reference = oracle::series(12, 1200);
    for name in ["symmetric2", "asymmetric", "symmetricP1", "rabinerJuang:6c", "rabinerJuang:7d"] {
        let pattern: StepPattern = name.parse().expect(name);
        for window in [Window::None, Window::Slanted { radius: 40 }] {
            let settings = Settings { window, ..Settings::default() };
            compare(&pattern, settings, (&query).into(), (&reference).into());
        }
    }
}

#[test]
fn flat_and_steep_paths_agree_where_a_strip_is_swept_more_than_once() {
    let short = oracle::series(15, 150);
    let long = oracle::series(16, 4000);
    for name in ["symmetric2", "asymmetricP0", "rabinerJuang:1d"] {
        let pattern: StepPattern = name.parse().expect(name);
        let settings = Settings::default();
        compare(&pattern, settings, (&short).into(), (&long).into());
        compare(&pattern, settings, (&long).into(), (&short).into());
    }
}

#[test]
fn channels_agree_for_every_local_distance() {
    let query = oracle::series(13, 3 * 90);
    let reference = oracle::series(14, 3 * 70);
    let query = Series::with_channels(&query, 3).expect("whole samples");
    let reference = Series::with_channels(&reference, 3).expect("whole samples");
    for local_distance in
        [LocalDistance::Absolute, LocalDistance::Squared, LocalDistance::Euclidean]
    {
        let settings = Settings { local_distance, ..Settings::default() };
        compare(&StepPattern::symmetric2(), settings, query, reference);
        compare(&StepPattern::symmetric_p05(), settings, query, reference);
    }
}

fn any_branch() -> impl Strategy<Value = Branch> {
    let step = (0usize..4, 0usize..4, 0u8..5)
        .prop_filter("advances", |(x, y, _)| x + y > 0)
        .prop_map(|(x, y, weight)| Step::new(x, y, f64::from(weight) / 2.0));
    prop::collection::vec(step, 1..4).prop_map(Branch::new)
}

fn any_window() -> impl Strategy<Value = Window> {
    prop_oneof![
        Just(Window::None),
        Just(Window::Itakura),
        (0usize..40).prop_map(|radius| Window::SakoeChiba { radius }),
        (0usize..40).prop_map(|radius| Window::Slanted { radius }),
    ]
}

fn any_ends() -> impl Strategy<Value = Ends> {
    prop_oneof![
        Just(Ends::Closed),
        Just(Ends::OpenEnd),
        Just(Ends::OpenBegin),
        Just(Ends::OpenBoth),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(600))]

    #[test]
    fn any_pattern_window_and_ends_agree(
        branches in prop::collection::vec(any_branch(), 1..6),
        window in any_window(),
        ends in any_ends(),
        (n, m) in (1usize..170, 1usize..170),
        seed in any::<u64>(),
    ) {
        let pattern = StepPattern::new("any", branches, Normalisation::Query).expect("a pattern");
        let (query, reference) = (oracle::series(seed, n), oracle::series(seed ^ 1, m));
        let settings = Settings { window, ends, ..Settings::default() };
        compare(&pattern, settings, (&query).into(), (&reference).into());
    }
}
