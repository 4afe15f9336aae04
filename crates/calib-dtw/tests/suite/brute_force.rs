//! Tests every pattern against an enumeration of all paths of short pairs.

use crate::oracle;
use calib_dtw::{Dtw, Ends, InstructionSet, Series, Settings, StepPattern, Window};

/// Returns the minimum cost over all paths from cell (i, j), reached at `cost`, to an end.
fn walk(
    dtw: &Dtw,
    pair: (Series<'_>, Series<'_>),
    (i, j): (isize, usize),
    cost: f64,
    best: &mut f64,
) {
    let (query, reference) = pair;
    let n = query.len();
    let m = reference.len();
    let settings = dtw.settings();
    let at_end = i == n as isize - 1 && (j == m - 1 || settings.ends.open_end());
    if at_end {
        *best = best.min(cost);
    }
    for branch in dtw.pattern().branches() {
        let (a, b) = branch.origin();
        let end = (i + a as isize, j + b);
        // A path leaves the virtual row of an open begin at once.
        if end.0 < 0 || end.0 >= n as isize || end.1 >= m {
            continue;
        }
        if !oracle::open(settings, end.0 as usize, end.1, n, m) {
            continue;
        }
        let mut cost = cost;
        let mut at = (i, j);
        for step in branch.steps() {
            at = (at.0 + step.query as isize, at.1 + step.reference);
            if let Ok(row) = usize::try_from(at.0) {
                let x = query.sample(row);
                let y = reference.sample(at.1);
                cost += step.weight * settings.local_distance.between(x, y);
            }
        }
        walk(dtw, pair, end, cost, best);
    }
}

fn least(dtw: &Dtw, query: Series<'_>, reference: Series<'_>) -> Option<f64> {
    let mut best = f64::INFINITY;
    let n = query.len();
    let m = reference.len();
    if dtw.settings().ends.open_begin() {
        for column in 0..m {
            walk(dtw, (query, reference), (-1, column), 0.0, &mut best);
        }
    } else if oracle::open(dtw.settings(), 0, 0, n, m) {
        let first = dtw.settings().local_distance;
        let first = first.between(query.sample(0), reference.sample(0));
        walk(dtw, (query, reference), (0, 0), first, &mut best);
    }
    (best < f64::INFINITY).then_some(best)
}

#[test]
fn distances_are_the_least_over_all_paths() {
    let windows = [
        Window::None,
        Window::SakoeChiba { radius: 1 },
        Window::Slanted { radius: 1 },
        Window::Itakura,
    ];
    let mut found = 0;
    for pattern in StepPattern::all().chain(oracle::unusual_patterns()) {
        for (seed, (n, m)) in
            [(1, 1), (1, 4), (4, 1), (5, 5), (6, 4), (4, 6)].into_iter().enumerate()
        {
            let query = oracle::series(seed as u64, n);
            let reference = oracle::series(seed as u64 + 100, m);
            let query = Series::new(&query);
            let reference = Series::new(&reference);
            for window in windows {
                for ends in [Ends::Closed, Ends::OpenEnd, Ends::OpenBegin, Ends::OpenBoth] {
                    let settings = Settings { window, ends, ..Settings::default() };
                    let dtw = Dtw::with_settings(pattern.clone(), settings);
                    let needs_query_length = ends.open_begin();
                    if needs_query_length
                        && pattern.normalisation() != calib_dtw::Normalisation::Query
                    {
                        assert!(dtw.distance(query, reference).is_err());
                        continue;
                    }
                    // With an open end the smallest normalised distance wins. It is the smallest
                    // raw distance only where the length of the reference does not matter.
                    if ends.open_end()
                        && pattern.normalise(1.0, 1, 2) != pattern.normalise(1.0, 1, 3)
                    {
                        continue;
                    }
                    let expected = least(&dtw, query, reference);
                    for set in InstructionSet::available() {
                        let dtw = dtw.clone().instruction_set(set).expect("available");
                        let ours = dtw.distance(query, reference).ok().map(|d| d.raw);
                        let agree = match (ours, expected) {
                            (Some(a), Some(b)) => (a - b).abs() <= 1e-12 * b.max(1.0),
                            (a, b) => a == b,
                        };
                        assert!(
                            agree,
                            "{pattern} {n}x{m} {settings:?} {set}: {ours:?}, expected {expected:?}"
                        );
                        found += usize::from(ours.is_some());
                    }
                }
            }
        }
    }
    assert!(found > 1000);
}
