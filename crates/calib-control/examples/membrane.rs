//! Asks whether an agent that was tuned in the model of a plant's log beats the operators' rule, and its own default. The simulated plant
//! has the true returns:
//!
//! ```sh
//! cargo run --release -p calib-control --example membrane -- DIR [PLANTS] [TRANSITIONS] [TRUTH_RUNS] [rule|perturbed|random]
//! ```
//!
//! `DIR/plants.jsonl` has one line per plant. Finished lines are not computed again. Finally the program writes
//! `DIR/POLICY-TRANSITIONS.md`: means over plants with 95 % t-intervals.

use std::{
    error::Error,
    fmt::Write as _,
    fs::{self, OpenOptions},
    io::Write as _,
    path::{Path, PathBuf},
};

use calib_control::{
    ActionModel, ActionModelConfig, Agent, AgentConfig, Begin, Behaviour, Ensemble as _, Grid,
    Membrane, Quality, Question, RunBudget, RunLength, Simulated, Starts, Support, TaskKind, judge,
    off_policy_values, record, regret, run_agent, sweep, truth,
};
use calib_core::{Seed, Silent, States};
use calib_stats::{RankRule, summarise};
use serde_json::{Value, json};

type Outcome<T> = Result<T, Box<dyn Error>>;

/// Steps of a run, in the model and in the plant: a year of half hours.
const STEPS: usize = 17_520;
const KIND: TaskKind = TaskKind::Membrane;

fn main() -> Outcome<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let directory = Path::new(arguments.first().ok_or("where to write?")?);
    let plants = number(&arguments, 1, 20)?;
    let transitions = number(&arguments, 2, 5000)?;
    let truth_runs = number(&arguments, 3, 3)?;
    let policy: Quality = match arguments.get(4) {
        Some(name) => serde_json::from_value(json!(name))?,
        None => Quality::Perturbed,
    };
    fs::create_dir_all(directory)?;
    let study = Study { directory: directory.to_owned(), transitions, truth_runs, policy };
    for plant in 0..plants {
        study.plant(plant)?;
    }
    study.table()
}

/// Returns the number at a place of the arguments, or `default` if there is none.
fn number(arguments: &[String], place: usize, default: usize) -> Outcome<usize> {
    Ok(arguments.get(place).map_or(Ok(default), |text| text.parse())?)
}

struct Study {
    directory: PathBuf,
    transitions: usize,
    truth_runs: usize,
    policy: Quality,
}

/// Returns an untuned agent: calib's default, but with the discount of a task that need not end.
fn default() -> AgentConfig {
    AgentConfig { gamma: 0.99, tilings: 8, ..AgentConfig::default() }
}

fn grid() -> Grid {
    Grid {
        step_size: Some(vec![0.003, 0.03, 0.3]),
        temperature: Some(vec![1.0, 10.0, 100.0]),
        initial_weight: Some(vec![0.0, 400.0]),
        ..Grid::default()
    }
}

impl Study {
    fn path(&self) -> PathBuf {
        self.directory.join("plants.jsonl")
    }

    fn lines(&self) -> Vec<Value> {
        let text = fs::read_to_string(self.path()).unwrap_or_default();
        let lines = text.lines().filter_map(|line| serde_json::from_str::<Value>(line).ok());
        lines
            .filter(|line| {
                line["policy"] == self.policy.name() && line["transitions"] == self.transitions
            })
            .collect()
    }

    fn plant(&self, number: usize) -> Outcome<()> {
        if self.lines().iter().any(|line| line["plant"] == number) {
            return Ok(());
        }
        let line = self.one(number)?;
        let mut file = OpenOptions::new().create(true).append(true).open(self.path())?;
        writeln!(file, "{line}")?;
        Ok(())
    }

    /// Chooses a setting from the log of one plant, and compares it with the truth.
    fn one(&self, number: usize) -> Outcome<Value> {
        let seed = Seed::new(19).child("membrane").number(number as u64);
        let span = RunLength { steps: STEPS, timeout: KIND.timeout() };
        let mut operators = self.operators()?;
        let (model, starts) = self.model(&mut operators, &mut simulated(seed), seed)?;
        let candidates = grid().candidates(default())?;
        let untuned = candidates.iter().position(|candidate| *candidate == default());
        let budget = RunBudget { runs: 1, span };
        let runs = sweep(&model, &candidates, budget, seed.child("sweep"), &Silent)?;
        let log = model.log();
        // Plants rarely trip, so careful operators leave few terminals in the log.
        let support = Support { fewest_terminals: 0, ..Support::default() };
        let rule = RankRule::WorstRank;
        let new = Question::new(log, span.timeout, candidates.len());
        let verdict = judge(&runs, &Question { default: untuned, rule, support, ..new }, seed)?;
        let fitted =
            off_policy_values(log, &starts, &candidates, STEPS, span.timeout, &Silent)?.fitted_q;
        let best_fitted = (0..fitted.len())
            .max_by(|&a, &b| fitted[a].value.total_cmp(&fitted[b].value).then(b.cmp(&a)));
        let budget = RunBudget { runs: self.truth_runs, span };
        let lives = truth(|| simulated(seed), &candidates, budget, seed, &Silent)?;
        let means: Vec<f64> = (0..candidates.len())
            .map(|candidate: usize| {
                lives.iter().map(|run| run[candidate]).sum::<f64>() / lives.len() as f64
            })
            .collect();
        let mut rule = Behaviour::rule_of::<Membrane>().ok_or("a plant has a rule")?;
        let [rule, logged] = [&mut rule, &mut operators].map(|behaviour: &mut Behaviour| {
            behaviour.mean_return(&mut simulated(seed), 100, span.timeout, seed.child("policy"))
        });
        let [taught, taught_default] = [candidates[verdict.chosen], default()]
            .map(|config: AgentConfig| self.taught(&model, config, span, seed));
        Ok(json!({
            "plant": number, "policy": self.policy, "transitions": self.transitions,
            "actions": log.counts(), "terminals": log.terminals(), "covered": model.covered(),
            "truth": means, "chosen": verdict.chosen, "fitted": best_fitted, "default": untuned,
            "taught": taught, "taught_default": taught_default,
            "rule": rule, "logged": logged,
            "uncovered": verdict.coverage[verdict.chosen].uncovered(),
            "doubts": verdict.doubts, "model": verdict.selection.mean_errors,
            "percentile": regret(&means, verdict.chosen).percentile,
        }))
    }

    /// Returns the behaviour whose actions are logged.
    fn operators(&self) -> Outcome<Behaviour> {
        if self.policy == Quality::Random {
            return Ok(Behaviour::Random);
        }
        let rule = Behaviour::rule_of::<Membrane>().ok_or("a plant has a rule")?;
        Ok(rule.perturbed(self.policy.random_share()))
    }

    /// Returns the model of a log of these operators, and its start states.
    fn model(
        &self,
        operators: &mut Behaviour,
        plant: &mut Simulated<Membrane>,
        seed: Seed,
    ) -> Outcome<(ActionModel, States)> {
        let seed = seed.child("log");
        let log = record(operators, plant, self.transitions, KIND.timeout(), seed).decisions(8)?;
        let states = log.states().clone();
        let first: Vec<f32> =
            log.starts().into_iter().flat_map(|row| states.row(row.get()).to_vec()).collect();
        let starts = States::new(first, log.starts().len(), states.columns())?;
        let begin = Starts { observed: starts.clone(), metric: starts.clone() };
        let config = ActionModelConfig::default();
        let worst = KIND.worst_return();
        Ok((ActionModel::build(log, &states, begin, &config, worst, &Silent)?, starts))
    }

    /// Returns the true mean return of an agent that first learned in every ensemble member, one after the other, and
    /// then acts at the plant.
    fn taught(&self, model: &ActionModel, config: AgentConfig, span: RunLength, seed: Seed) -> f64 {
        let mut agent = Agent::new(config, 4, 8);
        for member in 0..model.members() {
            let seed = seed.child("taught").number(member as u64);
            run_agent(&mut agent, &mut model.rollout(member), span, seed);
        }
        (0..self.truth_runs)
            .map(|run: usize| {
                let run_seed = seed.child("truth").number(run as u64);
                run_agent(&mut agent.clone(), &mut simulated(seed), span, run_seed).mean_return()
            })
            .sum::<f64>()
            / self.truth_runs as f64
    }

    fn table(&self) -> Outcome<()> {
        let lines = self.lines();
        let ways = ways();
        let mut text = String::new();
        writeln!(text, "{} plants, {} policy\n", lines.len(), self.policy.name())?;
        writeln!(text, "| | return an episode | tuned less this | taught less this |")?;
        writeln!(text, "|---|---|---|---|")?;
        for (name, value) in &ways {
            let own: Vec<f64> = lines.iter().map(value).collect();
            let [tuned, taught] = [ways[0].1, ways[1].1].map(|other: fn(&Value) -> f64| {
                told(&lines.iter().map(|line| other(line) - value(line)).collect::<Vec<f64>>())
            });
            writeln!(text, "| {name} | {} | {} | {} |", told(&own)?, tuned?, taught?)?;
        }
        let [percentile, uncovered] = ["percentile", "uncovered"].map(|key| {
            told(&lines.iter().map(|line| 100.0 * read(line, key)).collect::<Vec<f64>>())
        });
        let refused = lines.iter().filter(|line| line["doubts"] != json!([])).count();
        writeln!(
            text,
            "\npercentile of the choice {}; {} % of its steps in the model not covered; {refused} refused",
            percentile?, uncovered?
        )?;
        let name = format!("{}-{}.md", self.policy.name(), self.transitions);
        Ok(fs::write(self.directory.join(name), text)?)
    }
}

/// Returns the plant of this seed as an environment.
fn simulated(seed: Seed) -> Simulated<Membrane> {
    Simulated::new(Membrane::new(seed), Begin::AsTheTask)
}

fn read(line: &Value, key: &str) -> f64 {
    line[key].as_f64().unwrap_or(f64::NAN)
}

/// Returns the true returns of all settings.
fn all(line: &Value) -> Vec<f64> {
    line["truth"].as_array().into_iter().flatten().filter_map(Value::as_f64).collect()
}

/// Returns the true return of the setting that `key` names.
fn truth_of(line: &Value, key: &str) -> f64 {
    let chosen = line[key].as_u64().unwrap_or(0) as usize;
    line["truth"][chosen].as_f64().unwrap_or(f64::NAN)
}

/// A policy to compare: its name, and its return in a line of results.
type Way = (&'static str, fn(&Value) -> f64);

fn ways() -> [Way; 9] {
    [
        ("tuned in the model", |line| truth_of(line, "chosen")),
        ("the same, taught in the model first", |line| read(line, "taught")),
        ("chosen by fitted Q evaluation", |line| truth_of(line, "fitted")),
        ("default configuration", |line| truth_of(line, "default")),
        ("the same, taught in the model first", |line| read(line, "taught_default")),
        ("random configuration", |line| all(line).iter().sum::<f64>() / all(line).len() as f64),
        ("best configuration", |line| all(line).into_iter().fold(f64::NEG_INFINITY, f64::max)),
        ("operators' rule", |line| read(line, "rule")),
        ("what was logged", |line| read(line, "logged")),
    ]
}

/// Formats the mean and half of its 95 % interval.
fn told(values: &[f64]) -> Outcome<String> {
    let summary = summarise(values)?;
    let half = summary.interval.map_or(f64::NAN, |interval| interval.high - summary.mean);
    Ok(format!("{:.0} ± {half:.0}", summary.mean))
}
