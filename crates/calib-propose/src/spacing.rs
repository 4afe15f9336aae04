use calib_data::Sketch;

use crate::{Scope, Size};

/// Candidate distances between states, in rows of the log.
const SPACINGS: [usize; 11] = [1, 2, 3, 5, 10, 15, 20, 30, 60, 100, 200];
/// Neighbouring states with a higher autocorrelation, for most of the fastest channels, are hardly distinguishable.
const ALIKE: f64 = 0.98;
/// Fewest states in a horizon, if the log is dense enough.
const LEAST_AHEAD: f64 = 5.0;
/// Fewest desired states in the training range.
const LEAST_STATES: usize = 1_000;

/// Returns the values of `preprocess.subsample` that deserve a trial model. The first is the best if its rollouts neither
/// circle nor replay the log: at this distance the fastest quarter of the channels has lost some of its autocorrelation.
///
/// At smaller distances, the neighbours of a state are its own predecessors and successors, and rollouts hardly move.
pub fn spacings(sketch: &Sketch, scope: &Scope, train_rows: usize) -> Vec<usize> {
    let first = SPACINGS.into_iter().find(|&lag| quartile(sketch, scope, lag) <= ALIKE);
    let most = (train_rows / LEAST_STATES).max(1);
    let from = first.unwrap_or(1).min(most);
    let worth: Vec<usize> =
        SPACINGS.into_iter().filter(|spacing| (from..=most).contains(spacing)).collect();
    if worth.is_empty() { vec![from] } else { worth }
}

/// Chooses the spacing of a study without a model, and gives the reason in words: the first of [`spacings`], or a smaller one.
/// A smaller one lets four windows fit in the held-out period, and makes a given horizon several states long.
/// `rows` are the numbers of rows of the training range and of the held-out period.
pub fn spacing_by_log(
    sketch: &Sketch,
    scope: &Scope,
    rows: [usize; 2],
    horizon_secs: Option<f64>,
) -> (usize, &'static str) {
    let first = spacings(sketch, scope, rows[0])[0];
    let ahead =
        horizon_secs.map_or(usize::MAX, |secs| (secs / sketch.period_secs / LEAST_AHEAD) as usize);
    let windows = rows[1] / Size::states_of_four_windows(LEAST_AHEAD) as usize;
    let most = ahead.min(windows).max(1);
    let nearer =
        SPACINGS.into_iter().filter(|spacing| *spacing <= most.min(first)).max().unwrap_or(1);
    let why = if nearer < first && ahead <= windows {
        "further apart, --horizon would be fewer than five states"
    } else if nearer < first {
        "further apart, four windows would not fit in the held-out period"
    } else if first == 1 {
        "as the log was recorded"
    } else if quartile(sketch, scope, first) <= ALIKE {
        "the first distance at which the fastest quarter of the channels has changed"
    } else {
        "as far as the training range allows: most channels are slow"
    };
    (nearer, why)
}

/// Returns the lower quartile, over channels, of the autocorrelation at a distance.
fn quartile(sketch: &Sketch, scope: &Scope, lag: usize) -> f64 {
    let known = scope.channels.iter().filter_map(|&channel| {
        let all = &sketch.channels[channel].autocorrelation;
        all.iter().find(|(at, _)| *at >= lag).map(|(_, value)| *value)
    });
    let mut all: Vec<f64> = known.collect();
    all.sort_by(f64::total_cmp);
    all.get(all.len() / 4).copied().unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{sketch, wave};

    fn first(length: f64, rows: usize) -> usize {
        let log = sketch(rows, &[("A", wave(length))]);
        let scope = Scope::of(&log).expect("a channel");
        spacings(&log, &scope, rows)[0]
    }

    #[test]
    fn slow_channels_are_looked_at_further_apart() {
        assert_eq!(first(10.0, 20_000), 1, "cos 36° is 0.81");
        assert_eq!(first(100.0, 20_000), 5, "cos 11° is 0.981, cos 18° is 0.95");
        assert_eq!(first(1_000.0, 2_000), 2, "no further than a thousand states allow");
        assert_eq!(first(100.0, 200), 1);
    }

    #[test]
    fn later_trials_are_further_apart() {
        let log = sketch(20_000, &[("A", wave(10.0))]);
        let scope = Scope::of(&log).expect("a channel");
        assert_eq!(spacings(&log, &scope, 20_000), [1, 2, 3, 5, 10, 15, 20]);
    }

    #[test]
    fn a_horizon_that_was_asked_for_is_several_states_long() {
        let log = sketch(20_000, &[("A", wave(100.0))]);
        let scope = Scope::of(&log).expect("a channel");
        let spacing =
            |horizon: Option<f64>| spacing_by_log(&log, &scope, [13_000, 7_000], horizon).0;
        assert_eq!(spacing(None), 5, "by autocorrelation");
        assert_eq!(spacing(Some(3_600.0)), 5, "twelve states of five minutes");
        assert_eq!(spacing(Some(900.0)), 3, "five states of three minutes");
        assert_eq!(spacing(Some(60.0)), 1, "as near as the log has rows");
        let few = spacing_by_log(&log, &scope, [13_000, 3_000], None);
        assert_eq!(few, (2, "further apart, four windows would not fit in the held-out period"));
    }
}
