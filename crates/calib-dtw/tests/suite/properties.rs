//! Tests properties that hold for any series.

use calib_dtw::{Dtw, Ends, PatternSet, Series, Settings, StepPattern, Window};
use proptest::prelude::*;

use crate::oracle;

fn any_pattern() -> impl Strategy<Value = StepPattern> {
    prop::sample::select(StepPattern::all().collect::<Vec<_>>())
}

fn pair() -> impl Strategy<Value = (Vec<f64>, Vec<f64>)> {
    (any::<u64>(), 1usize..120, 1usize..120)
        .prop_map(|(seed, n, m)| (oracle::series(seed, n), oracle::series(!seed, m)))
}

/// Returns the distance before normalisation, infinite if there is no path.
fn raw(dtw: &Dtw, x: &[f64], y: &[f64]) -> f64 {
    dtw.distance(x, y).map_or(f64::INFINITY, |distance| distance.raw)
}

proptest! {
    #[test]
    fn a_series_is_at_distance_zero_from_itself(pattern in any_pattern(), (x, _) in pair()) {
        let alignment = Dtw::new(pattern).align(&x, &x).expect("the diagonal");
        prop_assert_eq!(alignment.distance.raw, 0.0);
    }

    #[test]
    fn symmetric_patterns_are_symmetric(
        name in prop::sample::select(vec!["symmetric1", "symmetric2", "symmetricP05", "symmetricP1", "symmetricP2", "rabinerJuang:2d", "rabinerJuang:6a"]),
        (x, y) in pair(),
    ) {
        let dtw = Dtw::new(name.parse().expect("a pattern"));
        let (there, back) = (dtw.distance(&x, &y).ok(), dtw.distance(&y, &x).ok());
        prop_assert_eq!(there.map(|d| d.raw), back.map(|d| d.raw));
        prop_assert_eq!(there.map(|d| d.normalised), back.map(|d| d.normalised));
    }

    #[test]
    fn a_wider_window_is_never_worse(pattern in any_pattern(), (x, y) in pair()) {
        let dtw = Dtw::new(pattern);
        let unlimited = raw(&dtw, &x, &y);
        for make in [|radius| Window::SakoeChiba { radius }, |radius| Window::Slanted { radius }] {
            let by_radius: Vec<f64> = [0, 1, 2, 5, 20, 200].into_iter().map(|radius| raw(&dtw.clone().window(make(radius)), &x, &y)).collect();
            prop_assert!(by_radius.is_sorted_by(|narrow, wide| narrow >= wide), "{:?}", by_radius);
            prop_assert_eq!(by_radius[5], unlimited);
        }
        prop_assert!(raw(&dtw.window(Window::Itakura), &x, &y) >= unlimited);
    }

    #[test]
    fn open_ends_are_never_worse_where_the_query_normalises(
        name in prop::sample::select(vec!["asymmetric", "asymmetricP1", "rabinerJuang:3c", "rabinerJuang:6c"]),
        (x, y) in pair(),
    ) {
        let pattern: StepPattern = name.parse().expect("a pattern");
        let [closed, open_end, open_begin, open_both] =
            [Ends::Closed, Ends::OpenEnd, Ends::OpenBegin, Ends::OpenBoth].map(|ends| raw(&Dtw::new(pattern.clone()).ends(ends), &x, &y));
        prop_assert!(open_end <= closed);
        prop_assert!(open_both <= open_begin);
    }

    #[test]
    fn a_set_gives_what_its_patterns_give_alone(
        patterns in prop::collection::vec(any_pattern(), 1..6),
        (x, y) in pair(),
    ) {
        let together = PatternSet::new(patterns.clone(), Settings::default()).distances(&x, &y).expect("good series");
        for (pattern, distance) in patterns.into_iter().zip(together) {
            prop_assert_eq!(Dtw::new(pattern).distance(&x, &y).ok(), distance.ok());
        }
    }
}

#[test]
fn pairs_in_parallel_give_what_one_thread_gives() {
    let series: Vec<Vec<f64>> =
        (0..24).map(|seed| oracle::series(seed, 60 + seed as usize)).collect();
    let pairs: Vec<(Series<'_>, Series<'_>)> =
        series.iter().zip(series.iter().rev()).map(|(x, y)| (x.into(), y.into())).collect();
    let patterns = [StepPattern::symmetric2(), StepPattern::symmetric_p1()];
    let set = PatternSet::new(patterns.clone(), Settings::default());
    let dtw = Dtw::new(patterns[1].clone());
    let [one, four] = [1, 4].map(|threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| (set.distances_of_pairs(&pairs), dtw.distances(&pairs)))
    });
    assert_eq!(one, four);
    for (&(x, y), (both, alone)) in pairs.iter().zip(one.0.iter().zip(&one.1)) {
        assert_eq!(both.as_ref().unwrap()[1].as_ref().ok(), alone.as_ref().ok());
        assert_eq!(alone, &dtw.distance(x, y));
    }
}
