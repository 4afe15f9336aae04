//! Estimates time, memory and disk space of a sweep of agents that act.

use calib_base::{
    StepError, disk_room, memory,
    outcome::Told,
    output::{Printer, bytes, count, counted, duration_of_secs},
};
use calib_control::{
    ActionModel, ActionModelKind, ControlConfig, Decisions, Distance, FixedRollouts, NetworkConfig,
    NetworkModel, off_policy_bytes,
};
use calib_model_steps::represent::{RepresentationCost, decisions};
use calib_study::Job;
use schemars::JsonSchema;
use serde::Serialize;

use super::{
    agents::ComparedAgents,
    cost::{AgentCost, KEEPING_SECS, MeasuredCosts},
    log::{self, ActionLog},
    model,
    units::RunFiles,
    work_left::{WorkLeft, WorkScope, runs_of_kind},
};

/// Bytes of a run's file, and of its part for each column.
const RUN_BYTES: usize = 1_000;
const COLUMN_BYTES: usize = 50;
/// Bytes of a network's file beside its weights and biases.
const NETWORK_BYTES: usize = 1_500;
/// Size of a disk block. Files take whole blocks on most disks.
const BLOCK_BYTES: usize = 4_096;

/// The plan of `calib control`: the result of a dry run.
#[derive(Debug, Serialize, JsonSchema)]
pub struct ControlPlan {
    /// Number of runs, each one setting in one ensemble member; under `--share`, the runs of this share.
    runs: usize,
    /// Runs that are still to make.
    left: usize,
    /// Number of threads.
    threads: usize,
    /// Memory that the command needs.
    memory: ControlMemory,
    /// Bytes on disk for the representation, the model and networks that are missing, and for the runs still to make.
    disk: u64,
    /// Expected time, if known.
    #[serde(skip_serializing_if = "Option::is_none")]
    expected: Option<ControlTime>,
    /// Why the expected time is not known.
    #[serde(skip_serializing_if = "Option::is_none")]
    unknown: Option<String>,
}

/// Largest memory use in bytes, without calib itself.
#[derive(Clone, Copy, Debug, Default, Serialize, JsonSchema)]
struct ControlMemory {
    /// The decisions of the log.
    log: u64,
    /// Building the tables of neighbours of all ensemble members.
    tables: u64,
    /// Training the representation, if it is missing.
    representation: u64,
    /// Memory of other kinds of models, in addition to the tables.
    other_models: u64,
    /// An agent, or its evaluation by the log alone, on each thread. It does not include the memory of a program of
    /// agents.
    thread: u64,
    /// Sum of all these.
    total: u64,
    /// Memory that the system has, if it reports it.
    available: Option<u64>,
}

/// Expected time in seconds until the last thread ends, if nothing else runs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, JsonSchema)]
struct ControlTime {
    /// Training and scoring the representation, if it is missing.
    representation_secs: f64,
    /// Building models, including the training of networks.
    models_secs: f64,
    /// The runs still to make, and writing their files.
    runs_secs: f64,
    /// Constant and random actions, evaluations by the log alone, and one more run of the chosen agent; 0 under
    /// `--share`.
    other_secs: f64,
    /// Sum of all these.
    secs: f64,
}

/// Estimates the sweep of a study, and times some of it. `units` are the existing runs.
///
/// # Errors
/// Returns an error if there are too many runs, the stored model cannot be read, or the observer asks to stop.
pub(super) fn planned(
    job: &Job,
    config: &ControlConfig,
    log: &ActionLog,
    agents: &ComparedAgents,
    units: &RunFiles,
    printer: &Printer,
) -> Result<ControlPlan, StepError> {
    let work = WorkLeft::of(job, config, agents.count(), units, printer)?;
    let threads = rayon::current_num_threads();
    let kept = model::open_kept(job, config, log)?;
    let networks = untrained(job, config, log, &work, kept.as_ref())?;
    let progress = printer.silent().progress();
    let represented = if config.model.distance == Distance::Laplacian && kept.is_none() {
        decisions::cost(job, log.material(), &progress)?
    } else {
        None
    };
    let represented = represented.as_ref();
    let measured = match agents {
        ComparedAgents::Own(_) => {
            let worst = model::rules(config, log)?.worst_return;
            let own = agents.own();
            let decisions = &log.decisions;
            MeasuredCosts::measure(config, own, decisions, kept.as_ref(), worst, &progress)
        }
        ComparedAgents::Program { .. } => {
            Err(StepError::message("it depends on the program, of which nothing was run"))
        }
    };
    let (expected, unknown) = match measured {
        Ok(costs) => {
            let decisions = &log.decisions;
            let time =
                ControlTime::of(&costs, represented, &work, networks, config, decisions, threads);
            (Some(time), None)
        }
        Err(reason) if reason.was_cancelled() => return Err(reason),
        Err(reason) => (None, Some(reason.to_string())),
    };
    Ok(ControlPlan {
        runs: work.runs,
        left: work.left(),
        threads,
        memory: ControlMemory::of(config, log, agents, represented, &work, networks, threads)?,
        disk: disk(config, &log.decisions, kept.is_some(), networks, work.left())
            .saturating_add(represented.map_or(0, |cost| cost.disk)),
        expected,
        unknown,
    })
}

/// Returns the seconds that a new sweep of a study takes with each of these numbers of steps, as a dry run estimates them. `None` for
/// agents of a program, and where a part of the log is no log to time anything in.
///
/// # Errors
/// Returns an error if there are too many runs, the model does not fit into memory, or the observer asks to stop.
pub(crate) fn expected_secs<const LENGTHS: usize>(
    job: &Job,
    config: &ControlConfig,
    log: &ActionLog,
    steps: [usize; LENGTHS],
    printer: &Printer,
) -> Result<Option<[f64; LENGTHS]>, StepError> {
    let agents = ComparedAgents::of_study(job, config)?;
    let ComparedAgents::Own(own) = &agents else { return Ok(None) };
    log::require_model(&log.decisions, config)?;
    let work = WorkLeft::of_new(config, own.len())?;
    let progress = printer.progress();
    let represented = match config.model.distance {
        Distance::Laplacian => decisions::cost(job, log.material(), &progress)?,
        Distance::Euclidean => None,
    };
    let worst = model::rules(config, log)?.worst_return;
    let all = &log.decisions;
    let costs = match MeasuredCosts::measure(config, own, all, None, worst, &progress) {
        Ok(costs) => costs,
        Err(reason) if reason.was_cancelled() => return Err(reason),
        Err(_) => return Ok(None),
    };
    let represented = represented.as_ref();
    let networks = work.members(ActionModelKind::Network).len();
    let threads = rayon::current_num_threads();
    Ok(Some(steps.map(|steps| {
        let config = ControlConfig { steps, ..config.clone() };
        ControlTime::of(&costs, represented, &work, networks, &config, all, threads).secs
    })))
}

/// Returns the number of networks to train: those that runs need and that have no valid file.
fn untrained(
    job: &Job,
    config: &ControlConfig,
    log: &ActionLog,
    work: &WorkLeft,
    kept: Option<&ActionModel>,
) -> Result<usize, StepError> {
    let needed = work.members(ActionModelKind::Network);
    let Some(model) = kept else { return Ok(needed.len()) };
    let Some(files) = model::network_files(job, config, log)? else { return Ok(needed.len()) };
    Ok(NetworkModel::count_untrained(model, needed, model::seed(job.study().seed), &files))
}

impl ControlTime {
    fn of(
        costs: &MeasuredCosts,
        represented: Option<&RepresentationCost>,
        work: &WorkLeft,
        networks: usize,
        config: &ControlConfig,
        log: &Decisions,
        threads: usize,
    ) -> Self {
        let steps = config.steps as f64;
        let representation_secs = represented.map_or(0.0, |cost| representing(cost, threads));
        let mut models_secs = costs.building;
        let mut runs_secs = 0.0;
        let mut other_secs = 0.0;
        for (left, kind) in work.kinds.iter().zip(&costs.kinds) {
            models_secs += match left.kind {
                ActionModelKind::Network => {
                    side_by_side(&[Pieces { count: networks, secs: kind.making }], threads)
                }
                _ if left.members.is_empty() => 0.0,
                _ => kind.making,
            };
            let runs = left.of_settings.iter().zip(&costs.agents).map(|(&count, agent)| Pieces {
                count,
                secs: agent.beginning + steps * (agent.step + kind.step) + KEEPING_SECS,
            });
            runs_secs += side_by_side(&runs.collect::<Vec<_>>(), threads);
            if work.scope == WorkScope::All {
                let rollouts = FixedRollouts::new(config.runs, config.run_length(), log.levels());
                let count = left.members.len().saturating_mul(rollouts.in_member(log.levels()));
                let secs = steps * kind.step;
                other_secs += side_by_side(&[Pieces { count, secs }], threads);
            }
        }
        if work.scope == WorkScope::All {
            let evaluated = costs
                .agents
                .iter()
                .map(|agent| Pieces { count: 1, secs: by_the_log(agent, steps, log) });
            other_secs += side_by_side(&evaluated.collect::<Vec<_>>(), threads);
            // The choice is not known yet, so its setting may be any.
            let once_more = costs
                .agents
                .iter()
                .map(|agent| agent.beginning + steps * (agent.step + costs.neighbors_step));
            other_secs += once_more.sum::<f64>() / costs.agents.len().max(1) as f64;
        }
        let secs = representation_secs + models_secs + runs_secs + other_secs;
        Self { representation_secs, models_secs, runs_secs, other_secs, secs }
    }

    /// Returns the parts of the time, such as "models 2.0 s, runs 8.0 s".
    fn parts(self) -> String {
        let Self { representation_secs, models_secs, runs_secs, other_secs, .. } = self;
        let representation = if representation_secs > 0.0 {
            format!("representation {}, ", duration_of_secs(representation_secs))
        } else {
            String::new()
        };
        let [models, runs] = [models_secs, runs_secs].map(duration_of_secs);
        let others = if other_secs > 0.0 {
            let others = duration_of_secs(other_secs);
            format!(", constant actions and evaluations by the log alone {others}")
        } else {
            String::new()
        };
        format!("{representation}models {models}, runs {runs}{others}")
    }
}

/// Returns the time to train a representation, in seconds.
fn representing(cost: &RepresentationCost, threads: usize) -> f64 {
    let trainings = cost.trainings.iter().map(|&secs| Pieces { count: 1, secs });
    side_by_side(&trainings.collect::<Vec<_>>(), threads) + cost.scoring
}

/// Returns the time to evaluate an agent from the log alone: it learns from the log, and its policy is evaluated.
fn by_the_log(agent: &AgentCost, steps: f64, log: &Decisions) -> f64 {
    let learning = agent.beginning + steps * agent.step;
    learning + log.len() as f64 * agent.evaluated_transition
}

/// Pieces of work that take equally long.
#[derive(Clone, Copy)]
struct Pieces {
    count: usize,
    /// Seconds of each on one thread.
    secs: f64,
}

/// Returns the time of pieces of work that threads take up one after the other.
fn side_by_side(pieces: &[Pieces], threads: usize) -> f64 {
    let there: Vec<&Pieces> = pieces.iter().filter(|pieces| pieces.count > 0).collect();
    let all: usize = there.iter().map(|pieces| pieces.count).sum();
    let secs: f64 = there.iter().map(|pieces| pieces.count as f64 * pieces.secs).sum();
    let longest = there.iter().map(|pieces| pieces.secs).fold(0.0, f64::max);
    let rounds = all.div_ceil(threads.max(1)) as f64;
    (rounds * secs / all.max(1) as f64).max(longest)
}

impl ControlMemory {
    fn of(
        config: &ControlConfig,
        log: &ActionLog,
        agents: &ComparedAgents,
        represented: Option<&RepresentationCost>,
        work: &WorkLeft,
        networks: usize,
        threads: usize,
    ) -> Result<Self, StepError> {
        let decisions = &log.decisions;
        let columns = decisions.states().columns();
        let transitions = decisions.len();
        let starts = log::start_rows(decisions, config.start).len();
        let tables = ActionModel::build_bytes(decisions, starts, &config.model);
        // Increments keep the scaled states of all sources and their numbers. Networks keep examples for each one
        // trained at the same time.
        let set = decisions.settings().map_or(0, calib_control::Settings::columns);
        let increments = transitions * (4 * (columns + set) + 4);
        let example = 4 * (2 * columns + decisions.levels() + 2);
        let networks = threads.min(networks) * transitions * example;
        let no_increments = work.members(ActionModelKind::Increments).is_empty();
        let increments = if no_increments { 0 } else { increments };
        let other_models = increments.max(networks) as u64;
        let mut thread = 0;
        for agent in agents.own() {
            thread = agent.bytes(columns, decisions.levels())?.max(thread);
        }
        if work.scope == WorkScope::All && !agents.own().is_empty() {
            thread += off_policy_bytes(decisions);
        }
        let log = log_bytes(decisions);
        let all_threads = thread.saturating_mul(threads as u64);
        // The representation is freed before runs begin. The tables are made from it.
        let representation = represented.map_or(0, |cost| cost.memory);
        let beside_tables = representation.max(other_models.saturating_add(all_threads));
        let total = log.saturating_add(tables).saturating_add(beside_tables);
        let available = memory::available();
        Ok(Self { log, tables, representation, other_models, thread, total, available })
    }

    fn line(&self) -> String {
        let Self { log, tables, representation, other_models, thread, total, available } = *self;
        let representation = match representation {
            0 => String::new(),
            representation => format!(", {} of the representation", bytes(representation)),
        };
        let others = match other_models {
            0 => String::new(),
            others => format!(", {} of increments or networks", bytes(others)),
        };
        let thread = match thread {
            0 => "without what the agents' program takes".to_owned(),
            thread => format!("{} a thread", bytes(thread)),
        };
        let parts = format!(
            "{} of the log{representation}, {} of neighbours{others}, {thread}",
            bytes(log),
            bytes(tables),
        );
        memory::plan_line(total, &parts, available)
    }
}

/// Returns the bytes of a log of decisions: states, times, and the data of each transition.
fn log_bytes(log: &Decisions) -> u64 {
    let set = log.settings().map_or(0, calib_control::Settings::columns);
    (log.states().rows() * (4 * (log.states().columns() + set) + 8) + 24 * log.len()) as u64
}

/// Returns the bytes of the files of this many networks.
fn networks_bytes(log: &Decisions, networks: usize) -> u64 {
    let weights = NetworkConfig::default().parameters(log.states().columns(), log.levels());
    let file = (4 * weights + NETWORK_BYTES).next_multiple_of(BLOCK_BYTES);
    (file as u64).saturating_mul(networks as u64)
}

/// Returns the bytes that the folder of results grows by, without the report. `networks` and `runs` are those that are missing.
fn disk(
    config: &ControlConfig,
    log: &Decisions,
    is_model_kept: bool,
    networks: usize,
    runs: usize,
) -> u64 {
    let run = (RUN_BYTES + COLUMN_BYTES * log.states().columns()).next_multiple_of(BLOCK_BYTES);
    let starts = log::start_rows(log, config.start).len();
    let tables = ActionModel::bytes(log, starts, &config.model);
    let model = if is_model_kept { 0 } else { tables.saturating_add(log_bytes(log)) };
    let runs = (runs as u64).saturating_mul(run as u64);
    model.saturating_add(networks_bytes(log, networks)).saturating_add(runs)
}

/// Refuses a sweep of this many settings if the disk has no room for its model and runs.
///
/// # Errors
/// Returns an error if there is clearly less room, or there are too many runs to number.
pub(super) fn require_room(
    job: &Job,
    config: &ControlConfig,
    log: &Decisions,
    settings: usize,
) -> Result<(), StepError> {
    let layout = job.layout();
    let runs = runs_of_kind(config, settings)?.saturating_mul(config.models.len());
    let has_networks = config.models.contains(&ActionModelKind::Network);
    let networks = if has_networks { config.model.members } else { 0 };
    let model = disk_room::left(disk(config, log, false, networks, 0), &layout.control_model());
    let runs = disk_room::left(disk(config, log, true, 0, runs), &layout.control_units());
    disk_room::require(
        model.saturating_add(runs),
        "the sweep",
        layout.root(),
        "choose a folder on another disk with --output, lower control.runs or control.model.neighbors, or sweep fewer settings",
    )
}

impl ControlPlan {
    /// Returns the plan of a sweep that already has a verdict.
    ///
    /// # Errors
    /// Returns an error if there are too many runs to number.
    pub(super) fn of_nothing(
        config: &ControlConfig,
        settings: usize,
        units: &RunFiles,
    ) -> Result<Self, StepError> {
        let of_kind = runs_of_kind(config, settings)?;
        let available = memory::available();
        Ok(Self {
            runs: config.models.iter().map(|&kind| units.own_runs(kind, of_kind)).sum(),
            left: 0,
            threads: rayon::current_num_threads(),
            memory: ControlMemory { available, ..ControlMemory::default() },
            disk: 0,
            expected: Some(ControlTime::default()),
            unknown: None,
        })
    }

    /// Prints the plan and its estimates.
    pub(super) fn announce(&self, job: &Job, printer: &Printer) {
        let Self { runs, left, threads, disk, .. } = *self;
        let threads = counted(threads, "thread");
        let share =
            job.policy().share.map_or_else(String::new, |share| format!(" of share {share}"));
        printer.say(&format!(
            "runs left to make{share}: {} of {}, on {threads}",
            count(left),
            count(runs)
        ));
        printer.say(&self.memory.line());
        let disk = format!("up to {} on disk beside the report", bytes(disk));
        let time = if let Some(expected) = &self.expected {
            format!(
                "expecting about {} on {threads} ({})",
                duration_of_secs(expected.secs),
                expected.parts()
            )
        } else {
            let reason = self.unknown.as_deref().unwrap_or_default();
            format!("how long it takes is not known: {reason}")
        };
        printer.say(&format!("{time}; {disk}"));
    }
}

impl Told for ControlPlan {
    fn tell(&self, _job: &Job, printer: &Printer) -> Result<(), StepError> {
        if printer.is_json() { printer.json(self) } else { Ok(()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::{cost::KindCost, work_left::KindLeft};

    #[test]
    fn pieces_take_whole_rounds_and_as_long_as_the_longest() {
        let equal = [Pieces { count: 3, secs: 2.0 }];
        assert_eq!([1, 2, 3, 8].map(|threads| side_by_side(&equal, threads)), [6.0, 4.0, 2.0, 2.0]);
        let unlike = [Pieces { count: 3, secs: 1.0 }, Pieces { count: 1, secs: 9.0 }];
        assert_eq!(side_by_side(&unlike, 4), 9.0);
        assert_eq!(side_by_side(&[Pieces { count: 0, secs: 5.0 }], 2), 0.0);
    }

    fn decisions() -> Decisions {
        let rows = 101;
        let states = vec![0.5; rows];
        let states = calib_core::States::new(states, rows, 1).expect("valid");
        let actions: Vec<Option<u16>> = (0..rows).map(|row| Some((row % 2) as u16)).collect();
        let columns = calib_control::Columns {
            actions: &actions,
            rewards: &vec![0.0; rows],
            endings: &vec![calib_control::Ending::Continues; rows],
        };
        let segments = calib_core::Segments::from_lengths([rows]).expect("valid");
        Decisions::new(states, &segments, columns, 2).expect("a log")
    }

    /// Returns work for neighbours and networks, in two members each.
    fn work(scope: WorkScope, of_settings: [usize; 2], members: usize) -> WorkLeft {
        let kinds = [ActionModelKind::Neighbors, ActionModelKind::Network].map(|kind| KindLeft {
            kind,
            of_settings: of_settings.to_vec(),
            members: (0..members).collect(),
        });
        WorkLeft { scope, runs: 8, kinds: kinds.into() }
    }

    #[test]
    fn what_is_left_is_counted_once_by_its_parts() {
        let agents = [1.0, 3.0]
            .map(|step| AgentCost { beginning: 0.0, step, evaluated_transition: 0.5 })
            .to_vec();
        let kinds = vec![KindCost { making: 0.0, step: 1.0 }, KindCost { making: 7.0, step: 2.0 }];
        let costs = MeasuredCosts { building: 5.0, neighbors_step: 1.0, kinds, agents };
        let config = ControlConfig { steps: 10, runs: 1, ..ControlConfig::default() };
        let log = decisions();
        let time = |work: &WorkLeft, networks| {
            ControlTime::of(&costs, None, work, networks, &config, &log, 1)
        };
        let all = time(&work(WorkScope::All, [2, 2], 2), 2);
        // The model, and two networks.
        assert_eq!(all.models_secs, 5.0 + 2.0 * 7.0);
        // Two runs of each setting: steps of 2 and 4 seconds in one model, of 3 and 5 in the other.
        let kept = 8.0 * KEEPING_SECS;
        assert!((all.runs_secs - 10.0 * 2.0 * (2.0 + 4.0 + 3.0 + 5.0) - kept).abs() < 1e-9);
        // 32 rollouts of random actions and 16 of each of two constant ones, in two members of both kinds. Then both
        // agents from the log, and one of them again.
        let [constant, by_the_log, again] =
            [10.0 * 128.0 * (1.0 + 2.0), 10.0 + 30.0 + 2.0 * 50.0, 30.0];
        assert_eq!(all.other_secs, constant + by_the_log + again);
        assert_eq!(all.secs, all.models_secs + all.runs_secs + all.other_secs);
        let stored = time(&work(WorkScope::All, [2, 2], 2), 0);
        assert_eq!((stored.models_secs, stored.runs_secs), (5.0, all.runs_secs));
        let part = time(&work(WorkScope::Share, [1, 0], 1), 1);
        assert_eq!((part.models_secs, part.other_secs), (12.0, 0.0));
        assert!((part.runs_secs - 10.0 * (2.0 + 3.0) - 2.0 * KEEPING_SECS).abs() < 1e-9);
        assert_eq!(part.secs, part.models_secs + part.runs_secs);
        assert_eq!(part.parts(), "models 12 s, runs 50 s");
        let none = time(&work(WorkScope::Share, [0, 0], 0), 0);
        assert_eq!((none.models_secs, none.runs_secs), (5.0, 0.0));
    }

    #[test]
    fn a_new_sweep_lacks_every_run() {
        let config = ControlConfig { runs: 2, ..ControlConfig::default() };
        let members = config.model.members;
        let work = WorkLeft::of_new(&config, 7).expect("few");
        assert_eq!(work.runs, config.models.len() * members * 2 * 7);
        assert_eq!(work.left(), work.runs);
        assert_eq!(work.members(ActionModelKind::Network).len(), members);
        assert!(work.scope == WorkScope::All);
    }

    #[test]
    fn a_representation_comes_before_the_rest() {
        let cost = RepresentationCost { trainings: vec![4.0; 3], scoring: 1.0, memory: 1, disk: 1 };
        assert_eq!([1, 2, 3].map(|threads| representing(&cost, threads)), [13.0, 9.0, 5.0]);
        let costs = MeasuredCosts {
            building: 5.0,
            neighbors_step: 1.0,
            kinds: Vec::new(),
            agents: Vec::new(),
        };
        let nothing = WorkLeft { scope: WorkScope::Share, runs: 0, kinds: Vec::new() };
        let config = ControlConfig::default();
        let time = ControlTime::of(&costs, Some(&cost), &nothing, 0, &config, &decisions(), 2);
        assert_eq!((time.representation_secs, time.secs), (9.0, 14.0));
        assert_eq!(time.parts(), "representation 9.0 s, models 5.0 s, runs 0.0 s");
    }

    #[test]
    fn only_what_is_missing_takes_disk() {
        let config = ControlConfig::default();
        let log = decisions();
        // One block per run.
        let runs = 3 * 4_096;
        assert_eq!(disk(&config, &log, true, 0, 3), runs);
        // 100 transitions and the start, two actions, three neighbours, five members, eight bytes. Then the log.
        let tables = 101 * 2 * 3 * 5 * 8;
        let whole = runs + tables + 101 * 12 + 24 * 100;
        assert_eq!(disk(&config, &log, false, 0, 3), whole);
        // 4,611 weights and biases of four bytes take five blocks in each network.
        assert_eq!(disk(&config, &log, false, 5, 3), whole + 5 * 5 * 4_096);
        assert_eq!(disk(&config, &log, true, 2, 3), runs + 2 * 5 * 4_096);
    }
}
