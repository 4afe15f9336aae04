//! Tests of figures: their content, and data that cannot be drawn.

use calib_report::{
    Dash, Figure, LearningEnvironment, ReportError, RolloutFigure, ScaleKind, Sensitivity, Setting,
    Side,
};

use crate::fixture::{self, grid, learning, recorded, rollout, sensitivity};

/// Reads width and height from the header of a PNG file.
fn png_size(bytes: &[u8]) -> (u32, u32) {
    assert_eq!(bytes[..8], *b"\x89PNG\r\n\x1a\n");
    let [width, height] =
        [16, 20].map(|at: usize| u32::from_be_bytes(bytes[at..at + 4].try_into().unwrap()));
    (width, height)
}

fn svg_size(figure: &Figure) -> (u32, u32) {
    let svg = figure.svg();
    let view = svg.split("viewBox=\"0 0 ").nth(1).unwrap().split('"').next().unwrap();
    let mut sides = view.split(' ').map(|side| side.parse().unwrap());
    (sides.next().unwrap(), sides.next().unwrap())
}

#[test]
fn png_has_twice_the_size_of_svg() {
    for figure in [sensitivity("PIT300").figure().unwrap(), rollout(500).figure().unwrap()] {
        let (width, height) = svg_size(&figure);
        let (png_width, png_height) = png_size(&figure.png().unwrap());
        assert_eq!(png_width, 2 * width);
        assert!(png_height.abs_diff(2 * height) <= 2);
    }
}

#[test]
fn a_sensitivity_figure_has_scores_left_ranks_right_and_a_mark_at_the_choice() {
    let chart = sensitivity("PIT300").figure().unwrap().chart().clone();
    let sides: Vec<Side> = chart.series.iter().map(|series| series.side).collect();
    assert_eq!(sides, [Side::Left, Side::Left, Side::Right]);
    assert_eq!(chart.series[0].points[3].y, f64::INFINITY);
    assert_eq!(
        chart.series[2].points.iter().map(|point| point.y).collect::<Vec<_>>(),
        [3.0, 1.0, 2.0, 4.0]
    );
    assert_eq!(
        chart.rules.iter().map(|rule| rule.label.as_str()).collect::<Vec<_>>(),
        ["chosen 1e-4", "default 1e-3"]
    );
}

#[test]
fn small_svg() {
    let mut figure = sensitivity("PIT300");
    for curve in &mut figure.errors {
        curve.summaries.truncate(2);
    }
    figure.errors.truncate(1);
    figure.worst_ranks[0].worst_ranks = vec![2, 1];
    figure.worst_ranks[0].label = "kNN".to_owned();
    figure.values.truncate(2);
    figure.default = None;
    let svg = figure.figure().unwrap().svg();
    let curves = &svg[svg.find("<g class=\"series\"").unwrap()..];
    // One element per line makes the snapshot easier to review.
    insta::assert_snapshot!(curves.replace("><", ">\n<"), @r##"
<g class="series" data-series="0" clip-path="url(#figure-clip0)">
<g class="scaled">
<path class="area c0" d="M125.5 213.4l729.9 217.5l0 -98.3l-729.9 -217.5z" fill="#0072b2" fill-opacity="0.18"/>
<path class="line c0" d="M125.5 213.4l0 -98.3" fill="none" stroke="#0072b2" stroke-width="1.4" stroke-linejoin="round" vector-effect="non-scaling-stroke"/>
<path class="line c0" d="M121.5 213.4l8 0" fill="none" stroke="#0072b2" stroke-width="1.4" stroke-linejoin="round" vector-effect="non-scaling-stroke"/>
<path class="line c0" d="M121.5 115.1l8 0" fill="none" stroke="#0072b2" stroke-width="1.4" stroke-linejoin="round" vector-effect="non-scaling-stroke"/>
<path class="line c0" d="M855.4 430.9l0 -98.3" fill="none" stroke="#0072b2" stroke-width="1.4" stroke-linejoin="round" vector-effect="non-scaling-stroke"/>
<path class="line c0" d="M851.4 430.9l8 0" fill="none" stroke="#0072b2" stroke-width="1.4" stroke-linejoin="round" vector-effect="non-scaling-stroke"/>
<path class="line c0" d="M851.4 332.6l8 0" fill="none" stroke="#0072b2" stroke-width="1.4" stroke-linejoin="round" vector-effect="non-scaling-stroke"/>
<path class="line c0" d="M125.5 164.2l729.9 217.6" fill="none" stroke="#0072b2" stroke-width="2.6" stroke-linejoin="round" vector-effect="non-scaling-stroke"/>
</g>
<circle class="symbol c0" transform="translate(125.5 164.2)" fill="#0072b2" r="4"/>
<circle class="symbol c0" transform="translate(855.4 381.8)" fill="#0072b2" r="4"/>
</g>
<g class="series" data-series="1" clip-path="url(#figure-clip0)">
<g class="scaled">
<path class="line c1" d="M125.5 115.1l729.9 315.8" fill="none" stroke="#d55e00" stroke-width="1.8" stroke-linejoin="round" vector-effect="non-scaling-stroke" stroke-dasharray="7 4"/>
</g>
<path class="symbol c1" transform="translate(125.5 115.1)" fill="#d55e00" d="M-3.6 -3.6l7.2 0l0 7.2l-7.2 0z"/>
<path class="symbol c1" transform="translate(855.4 430.9)" fill="#d55e00" d="M-3.6 -3.6l7.2 0l0 7.2l-7.2 0z"/>
</g>
</svg>
"##);
}

#[test]
fn curves_run_from_left_to_right_whatever_the_order_of_the_grid() {
    let mut figure = sensitivity("PIT300");
    figure.values.reverse();
    let chart = figure.figure().unwrap().chart().clone();
    for series in &chart.series {
        assert!(series.points.windows(2).all(|pair| pair[0].x < pair[1].x));
    }
    assert_eq!(chart.series[0].points[0].y, f64::INFINITY);
}

#[test]
fn names_are_shown_in_grid_order() {
    let mut figure = sensitivity("PIT300");
    figure.values = ["adam", "sgd", "none", "other"].map(Setting::from).to_vec();
    let svg = figure.figure().unwrap().svg();
    let places = ["adam", "sgd", "other"].map(|name| svg.find(&format!(">{name}<")).unwrap());
    assert!(places[0] < places[1] && places[1] < places[2]);
}

#[test]
fn every_rollout_gets_its_own_panel_over_the_truth() {
    let svg = rollout(100).figure().unwrap().svg();
    assert_eq!(
        svg.matches("class=\"line truth\"").count(),
        1 + 2 * 2,
        "legend, and two pieces around the gap in each panel"
    );
    assert_eq!(svg.matches("time since start (s)").count(), 1);
    assert_eq!(svg.matches("<clipPath").count(), 2);
}

#[test]
fn the_sensitivity_of_all_sensors_is_one_figure_with_one_legend() {
    let all = ["PIT300", "TIT101", "TUIT101", "FIT101"].map(sensitivity);
    let figure = Sensitivity::panels(&all).unwrap();
    let svg = figure.svg();
    for sensor in ["PIT300", "TIT101", "TUIT101", "FIT101"] {
        assert_eq!(svg.matches(&format!(">{sensor}<")).count(), 1, "{sensor}");
    }
    assert_eq!(svg.matches(">Log replay<").count(), 1, "one legend");
    assert_eq!(svg.matches(">diverged<").count(), 1);
    assert_eq!(svg.matches("<clipPath").count(), 4);
    assert_eq!(svg.matches(">mean NRMSE<").count(), 2, "once a row");
    png_size(&figure.png().unwrap());
    assert!(Sensitivity::panels(&[]).is_err());
}

#[test]
fn rollouts_from_the_same_starts_stand_beside_what_was_recorded() {
    let mut grid = grid(500);
    let figure = grid.figure().unwrap();
    let svg = figure.svg();
    for text in ["recorded, kPa", "year", "week", "start 1", "start 2"] {
        assert_eq!(svg.matches(&format!(">{text}<")).count(), 1, "{text}");
    }
    assert_eq!(svg.matches("<clipPath").count(), 5, "the place of a missing rollout stays free");
    assert_eq!(svg.matches("time since start").count(), 2, "below the last plot of two columns");
    png_size(&figure.png().unwrap());

    // A runaway model must not flatten the others.
    grid.rows[0].rollouts[1].as_mut().unwrap().values[100] = 1e30;
    assert_eq!(grid.figure().unwrap().chart().left.scale, {
        grid.rows[0].rollouts[1].as_mut().unwrap().values[100] = 1e3;
        grid.figure().unwrap().chart().left.scale.clone()
    });
    grid.rows.clear();
    assert!(grid.figure().unwrap_err().to_string().contains("PIT300"));
}

#[test]
fn a_spike_is_drawn_and_a_runaway_presses_nothing_flat() {
    let mut figure = fixture::long_rollout();
    figure.rollouts[0].values[12_345] = -13.0;
    let chart = figure.figure().unwrap().chart().clone();
    assert!(chart.series[1].points.iter().any(|point| point.y == -13.0));
    figure.rollouts[1].values[20_000..].fill(5e34);
    let scale = figure.figure().unwrap().chart().left.scale.clone();
    assert!(scale.max < 10.0, "{scale:?}");
}

#[test]
fn a_learning_curve_ends_in_a_cross_where_a_run_diverged() {
    let mut curves = learning("PIT300", LearningEnvironment::Member { number: 0, model: None });
    let figure = curves.figure().unwrap();
    let chart = figure.chart();
    let ends: Vec<f64> =
        chart.series.iter().map(|series| series.points.last().unwrap().x).collect();
    assert_eq!(ends, [1000.0, 1000.0, 1000.0, 600.0]);
    let points = &chart.series[3].points;
    assert!(points[28].y.is_finite() && points[29].y.is_infinite(), "{points:?}");
    assert!(chart.series[0].points.iter().all(|point| point.interval.is_some()));
    assert_eq!((chart.x.scale.min, chart.x.scale.max), (0.0, 1000.0));

    // A curve that explodes midway is cut off, so that the others stay distinguishable.
    for (_, summary) in curves.curves[2].points.iter_mut().skip(10) {
        summary.mean = 1e30;
    }
    let exploding = curves.figure().unwrap();
    let scale = &exploding.chart().left.scale;
    assert_eq!(scale.kind, ScaleKind::Log);
    assert!(scale.max < 1e3, "{scale:?}");

    // If there are more settings than colours, curves differ by their dashes.
    let curve = curves.curves[0].clone();
    curves.curves = vec![curve; 9];
    let many = curves.figure().unwrap();
    assert_eq!(
        (many.chart().series[5].dash, many.chart().series[6].dash),
        (Dash::Solid, Dash::Dashed)
    );

    for curve in &mut curves.curves {
        curve.points.clear();
    }
    let error = curves.figure().unwrap_err().to_string();
    assert!(
        error.contains("PIT300: learning curves, ensemble member 0") && error.contains("points"),
        "{error}"
    );
}

#[test]
fn recorded_periods_stand_below_each_other_on_one_vertical_axis() {
    let figure = recorded("PIT300", 200).figure().unwrap();
    let svg = figure.svg();
    for heading in
        ["training: 2022-11-01 00:00 to 2022-11-08 00:00, between -2.23 and 3", "april: "]
    {
        assert!(svg.contains(heading), "{heading}");
    }
    // 199 minutes from 2022-10-31 23:46:40 have ticks at half hours.
    assert!(svg.contains(">00:30<") && svg.contains(">03:00<"), "dates along the axis");
    assert_eq!(figure.chart().title, "PIT300: recorded in each period");
    let told = &figure.chart().description;
    assert!(
        told.contains("training: 2022-11-01 00:00 to 2022-11-08 00:00, between -2.23 and 3;"),
        "{told}"
    );
    assert!(told.contains("between -1.23 and 4;"), "{told}");
    let scale = &figure.chart().left.scale;
    assert!(scale.min < -2.2 && scale.max > 5.0, "all values of all periods: {scale:?}");
    // A gap breaks the line of the last period in two.
    let lines =
        svg.matches("class=\"line ink\"").count() + svg.matches("class=\"line c0\"").count();
    assert_eq!(lines, 4);
    let (width, height) = svg_size(&figure);
    assert!(width == 960 && height > 3 * 110, "{width} x {height}");
    png_size(&figure.png().unwrap());
}

#[test]
fn periods_without_values_are_left_out_and_none_is_an_error() {
    let mut figure = recorded("PIT300", 200);
    figure.periods[1].points.clear();
    figure.periods[2].points.truncate(1);
    let svg = figure.figure().unwrap().svg();
    assert!(!svg.contains("april") && !svg.contains("NaN"));
    for period in &mut figure.periods {
        period.points.iter_mut().for_each(|point| point.1 = f64::NAN);
    }
    insta::assert_snapshot!(figure.figure().unwrap_err().to_string(), @r#"
figure "PIT300: recorded in each period" has no values; expected at least one
"#);
}

#[test]
fn long_trajectories_are_thinned() {
    let chart = fixture::long_rollout().figure().unwrap().chart().clone();
    for series in &chart.series {
        assert!(series.points.len() <= calib_report::MAX_POINTS);
        assert!(series.points.len() > calib_report::MAX_POINTS / 2);
    }
    assert_eq!(chart.x.label, "time since start (h)");
}

fn message(result: Result<Figure, ReportError>) -> String {
    result.unwrap_err().to_string()
}

#[test]
fn what_cannot_be_drawn_is_an_error_that_says_what_is_wrong() {
    let mut figure = sensitivity("PIT300");
    figure.errors[0].summaries.pop();
    insta::assert_snapshot!(message(figure.figure()), @r#"
curve "Online" of figure "PIT300: sensitivity to learning_rate" has 3 points; expected 4, one for each setting
"#);
    let mut figure = sensitivity("PIT300");
    figure.chosen = Some(4);
    insta::assert_snapshot!(message(figure.figure()), @r#"
the chosen setting of figure "PIT300: sensitivity to learning_rate" is number 4; expected less than 4
"#);
    let mut figure = sensitivity("PIT300");
    figure.values.clear();
    insta::assert_snapshot!(message(figure.figure()), @r#"
figure "PIT300: sensitivity to learning_rate" has no values; expected at least one
"#);
    let mut figure = rollout(10);
    figure.rollouts[0].period_secs = 0.0;
    insta::assert_snapshot!(message(figure.figure()), @r#"
trajectory "kNN" has a sample period of 0 s; expected a positive number
"#);
    let empty = RolloutFigure { truth: None, rollouts: vec![], ..rollout(1) };
    insta::assert_snapshot!(message(empty.figure()), @r#"
figure "PIT300: rollouts over the true trajectory" has no values; expected at least one
"#);
}

#[test]
fn degenerate_figures_are_still_drawn() {
    let mut flat = sensitivity("PIT300");
    flat.values.truncate(1);
    flat.chosen = Some(0);
    flat.default = None;
    for curve in &mut flat.errors {
        curve.summaries.truncate(1);
    }
    flat.worst_ranks[0].worst_ranks.truncate(1);
    let mut missing = sensitivity("PIT300");
    for curve in &mut missing.errors {
        curve.summaries.fill(None);
    }
    let mut negative = sensitivity("PIT300");
    negative.values = [-1.0, 0.0, 1.0, 2.0].map(Setting::from).to_vec();
    let one_point = rollout(1);
    let mut gap_only = rollout(3);
    gap_only.truth = None;
    for trajectory in &mut gap_only.rollouts {
        trajectory.values.fill(f64::NAN);
    }
    let figures =
        [flat.figure(), missing.figure(), negative.figure(), one_point.figure(), gap_only.figure()];
    for figure in figures {
        let figure = figure.unwrap();
        let svg = figure.svg();
        assert!(!svg.contains("NaN") && !svg.contains("inf"), "{svg}");
        png_size(&figure.png().unwrap());
    }
}
