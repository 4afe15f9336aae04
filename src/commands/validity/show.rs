//! The judgement for people: tables on the terminal, and the same for the page.

use calib_report::{Cell, Table};
use calib_stats::Interval;
use calib_validity::{
    Accuracy, Comparison, Method, MethodSummary, Outcome, Pair, Predictor, RankAgreement,
};

use super::Judgement;
use crate::output::{Printer, percent, table};

/// Print all tables.
pub(super) fn show(judgement: &Judgement, printer: &Printer) -> anyhow::Result<()> {
    printer.result(&subtitle(judgement))?;
    for of in tables(judgement) {
        printer.result("")?;
        printer.result(&of.title)?;
        let header: Vec<&str> = of.columns.iter().map(String::as_str).collect();
        let rows: Vec<Vec<String>> =
            of.rows.iter().map(|row| row.iter().map(text).collect()).collect();
        printer.lines(&table(&header, &rows))?;
    }
    printer.result("")?;
    for finding in findings(judgement) {
        printer.result(&finding)?;
    }
    Ok(())
}

fn text(cell: &Cell) -> String {
    match cell {
        Cell::Text(text) => text.clone(),
        Cell::Number(value) => crate::output::significant(*value),
        Cell::Percent(share) => percent(*share),
        Cell::Count(value) => value.to_string(),
        Cell::Setting(setting) => setting.to_string(),
        Cell::Missing => "–".to_owned(),
    }
}

/// What was judged, in a line.
pub(super) fn subtitle(judgement: &Judgement) -> String {
    let validity = &judgement.validity;
    format!(
        "{} plant–sensor pairs of {} plants, {} values of the grid; intervals over plants, {} resamples",
        validity.pairs,
        validity.plants.len(),
        validity.values.len(),
        crate::output::count(validity.resamples)
    )
}

/// All tables, the most important first.
pub(super) fn tables(judgement: &Judgement) -> Vec<Table> {
    let validity = &judgement.validity;
    let mut tables = vec![methods("Regret", &validity.methods)];
    let of_models: Vec<&Comparison> = validity.comparisons.iter().collect();
    tables.push(comparisons("Two by two", &of_models));
    tables.push(agreement(&validity.agreement));
    tables.push(methods("Rules of choice", &validity.rules));
    let of_rules: Vec<&Comparison> = validity.rule_comparisons.iter().collect();
    tables.push(comparisons("Rules against the worst rank", &of_rules));
    tables.push(accuracy(&validity.accuracy));
    tables.push(each(judgement));
    tables.retain(|table| !table.rows.is_empty());
    tables
}

fn methods(title: &str, methods: &[MethodSummary]) -> Table {
    let rows = methods.iter().map(|of| {
        vec![
            Cell::Text(of.method.to_string()),
            Cell::Count(of.pairs as u64),
            Cell::Percent(of.mean),
            shares(of.interval),
            Cell::Percent(of.typical),
            shares(of.typical_interval),
            Cell::Percent(of.median),
            Cell::Percent(of.good),
            Cell::Count(of.diverged as u64),
        ]
    });
    of(
        title,
        "Regret is how much larger the Online error of the choice is than that of the best value. Typical: the geometric \
         mean of the errors over the best ones, minus one, which no single pair can dominate.",
        &[
            "choice of",
            "pairs",
            "mean regret",
            "95 %",
            "typical",
            "95 %",
            "median",
            "within 5 %",
            "diverged",
        ],
        rows.collect(),
    )
}

fn comparisons(title: &str, comparisons: &[&Comparison]) -> Table {
    let rows = comparisons.iter().map(|of| {
        vec![
            Cell::Text(of.method.to_string()),
            Cell::Text(of.against.to_string()),
            Cell::Text(format!("{} / {} / {}", of.wins, of.ties, of.losses)),
            points(of.difference),
            of.interval.map_or(Cell::Missing, |of| {
                Cell::Text(format!("{} to {}", percent_points(of.low), percent_points(of.high)))
            }),
            of.error_ratio.map_or(Cell::Missing, |ratio| Cell::Text(format!("{ratio:.3}"))),
            of.error_ratio_interval
                .map_or(Cell::Missing, |of| Cell::Text(format!("{:.3} to {:.3}", of.low, of.high))),
        ]
    });
    of(
        title,
        "Wins, ties and losses by regret, pair by pair. The difference is of mean regrets, in percentage points; the ratio is the \
         geometric mean of the Online errors' quotients: below 1 the first is better.",
        &[
            "choice of",
            "against",
            "wins / ties / losses",
            "difference",
            "95 %",
            "error ratio",
            "95 %",
        ],
        rows.collect(),
    )
}

fn agreement(agreement: &[RankAgreement]) -> Table {
    let number = |value: f64| Cell::Text(format!("{value:.2}"));
    let rows = agreement.iter().map(|of| {
        let interval = of.interval.map(|of| format!("{:.2} to {:.2}", of.low, of.high));
        vec![
            Cell::Text(of.model.clone()),
            Cell::Count(of.pairs as u64),
            number(of.mean),
            interval.map_or(Cell::Missing, Cell::Text),
            number(of.smallest),
        ]
    });
    of(
        "Agreement of rankings with Online",
        "Spearman's correlation of the model's ranking of the values with their Online errors, mean over pairs.",
        &["model", "pairs", "mean", "95 %", "smallest"],
        rows.collect(),
    )
}

fn accuracy(all: &[Accuracy]) -> Table {
    let rows = all.iter().filter_map(|of| {
        let correlation = of.correlation?;
        let predictor = match of.predictor {
            Predictor::OneStep => "one-step error of the sensor",
            Predictor::OneStepAll => "one-step error of all columns",
            Predictor::Dtw => "warping distance",
        };
        let outcome = match of.outcome {
            Outcome::Regret => "regret",
            Outcome::Disagreement => "disagreement of rankings",
        };
        let interval = of.interval.map(|of| format!("{:.2} to {:.2}", of.low, of.high));
        Some(vec![
            Cell::Text(predictor.to_owned()),
            Cell::Text(outcome.to_owned()),
            Cell::Count(of.pairs as u64),
            Cell::Count(of.models as u64),
            Cell::Text(format!("{correlation:.2}")),
            interval.map_or(Cell::Missing, Cell::Text),
        ])
    });
    of(
        "Does the more accurate model choose better?",
        "Rank correlation over models within each plant–sensor pair, pooled. 1: always; 0: accuracy says nothing; below 0: the more \
         accurate model chooses worse.",
        &["less", "and less", "pairs", "models", "correlation", "95 %"],
        rows.collect(),
    )
}

/// Regret of every method in every pair.
fn each(judgement: &Judgement) -> Table {
    let Judgement { pairs, validity, .. } = judgement;
    let methods: Vec<&Method> = validity.methods.iter().map(|of| &of.method).collect();
    let regret = |pair: usize, method: &Method| {
        let found = validity.each.iter().find(|of| of.pair == pair && of.method == *method);
        found.map_or(Cell::Missing, |of| Cell::Percent(of.regret))
    };
    let row = |(number, pair): (usize, &Pair)| {
        let best = pair.online.iter().enumerate().min_by(|(_, a), (_, b)| a.total_cmp(b));
        let best = best.map_or("", |(value, _)| &validity.values[value]);
        let names = [&pair.plant, &pair.sensor].map(|name| Cell::Text(name.clone()));
        let regrets = methods.iter().map(|method| regret(number, method));
        names.into_iter().chain([Cell::Text(best.to_owned())]).chain(regrets).collect()
    };
    let mut columns = vec!["plant".to_owned(), "sensor".to_owned(), "best value".to_owned()];
    columns.extend(methods.iter().map(|method| short(method)));
    let rows = pairs.iter().enumerate().map(row).collect();
    Table {
        title: "Regret in every pair".to_owned(),
        caption: String::new(),
        columns,
        rows,
        best: None,
    }
}

/// A method in a narrow column or on an axis.
pub(super) fn short(method: &Method) -> String {
    match method {
        Method::MostAccurate => "least 1-step".to_owned(),
        Method::LeastWarped => "least DTW".to_owned(),
        Method::BestDefault => "hindsight".to_owned(),
        Method::OtherPlants => "other plants".to_owned(),
        Method::Default => "default".to_owned(),
        Method::Random => "random".to_owned(),
        other => other.to_string(),
    }
}

/// What was found, in sentences.
pub(super) fn findings(judgement: &Judgement) -> Vec<String> {
    let validity = &judgement.validity;
    let against = |method: &MethodSummary, other: &Method| -> Option<String> {
        let of = validity.comparisons.iter();
        let of = of.clone().find(|of| of.method == method.method && of.against == *other)?;
        let ratio = of.error_ratio?;
        let share = if ratio < 1.0 {
            format!("{} less", percent(1.0 - ratio))
        } else {
            format!("{} more", percent(ratio - 1.0))
        };
        let certain = of.error_ratio_interval.is_some_and(|of| of.high < 1.0 || of.low > 1.0);
        let certain = if certain { "" } else { ", which may be chance" };
        Some(format!("{share} error than {other}{certain}"))
    };
    let models = validity.methods.iter().filter(|of| matches!(of.method, Method::Model(_)));
    models
        .map(|of| {
            let others = [Method::OtherPlants, Method::LogReplay, Method::Random];
            let others: Vec<String> =
                others.iter().filter_map(|other| against(of, other)).collect();
            let others =
                if others.is_empty() { String::new() } else { format!(": {}", others.join("; ")) };
            format!(
                "{} chooses with a typical regret of {} over {} pairs{others}.",
                of.method,
                percent(of.typical),
                of.pairs
            )
        })
        .collect()
}

fn shares(interval: Option<Interval>) -> Cell {
    interval.map_or(Cell::Missing, |Interval { low, high }| {
        Cell::Text(format!("{} to {}", percent(low), percent(high)))
    })
}

fn points(difference: Option<f64>) -> Cell {
    difference.map_or(Cell::Missing, |share| Cell::Text(percent_points(share)))
}

/// A difference of shares with its sign, in percentage points.
fn percent_points(share: f64) -> String {
    format!("{:+.1}", 100.0 * share)
}

fn of(title: &str, caption: &str, columns: &[&str], rows: Vec<Vec<Cell>>) -> Table {
    Table {
        title: title.to_owned(),
        caption: caption.to_owned(),
        columns: columns.iter().map(|&name| name.to_owned()).collect(),
        rows,
        best: None,
    }
}
