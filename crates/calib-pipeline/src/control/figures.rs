//! Figures of the report on agents that act.

use calib_report::{
    Axis, Cell, Chart, Colour, Dash, Marker, OverviewFigure, Point, Rule, Scale, Series, Side,
    Table,
};
use calib_stats::{Estimate, jackknife};

use super::{
    conduct::{AgentConduct, ColumnConduct, SetValues},
    described::ColumnMap,
    files::ControlEvaluation,
    show,
};

/// Number of columns whose map is drawn.
pub(super) const MAPS: usize = 8;
/// Number of settings whose curves are drawn, besides the default.
const CURVES: usize = 5;

const MARKERS: [Marker; 5] =
    [Marker::Circle, Marker::Square, Marker::Triangle, Marker::Diamond, Marker::TriangleDown];
const DASHES: [Dash; 3] = [Dash::Solid, Dash::Dashed, Dash::Dotted];

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
    if let Some(conduct) = &evaluation.conduct {
        let state = conduct.columns.first();
        let sets = conduct.set.iter().zip(["last-steps-1", "last-steps-2", "last-steps-3"]);
        all.extend(state.into_iter().flat_map(|state| {
            sets.clone().map(|(set, name)| (name, last_steps(conduct, state, set)))
        }));
        let columns = conduct.columns.iter().zip(["taken-1", "taken-2", "taken-3", "taken-4"]);
        all.extend(columns.map(|(column, name)| (name, taken(evaluation, column, conduct.steps))));
    }
    let maps = evaluation.log.map.iter().zip(COVERAGES);
    all.extend(maps.map(|(map, name)| (name, coverage(evaluation, map))));
    all
}

fn series(number: usize, label: &str, points: Vec<Point>) -> Series {
    Series {
        label: label.to_owned(),
        side: Side::Left,
        colour: Colour::Curve(number),
        dash: DASHES[number / 6 % DASHES.len()],
        width: 1.6,
        marker: Some(MARKERS[number % MARKERS.len()]),
        points,
    }
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
    let value = |candidate: usize| evaluation.fields[candidate][field].1.as_str();
    let mut values: Vec<&str> = Vec::new();
    for candidate in 0..evaluation.fields.len() {
        if !values.contains(&value(candidate)) {
            values.push(value(candidate));
        }
    }
    let ways = [("mean of the settings", mean as Pooled), ("best of the settings", highest)];
    let drawn: Vec<Series> = ways
        .iter()
        .enumerate()
        .map(|(number, &(label, pooled))| {
            let points = values.iter().enumerate().map(|(place, own)| {
                let with: Vec<usize> = (0..evaluation.fields.len())
                    .filter(|&candidate| value(candidate) == *own)
                    .filter(|&candidate| !evaluation.has_failed(candidate))
                    .collect();
                let estimate = pooled_return(evaluation, &with, pooled);
                let interval = estimate
                    .and_then(|estimate| estimate.interval)
                    .map(|interval| (interval.low, interval.high));
                let y = estimate.map_or(f64::NAN, |estimate| estimate.value);
                Point { x: place as f64, y, interval }
            });
            series(number, label, points.collect())
        })
        .collect();
    let ends = drawn.iter().flat_map(|series| &series.points).flat_map(|point| {
        let (low, high) = point.interval.unwrap_or((point.y, point.y));
        [point.y, low, high]
    });
    let scale = Scale::linear_around(&ends.filter(|end| end.is_finite()).collect::<Vec<_>>());
    let name = &evaluation.fields[0][field].0;
    let title = format!("Return in the model against {name}");
    let mark = |candidate: usize, label: &str, dash: Dash| {
        let place = values.iter().position(|&other| other == value(candidate)).unwrap_or(0);
        Rule { x: place as f64, label: label.to_owned(), dash }
    };
    let default = evaluation
        .verdict
        .default
        .filter(|&candidate| value(candidate) != value(evaluation.verdict.chosen));
    let mut rules = vec![mark(evaluation.verdict.chosen, "chosen", Dash::Solid)];
    rules.extend(default.map(|candidate| mark(candidate, "default", Dash::Dashed)));
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
    let label = |candidate: usize| {
        let name = show::name(evaluation, candidate);
        match show::role(evaluation, candidate) {
            "" => name,
            role => format!("{name} ({role})"),
        }
    };
    let drawn = with.iter().zip(&curves).enumerate();
    let drawn = drawn
        .map(|(number, (&candidate, curve))| series(number, &label(candidate), points(1.0, curve)));
    let title = "How agents learn in the model".to_owned();
    Some(OverviewFigure {
        caption: "Mean return of the episodes in each tenth of a run, over models and runs: the best settings by rank, and the default. A curve that still rises would gain from more steps."
            .to_owned(),
        table: Table {
            title: title.clone(),
            columns: std::iter::once("tenth".to_owned())
                .chain(with.iter().map(|&candidate| label(candidate)))
                .collect(),
            rows: (0..curves[0].len()).map(|tenth: usize| {
        let shown = curves.iter().map(|curve| Cell::Number(curve[tenth]));
        std::iter::once(Cell::Count(tenth as u64 + 1)).chain(shown).collect()
    }).collect(),
            ..Table::default()
        },
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

/// Draws where along a column the log shows the effect of each action.
fn coverage(evaluation: &ControlEvaluation, map: &ColumnMap) -> OverviewFigure {
    by_parts(&SharesByPart {
        title: format!("Where along {} actions are known", map.column),
        caption: format!(
            "Share of the recorded states in each fifth of {} near which the action was taken. What a choice does where curves are low rests on \
             steps from elsewhere.",
            map.column
        ),
        axis: "states in which it is known (%)",
        column: &map.column,
        upper: &map.upper,
        shares: &map.covered,
        evaluation,
    })
}

/// Draws the actions that the chosen agent takes along a column.
fn taken(evaluation: &ControlEvaluation, column: &ColumnConduct, steps: usize) -> OverviewFigure {
    let visited: Vec<Vec<f64>> = column
        .taken
        .iter()
        .map(|shares| {
            let parts = shares.iter().zip(&column.steps);
            parts.map(|(&share, &steps)| if steps > 0 { share } else { f64::NAN }).collect()
        })
        .collect();
    by_parts(&SharesByPart {
        title: format!("What the chosen agent does along {}", column.column),
        caption: format!(
            "Share of the agent's steps in each fifth of {} in which it takes the action, over the last {steps} steps of its first run in the \
             neighbours of the first ensemble member. Lines have no point where it never was. It goes on exploring, so no share need be 100 %.",
            column.column
        ),
        axis: "steps in which it is taken (%)",
        column: &column.column,
        upper: &column.upper,
        shares: &visited,
        evaluation,
    })
}

/// The share of each action in each part of a column.
struct SharesByPart<'a> {
    title: String,
    caption: String,
    axis: &'a str,
    column: &'a str,
    /// Upper bounds of the parts.
    upper: &'a [f64],
    /// `[actions][parts]`.
    shares: &'a [Vec<f64>],
    evaluation: &'a ControlEvaluation,
}

fn by_parts(shown: &SharesByPart<'_>) -> OverviewFigure {
    let SharesByPart { title, caption, axis, column, upper, shares, evaluation } = shown;
    let actions = &evaluation.log.actions;
    let drawn = actions.iter().zip(*shares).enumerate().map(|(number, (action, shares))| {
        let percent: Vec<f64> = shares.iter().map(|share| 100.0 * share).collect();
        series(number, &action.name, points(0.0, &percent))
    });
    let names: Vec<String> =
        upper.iter().map(|upper| format!("to {}", calib_report::number(*upper))).collect();
    OverviewFigure {
        caption: caption.clone(),
        table: Table {
            title: title.clone(),
            columns: std::iter::once((*column).to_owned())
                .chain(actions.iter().map(|action| action.name.clone()))
                .collect(),
            rows: names
                .iter()
                .enumerate()
                .map(|(part, name)| {
                    let own = shares.iter().map(|shares| match shares[part] {
                        share if share.is_nan() => Cell::Missing,
                        share => Cell::Percent(share),
                    });
                    std::iter::once(Cell::Text(name.clone())).chain(own).collect()
                })
                .collect(),
            ..Table::default()
        },
        chart: Chart {
            description: format!("{title}: {axis} of each action."),
            title: title.clone(),
            x: Axis { label: (*column).to_owned(), scale: Scale::names(names) },
            // Leaves room for whole markers at 100 %.
            left: Axis { label: (*axis).to_owned(), scale: Scale::linear(0.0, 103.0) },
            right: None,
            series: drawn.collect(),
            rules: Vec::new(),
        },
    }
}

/// Draws the last steps of the chosen agent: a state column, and the values that an action column was set to.
fn last_steps(conduct: &AgentConduct, state: &ColumnConduct, set: &SetValues) -> OverviewFigure {
    let first = 1.0 + (conduct.steps - state.values.len()) as f64;
    let line = |values: &[f64], side: Side, number: usize, label: &str| {
        let mut drawn = Vec::new();
        for (step, &y) in values.iter().enumerate() {
            let x = first + step as f64;
            if conduct.begins.contains(&step) {
                // A missing point separates episodes.
                drawn.push(Point { x, y: f64::NAN, interval: None });
            } else if side == Side::Right && step > 0 {
                // A set value holds until the next one.
                drawn.push(Point { x, y: values[step - 1], interval: None });
            }
            drawn.push(Point { x, y, interval: None });
        }
        Series { side, marker: None, ..series(number, label, drawn) }
    };
    let title =
        format!("{} and {} in the last steps of the chosen agent", state.column, set.column);
    let last = first + state.values.len() as f64 - 1.0;
    OverviewFigure {
        caption: "The last steps of the chosen agent's first run, in the neighbours of the first ensemble member. Lines break where an episode begins."
            .to_owned(),
        table: Table {
            title: title.clone(),
            columns: ["step", &state.column, &set.column, "reward"].map(str::to_owned).to_vec(),
            rows: state
                .values
                .iter()
                .zip(&set.values)
                .zip(&conduct.rewards)
                .enumerate()
                .map(|(step, ((&value, &set), &reward))| {
                    let numbers = [value, set, reward].map(Cell::Number);
                    let step = Cell::Count(first as u64 + step as u64);
                    std::iter::once(step).chain(numbers).collect()
                })
                .collect(),
            ..Table::default()
        },
        chart: Chart {
            description: format!("{} and {} against the step.", state.column, set.column),
            title,
            x: Axis { label: "step".to_owned(), scale: Scale::linear(first, last) },
            left: Axis {
                label: state.column.clone(),
                scale: Scale::linear_around(&state.values),
            },
            right: Some(Axis {
                label: set.column.clone(),
                scale: Scale::linear_around(&set.values),
            }),
            series: vec![
                line(&state.values, Side::Left, 0, &state.column),
                line(&set.values, Side::Right, 1, &set.column),
            ],
            rules: Vec::new(),
        },
    }
}
