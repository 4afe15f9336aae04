//! Tests which inputs are refused, and with which messages.

use calib_dtw::{
    Branch, Dtw, DtwError, Ends, LocalDistance, Normalisation, PatternSet, Role, Series, Settings,
    Step, StepPattern, Window,
};

fn message(error: impl std::fmt::Display) -> String {
    error.to_string()
}

#[test]
fn empty_series_are_named() {
    let dtw = Dtw::new(StepPattern::symmetric2());
    let empty: [f64; 0] = [];
    let error = dtw.distance(&empty, &[1.0]).unwrap_err();
    assert_eq!(error, DtwError::Empty { role: Role::Query });
    let error = dtw.align(&[1.0], &empty).unwrap_err();
    assert_eq!(message(error), "the reference is empty: expected at least one sample");
}

#[test]
fn values_that_are_not_finite_are_located() {
    let dtw = Dtw::new(StepPattern::symmetric2());
    let error = dtw.distance(&[0.0, f64::NAN], &[1.0]).unwrap_err();
    assert_eq!(
        message(error),
        "sample 1, channel 0 of the query is NaN: expected finite values; \
         fill or drop missing samples first"
    );
    let values = [0.0, 1.0, 2.0, f64::INFINITY];
    let pairs = Series::with_channels(&values, 2).unwrap();
    let good = Series::with_channels(&[0.0, 1.0], 2).unwrap();
    let error = dtw.distance(good, pairs).unwrap_err();
    assert!(message(error).starts_with("sample 1, channel 1 of the reference is inf"));
}

#[test]
fn shapes_must_fit() {
    let error = Series::with_channels(&[0.0; 5], 2).unwrap_err();
    assert_eq!(message(error), "5 values are no whole number of samples of 2 channels");
    assert!(Series::with_channels(&[0.0; 5], 0).is_err());
    let two = Series::with_channels(&[0.0; 4], 2).unwrap();
    let dtw = Dtw::new(StepPattern::symmetric2());
    let error = dtw.distance(two, &[0.0; 4]).unwrap_err();
    assert_eq!(
        message(error),
        "the query has 2 channels, the reference 1: expected the same number"
    );
}

#[test]
fn sums_that_could_overflow_are_refused() {
    let huge = [1e300, -1e300];
    let dtw = Dtw::new(StepPattern::symmetric2());
    assert!(dtw.distance(&huge, &[0.0]).is_ok());
    let squared = dtw.local_distance(LocalDistance::Squared);
    let error = squared.distance(&huge, &[0.0]).unwrap_err();
    assert!(message(error).starts_with("values up to 1e300 overflow"));
}

#[test]
fn lengths_beyond_the_slope_limits_say_what_would_do() {
    let dtw = Dtw::new(StepPattern::symmetric_p1());
    let error = dtw.distance(&[0.0; 10], &[0.0; 20]).unwrap_err();
    let text = "no admissible path for a query of 10 and a reference of 20 samples: step pattern \
                `symmetricP1` advances 0.500 to 2.000 reference samples a query sample, which for \
                this query allows references of 6 to 19 samples";
    assert!(message(&error).starts_with(text), "{error}");
    let DtwError::NoPath(no_path) = error else { panic!("{error}") };
    assert_eq!(no_path.reference_limits(), (6, Some(19)));
    // The limits in the message are exactly what is possible.
    assert!(dtw.distance(&[0.0; 10], &[0.0; 19]).is_ok());
    assert!(dtw.distance(&[0.0; 10], &[0.0; 6]).is_ok());
    assert!(dtw.distance(&[0.0; 10], &[0.0; 5]).is_err());
}

#[test]
fn lengths_that_no_combination_of_steps_fits_are_told_apart() {
    let steps = Branch::new([Step::new(2, 2, 1.0)]);
    let pattern = StepPattern::new("even", [steps], Normalisation::Query).unwrap();
    let dtw = Dtw::new(pattern);
    assert!(dtw.distance(&[0.0; 5], &[0.0; 5]).is_ok());
    let error = dtw.distance(&[0.0; 4], &[0.0; 4]).unwrap_err();
    assert!(
        message(error)
            .ends_with("references of 4 to 4 samples, but no combination of its steps fits these")
    );
}

#[test]
fn a_window_that_forbids_every_path_is_named() {
    let window = Window::SakoeChiba { radius: 3 };
    let dtw = Dtw::new(StepPattern::symmetric2()).window(window);
    let error = dtw.distance(&[0.0; 10], &[0.0; 20]).unwrap_err();
    assert!(message(error).ends_with("the window sakoeChiba:3 may forbid more: widen it"));
}

#[test]
fn an_open_begin_needs_a_pattern_normalised_by_the_query() {
    let dtw = Dtw::new(StepPattern::symmetric2()).ends(Ends::OpenBoth);
    let error = dtw.distance(&[0.0; 3], &[0.0; 9]).unwrap_err();
    assert!(message(error).contains("`symmetric2` cannot have an open begin"));
}

#[test]
fn patterns_of_a_set_fail_one_by_one() {
    let patterns = [StepPattern::symmetric2(), StepPattern::symmetric_p1()];
    let set = PatternSet::new(patterns, Settings::default());
    let distances = set.distances(&[0.0; 3], &[1.0; 9]).unwrap();
    assert_eq!(distances[0].as_ref().unwrap().raw, 11.0);
    assert_eq!(distances[1].as_ref().unwrap_err().reference_limits(), (2, Some(5)));
    assert!(set.distances(&[f64::NAN], &[1.0]).is_err());
}
