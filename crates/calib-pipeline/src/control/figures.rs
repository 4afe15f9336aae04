//! Figures of the report on agents that act.

use calib_report::{
    ActionShares, Axis, Cell, Chart, Dash, OverviewFigure, Point, Rule, Scale, Series, Table,
};
use calib_stats::{Estimate, jackknife};

use super::{described::ColumnMap, evaluation::ControlEvaluation, show};

/// Number of columns whose map is drawn.
pub(super) const MAPS: usize = 8;
/// Number of settings whose curves are drawn, besides the default.
const CURVES: usize = 5;

/// Returns all figures with their file names.
pub(super) fn all(evaluation: &ControlEvaluation) -> Vec<(&'static str, OverviewFigure)> {
    const SENSITIVITIES: &[&str] = &[
        "sensitivity-1",
        "sensitivity-2",
        "sensitivity-3",
        "sensitivity-4",
        "sensitivity-5",
        "sensitivity-6",
    ];
    const COVERAGES: [&str; MAPS] = [
        "coverage-1",
        "coverage-2",
        "coverage-3",
        "coverage-4",
        "coverage-5",
        "coverage-6",
        "coverage-7",
        "coverage-8",
    ];
    let fields = evaluation.fields.first().map_or(0, Vec::len);
    let mut all: Vec<_> = (0..fields)
        .zip(SENSITIVITIES)
        .map(|(field, &name)| (name, sensitivity(evaluation, field)))
        .collect();
    all.extend(learning(evaluation).map(|figure| ("learning", figure)));
    let actions: Vec<String> =
        evaluation.log.actions.iter().map(|action| action.name.clone()).collect();
    let conduct = evaluation.conduct.iter();
    let model = "neighbours of the first ensemble member";
    all.extend(conduct.flat_map(|conduct| conduct.figures(&actions, model)));
    let maps = evaluation.log.map.iter().zip(COVERAGES);
    all.extend(maps.map(|(map, name)| (name, coverage(map, &actions))));
    all
}

/// Returns one point per entry of `values`, starting at `first`.
fn points(first: f64, values: &[f64]) -> Vec<Point> {
    let numbered = values.iter().enumerate();
    numbered.map(|(place, &y)| Point { x: first + place as f64, y, interval: None }).collect()
}

/// A function that reduces many numbers to one.
type Pooled = fn(&[f64]) -> f64;

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

fn highest(values: &[f64]) -> f64 {
    values.iter().copied().fold(f64::NEG_INFINITY, f64::max)
}

/// Returns the pooled return of these settings in the model, with its interval over members. `None` without settings.
fn pooled_return(
    evaluation: &ControlEvaluation,
    candidates: &[usize],
    pooled: Pooled,
) -> Option<Estimate> {
    if candidates.is_empty() {
        return None;
    }
    let members = evaluation.verdict.members.iter();
    let returns: Vec<f64> = members
        .map(|returns| {
            let own = candidates.iter().map(|&candidate| returns[candidate]);
            pooled(&own.collect::<Vec<f64>>())
        })
        .collect();
    let mean = calib_stats::mean(&returns).ok()?;
    Some(Estimate { value: mean, interval: jackknife(mean, &returns) })
}

/// Draws the return in the model against one swept field: the mean and the best of the settings with each value, with
/// intervals over members. Settings with which the program failed have no return.
fn sensitivity(evaluation: &ControlEvaluation, field: usize) -> OverviewFigure {
    let swept: Vec<&str> =
        evaluation.fields.iter().map(|fields| fields[field].1.as_str()).collect();
    let mut values: Vec<&str> = Vec::new();
    for &value in &swept {
        if !values.contains(&value) {
            values.push(value);
        }
    }
    let ways = [("mean of the settings", mean as Pooled), ("best of the settings", highest)];
    let drawn: Vec<Series> = ways
        .iter()
        .enumerate()
        .map(|(number, &(label, pooled))| {
            let points = values.iter().enumerate().map(|(place, own)| {
                let with: Vec<usize> = (0..swept.len())
                    .filter(|&candidate| swept[candidate] == *own)
                    .filter(|&candidate| !evaluation.has_failed(candidate))
                    .collect();
                let estimate = pooled_return(evaluation, &with, pooled);
                let interval = estimate
                    .and_then(|estimate| estimate.interval)
                    .map(|interval| (interval.low, interval.high));
                let y = estimate.map_or(f64::NAN, |estimate| estimate.value);
                Point { x: place as f64, y, interval }
            });
            Series::numbered(number, label, points.collect())
        })
        .collect();
    let scale = Series::scale_around(&drawn);
    let name = &evaluation.fields[0][field].0;
    let title = format!("Return in the model against {name}");
    let chosen = swept[evaluation.verdict.chosen];
    let default = evaluation.verdict.default.map(|default| swept[default]);
    let mut rules = vec![mark(&values, chosen, "chosen", Dash::Solid)];
    let default = default.filter(|default| *default != chosen);
    rules.extend(default.map(|default| mark(&values, default, "default", Dash::Dashed)));
    OverviewFigure {
        caption: "Mean return per episode in the model, learning included, over all settings with the value that did not fail, and of the best of them in each ensemble member, with 95 % intervals over blocks of the log. It ranks settings and does not say what the plant will give."
            .to_owned(),
        table: Table {
            title: title.clone(),
            columns: std::iter::once(name.clone())
                .chain(ways.iter().map(|way| way.0.to_owned()))
                .collect(),
            rows: values.iter().enumerate().map(|(place, own)| {
        let shown = drawn.iter().map(|series| match series.points[place].y {
            none if none.is_nan() => Cell::Text(show::FAILED.to_owned()),
            mean => Cell::Number(mean),
        });
        std::iter::once(Cell::Text((*own).to_owned())).chain(shown).collect()
    }).collect(),
            ..Table::default()
        },
        panels: Vec::new(),
        chart: Chart {
            description: format!("Mean return per episode in the model for each {name}."),
            title,
            x: Axis {
                label: name.clone(),
                scale: Scale::names(values.iter().map(|&name| name.to_owned()).collect()),
            },
            left: Axis { label: "return per episode, in the model".to_owned(), scale },
            right: None,
            series: drawn,
            rules,
        },
    }
}

/// Returns the line that marks one of these values.
fn mark(values: &[&str], value: &str, label: &str, dash: Dash) -> Rule {
    let place = values.iter().position(|&other| other == value).unwrap_or(0);
    Rule { x: place as f64, label: label.to_owned(), dash }
}

/// Draws the learning curves of the best settings and the default. `None` if no run had ten episodes.
fn learning(evaluation: &ControlEvaluation) -> Option<OverviewFigure> {
    let order = show::best(evaluation, CURVES);
    let with: Vec<usize> =
        order.into_iter().filter(|&candidate| !evaluation.learning[candidate].is_empty()).collect();
    let curves: Vec<&Vec<f64>> =
        with.iter().map(|&candidate| &evaluation.learning[candidate]).collect();
    let finite: Vec<f64> =
        curves.iter().copied().flatten().copied().filter(|value| value.is_finite()).collect();
    if finite.is_empty() {
        return None;
    }
    let drawn = with.iter().zip(&curves).enumerate();
    let drawn = drawn.map(|(number, (&candidate, curve))| {
        Series::numbered(number, &labelled(evaluation, candidate), points(1.0, curve))
    });
    let title = "How agents learn in the model".to_owned();
    Some(OverviewFigure {
        caption: "Mean return of the episodes in each tenth of a run, over models and runs: the best settings by rank, and the default. A curve that still rises would gain from more steps."
            .to_owned(),
        table: Table {
            title: title.clone(),
            columns: std::iter::once("tenth".to_owned())
                .chain(with.iter().map(|&candidate| labelled(evaluation, candidate)))
                .collect(),
            rows: (0..curves[0].len()).map(|tenth: usize| {
        let shown = curves.iter().map(|curve| Cell::Number(curve[tenth]));
        std::iter::once(Cell::Count(tenth as u64 + 1)).chain(shown).collect()
    }).collect(),
            ..Table::default()
        },
        panels: Vec::new(),
        chart: Chart {
            description: "Return per episode against the part of the run.".to_owned(),
            title,
            x: Axis {
                label: "tenth of the episodes".to_owned(),
                scale: Scale::linear(1.0, curves[0].len() as f64),
            },
            left: Axis {
                label: "return per episode, in the model".to_owned(),
                scale: Scale::linear_around(&finite),
            },
            right: None,
            series: drawn.collect(),
            rules: Vec::new(),
        },
    })
}

/// Returns the name of a setting, with its role if it has one.
fn labelled(evaluation: &ControlEvaluation, candidate: usize) -> String {
    let name = evaluation.setting_name(candidate);
    match show::role(evaluation, candidate) {
        "" => name,
        role => format!("{name} ({role})"),
    }
}

/// Draws where along a column the log shows the effect of each of these actions.
fn coverage(map: &ColumnMap, actions: &[String]) -> OverviewFigure {
    let shares = ActionShares {
        title: format!("Where along {} actions are known", map.column),
        caption: format!(
            "Share of the recorded states in each fifth of {} near which the action was taken. What a choice does where curves are low rests on \
             steps from elsewhere.",
            map.column
        ),
        axis: "states in which it is known (%)",
        column: &map.column,
        upper: &map.upper,
        actions,
        shares: &map.covered,
    };
    shares.figure()
}
