//! What passes will take: a few steps of them are made and timed.

use std::{collections::BTreeMap, time::Duration};

use anyhow::Context as _;
use calib_agent::{CurveRule, Learner, NoKeeper, Run, train_learners};
use calib_core::Silent;
use calib_study::Study;
use calib_sweep::{Candidate, Environment, RunStream, Start};

use crate::{
    base::clock::Stopwatch,
    sweep::setting::{Setting, agent_seed},
};

/// What a pass trains.
#[derive(Clone, Copy)]
pub(crate) struct Trained<'a> {
    pub(crate) study: &'a Study,
    pub(crate) candidates: &'a [Candidate],
    /// Name and column of each.
    pub(crate) sensors: &'a [(String, usize)],
    /// What agents start from, by sensor, if they were pre-trained.
    pub(crate) starts: &'a BTreeMap<String, Start>,
    /// Steps of every stream.
    pub(crate) steps: usize,
}

impl<'a> Trained<'a> {
    /// What the passes of a sweep train.
    pub(crate) fn of(study: &'a Study, setting: &'a Setting) -> Self {
        let Setting { candidates, sensors, starts, streams, .. } = setting;
        Self { study, candidates, sensors, starts, steps: streams.demand.span.steps }
    }
}

/// Seconds of a pass over a stream by all values, on one thread.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Cost {
    /// Whatever the number of sensors.
    fixed: f64,
    /// For each sensor.
    sensor: f64,
}

/// How long the steps take that are timed.
const TIMED: Duration = Duration::from_millis(600);
/// Steps that are made before: buffers fill, caches warm.
const WARMING: usize = 64;
/// Sensors that are trained beside one another to see what they share.
const BESIDE: usize = 4;

impl Cost {
    /// Of the passes of a sweep.
    ///
    /// # Errors
    /// If the sweep has no environments, or agents cannot be trained.
    pub(crate) fn measure(
        trained: Trained<'_>,
        environments: &[Box<dyn Environment + '_>],
    ) -> anyhow::Result<Self> {
        let environment = environments.iter().find(|environment| environment.runs() > 0);
        let environment = environment.context("the sweep has no runs")?;
        let clock = Stopwatch::start();
        let streamed = environment.stream(0)?;
        Self::over(trained, &streamed, clock.elapsed().as_secs_f64())
    }

    /// Of passes over a stream that took `making` seconds to make.
    ///
    /// # Errors
    /// If agents cannot be trained.
    pub(crate) fn over(
        trained: Trained<'_>,
        streamed: &RunStream,
        making: f64,
    ) -> anyhow::Result<Self> {
        let of = |sensors: usize| seconds(trained, streamed, sensors);
        let (one, beside) = (of(1)?, trained.sensors.len().min(BESIDE));
        if beside < 2 {
            return Ok(Self { fixed: making, sensor: one });
        }
        let sensor = ((of(beside)? - one) / (beside - 1) as f64).clamp(0.3 * one, one);
        Ok(Self { fixed: making + one - sensor, sensor })
    }

    /// Of a pass of so many sensors.
    pub(crate) fn of(self, sensors: usize) -> f64 {
        self.fixed + sensors as f64 * self.sensor
    }
}

/// Of a pass of the first `sensors` sensors over a whole stream.
fn seconds(trained: Trained<'_>, streamed: &RunStream, sensors: usize) -> anyhow::Result<f64> {
    let Trained { study, candidates, starts, steps, .. } = trained;
    let stream = &*streamed.stream;
    let all = steps.min(stream.len().saturating_sub(1));
    let learners: Vec<Learner<'_>> = trained.sensors[..sensors]
        .iter()
        .flat_map(|(sensor, column)| {
            let start = starts.get(sensor).map(|start| &start.checkpoint);
            let config = candidates.iter().map(|candidate| &candidate.agent);
            config.map(move |config| Learner { config, cumulant: *column, start, baseline: None })
        })
        .collect();
    let timed = |steps: usize| -> anyhow::Result<f64> {
        let curve = CurveRule { windows: study.sweep.curve_points };
        let run = Run { stream, steps, curve, seed: agent_seed(study) };
        let clock = Stopwatch::start();
        train_learners(run, &learners, &NoKeeper, &Silent)?;
        Ok(clock.elapsed().as_secs_f64())
    };
    // Until a mini-batch can be drawn a step costs next to nothing.
    let batches = candidates.iter().map(|candidate| candidate.agent.batch_size);
    let first = all.min(WARMING.max(batches.max().unwrap_or(0)));
    let before = timed(first)?;
    let mut steps = 16;
    loop {
        let last = all.min(first + steps);
        let after = timed(last)?;
        let took = (after - before).max(0.0);
        if last == all {
            return Ok(after);
        }
        if took > TIMED.as_secs_f64() {
            return Ok(before + took * (all - first) as f64 / (last - first) as f64);
        }
        steps *= if took < 0.1 * TIMED.as_secs_f64() { 8 } else { 2 };
    }
}
