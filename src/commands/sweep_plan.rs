//! What a sweep would do, before it does it.

use anyhow::bail;
use calib_agent::{AgentConfig, training_bytes};
use calib_data::Dataset;
use calib_sweep::{Candidate, Role};
use serde::Serialize;

use crate::{
    memory,
    output::{Printer, bytes, count, table},
    study::Study,
};

/// What is to be done: the result of a dry run.
#[derive(Debug, Serialize)]
pub(super) struct SweepPlan<'a> {
    /// Every value, in the order of the results.
    pub(super) candidates: &'a [Candidate],
    /// Units (environment, run) in all.
    pub(super) units: usize,
    /// Units that have no result yet.
    pub(super) left: usize,
    /// Steps of every stream.
    pub(super) steps: usize,
    /// Threads that share the work.
    pub(super) threads: usize,
    /// What it takes.
    pub(super) memory: Memory,
}

/// Bytes that a sweep takes at most.
#[derive(Clone, Copy, Debug, Serialize)]
pub(super) struct Memory {
    /// Recorded states, shared by all threads.
    pub(super) data: u64,
    /// One stream with its agents, on each thread that has a unit to run.
    pub(super) thread: u64,
    /// Results and learning curves of all units.
    pub(super) results: u64,
    /// All of it.
    pub(super) total: u64,
    /// What the system has, where it says so.
    pub(super) available: Option<u64>,
}

impl Memory {
    /// Of a sweep of `candidates` over `units` units of `steps` steps, of which `left` are still to be run.
    pub(super) fn of(
        study: &Study,
        dataset: &Dataset,
        candidates: &[Candidate],
        steps: usize,
        [units, left]: [usize; 2],
    ) -> Self {
        let width = dataset.train.states().columns();
        let held_out = dataset.held_out.as_ref().map_or(0, calib_core::Frames::rows);
        // The model keeps the training states of its own; states are f32, timestamps 8 bytes.
        let rows = 2 * dataset.train.rows() + held_out;
        let data = (rows * (4 * width + 8)) as u64;
        let agents: Vec<AgentConfig> =
            candidates.iter().map(|candidate| candidate.agent.clone()).collect();
        let sensors = study.sweep.sensors.len();
        // A stream is a list of row numbers.
        let thread = 4 * (steps as u64 + 1) + training_bytes(&agents, sensors, width, steps + 1);
        let row = 200 + 24 * study.sweep.curve_points as u64;
        let results = (units * candidates.len() * sensors) as u64 * row;
        let threads = rayon::current_num_threads().min(left) as u64;
        let total = data + threads * thread + results;
        Self { data, thread, results, total, available: memory::available() }
    }

    fn text(&self) -> String {
        let available = self
            .available
            .map_or_else(String::new, |available| format!("; {} are available", bytes(available)));
        format!(
            "memory: up to {} ({} of data, {} a thread, {} of results){available}",
            bytes(self.total),
            bytes(self.data),
            bytes(self.thread),
            bytes(self.results)
        )
    }
}

impl SweepPlan<'_> {
    /// Say what will be done, and refuse what would not fit.
    pub(super) fn announce(&self, study: &Study, printer: &Printer) -> anyhow::Result<()> {
        printer.say(&format!(
            "{} values x {} units (sensor, environment, run) of {} steps, for {}; {} left to run on {} threads",
            self.candidates.len(),
            count(self.units),
            count(self.steps),
            study.sweep.sensors.join(", "),
            if self.left == self.units { "all units are".to_owned() } else { format!("{} units are", count(self.left)) },
            self.threads,
        ));
        if self.left == 0 {
            return Ok(());
        }
        let memory = &self.memory;
        printer.say(&memory.text());
        let Some(available) = memory.available.filter(|&available| memory.total > available) else {
            return Ok(());
        };
        let shared = memory.data + memory.results;
        let fit = available.saturating_sub(shared) / memory.thread.max(1);
        let advice = if fit > 0 {
            format!("use --threads {fit}, or fewer or smaller values")
        } else if memory.thread > shared {
            "sweep fewer or smaller values (hidden_units, batch_size), or set a smaller sweep.steps"
                .to_owned()
        } else {
            "use a shorter data.train or a larger preprocess.subsample, or set a smaller sweep.curve_points"
                .to_owned()
        };
        bail!(
            "the sweep may take {} of memory and {} are available; {advice}",
            bytes(memory.total),
            bytes(available)
        )
    }

    /// Every value, as a list or for machines.
    pub(super) fn show(&self, json: bool, printer: &Printer) -> anyhow::Result<()> {
        if json {
            return printer.json(self);
        }
        let rows: Vec<Vec<String>> = self
            .candidates
            .iter()
            .map(|candidate| {
                let note = match (candidate.role, candidate.is_default) {
                    (Role::Default, _) => "the default, Online only",
                    (Role::Grid, true) => "the default",
                    (Role::Grid, false) => "",
                };
                vec![candidate.label(), candidate.index.to_string(), note.to_owned()]
            })
            .collect();
        printer.result(&table(&["value", "candidate", ""], &rows))
    }
}
