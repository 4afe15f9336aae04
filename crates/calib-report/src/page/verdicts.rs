//! The first section of the report, with the verdicts.

use calib_core::{is_many_times, number, percent};
use maud::{Markup, html};

use super::document::Section;
use super::tables::table;
use super::text::prose;
use crate::report::{are_of_several_models, caveats, summary};
use calib_stats::{Bounded, Estimate};

use crate::{Cell, ChoiceBaseline, Reason, Report, Setting, Table, Verdict};

/// Most cards of an overview. More cards are folded, and the table of verdicts comes first.
const MANY_CARDS: usize = 9;

/// Most lines of a summary.
const MANY_LINES: usize = 5;

/// Returns the section: one card per sensor, warnings, and a table of all verdicts.
pub(super) fn verdicts(report: &Report) -> Section {
    let warnings = [caveats(&report.verdicts), report.warnings.clone()].concat();
    let judged = report.verdicts.iter().any(|verdict| verdict.online.is_some());
    let body = html! {
        @if report.verdicts.is_empty() {
            p.empty { "There is no verdict: nothing was swept." }
        }
        @if let Some(predicts) = &report.predicts { p.predicts { (prose(predicts)) } }
        @match summary(report).as_slice() {
            [] => {}
            // The table gives the same in less space.
            many if many.len() > MANY_LINES && report.decision.is_some() => {}
            [one] => { p.summary { (prose(one)) } }
            several => { ul.summary { @for line in several { li { (prose(line)) } } } }
        }
        @if let Some(decision) = &report.decision { (table(decision, "decision")) }
        @if report.verdicts.len() > MANY_CARDS {
            (all_verdicts(report))
            details.many { summary { "Each verdict with its reasons (" (report.verdicts.len()) ")" } (cards(report)) }
        } @else {
            (cards(report))
        }
        @if judged && report.verdicts.iter().any(|verdict| verdict.has_costs() && !verdict.is_simpler_better()) {
            p.caption {
                "Regret: how much larger the prediction error on held-out data is than with the best setting of each window. A bar is full at 50 %, and the line in it ends at the 95 % upper bound over windows. Another held-out window: the cost of choosing by one other window of the held-out period."
            }
        }
        @if report.verdicts.iter().any(Verdict::is_simpler_better) {
            p.caption {
                "NRMSE: the prediction error on held-out data, or on windows of the log where held-out data can show nothing, divided by the spread of returns in the training range. A bar is full at 1, the error of always predicting their mean. The chosen simple predictor did best on windows of the log, unless held-out data clearly prefers another. One may have less error here, which nobody knew beforehand."
            }
        }
        @if !warnings.is_empty() {
            div.warnings role="note" {
                h3 { "Before you rely on this" }
                ul { @for warning in &warnings { li { (prose(warning)) } } }
            }
        }
        @if (1..=MANY_CARDS).contains(&report.verdicts.len()) { (all_verdicts(report)) }
    };
    Section { id: "verdict", title: "Verdict", parts: Vec::new(), body }
}

fn cards(report: &Report) -> Markup {
    html! { div.cards { @for verdict in &report.verdicts { (card(verdict, report)) } } }
}

fn all_verdicts(report: &Report) -> Markup {
    let judged = report.verdicts.iter().any(|verdict| verdict.online.is_some());
    html! {
        (table(&comparison(report).without_empty_columns(), "verdicts"))
        @if judged { (table(&alternatives(report).without_empty_columns(), "alternatives")) }
        @if report.verdicts.iter().any(|verdict| !verdict.simple.is_empty()) {
            (table(&beside_simple(report).without_empty_columns(), "simple"))
        }
        @if let Some(parts) = parts(report) { (table(&parts, "parts")) }
    }
}

/// Returns a card: the advice and its cost. The reasons are folded.
fn card(verdict: &Verdict, report: &Report) -> Markup {
    html! {
        article class={ "card " (verdict.class()) } {
            p.badge { (verdict.badge()) }
            h3 {
                @if are_of_several_models(&report.verdicts) { (verdict.model) ": " }
                (prose(&verdict.headline()))
            }
            p.plain { (prose(&verdict.plain())) }
            @if verdict.is_simpler_better() {
                (errors(verdict))
            } @else if verdict.has_costs() {
                (costs(verdict))
            }
            details.why open[report.verdicts.len() == 1] {
                summary { "Why" }
                ul { @for reason in verdict.reasons() { li { (prose(&reason)) } } }
            }
        }
    }
}

/// Other selection methods on a card, with their names there.
const OTHER_WAYS: [(&str, ChoiceBaseline); 4] = [
    ("Default", ChoiceBaseline::Default),
    ("Log replay", ChoiceBaseline::LogReplay),
    ("Another held-out window", ChoiceBaseline::AnotherWindow),
    ("Any setting, on average", ChoiceBaseline::Random),
];

/// Returns the costs of the choice and of other selection methods.
fn costs(verdict: &Verdict) -> Markup {
    let unknown = if verdict.has_all_diverged() { "diverged" } else { "not checked" };
    html! {
        dl.costs {
            @if let Some(online) = &verdict.online {
                (cost("This choice", Some(&verdict.chosen), online.regret, unknown))
            }
            @for (name, baseline) in OTHER_WAYS {
                @if let Some(other) = verdict.alternative(baseline) {
                    (cost(name, other.value.as_ref(), other.regret, unknown))
                }
            }
        }
    }
}

/// Returns the errors of the chosen agent and of simple predictors, if the advice is a simple predictor.
fn errors(verdict: &Verdict) -> Markup {
    let online = verdict.online.as_ref().map(|online| online.chosen_error);
    let agent = verdict.agent_on_log.or(online);
    let used = verdict.simple_to_use();
    html! {
        dl.costs {
            @if let Some(agent) = agent { (error("Chosen agent", agent)) }
            @for row in &verdict.simple {
                @let label = row.predictor.label();
                @if used == Some(row.predictor) {
                    (error(&format!("{label} (chosen)"), row.error))
                } @else {
                    (error(label, row.error))
                }
            }
        }
    }
}

/// Returns an NRMSE as a number, and as a bar that is full at 1, the error of the mean.
fn error(name: &str, error: f64) -> Markup {
    html! {
        div {
            dt { (name) }
            dd { @if error.is_finite() { "NRMSE " (number(error)) } @else { "diverged" } }
            span.bar aria-hidden="true" {
                span style={ "width:" (format!("{:.0}", error.clamp(0.0, 1.0) * 100.0)) "%" } {}
            }
        }
    }
}

/// Returns the cost of one selection method as a number (or the word for `unknown`), and as a bar that is full at 50 %.
fn cost(name: &str, value: Option<&Setting>, regret: Option<Bounded>, unknown: &str) -> Markup {
    html! {
        div {
            dt { (name) @if let Some(value) = value { " " code { (value) } } }
            dd {
                @match regret.map(|regret| regret.value) {
                    Some(regret) if regret.is_finite() => { (percent(regret)) " regret" }
                    Some(_) => { "diverged" }
                    None => { (unknown) }
                }
            }
            @if let Some(regret) = regret {
                span.bar aria-hidden="true" {
                    span style={ "width:" (format!("{:.0}", bar_percent(regret.value))) "%" } {}
                    @if let Some(upper) = regret.upper {
                        i style={
                            "left:" (format!("{:.1}", bar_percent(regret.value))) "%;width:"
                            (format!("{:.1}", bar_percent(upper) - bar_percent(regret.value))) "%"
                        } {}
                    }
                }
            }
        }
    }
}

/// Returns the percentage of a bar that a regret fills. A regret of 50 % fills it.
fn bar_percent(regret: f64) -> f64 {
    (regret / 0.5).clamp(0.0, 1.0) * 100.0
}

fn comparison(report: &Report) -> Table {
    let field = common_field(&report.verdicts);
    let columns = [
        "Sensor",
        "Model",
        "Advice",
        field.unwrap_or("Choice"),
        "Grade",
        "Tied with",
        "Worst rank",
        "Held-out error",
        "Best held-out error",
        "Skill",
        "Regret",
        "95 %",
        "Stability",
        "Or next to it",
    ];
    Table {
        title: "All verdicts".to_owned(),
        caption: format!(
            "Held-out error is the mean NRMSE of the choice over the held-out windows. NRMSE divides by the spread of returns in the training range: 1 is \
             the error of their mean. Skill compares with another mean, that of each held-out window, which is only known afterwards: 0 is as good as that. Regret is how much worse the choice is than the best setting of each window, with its upper bound over windows. Stability is the share of resamples (of {}) that would choose the same setting, or one next to it on the grid. Another log of the same plant agrees less often.",
            if report.has_models() {
                "models, runs and windows of this log"
            } else {
                "windows of this log"
            }
        ),
        columns: columns.map(ToOwned::to_owned).to_vec(),
        rows: report.verdicts.iter().map(|verdict| row(verdict, field)).collect(),
        best: None,
    }
}

/// Returns choice and advice by each part of the runs, one row per sensor and part. `None` if only one part is known.
fn parts(report: &Report) -> Option<Table> {
    if report.verdicts.iter().all(|verdict| verdict.parts.len() < 2) {
        return None;
    }
    let columns = [
        "Sensor",
        "Model",
        "Part of each run",
        "Setting by it",
        "Advice by it",
        "Compared with",
        "Setting's error, divided by that",
        "From",
        "To",
        "Error of the verdict's choice",
        "Error in the first tenth",
    ];
    let table = Table {
        title: "By part of the run".to_owned(),
        caption: "What calib would choose and advise if errors over this part of each run counted (`sweep.scored`). The error of this setting is divided by that of a simple predictor over the same part: the predictor to use instead, or else the one that the log prefers. The quotient is a geometric mean over windows, with its 95 % interval. Below 1 the agent is better. Error of the verdict's choice: over this part of the held-out runs. Error in the first tenth: the share of its squared error that the verdict's choice makes while it starts up. An even share is a tenth."
            .to_owned(),
        columns: columns.map(ToOwned::to_owned).to_vec(),
        rows: report.verdicts.iter().flat_map(rows_of_parts).collect(),
        best: None,
    };
    Some(table.without_empty_columns())
}

/// Returns one row for each part of the runs. The share of the start-up is about whole runs, so the first row has it.
fn rows_of_parts(verdict: &Verdict) -> Vec<Vec<Cell>> {
    let shares = [verdict.start_up_share].into_iter().chain(std::iter::repeat(None));
    let rows = verdict.parts.iter().zip(shares).map(|(part, share)| {
        let [low, high] = interval_cells(part.ratio);
        vec![
            Cell::Text(verdict.sensor.clone()),
            model(verdict),
            Cell::Text(part.part.to_owned()),
            Cell::Setting(part.chosen.clone()),
            Cell::Text(part.advice()),
            part.compared
                .map_or(Cell::Missing, |predictor| Cell::Text(predictor.label().to_owned())),
            part.ratio.map(|ratio| ratio.value).into(),
            low,
            high,
            part.error.into(),
            percent_cell(share),
        ]
    });
    rows.collect()
}

/// Returns the ends of the interval of a ratio.
fn interval_cells(ratio: Option<Estimate>) -> [Cell; 2] {
    let interval = ratio.and_then(|ratio| ratio.interval);
    interval.map_or([Cell::Missing, Cell::Missing], |interval| {
        [interval.low, interval.high].map(Cell::Number)
    })
}

/// Returns the errors of the simple predictors, and those of the chosen agents divided by them.
fn beside_simple(report: &Report) -> Table {
    let rows = report.verdicts.iter().flat_map(|verdict| {
        verdict.simple.iter().map(move |simple| {
            let ratio: Cell = simple.ratio.map(|ratio| ratio.value).into();
            let ends = interval_cells(simple.ratio);
            let names = [Cell::Text(verdict.sensor.clone()), model(verdict)];
            let predictor = Cell::Text(simple.predictor.label().to_owned());
            let errors = [predictor, Cell::Number(simple.error), ratio];
            names.into_iter().chain(errors).chain(ends).collect()
        })
    });
    Table {
        title: "Beside simple predictors".to_owned(),
        caption: "The error of each simple predictor, and the error of the chosen agent divided by it: geometric mean over held-out windows, or over those of the log where nothing is held out, with its 95 % interval. Below 1 the agent is better."
            .to_owned(),
        columns: ["Sensor", "Model", "Predictor", "Error", "Agent's, divided by it", "From", "To"]
            .map(ToOwned::to_owned)
            .to_vec(),
        rows: rows.collect(),
        best: None,
    }
}

/// Returns the costs of the choices and of other selection methods.
fn alternatives(report: &Report) -> Table {
    let ways = [
        ("Default", ChoiceBaseline::Default),
        ("Log replay", ChoiceBaseline::LogReplay),
        ("Latest window", ChoiceBaseline::LatestWindow),
        ("Any setting, on average", ChoiceBaseline::Random),
        ("Best fixed setting, in hindsight", ChoiceBaseline::Hindsight),
        ("Another window", ChoiceBaseline::AnotherWindow),
    ];
    Table {
        title: "Other ways to choose, and agreement".to_owned(),
        caption: format!(
            "The regret on held-out data of the choice, and of what other ways would have chosen. Then how far {} ranking of all settings agrees with that of held-out data.",
            if report.has_models() { "the model's" } else { "the log's" }
        ),
        columns: ["Sensor", "Model", "This choice"]
            .into_iter()
            .chain(ways.map(|(name, _)| name))
            .chain(["Spearman", "Kendall", "Top k"])
            .map(str::to_owned)
            .collect(),
        rows: report
            .verdicts
            .iter()
            .map(|verdict| {
                let names = [Cell::Text(verdict.sensor.clone()), model(verdict)];
                let others =
                    ways.iter().map(|&(_, baseline)| percent_cell(verdict.regret_of(baseline)));
                let costs = [percent_cell(verdict.regret())].into_iter().chain(others);
                names.into_iter().chain(costs).chain(agreement(verdict)).collect()
            })
            .collect(),
        best: None,
    }
}

/// Returns the correlations of the rankings, and whether the choice is among the best.
fn agreement(verdict: &Verdict) -> [Cell; 3] {
    let online = verdict.online.as_ref();
    let top = online.and_then(|online| online.top_k).map_or(Cell::Missing, |top| {
        Cell::Text(format!("{} top {}", if top.hit { "in" } else { "not in" }, top.k))
    });
    [
        correlation(online.and_then(|online| online.spearman)),
        correlation(online.and_then(|online| online.kendall)),
        top,
    ]
}

/// Formats a number between −1 and 1.
fn correlation(value: Option<f64>) -> Cell {
    value.map_or(Cell::Missing, |value| Cell::Text(format!("{value:.2}")))
}

/// Returns the model that chose, if there is one. A column without any model is left out.
fn model(verdict: &Verdict) -> Cell {
    if verdict.has_model() { Cell::Text(verdict.model.clone()) } else { Cell::Missing }
}

/// Returns the hyperparameter, if all verdicts are about the same one.
fn common_field(verdicts: &[Verdict]) -> Option<&str> {
    let first = &verdicts.first()?.field;
    verdicts.iter().all(|verdict| verdict.field == *first).then_some(first)
}

/// Returns a row. `field` is the hyperparameter of all rows, which then stands in the heading.
fn row(verdict: &Verdict, field: Option<&str>) -> Vec<Cell> {
    let online = verdict.online.as_ref();
    let ties: Vec<String> = verdict
        .tie_set
        .iter()
        // Other selection methods do not use worst ranks, and have separated these settings.
        .filter(|value| verdict.reason == Reason::WorstRank && **value != verdict.chosen)
        .map(ToString::to_string)
        .collect();
    let upper = online.and_then(|online| online.regret?.upper);
    let same = verdict.stability.iter().find(|(value, _)| *value == verdict.chosen);
    vec![
        Cell::Text(verdict.sensor.clone()),
        model(verdict),
        Cell::Text(verdict.advice()),
        match field {
            Some(_) => Cell::Setting(verdict.chosen.clone()),
            None => Cell::Text(format!("{} = {}", verdict.field, verdict.chosen)),
        },
        Cell::Text(verdict.grade.word().to_owned()),
        if ties.is_empty() { Cell::Missing } else { Cell::Text(ties.join(", ")) },
        if verdict.has_model() {
            Cell::Text(format!("{} of {}", verdict.worst_rank, verdict.values))
        } else {
            Cell::Missing
        },
        online.map(|online| online.chosen_error).into(),
        online.map_or(Cell::Missing, |online| {
            Cell::Text(format!("{} ({})", number(online.best_error), online.best))
        }),
        correlation(online.and_then(|online| online.chosen_skill)),
        percent_cell(verdict.regret()),
        upper.map_or(Cell::Missing, |upper| Cell::Text(upper_bound(upper))),
        percent_cell(same.map(|&(_, share)| share)),
        percent_cell(verdict.stability_nearby),
    ]
}

/// Returns "up to 4 %"; for a bound without a number, the words in its place.
fn upper_bound(upper: f64) -> String {
    if is_many_times(upper) { percent(upper) } else { format!("up to {}", percent(upper)) }
}

/// Returns the share, if there is one.
fn percent_cell(share: Option<f64>) -> Cell {
    share.map_or(Cell::Missing, Cell::Percent)
}
