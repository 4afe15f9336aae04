//! Figures of the validity report.

use std::path::Path;

use calib_agent::Part;
use calib_base::StepError;
use calib_model_steps::rollouts::figures;
use calib_report::{
    Axis, Cell, Chart, Colour, Dash, OverviewFigure, Point, Scale, ScaleKind, Series, Side, Table,
};
use calib_validity::{Method, MethodSummary, ModelPair, Validity};

use super::{answer::JudgedStudies, show, tables::short};

/// Smallest drawn regret. Smaller ones are drawn here, because a logarithmic axis has no zero.
const FLOOR: f64 = 1e-3;
/// Largest drawn regret.
const CEILING: f64 = 10.0;

pub(super) fn write(directory: &Path, judged: &JudgedStudies) -> Result<(), StepError> {
    for (name, figure) in all(judged) {
        figures::write(directory, name, &figure.figure())?;
    }
    Ok(())
}

pub(super) fn all(judged: &JudgedStudies) -> Vec<(&'static str, OverviewFigure)> {
    let first = judged.validity();
    let mut all = vec![("regret", regrets(first, "")), ("profile", profile(first))];
    let later = judged.scores.iter().skip(1).find(|score| score.part == Part::AfterFirstQuarter);
    all.extend(later.map(|score| {
        let by = format!(". {}", show::of_score(score));
        ("regret-after-first-quarter", regrets(&score.validity, &by))
    }));
    let one_step = "one-step error of the sensor / no change";
    let predictors = [
        ("one-step", one_step, (|model| model.one_step_relative) as fn(&ModelPair) -> Option<f64>),
        ("dtw", "normalised warping distance", |model| model.dtw),
    ];
    for (name, label, value) in predictors {
        all.extend(scatter(first, label, value).map(|figure| (name, figure)));
    }
    all
}

fn in_percent(share: f64) -> f64 {
    100.0 * share
}

/// Returns the ends of the interval of a method's typical regret, in per cent.
fn ends(method: &MethodSummary) -> Option<(f64, f64)> {
    let interval = method.typical_interval?;
    Some((in_percent(interval.low), in_percent(interval.high)))
}

/// Draws the typical regret of each method, with its interval. `by` names the score.
fn regrets(validity: &Validity, by: &str) -> OverviewFigure {
    let methods = &validity.methods;
    let values: Vec<f64> = methods
        .iter()
        .flat_map(|method| {
            let typical = in_percent(method.typical);
            let (low, high) = ends(method).unwrap_or((typical, typical));
            [typical, low, high]
        })
        .collect();
    let series = [("models", true), ("without a model", false)];
    let series = series.into_iter().enumerate().map(|(number, (label, models))| {
        let own = (methods.iter().enumerate())
            .filter(|(_, method)| matches!(method.method, Method::Model(_)) == models);
        let points = own.map(|(place, method)| Point {
            x: place as f64,
            y: in_percent(method.typical),
            interval: ends(method),
        });
        of_points(label, number, broken(points.collect()))
    });
    let title = format!("Typical regret of each way to choose{by}");
    OverviewFigure {
        caption: "Geometric mean over plant–sensor pairs of the error of the choice on held-out data over that of the best setting, minus one, with 95 % intervals over plants. Lower is better. Other plants: the best default of all other plants. Same optimiser: of those with the same optimiser. The best fixed setting and another window are only known afterwards."
            .to_owned(),
        table: Table {
            title: title.clone(),
            columns: ["choice of", "typical regret", "mean regret"].map(str::to_owned).to_vec(),
            rows: methods
                .iter()
                .map(|method| {
                    vec![
                        Cell::Text(method.method.to_string()),
                        Cell::Percent(method.typical),
                        Cell::Percent(method.mean),
                    ]
                })
                .collect(),
            ..Table::default()
        },
        panels: Vec::new(),
        chart: Chart {
            description: "Typical regret of each way to choose, with intervals.".to_owned(),
            title,
            x: Axis {
                label: String::new(),
                scale: Scale::names(methods.iter().map(|method| short(&method.method)).collect()),
            },
            left: Axis { label: "typical regret (%)".to_owned(), scale: Scale::around(&values) },
            right: None,
            series: series.filter(|series| !series.points.is_empty()).collect(),
            rules: Vec::new(),
        },
    }
}

/// Draws the share of pairs with at most a given regret.
fn profile(validity: &Validity) -> OverviewFigure {
    let methods: Vec<&MethodSummary> = validity
        .methods
        .iter()
        .filter(|method| {
            let other = [
                Method::LogReplay,
                Method::Default,
                Method::BestDefault,
                Method::OtherPlants,
                Method::AnotherWindow,
            ];
            method.method.is_model() || other.contains(&method.method)
        })
        .collect();
    let mut rows = Vec::new();
    let series = methods.iter().enumerate().map(|(number, summary)| {
        let own = validity.each.iter().filter(|each| each.method == summary.method);
        let mut regrets: Vec<f64> = own.map(|each| each.regret).collect();
        regrets.sort_by(f64::total_cmp);
        let mut row = vec![Cell::Text(summary.method.to_string())];
        row.extend([0.0, 0.05, 0.2, 1.0].map(|limit| {
            let within = regrets.iter().filter(|&&regret| regret <= limit).count();
            Cell::Percent(within as f64 / regrets.len() as f64)
        }));
        rows.push(row);
        Series {
            label: summary.method.to_string(),
            side: Side::Left,
            colour: Colour::Curve(number),
            dash: if matches!(summary.method, Method::Model(_)) {
                Dash::Solid
            } else {
                Dash::Dashed
            },
            width: 1.8,
            marker: None,
            points: steps(&regrets),
        }
    });
    let title = "How often a choice is how good".to_owned();
    let series = series.collect();
    OverviewFigure {
        caption: "Share of plant–sensor pairs in which the regret is at most so large. Further left and higher is better; \
                  regrets of less than 0.1 % are drawn at the left edge."
            .to_owned(),
        table: Table {
            title: title.clone(),
            columns: ["choice of", "none", "at most 5 %", "at most 20 %", "at most 100 %"]
                .map(str::to_owned)
                .to_vec(),
            rows,
            ..Table::default()
        },
        panels: Vec::new(),
        chart: Chart {
            description: "Share of plant–sensor pairs with at most a regret, for each way to choose."
                .to_owned(),
            title,
            x: Axis {
                label: "regret (%, log scale)".to_owned(),
                scale: Scale { kind: ScaleKind::Log, min: 100.0 * FLOOR, max: 100.0 * CEILING },
            },
            left: Axis { label: "share of pairs (%)".to_owned(), scale: Scale::linear(0.0, 100.0) },
            right: None,
            series,
            rules: Vec::new(),
        },
    }
}

/// Returns a step function that rises at each of the sorted regrets.
fn steps(regrets: &[f64]) -> Vec<Point> {
    let all = regrets.len();
    let at_floor = regrets.iter().filter(|&&regret| regret <= FLOOR).count();
    let mut points = vec![step(FLOOR, at_floor, all)];
    let mut last = 0;
    for (number, &regret) in regrets.iter().enumerate().filter(|(_, regret)| **regret <= CEILING) {
        if regret > FLOOR {
            points.extend([number, number + 1].map(|reached| step(regret, reached, all)));
        }
        last = number + 1;
    }
    points.push(step(CEILING, last, all));
    points
}

/// Returns the point at which `reached` of `all` pairs have at most this regret.
fn step(regret: f64, reached: usize, all: usize) -> Point {
    Point { x: 100.0 * regret, y: 100.0 * reached as f64 / all as f64, interval: None }
}

/// Draws the regret of every model in every pair against a property of the model.
fn scatter(
    validity: &Validity,
    label: &str,
    value: fn(&ModelPair) -> Option<f64>,
) -> Option<OverviewFigure> {
    let mut rows = Vec::new();
    let mut points: Vec<Vec<Point>> = Vec::with_capacity(validity.models.len());
    for name in &validity.models {
        let own =
            validity.each.iter().filter(|regret| regret.method == Method::Model(name.clone()));
        let of_model = own.filter_map(|regret| {
            let pair = &validity.judged[regret.pair];
            let model = pair.models.iter().find(|model| model.model == *name)?;
            let x = value(model).filter(|x| *x > 0.0)?;
            let names = [&pair.plant, &pair.sensor, name].map(|name| Cell::Text(name.clone()));
            rows.push([&names[..], &[Cell::Number(x), Cell::Percent(regret.regret)]].concat());
            Some(Point { x, y: 100.0 * regret.regret.clamp(FLOOR, CEILING), interval: None })
        });
        let mut of_model: Vec<Point> = of_model.collect();
        of_model.sort_by(|a, b| a.x.total_cmp(&b.x));
        points.push(of_model);
    }
    let x: Vec<f64> = points.iter().flatten().map(|point| point.x).collect();
    if x.is_empty() {
        return None;
    }
    let named = validity.models.iter().zip(points).enumerate();
    let series = named.map(|(number, (name, points))| of_points(name, number, broken(points)));
    let title = format!("Regret against {label}");
    Some(OverviewFigure {
        caption: format!(
            "Each point is a model on one sensor of one plant: {label}, and the regret of its choice (0.1 % stands for less). \
             If accuracy decided, points would rise to the right."
        ),
        table: Table {
            title: title.clone(),
            columns: ["plant", "sensor", "model", label, "regret"].map(str::to_owned).to_vec(),
            rows,
            ..Table::default()
        },
        panels: Vec::new(),
        chart: Chart {
            description: format!("Regret of every model in every pair against {label}."),
            title,
            x: Axis { label: format!("{label} (log scale)"), scale: Scale::log_around(&x) },
            left: Axis {
                label: "regret (%, log scale)".to_owned(),
                scale: Scale { kind: ScaleKind::Log, min: 80.0 * FLOOR, max: 120.0 * CEILING },
            },
            right: None,
            series: series.collect(),
            rules: Vec::new(),
        },
    })
}

/// Separates points by missing ones, so that no line connects them.
fn broken(points: Vec<Point>) -> Vec<Point> {
    points
        .into_iter()
        .flat_map(|point| [point, Point { y: f64::NAN, interval: None, ..point }])
        .collect()
}

fn of_points(label: &str, number: usize, points: Vec<Point>) -> Series {
    Series { dash: Dash::Solid, ..Series::numbered(number, label, points) }
}
