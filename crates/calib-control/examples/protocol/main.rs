//! Repeats the published protocol of choosing hyperparameters of control agents from logs (Wang et al. 2022):
//!
//! ```sh
//! cargo run --release -p calib-control --example protocol -- DIR [LOGS|FIRST..END] [TRUTH_RUNS] [nearest|minimum_return] [TASK,TASK] \
//!     [--model euclidean|laplacian|network|pool|drawn]
//! ```
//!
//! `DIR/truth-TASK.json` holds the true mean returns of the 54 settings. `DIR/logs.jsonl` has one line per log and model: the choice of
//! each selection method, and the return that it promised. With `--model pool`, `DIR/pool.jsonl` has for every log the return of every
//! setting in every ensemble member of three kinds of models (neighbours, increments, networks). `scripts/pool_protocol.py` compares
//! selection rules on them. With `--model drawn` every log comes from its own task ([`drawn`]). Finished lines are not computed again, and
//! all models have the same logs. `docs/control` is such a folder; `scripts/control_protocol.py docs/control` makes the table and the
//! figure of docs/control.md.

mod drawn;

use std::{
    error::Error,
    fs::{self, OpenOptions},
    io::Write as _,
    path::Path,
};

use calib_control::{
    Acrobot, ActionModel, ActionModelConfig, Agent, AgentConfig, Begin, Behaviour, CartPole,
    Coverage, Decisions, Drift, Environment, Grid, IncrementModel, Increments, NetworkConfig,
    NetworkModel, Pessimism, PuddleWorld, Quality, Question, Run, RunBudget, RunLength, Simulated,
    Starts, Support, Task, TaskKind, constant_returns, judge, off_policy_values, record, sweep,
    truth,
};
use calib_core::{Seed, Silent, States};
use calib_represent::{LaplacianConfig, Split, Training, encode};
use calib_stats::RankRule;
use serde_json::{Value, json};

type Outcome<T> = Result<T, Box<dyn Error>>;

/// Steps for which an agent learns, in a model and in the task itself.
const STEPS: usize = 15_000;
/// Steps after which a behaviour stops learning even if it has not reached the wanted return.
const LEARNING: usize = 200_000;
const STARTS: usize = 30;

/// The representation in the literature. Only its batch of 128 pairs is our choice.
fn laplacian() -> LaplacianConfig {
    LaplacianConfig {
        kappa: 0.8,
        dimension: 8,
        hidden_units: 128,
        learning_rate: 3e-5,
        batch_size: 128,
        steps: 30_000,
        ..LaplacianConfig::default()
    }
}

/// The model in which agents learn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Model {
    /// Neighbours in the states themselves.
    Euclidean,
    /// Neighbours in a Laplacian representation.
    Laplacian,
    /// A network.
    Network,
    /// Neighbours, increments and networks. The file keeps all their estimates.
    Pool,
    /// The same three kinds, for tasks that are drawn.
    Drawn,
}

impl Model {
    const ALL: [Self; 5] =
        [Self::Euclidean, Self::Laplacian, Self::Network, Self::Pool, Self::Drawn];

    fn name(self) -> &'static str {
        match self {
            Self::Euclidean => "euclidean",
            Self::Laplacian => "laplacian",
            Self::Network => "network",
            Self::Pool => "pool",
            Self::Drawn => "drawn",
        }
    }

    /// Returns the name of the file that has one line per log.
    fn file(self) -> &'static str {
        match self {
            Self::Pool => "pool.jsonl",
            Self::Drawn => "drawn.jsonl",
            _ => "logs.jsonl",
        }
    }

    /// Returns whether a line belongs to this model. Lines of the Euclidean model do not name it.
    fn is_of(self, line: &Value) -> bool {
        line["model_kind"].as_str().unwrap_or("euclidean") == self.name()
    }
}

fn main() -> Outcome<()> {
    let mut arguments: Vec<String> = std::env::args().skip(1).collect();
    let model = match arguments.iter().position(|argument| argument == "--model") {
        None => Model::Euclidean,
        Some(place) => {
            let named: Vec<String> = arguments.drain(place..).skip(1).collect();
            let [name] = &named[..] else { return Err("--model NAME comes last".into()) };
            let own = Model::ALL.into_iter().find(|model| model.name() == name);
            own.ok_or_else(|| {
                format!("`{name}` is no model: euclidean, laplacian, network, pool or drawn")
            })?
        }
    };
    let directory = Path::new(arguments.first().ok_or("where to write?")?);
    let logs = match arguments.get(1).and_then(|text| text.split_once("..")) {
        Some((first, end)) => first.parse::<usize>()?..end.parse()?,
        None => 0..number(&arguments, 1, 30)?,
    };
    let truth_runs = number(&arguments, 2, 30)?;
    let pessimism = match arguments.get(3).map(String::as_str) {
        None | Some("nearest") => Pessimism::Nearest,
        Some("minimum_return") => Pessimism::MinimumReturn,
        Some(other) => return Err(format!("`{other}` is no rule for what is not covered").into()),
    };
    let wanted = arguments.get(4);
    fs::create_dir_all(directory)?;
    if model == Model::Drawn {
        return drawn::run(&directory.join(model.file()), logs);
    }
    let study = Study { directory, truth_runs, pessimism, model };
    let acrobot = study.truth(TaskKind::Acrobot, &Acrobot::default())?;
    let cart_pole = CartPole::with_slip(0.1);
    let poles = study.truth(TaskKind::CartPole, &cart_pole)?;
    let puddles = study.truth(TaskKind::PuddleWorld, &PuddleWorld::default())?;
    for log in logs {
        if is_wanted(wanted, TaskKind::PuddleWorld) {
            study.log(TaskKind::PuddleWorld, &PuddleWorld::default(), log, &puddles)?;
        }
        if is_wanted(wanted, TaskKind::CartPole) {
            study.log(TaskKind::CartPole, &cart_pole, log, &poles)?;
        }
        if is_wanted(wanted, TaskKind::Acrobot) {
            study.log(TaskKind::Acrobot, &Acrobot::default(), log, &acrobot)?;
        }
    }
    Ok(())
}

/// Returns the number at a place of the arguments, or `default` if there is none.
fn number(arguments: &[String], place: usize, default: usize) -> Outcome<usize> {
    Ok(arguments.get(place).map_or(Ok(default), |text| text.parse())?)
}

/// Returns whether the names, separated by commas, include this task. Without names, all tasks are wanted.
fn is_wanted(names: Option<&String>, kind: TaskKind) -> bool {
    names.is_none_or(|names| names.split(',').any(|name| name == kind.name()))
}

struct Study<'a> {
    directory: &'a Path,
    truth_runs: usize,
    pessimism: Pessimism,
    model: Model,
}

impl Study<'_> {
    fn candidates() -> Outcome<Vec<AgentConfig>> {
        Ok(Grid::published().candidates(AgentConfig::default())?)
    }

    /// Returns the true mean return of each setting. Reads it from its file, or computes it and writes it there.
    fn truth<T: Task>(&self, kind: TaskKind, task: &T) -> Outcome<Vec<f64>> {
        let path = self.directory.join(format!("truth-{}.json", kind.name()));
        if !path.exists() {
            let span = RunLength { steps: STEPS, timeout: kind.timeout() };
            let budget = RunBudget { runs: self.truth_runs, span };
            let runs = truth(
                || Simulated::new(task.clone(), Begin::AsTheTask),
                &Self::candidates()?,
                budget,
                Seed::new(1),
                &Silent,
            )?;
            fs::write(&path, json!({ "returns": runs }).to_string())?;
        }
        let read: Value = serde_json::from_slice(&fs::read(&path)?)?;
        let runs: Vec<Vec<f64>> = serde_json::from_value(read["returns"].clone())?;
        Ok(means(&runs))
    }

    /// Processes one log per behaviour and length.
    fn log<T: Task>(&self, kind: TaskKind, task: &T, number: usize, truth: &[f64]) -> Outcome<()> {
        for quality in Quality::PUBLISHED {
            for length in [500, 5000] {
                let name = format!("{}/{}/{length}/{number}", kind.name(), quality.name());
                let path = self.directory.join(self.model.file());
                let rule = json!(self.pessimism);
                let lines = fs::read_to_string(&path).unwrap_or_default();
                let of_log: Vec<Value> = lines
                    .lines()
                    .filter_map(|line| serde_json::from_str::<Value>(line).ok())
                    .filter(|line| line["name"] == name.as_str())
                    .collect();
                let done = of_log.iter().any(|line| line["rule"] == rule && self.model.is_of(line));
                if !done {
                    // The choice by fitted Q evaluation does not depend on the model.
                    let fitted = of_log.iter().find_map(|line| line["fitted"].as_u64());
                    let line = self.one(kind, task, (quality, length, number), truth, fitted)?;
                    let mut file = OpenOptions::new().create(true).append(true).open(&path)?;
                    writeln!(file, "{}", with(line, &name))?;
                }
            }
        }
        Ok(())
    }

    fn one<T: Task>(
        &self,
        kind: TaskKind,
        task: &T,
        (quality, length, number): (Quality, usize, usize),
        truth: &[f64],
        fitted: Option<u64>,
    ) -> Outcome<Value> {
        let candidates = Self::candidates()?;
        let seed = Seed::new(2).child(kind.name()).child(quality.name());
        let seed = seed.number(length as u64).number(number as u64);
        let timeout = kind.timeout();
        let mut world = Simulated::new(task.clone(), Begin::AsTheTask);
        let wanted = kind.near_optimal();
        let best = best_of(&candidates, truth);
        let mut behaviour = behaviour(quality, (best, wanted), timeout, &mut world, seed);
        let behaved = behaviour.mean_return(&mut world, 100, timeout, seed.child("behaved"));
        let mut anywhere = Simulated::new(task.clone(), Begin::Anywhere);
        let recorded = record(&mut behaviour, &mut anywhere, length, timeout, seed.child("log"));
        let log = recorded.decisions(world.actions())?;
        let starts = starts(&mut world, seed.child("starts"))?;
        if self.model == Model::Pool {
            return self.pool(kind, &log, &starts, &candidates, seed);
        }
        let runs = self.runs(kind, &log, &starts, &candidates, seed)?;
        let default = candidates.iter().position(|candidate| *candidate == AgentConfig::default());
        let support = Support::default();
        let rule = RankRule::WorstRank;
        let question =
            Question { default, rule, support, ..Question::new(&log, timeout, candidates.len()) };
        let verdict = judge(&runs, &question, seed)?;
        let fitted = if let Some(fitted) = fitted {
            Some(fitted as usize)
        } else {
            let values =
                off_policy_values(&log, &starts, &candidates, STEPS, timeout, &Silent)?.fitted_q;
            (0..values.len())
                .max_by(|&a, &b| values[a].value.total_cmp(&values[b].value).then(b.cmp(&a)))
        };
        let mut line = json!({
            "rule": self.pessimism,
            "behaviour": behaved, "actions": log.counts(), "terminals": log.terminals(),
            "chosen": verdict.chosen, "fitted": fitted,
            "promised": verdict.selection.mean_errors[verdict.chosen],
            "uncovered": verdict.coverage[verdict.chosen].uncovered(),
            "doubts": verdict.doubts,
        });
        if self.model != Model::Euclidean {
            line["model_kind"] = json!(self.model.name());
        }
        Ok(line)
    }

    /// Runs every setting in the model of the log.
    fn runs(
        &self,
        kind: TaskKind,
        log: &Decisions,
        starts: &States,
        candidates: &[AgentConfig],
        seed: Seed,
    ) -> Outcome<Vec<Run>> {
        let span = RunLength { steps: STEPS, timeout: kind.timeout() };
        let budget = RunBudget { runs: 1, span };
        let [metric, begin] = match self.model {
            Model::Euclidean => [log.states().clone(), starts.clone()],
            Model::Laplacian => represented(log, starts, seed.child("representation"))?,
            Model::Pool | Model::Drawn => unreachable!("have lines of their own"),
            Model::Network => {
                let config = NetworkConfig::default();
                let seed_of = seed.child("networks");
                let model = NetworkModel::train(log, starts.clone(), &config, seed_of, &Silent)?;
                return Ok(sweep(&model, candidates, budget, seed.child("sweep"), &Silent)?);
            }
        };
        let begin = Starts { observed: starts.clone(), metric: begin };
        let model = self.neighbors(kind, log, &metric, begin)?;
        Ok(sweep(&model, candidates, budget, seed.child("sweep"), &Silent)?)
    }

    fn neighbors(
        &self,
        kind: TaskKind,
        log: &Decisions,
        metric: &States,
        begin: Starts,
    ) -> Outcome<ActionModel> {
        let config = ActionModelConfig { pessimism: self.pessimism, ..Default::default() };
        let log = log.clone();
        let worst = kind.worst_return();
        Ok(ActionModel::build(log, metric, begin, &config, worst, &Silent)?)
    }

    /// Returns the mean return of every setting in every ensemble member of three kinds of models.
    fn pool(
        &self,
        kind: TaskKind,
        log: &Decisions,
        starts: &States,
        candidates: &[AgentConfig],
        seed: Seed,
    ) -> Outcome<Value> {
        let begin = Starts { observed: starts.clone(), metric: starts.clone() };
        let model = self.neighbors(kind, log, log.states(), begin)?;
        let mut line = pooled(&model, candidates, kind.timeout(), seed)?;
        line["rule"] = json!(self.pessimism);
        line["model_kind"] = json!("pool");
        Ok(line)
    }
}

/// Returns the mean over runs for each candidate, from `[runs][candidates]`.
fn means(runs: &[Vec<f64>]) -> Vec<f64> {
    (0..runs[0].len())
        .map(|candidate: usize| {
            runs.iter().map(|run| run[candidate]).sum::<f64>() / runs.len() as f64
        })
        .collect()
}

/// Returns the setting with the highest true return.
fn best_of(candidates: &[AgentConfig], truth: &[f64]) -> AgentConfig {
    let best = (0..truth.len()).max_by(|&a, &b| truth[a].total_cmp(&truth[b])).unwrap_or(0);
    candidates[best]
}

/// Returns the policy of this quality: that of an agent which learned until its mean return reached `wanted`.
fn behaviour(
    quality: Quality,
    (agent, wanted): (AgentConfig, f64),
    timeout: usize,
    world: &mut dyn Environment,
    seed: Seed,
) -> Behaviour {
    if quality == Quality::Random {
        return Behaviour::Random;
    }
    let agent = Agent::new(agent, world.columns(), world.actions());
    let span = RunLength { steps: LEARNING, timeout };
    Behaviour::learned(agent, world, wanted, span, seed.child("behaviour"))
        .perturbed(quality.random_share())
}

/// Returns the mean return of every setting in every ensemble member of neighbours, increments and networks.
fn pooled(
    model: &ActionModel,
    candidates: &[AgentConfig],
    timeout: usize,
    seed: Seed,
) -> Outcome<Value> {
    let budget = RunBudget { runs: 1, span: RunLength { steps: STEPS, timeout } };
    let increments = Increments::new(model, ActionModelConfig::DEFAULT.coverage, &Silent)?;
    let networks = NetworkModel::for_model(model, seed, None, &Silent)?;
    let seed = seed.child("sweep");
    let by_increments = IncrementModel::new(model, &increments);
    let log = model.log();
    let recorded = log.recorded_return(timeout)?;
    let actions = log.levels();
    let random = json!({
        "neighbors": constant_returns(model, actions, budget, seed, &Silent)?.random,
        "increments": constant_returns(&by_increments, actions, budget, seed, &Silent)?.random,
        "network": constant_returns(&networks, actions, budget, seed, &Silent)?.random,
    });
    Ok(json!({
        "random_actions": random,
        "actions": log.counts(),
        "terminals": log.terminals(),
        "recorded": [recorded.mean, recorded.best.unwrap_or(f64::INFINITY)],
        "keeps": increments.keeps(),
        "neighbors": told(&sweep(model, candidates, budget, seed, &Silent)?),
        "increments": told(&sweep(&by_increments, candidates, budget, seed, &Silent)?),
        "network": told(&sweep(&networks, candidates, budget, seed, &Silent)?),
    }))
}

/// Returns ψ for the states of a log and for its start states. It is trained on pairs along the log's episodes.
fn represented(log: &Decisions, starts: &States, seed: Seed) -> Outcome<[States; 2]> {
    let states = log.states();
    let segments = log.transitions().segments();
    // No representation is chosen, so all rows serve for training.
    let split = Split { training: 0..states.rows(), validation: 0..states.rows() };
    let config = laplacian();
    let mut training = Training::new(&config, states, segments, &split, seed)?;
    for _ in 0..config.steps {
        training.step();
    }
    let encoder = training.encoder();
    Ok([encode(encoder, states)?, encode(encoder, starts)?])
}

/// Returns the results of one kind of model: `returns[member][candidate]` and, per setting, the share of uncovered steps, the terminals per
/// step, and how far jumps move its episodes.
fn told(runs: &[Run]) -> Value {
    let candidates = 1 + runs.iter().map(|run| run.candidate).max().unwrap_or(0);
    let members = 1 + runs.iter().map(|run| run.member).max().unwrap_or(0);
    let mut returns = vec![vec![Value::Null; candidates]; members];
    let mut sums = vec![(Coverage::default(), 0, Drift::default()); candidates];
    for run in runs {
        returns[run.member][run.candidate] = rounded(run.mean_return);
        let (coverage, terminals, drift) = &mut sums[run.candidate];
        *coverage = coverage.and(run.coverage);
        *terminals += run.terminals;
        *drift = std::mem::take(drift).and(&run.drift);
    }
    let uncovered = sums.iter().map(|(coverage, ..)| rounded(coverage.uncovered()));
    let terminals = sums
        .iter()
        .map(|(coverage, terminals, _)| rounded(*terminals as f64 / coverage.steps.max(1) as f64));
    let moved = sums.iter().map(|(.., drift)| rounded(furthest(drift)));
    json!({
        "returns": returns,
        "uncovered": uncovered.collect::<Vec<_>>(),
        "terminals": terminals.collect::<Vec<_>>(),
        "moved": moved.collect::<Vec<_>>(),
    })
}

/// Returns the largest mean displacement of an episode among the columns.
fn furthest(drift: &Drift) -> f64 {
    drift.means().into_iter().map(|[mean, _]| mean.abs()).fold(0.0, f64::max)
}

/// Rounds to five significant digits. A value that is not finite becomes null.
fn rounded(value: f64) -> Value {
    if value.is_finite() {
        json!(format!("{value:.4e}").parse::<f64>().unwrap_or(value))
    } else {
        Value::Null
    }
}

/// Adds the name to the line.
fn with(mut line: Value, name: &str) -> Value {
    line["name"] = json!(name);
    line
}

/// Returns start states. They are known, as in the literature.
fn starts(world: &mut dyn Environment, seed: Seed) -> Outcome<States> {
    let mut rng = seed.rng();
    let columns = world.columns();
    let mut all = Vec::with_capacity(STARTS * columns);
    let mut state = vec![0.0; columns];
    for _ in 0..STARTS {
        world.start(&mut rng, &mut state);
        all.extend_from_slice(&state);
    }
    Ok(States::new(all, STARTS, columns)?)
}
