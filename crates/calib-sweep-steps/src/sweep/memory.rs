//! The memory that a sweep needs.

use calib_agent::{Accelerator, AgentConfig, MOST_TOGETHER, training_bytes};
use calib_base::{StepError, bail, memory, output::bytes};
use calib_data::Dataset;
use calib_model::ModelFamily;
use calib_study::Study;
use calib_sweep::{Candidate, Span};
use schemars::JsonSchema;
use serde::Serialize;

/// Largest memory use of a sweep in bytes, without calib itself.
#[derive(Clone, Copy, Debug, Serialize, JsonSchema)]
pub(crate) struct Memory {
    /// Recorded states, shared by all threads.
    pub(crate) data: u64,
    /// One stream with its agents, on each thread with a unit to run.
    pub(crate) thread: u64,
    /// Rollouts of a network, which are kept because every sensor uses them: all states of all runs.
    pub(crate) predictions: u64,
    /// Results and learning curves of all units.
    pub(crate) results: u64,
    /// Sum of all these.
    pub(crate) total: u64,
    /// Memory that the system has, if it reports it.
    pub(crate) available: Option<u64>,
}

/// Returns the agents of all settings.
pub fn agents_of(candidates: &[Candidate]) -> Vec<AgentConfig> {
    candidates.iter().map(|candidate| candidate.agent.clone()).collect()
}

/// Returns the memory of agents that learn along one stream. The memory of an external program is not known. For its
/// agents calib keeps one prediction per agent and state, and the returns.
fn agents_bytes(agents: &[AgentConfig], sensors: usize, width: usize, states: usize) -> u64 {
    if agents.iter().any(AgentConfig::is_external) {
        (states * (4 * agents.len() + 8) * sensors) as u64
    } else {
        training_bytes(agents, sensors, width, states)
    }
}

/// The quantities that the memory of a sweep depends on.
pub(crate) struct Sizes {
    /// Recorded states: the training range, counted twice if there is a model, and the held-out range.
    rows: usize,
    /// Number of values in a state.
    width: usize,
    /// Length of streams.
    span: Span,
    sensors: usize,
    curve_points: usize,
    /// All units: one per sensor, environment and run.
    units: usize,
    /// Remaining passes over streams, each for all sensors.
    passes: usize,
    /// Runs of a model whose rollouts are kept in memory.
    predicted_runs: usize,
}

impl Sizes {
    /// Returns the sizes of a sweep with `units` units and streams of length `span`. `passes` passes over streams are
    /// left.
    pub(crate) fn of(
        study: &Study,
        dataset: &Dataset,
        span: Span,
        [units, passes]: [usize; 2],
    ) -> Self {
        let held_out = dataset.held_out.as_ref().map_or(0, calib_core::Frames::rows);
        Self {
            rows: (1 + usize::from(study.has_model())) * dataset.train.rows() + held_out,
            width: dataset.train.states().columns(),
            span,
            sensors: study.sweep.sensors.len(),
            curve_points: study.sweep.curve_points,
            units,
            passes,
            predicted_runs: match study.model.kind.family() {
                ModelFamily::Network => study.member_runs() * study.gammas().len(),
                ModelFamily::Neighbors | ModelFamily::None => 0,
            },
        }
    }
}

impl Memory {
    /// Estimates the memory of a sweep of `agents` on this many threads.
    pub(crate) fn of(sizes: &Sizes, agents: &[AgentConfig], threads: usize) -> Self {
        let &Sizes { rows, width, span, sensors, curve_points, units, passes, predicted_runs } =
            sizes;
        let states = span.states();
        // States are f32, timestamps 8 bytes.
        let data = (rows * (4 * width + 8)) as u64;
        // A stream is a list of row numbers.
        let thread = 4 * states as u64 + agents_bytes(agents, sensors, width, states);
        let predictions = 4 * (predicted_runs * states * width) as u64;
        let row = 200 + 24 * curve_points as u64;
        let results = (units * agents.len()) as u64 * row;
        let total = data + threads.min(passes) as u64 * thread + predictions + results;
        Self { data, thread, predictions, results, total, available: memory::available() }
    }

    /// Estimates the memory on this machine if an accelerator trains runs side by side. Streams are held twice on their
    /// way there. Networks count only if the accelerator has no memory of its own.
    pub(crate) fn side_by_side(self, sizes: &Sizes, accelerator: &dyn Accelerator) -> Self {
        let states = sizes.span.states();
        let runs = sizes.passes.min(MOST_TOGETHER);
        // Beside the states: returns of each sensor, the learning course, and the random draws.
        let of_run = (states * (8 * sizes.width + 8 * sizes.sensors + 32)) as u64;
        let thread = accelerator.memory() + runs as u64 * of_run;
        let total = self.data + thread + self.predictions + self.results;
        Self { thread, total, ..self }
    }

    /// Whether the memory is available.
    pub(crate) fn fits(&self) -> bool {
        self.available.is_none_or(|available| self.total <= available)
    }

    /// Refuses a sweep that does not fit.
    ///
    /// # Errors
    /// Returns an error with a remedy if there is less memory.
    pub(crate) fn check(&self) -> Result<(), StepError> {
        let Some(available) = self.available.filter(|_| !self.fits()) else { return Ok(()) };
        let shared = self.data + self.predictions + self.results;
        let fit = available.saturating_sub(shared) / self.thread.max(1);
        let advice = if fit > 0 {
            format!("use --threads {fit}, or fewer or smaller settings")
        } else if self.thread > shared {
            "sweep fewer or smaller settings (hidden_units, batch_size), or set a smaller sweep.steps"
                .to_owned()
        } else {
            "use a shorter data.train or a larger preprocess.subsample, or set a smaller sweep.curve_points"
                .to_owned()
        };
        bail!(
            "the sweep may take {} of memory and {} are available; {advice}",
            bytes(self.total),
            bytes(available)
        )
    }

    pub(super) fn text(&self) -> String {
        let predictions = match self.predictions {
            0 => String::new(),
            predictions => format!(", {} of predicted states", bytes(predictions)),
        };
        let parts = format!(
            "{} of data, {} a thread{predictions}, {} of results",
            bytes(self.data),
            bytes(self.thread),
            bytes(self.results)
        );
        memory::plan_line(self.total, &parts, self.available)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_array_counts_once() {
        let sizes = Sizes {
            rows: 1000,
            width: 10,
            span: Span { steps: 99, tail: 1 },
            sensors: 3,
            curve_points: 50,
            units: 60,
            passes: 20,
            predicted_runs: 16,
        };
        let agents =
            [AgentConfig::default(), AgentConfig { learning_rate: 0.5, ..AgentConfig::default() }];
        let memory = Memory::of(&sizes, &agents, 4);
        assert_eq!(memory.data, 1000 * 48);
        assert_eq!(memory.predictions, 16 * 100 * 10 * 4);
        // One row per unit and setting. Units already have a single sensor.
        assert_eq!(memory.results, 60 * 2 * (200 + 24 * 50));
        assert_eq!(memory.thread, 4 * 100 + training_bytes(&agents, 3, 10, 100));
        assert_eq!(memory.total, 48_000 + 4 * memory.thread + 64_000 + 168_000);
        // Two passes use at most two threads, however many units they make.
        let few = Memory::of(&Sizes { passes: 2, predicted_runs: 0, ..sizes }, &agents, 4);
        assert_eq!(few.total, 48_000 + 2 * memory.thread + 168_000);
    }
}
