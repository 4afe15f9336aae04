//! The results as tables that fit a terminal.

use calib_base::output::percent;
use calib_report::{Cell, Table};
use calib_stats::Interval;
use calib_validity::{
    Accuracy, Badness, CAP, Comparison, GroupSummary, Method, MethodSummary, Predictor,
    RankAgreement, Validity,
};

use super::{
    answer::Judged,
    cells::{count, quotient, quotients, table},
    claims,
};

/// Returns all tables of a score except that of every pair, the most important first.
pub(super) fn of_score(validity: &Validity) -> Vec<Table> {
    let mut tables = claims::tables(validity);
    tables.insert(1, methods("Regret", &validity.methods));
    tables.insert(2, comparisons("Two by two", &validity.comparisons));
    tables.extend([
        methods("Rules of choice", &validity.rules),
        comparisons("Rules against each other, over all models", &validity.rule_comparisons),
        groups(&validity.groups),
        agreement(&validity.agreement),
        accuracy(&validity.accuracy),
    ]);
    tables.retain(|table| !table.rows.is_empty());
    tables
}

fn methods(title: &str, methods: &[MethodSummary]) -> Table {
    let rows = methods.iter().map(|method| {
        vec![
            Cell::Text(method.method.to_string()),
            count(method.pairs),
            Cell::Percent(method.mean),
            method.upper.map_or(Cell::Missing, Cell::Percent),
            Cell::Percent(method.typical),
            shares(method.typical_interval),
            Cell::Percent(method.worst_tenth),
            count(method.diverged),
        ]
    });
    table(
        title,
        &format!(
            "Regret is how much larger the error of the choice on held-out data is than that of the best setting, as a geometric mean over held-out windows. At most: the 95 % upper bound of the mean, which has no lower one. Typical: the geometric mean of the errors over the best ones, minus one, which no single pair can dominate. Worst tenth: the same over the tenth of the pairs with the largest regrets, at least one pair. In all of them, regrets above {} count as that, also those of choices that diverged.",
            percent(CAP)
        ),
        &["choice of", "pairs", "mean", "at most", "typical", "95 %", "worst tenth", "diverged"],
        rows.collect(),
    )
}

fn comparisons(title: &str, comparisons: &[Comparison]) -> Table {
    let rows = comparisons.iter().map(|comparison| {
        vec![
            Cell::Text(comparison.method.to_string()),
            Cell::Text(comparison.against.to_string()),
            Cell::Text(format!(
                "{} / {} / {}",
                comparison.wins, comparison.ties, comparison.losses
            )),
            quotient(Some(comparison.error_ratio)),
            quotients(comparison.error_ratio_interval),
            Cell::Text(claims::finding(comparison.finding).to_owned()),
        ]
    });
    table(
        title,
        "Wins, ties and losses by regret, pair by pair. The quotient is the geometric mean of the quotients of errors on held-out data: below 1 the first is better. Better and worse: the interval excludes 1. No worse: it ends below 1.01.",
        &["choice of", "against", "wins / ties / losses", "quotient", "95 %", "found"],
        rows.collect(),
    )
}

fn groups(groups: &[GroupSummary]) -> Table {
    let rows = groups.iter().map(|group| {
        vec![
            Cell::Text(format!("{} {}", group.feature, group.group)),
            Cell::Text(group.method.to_string()),
            count(group.plants),
            count(group.pairs),
            Cell::Percent(group.typical),
            shares(group.interval),
            quotient(group.against_default),
            quotients(group.against_default_interval),
        ]
    });
    table(
        "Does choosing well depend on the task?",
        "Typical regret over the pairs whose tasks have something in common, and the quotient of errors against the study's default \
         there. Intervals need eight plants.",
        &["task", "choice of", "plants", "pairs", "typical", "95 %", "/ default", "95 %"],
        rows.collect(),
    )
}

fn agreement(agreement: &[RankAgreement]) -> Table {
    let rows = agreement.iter().map(|agreement| {
        vec![
            Cell::Text(agreement.model.clone()),
            count(agreement.pairs),
            to_hundredths(agreement.mean),
            correlations(agreement.interval),
            to_hundredths(agreement.smallest),
            agreement.stability.map_or(Cell::Missing, Cell::Percent),
            agreement.saved_by_halving.map_or(Cell::Missing, Cell::Percent),
        ]
    });
    table(
        "Agreement of rankings with held-out data, and how firm choices are",
        "Spearman's correlation of the model's ranking of the settings with their regrets on held-out data, mean over pairs. Same choice: the share of resamples (of models, runs and windows of the log) from which the same setting is chosen. A race saves: the share of the updates in models and on the log that sweep.race = \"halving\" would not have made; what it would have chosen is the rule \"halved\".",
        &["model", "pairs", "correlation", "95 %", "smallest", "same choice", "a race saves"],
        rows.collect(),
    )
}

fn to_hundredths(value: f64) -> Cell {
    Cell::Text(format!("{value:.2}"))
}

fn correlations(interval: Option<Interval>) -> Cell {
    interval.map_or(Cell::Missing, |Interval { low, high }| {
        Cell::Text(format!("{low:.2} to {high:.2}"))
    })
}

fn accuracy(all: &[Accuracy]) -> Table {
    let rows = all.iter().filter_map(|accuracy| {
        let correlation = accuracy.correlation?;
        let predictor = match accuracy.predictor {
            Predictor::OneStep => "one-step error of the sensor",
            Predictor::OneStepAll => "one-step error of all columns",
            Predictor::Dtw => "warping distance",
        };
        let outcome = match accuracy.outcome {
            Badness::Regret => "regret",
            Badness::Disagreement => "disagreement of rankings",
        };
        Some(vec![
            Cell::Text(predictor.to_owned()),
            Cell::Text(outcome.to_owned()),
            count(accuracy.pairs),
            count(accuracy.models),
            to_hundredths(correlation),
            correlations(accuracy.interval),
        ])
    });
    table(
        "Does the more accurate model choose better?",
        "Rank correlation over models within each plant–sensor pair, pooled. 1: always; 0: accuracy says nothing; below 0: the more \
         accurate model chooses worse.",
        &["less", "and less", "pairs", "models", "correlation", "95 %"],
        rows.collect(),
    )
}

/// Returns the task of every plant.
pub(super) fn plants(plants: &[Judged]) -> Table {
    table(
        "Plants and tasks",
        "What the agent of each plant is like, and how many steps it learns.",
        &["plant", "optimiser", "agent", "gamma", "steps", "batch"],
        plants
            .iter()
            .map(|Judged { plant, task }| {
                vec![
                    Cell::Text(plant.clone()),
                    Cell::Text(task.optimiser.to_owned()),
                    Cell::Text(task.agent.clone()),
                    Cell::Text(task.gamma.to_string()),
                    count(task.steps),
                    count(task.batch_size),
                ]
            })
            .collect(),
    )
}

/// Returns the regret of every method in every pair.
pub(super) fn each(validity: &Validity) -> Table {
    let methods: Vec<&Method> = validity.methods.iter().map(|summary| &summary.method).collect();
    let mut rows: Vec<Vec<Cell>> = validity
        .judged
        .iter()
        .map(|pair| {
            let regrets = pair.regrets.iter().flatten().copied().enumerate();
            let best = regrets.min_by(|(_, a), (_, b)| a.total_cmp(b));
            let best = best.map_or("", |(value, _)| &validity.values[value]);
            let names = [&pair.plant, &pair.sensor, best].map(|name| Cell::Text(name.to_owned()));
            names.into_iter().chain(methods.iter().map(|_| Cell::Missing)).collect()
        })
        .collect();
    for regret in &validity.each {
        if let Some(place) = methods.iter().position(|method| **method == regret.method) {
            rows[regret.pair][3 + place] = Cell::Percent(regret.regret);
        }
    }
    let names = ["plant", "sensor", "best value"].map(str::to_owned).into_iter();
    Table {
        title: "Regret in every pair".to_owned(),
        columns: names.chain(methods.iter().map(|method| short(method))).collect(),
        rows,
        ..Table::default()
    }
}

/// Returns a short name of a method, for narrow columns and axes.
pub(super) fn short(method: &Method) -> String {
    match method {
        Method::MostAccurate => "least 1-step".to_owned(),
        Method::LeastWarped => "least DTW".to_owned(),
        Method::LogReplay => "log replay".to_owned(),
        Method::LatestWindow => "latest window".to_owned(),
        Method::BestDefault => "best default".to_owned(),
        Method::BestDefaultOfOptimiser => "per optimiser".to_owned(),
        Method::OtherPlants => "other plants".to_owned(),
        Method::OtherPlantsWithOptimiser => "same optimiser".to_owned(),
        Method::Default => "default".to_owned(),
        Method::Random => "random".to_owned(),
        Method::Hindsight => "best constant".to_owned(),
        Method::AnotherWindow => "other window".to_owned(),
        other => other.to_string(),
    }
}

/// Formats an interval of shares with a single unit.
fn shares(interval: Option<Interval>) -> Cell {
    interval.map_or(Cell::Missing, |Interval { low, high }| {
        let low = percent(low);
        let high = percent(high);
        Cell::Text(format!("{} to {high}", low.trim_end_matches(" %")))
    })
}
