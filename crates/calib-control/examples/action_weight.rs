//! Measures how much a continuous action should count in the distance. The plant is a pendulum whose torque is logged as a number:
//!
//! ```sh
//! cargo run --release -p calib-control --example action_weight -- DIR [LOGS] [TRUTH_RUNS]
//! ```
//!
//! `DIR/truth.json` holds the true mean returns of the 54 settings of the published grid, which choose among five torques.
//! `DIR/weights.jsonl` has one line per log and weight, with the chosen setting. Finished lines are not computed again. Finally the program
//! writes `DIR/weights.md`: means over logs, with 95 % t-intervals.

use std::{
    collections::BTreeMap,
    error::Error,
    fmt::Write as _,
    fs::{self, OpenOptions},
    io::Write as _,
    path::Path,
};

use calib_control::{
    ActionModel, ActionModelConfig, Agent, AgentConfig, Begin, Behaviour, Decisions, Grid, Levels,
    Pendulum, Quality, Question, RunBudget, RunLength, Simulated, Starts, Support, TaskKind, judge,
    record, regret, sweep, truth,
};
use calib_core::{RowIndex, Seed, Silent, States};

use calib_stats::{RankRule, summarise};
use serde_json::{Value, json};

type Outcome<T> = Result<T, Box<dyn Error>>;

const KIND: TaskKind = TaskKind::Pendulum;
const STEPS: usize = 15_000;
const SPAN: RunLength = RunLength { steps: STEPS, timeout: KIND.timeout() };
const WEIGHTS: [f64; 5] = [0.1, 0.3, 1.0, 3.0, 10.0];

fn main() -> Outcome<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let directory = Path::new(arguments.first().ok_or("where to write?")?);
    let logs = number(&arguments, 1, 10)?;
    let truth_runs = number(&arguments, 2, 30)?;
    fs::create_dir_all(directory)?;
    let candidates = Grid::published().candidates(AgentConfig::default())?;
    let truth = true_returns(&directory.join("truth.json"), &candidates, truth_runs)?;
    let path = directory.join("weights.jsonl");
    for log in 0..logs {
        for quality in [Quality::Medium, Quality::Random] {
            for length in [500, 5000] {
                one(&path, (quality, length, log), &candidates, &truth)?;
            }
        }
    }
    table(&path, &truth)
}

/// Returns the number at a place of the arguments, or `default` if there is none.
fn number(arguments: &[String], place: usize, default: usize) -> Outcome<usize> {
    Ok(arguments.get(place).map_or(Ok(default), |text| text.parse())?)
}

/// Returns the true mean return of each setting. Reads it from `path`, or computes it and writes it there.
fn true_returns(path: &Path, candidates: &[AgentConfig], runs: usize) -> Outcome<Vec<f64>> {
    if !path.exists() {
        let budget = RunBudget { runs, span: SPAN };
        let runs = truth(
            || Simulated::new(Pendulum::default(), Begin::AsTheTask),
            candidates,
            budget,
            Seed::new(1),
            &Silent,
        )?;
        fs::write(path, json!(runs).to_string())?;
    }
    let runs: Vec<Vec<f64>> = serde_json::from_slice(&fs::read(path)?)?;
    Ok((0..candidates.len())
        .map(|candidate: usize| {
            runs.iter().map(|run| run[candidate]).sum::<f64>() / runs.len() as f64
        })
        .collect())
}

/// Builds the model of one log with each weight, and chooses a setting in it.
fn one(
    path: &Path,
    (quality, length, number): (Quality, usize, usize),
    candidates: &[AgentConfig],
    truth: &[f64],
) -> Outcome<()> {
    let name = format!("{}/{length}/{number}", quality.name());
    if WEIGHTS.into_iter().all(|weight| is_done(path, &name, weight)) {
        return Ok(());
    }
    let seed = Seed::new(2).child(quality.name()).number(length as u64).number(number as u64);
    let log = log_of(quality, length, candidates, truth, seed)?;
    let starts = starts(&log)?;
    for weight in WEIGHTS.into_iter().filter(|&weight| !is_done(path, &name, weight)) {
        let config = ActionModelConfig { action_weight: weight, ..Default::default() };
        let metric = log.states().clone();
        let worst = KIND.worst_return();
        let model =
            ActionModel::build(log.clone(), &metric, starts.clone(), &config, worst, &Silent)?;
        let budget = RunBudget { runs: 1, span: SPAN };
        let runs = sweep(&model, candidates, budget, seed.child("sweep"), &Silent)?;
        let support = Support { fewest_terminals: 0, ..Support::default() };
        let rule = RankRule::WorstRank;
        let question =
            Question { rule, support, ..Question::new(&log, SPAN.timeout, candidates.len()) };
        let verdict = judge(&runs, &question, seed)?;
        let line = json!({
            "name": name, "weight": weight, "chosen": verdict.chosen,
            "promised": verdict.selection.mean_errors[verdict.chosen],
            "uncovered": verdict.coverage[verdict.chosen].uncovered(),
        });
        writeln!(OpenOptions::new().create(true).append(true).open(path)?, "{line}")?;
    }
    Ok(())
}

/// Whether the file has the line of this log and weight by now.
fn is_done(path: &Path, name: &str, weight: f64) -> bool {
    lines(path).iter().any(|line| line["name"] == name && line["weight"] == weight)
}

/// Records a log whose torques are spread around the five levels.
fn log_of(
    quality: Quality,
    length: usize,
    candidates: &[AgentConfig],
    truth: &[f64],
    seed: Seed,
) -> Outcome<Decisions> {
    let mut behaviour = Behaviour::Random;
    if quality != Quality::Random {
        let best = (0..truth.len()).max_by(|&a, &b| truth[a].total_cmp(&truth[b])).unwrap_or(0);
        let mut world = Simulated::new(Pendulum::default(), Begin::AsTheTask);
        let agent = Agent::new(candidates[best], 3, 5);
        let span = RunLength { steps: 200_000, ..SPAN };
        let learned = Behaviour::learned(
            agent,
            &mut world,
            KIND.near_optimal(),
            span,
            seed.child("behaviour"),
        );
        behaviour = learned.perturbed(quality.random_share());
    }
    let mut plant = Simulated::new(Pendulum::continuous(), Begin::AsTheTask);
    let recorded = record(&mut behaviour, &mut plant, length, SPAN.timeout, seed.child("log"));
    // `recorded.beside` has the torque in the row that the step led to, but a setting belongs to the row of the decision.
    let mut torque = recorded.beside.clone();
    torque.rotate_left(1);
    let acted = torque.iter_mut().zip(&recorded.actions);
    acted.filter(|(_, action)| action.is_none()).for_each(|(torque, _)| *torque = f64::NAN);
    let (levels, settings) = Levels::of_range(&[torque], 5, 64)?;
    Ok(recorded.decisions(levels.values.len())?.with_settings(settings)?)
}

/// Returns the first states of the recorded episodes as start states.
fn starts(log: &Decisions) -> Outcome<Starts> {
    let rows: Vec<usize> = log.starts().into_iter().map(RowIndex::get).collect();
    let states = log.states();
    let first: Vec<f32> = rows.iter().flat_map(|&row| states.row(row).to_vec()).collect();
    let first = States::new(first, rows.len(), states.columns())?;
    Ok(Starts { observed: first.clone(), metric: first })
}

fn lines(path: &Path) -> Vec<Value> {
    let text = fs::read_to_string(path).unwrap_or_default();
    text.lines().filter_map(|line| serde_json::from_str(line).ok()).collect()
}

/// Writes a table by length of the log and weight: the choices' percentile, their regret as a share of that of a random choice, and
/// their uncovered steps.
fn table(path: &Path, truth: &[f64]) -> Outcome<()> {
    let random = truth.iter().map(|value| truth.iter().copied().fold(f64::MIN, f64::max) - value);
    let random = random.sum::<f64>() / truth.len() as f64;
    let mut cells: BTreeMap<(String, String), Vec<[f64; 3]>> = BTreeMap::new();
    for line in lines(path) {
        let name = line["name"].as_str().unwrap_or_default();
        let cell = name.rsplit_once('/').map_or(name, |(cell, _)| cell).to_owned();
        let choice = regret(truth, line["chosen"].as_u64().unwrap_or(0) as usize);
        let uncovered = line["uncovered"].as_f64().unwrap_or(f64::NAN);
        let row = [choice.percentile, choice.regret / random, uncovered].map(|share| 100.0 * share);
        for cell in [cell, "all".to_owned()] {
            cells.entry((cell, line["weight"].to_string())).or_default().push(row);
        }
    }
    let mut text = String::from(
        "| behaviour and steps | weight | logs | percentile | regret in % of a random choice's | not covered, % |\n|---|---|---|---|---|---|\n",
    );
    for ((cell, weight), rows) in cells {
        let [percentile, regret, uncovered] = [0, 1, 2].map(|column: usize| -> Outcome<String> {
            let summary = summarise(&rows.iter().map(|row| row[column]).collect::<Vec<_>>())?;
            let half = summary.interval.map_or(f64::NAN, |interval| interval.high - summary.mean);
            Ok(format!("{:.0} ± {half:.0}", summary.mean))
        });
        let [percentile, regret, uncovered] = [percentile?, regret?, uncovered?];
        let logs = rows.len();
        writeln!(text, "| {cell} | {weight} | {logs} | {percentile} | {regret} | {uncovered} |")?;
    }
    Ok(fs::write(path.with_extension("md"), text)?)
}
