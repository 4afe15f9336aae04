//! The recursion written literally, for comparison: the whole matrix, one cell at a time.

use calib_dtw::{
    Branch, Distance, Dtw, Normalisation, Series, Settings, Step, StepPattern, Window,
};

/// Returns a random walk with exact decimals, so that cases print well.
pub(crate) fn series(seed: u64, len: usize) -> Vec<f64> {
    let mut state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ 0xD1B5_4A32_D192_ED03;
    let mut value = 0i64;
    (0..len)
        .map(|_| {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            value += (state % 2001) as i64 - 1000;
            value as f64 / 1000.0
        })
        .collect()
}

/// Whether a path may begin or end a branch in cell (i, j).
pub(crate) fn open(settings: Settings, i: usize, j: usize, n: usize, m: usize) -> bool {
    settings.window == Window::None || settings.window.columns(i, n, m).contains(&j)
}

/// Returns the cumulated distances of all cells; +∞ where no path leads.
pub(crate) fn cumulated(
    pattern: &StepPattern,
    settings: Settings,
    query: Series<'_>,
    reference: Series<'_>,
) -> Vec<Vec<f64>> {
    let n = query.len();
    let m = reference.len();
    let local = |i: isize, j: isize| match usize::try_from(i) {
        Ok(i) => settings.local_distance.between(query.sample(i), reference.sample(j as usize)),
        Err(_) => 0.0,
    };
    let mut g = vec![vec![f64::INFINITY; m]; n];
    for i in 0..n {
        for j in 0..m {
            if !open(settings, i, j, n, m) {
                continue;
            }
            if (i, j) == (0, 0) && !settings.ends.open_begin() {
                g[0][0] = local(0, 0);
                continue;
            }
            let row = i as isize;
            let column = j as isize;
            for branch in pattern.branches() {
                let (a, b) = branch.origin();
                let origin = match (i.checked_sub(a), j.checked_sub(b)) {
                    (Some(i), Some(j)) => g[i][j],
                    (None, Some(_)) if settings.ends.open_begin() && i + 1 == a => 0.0,
                    _ => f64::INFINITY,
                };
                if origin < f64::INFINITY {
                    let cost = branch
                        .cells()
                        .map(|c| {
                            c.weight * local(row - c.query as isize, column - c.reference as isize)
                        })
                        .reduce(|sum, paid| sum + paid)
                        .expect("steps");
                    g[i][j] = g[i][j].min(origin + cost);
                }
            }
        }
    }
    g
}

/// Returns the distance by [`cumulated`], or `None` if there is no path.
pub(crate) fn distance(dtw: &Dtw, query: Series<'_>, reference: Series<'_>) -> Option<Distance> {
    let g = cumulated(dtw.pattern(), dtw.settings(), query, reference);
    let n = query.len();
    let m = reference.len();
    let first = if dtw.settings().ends.open_end() { 0 } else { m - 1 };
    let mut best: Option<(f64, Distance)> = None;
    for (end, &raw) in g[n - 1].iter().enumerate().skip(first) {
        let normalised = dtw.pattern().normalise(raw, n, end + 1);
        let rank = normalised.unwrap_or(raw);
        if raw < f64::INFINITY && best.is_none_or(|(least, _)| rank < least) {
            let distance = Distance { raw, normalised, end };
            best = Some((rank, distance));
        }
    }
    best.map(|(_, distance)| distance)
}

/// Returns patterns without a compiled shape.
pub(crate) fn unusual_patterns() -> Vec<StepPattern> {
    vec![
        pattern("rigid", vec![vec![(1, 1, 1.0)]], Normalisation::Query),
        pattern(
            "mori",
            vec![
                vec![(1, 1, 2.0), (1, 0, 1.0)],
                vec![(1, 1, 3.0)],
                vec![(1, 1, 3.0), (0, 1, 3.0)],
                vec![(5, 4, 2.5)],
            ],
            Normalisation::Reference,
        ),
        pattern(
            "reference first",
            vec![
                vec![(0, 1, 0.5), (1, 1, 0.5)],
                vec![(2, 0, 2.0)],
                vec![(1, 1, 1.0)],
                vec![(1, 4, 1.0)],
            ],
            Normalisation::Query,
        ),
        pattern(
            "reference only",
            vec![vec![(0, 1, 1.0)], vec![(0, 2, 0.25)]],
            Normalisation::Query,
        ),
    ]
}

/// Returns a pattern whose branches have steps along the query and the reference, with weights.
fn pattern(
    name: &str,
    branches: Vec<Vec<(usize, usize, f64)>>,
    normalisation: Normalisation,
) -> StepPattern {
    let branches: Vec<_> = branches
        .into_iter()
        .map(|steps| {
            let steps = steps.into_iter().map(|(x, y, w)| Step::new(x, y, w));
            Branch::new(steps.collect::<Vec<_>>())
        })
        .collect();
    StepPattern::new(name, branches, normalisation).expect("a pattern")
}
