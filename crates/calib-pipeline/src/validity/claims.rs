//! The claims to test, and the power of the tests with this many plants.

use calib_base::output::percent;
use calib_report::{Cell, Table};
use calib_validity::{
    Claim, DIFFERENCES, Finding, GOOD, Method, MethodSummary, Outcome, Power, Test, Validity,
};

use super::cells::{at_most, count, quotient, quotients, table};

/// Returns the tables of the tests and their power.
pub(super) fn tables(validity: &Validity) -> Vec<Table> {
    vec![tests(&validity.tests), power(&validity.power)]
}

fn tests(tests: &[Test]) -> Table {
    table(
        "What was to be shown",
        "Claims that were named before anything was run. Yes: the whole 95 % interval over plants lies where the claim has it, or the \
         95 % upper bound of the mean; no: none of the interval does, or of that of the typical regret. No worse: at most 1 % more error.",
        &["choice of", "claim", "found", "95 %", "shown"],
        tests.iter().map(cells).collect(),
    )
}

fn cells(test: &Test) -> Vec<Cell> {
    let (value, interval) = match test.claim {
        Claim::SmallRegret => (Cell::Percent(test.value), at_most(test.upper)),
        Claim::Better | Claim::NoWorse => (quotient(Some(test.value)), quotients(test.interval)),
    };
    let outcome = match test.outcome {
        // Equal choices everywhere are neither worse nor better.
        Outcome::Holds if test.claim == Claim::NoWorse && test.value == 1.0 => "yes, the same",
        Outcome::Holds => "yes",
        Outcome::Fails => "no",
        Outcome::Open => "not told",
    };
    vec![
        Cell::Text(test.method.to_string()),
        Cell::Text(claimed(test)),
        value,
        interval,
        Cell::Text(outcome.to_owned()),
    ]
}

fn claimed(test: &Test) -> String {
    let other = test.against.as_ref().map_or_else(String::new, Method::to_string);
    match test.claim {
        Claim::SmallRegret => format!("mean regret below {}", percent(GOOD)),
        Claim::Better => format!("better than {other}"),
        Claim::NoWorse => format!("no worse than {other}"),
    }
}

fn power(power: &[Power]) -> Table {
    let differences = DIFFERENCES.map(|difference| format!("for {}", percent(difference)));
    let columns = ["choice of", "against", "plants", "deviation", "visible"];
    let columns: Vec<&str> =
        columns.into_iter().chain(differences.iter().map(String::as_str)).collect();
    table(
        "What so many plants can tell",
        "Standard deviation over plants of the plant's mean ln(quotient of errors), the smallest difference of errors that so many \
         plants see with 80 % power at 5 % two-sided, and the plants that it takes to see 1, 2 and 5 %.",
        &columns,
        power
            .iter()
            .map(|power| {
                let needed = power.needed.iter().map(|needed| needed.map_or(Cell::Missing, count));
                [
                    Cell::Text(power.method.to_string()),
                    Cell::Text(power.against.to_string()),
                    count(power.plants),
                ]
                .into_iter()
                .chain([
                    power.std.map_or(Cell::Missing, |std| Cell::Text(format!("{std:.3}"))),
                    power.visible.map_or(Cell::Missing, Cell::Percent),
                ])
                .chain(needed)
                .collect()
            })
            .collect(),
    )
}

/// Returns a word for the finding from an interval of quotients.
pub(super) const fn finding(finding: Finding) -> &'static str {
    match finding {
        Finding::Better => "better",
        Finding::Worse => "worse",
        Finding::NoWorse => "no worse",
        Finding::Untold => "unclear",
    }
}

/// Returns the findings, one sentence per model.
pub(super) fn findings(validity: &Validity) -> Vec<String> {
    let models = validity.methods.iter().filter(|method| method.method.is_model());
    models.map(|method| sentence(method, validity)).collect()
}

fn sentence(method: &MethodSummary, validity: &Validity) -> String {
    let interval = method
        .upper
        .map_or_else(String::new, |upper| format!(" (95 %: at most {})", percent(upper)));
    let floors = validity.methods.iter().filter(|floor| floor.method.is_floor());
    let floors: Vec<String> = floors
        .map(|floor| match floor.method {
            Method::AnotherWindow => {
                format!("choosing by another held-out window {}", percent(floor.mean))
            }
            _ => format!("the best fixed setting {}", percent(floor.mean)),
        })
        .collect();
    let floors = if floors.is_empty() { String::new() } else { format!("; {}", floors.join(", ")) };
    let others = [
        Method::Default,
        Method::BestDefault,
        Method::OtherPlants,
        Method::LogReplay,
        Method::Random,
    ];
    let others: Vec<String> =
        others.iter().filter_map(|other| against(method, other, validity)).collect();
    let others =
        if others.is_empty() { String::new() } else { format!(" It has {}.", others.join("; ")) };
    format!(
        "{} chooses with a mean regret of {}{interval} over {} pairs{floors}.{others}",
        method.method,
        percent(method.mean),
        method.pairs
    )
}

fn against(method: &MethodSummary, other: &Method, validity: &Validity) -> Option<String> {
    let mut comparisons = validity.comparisons.iter();
    let comparison = comparisons
        .find(|comparison| comparison.method == method.method && comparison.against == *other)?;
    let ratio = comparison.error_ratio;
    let share = match percent((ratio - 1.0).abs()) {
        none if none == percent(0.0) => return Some(format!("the same error as {other}")),
        share if ratio < 1.0 => format!("{share} less"),
        share => format!("{share} more"),
    };
    let told = match comparison.finding {
        Finding::Better | Finding::Worse => "",
        Finding::NoWorse => " (no worse by more than 1 %)",
        Finding::Untold => ", which may be chance",
    };
    Some(format!("{share} error than {other}{told}"))
}
