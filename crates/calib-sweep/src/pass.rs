use std::sync::Arc;

use calib_agent::{
    AgentConfig, AgentError, CurveRule, Learner, Run, RunOutcome, train_learners, with_traces,
};
use calib_core::{Cancelled, Monitor, Stream};

use crate::{
    Baselines, PlanOptions, Program, RunStream, SettingRun, SweepError, UnitRuns, UnitSink,
    plan::UnitJob, program::outcomes, run_checkpoint::RunCheckpoint,
};

/// One pass over one stream. It trains the units of one run in one environment, one unit per sensor, with all their
/// settings side by side. The stream is made once and every mini-batch is gathered once. Each unit's result is the same
/// as if it were trained alone.
pub(crate) struct Pass<'p, 'a> {
    pub(crate) jobs: Vec<&'p UnitJob<'a>>,
    /// The external program that trains the agents, if any.
    pub(crate) program: Option<&'p dyn Program>,
    /// The log that baselines are fitted on.
    pub(crate) baselines: Option<&'p Baselines<'a>>,
    pub(crate) options: &'p PlanOptions,
    /// Work between two saved states of the run.
    pub(crate) work_between: u64,
}

impl Pass<'_, '_> {
    /// Trains the units and puts them into `sink`. Results are in the order of the jobs.
    pub(crate) fn run(
        &self,
        sink: &dyn UnitSink,
        monitor: &dyn Monitor,
    ) -> Result<Vec<UnitRuns>, SweepError> {
        let streamed = self.stream()?;
        if streamed.not_finite.is_some() {
            monitor.advance(self.options.span.steps as u64);
            return self.put(sink, &streamed, SettingRun::failed);
        }
        let stream = &streamed.stream;
        if let Some(program) = self.program {
            let outcomes = outcomes(program, &self.jobs, &**stream, self.options, monitor)?;
            return self.put_outcomes(sink, &streamed, outcomes);
        }
        let baselines = self.baselines(&**stream, monitor)?;
        let mut learners = self.learners();
        for (learner, baseline) in learners.iter_mut().zip(&baselines) {
            learner.baseline = baseline.as_deref();
        }
        let run = self.agent_run(&**stream);
        let kept = RunCheckpoint::new(sink, &self.jobs, self.work_between);
        let outcomes =
            train_learners(run, &learners, &kept, monitor).map_err(|source| self.failed(source))?;
        let results = self.put_outcomes(sink, &streamed, outcomes)?;
        kept.forget();
        Ok(results)
    }

    /// Returns the stream that the agents see.
    pub(crate) fn stream(&self) -> Result<RunStream, SweepError> {
        let first = self.jobs[0];
        first.environment.stream(first.unit.run)
    }

    /// Returns the agents of all jobs, in the order of the jobs.
    pub(crate) fn learners(&self) -> Vec<Learner<'_>> {
        self.jobs
            .iter()
            .flat_map(|job| {
                let cumulant = job.column;
                let start = job.start.map(|start| &start.checkpoint);
                let agents = job.agents.iter();
                agents.map(move |candidate| Learner {
                    config: &candidate.agent,
                    cumulant,
                    start,
                    baseline: None,
                })
            })
            .collect()
    }

    /// Returns the baseline predictions of each agent at each state of the stream.
    fn baselines(
        &self,
        stream: &dyn Stream,
        monitor: &dyn Monitor,
    ) -> Result<Vec<Option<Arc<[f32]>>>, Cancelled> {
        let pretrained: Option<Vec<_>> =
            self.jobs.iter().map(|job| pretrained_baseline(job, stream)).collect();
        if let Some(pretrained) = pretrained {
            return Ok(pretrained.concat());
        }
        let Some(baselines) = self.baselines else { return Ok(Vec::new()) };
        let first = self.jobs[0];
        let rows = first.environment.fitting_rows(first.unit.run);
        let agents: Vec<(&AgentConfig, usize)> = self
            .jobs
            .iter()
            .flat_map(|job| job.agents.iter().map(|candidate| (&candidate.agent, job.column)))
            .collect();
        baselines.predictions(&agents, stream, &rows, monitor)
    }

    /// Returns the run of the agents over the pass's stream.
    pub(crate) fn agent_run<'s>(&self, stream: &'s dyn Stream) -> Run<'s> {
        Run {
            stream,
            steps: self.options.span.steps_in(stream.len()),
            curve: CurveRule { windows: self.options.curve_points },
            seed: self.jobs[0].seed,
        }
    }

    /// Converts the error that ended training.
    fn failed(&self, source: AgentError) -> SweepError {
        match source {
            AgentError::Cancelled(cancelled) => cancelled.into(),
            source => SweepError::Agent { unit: self.jobs[0].unit.clone(), source },
        }
    }

    /// Stores the outcomes of all jobs, in the order of the jobs and their agents.
    pub(crate) fn put_outcomes(
        &self,
        sink: &dyn UnitSink,
        streamed: &RunStream,
        outcomes: Vec<RunOutcome>,
    ) -> Result<Vec<UnitRuns>, SweepError> {
        let mut outcomes = outcomes.into_iter();
        self.put(sink, streamed, |steps| {
            let outcome = outcomes.next().unwrap_or_else(|| unreachable!("one an agent"));
            SettingRun::new(steps, outcome)
        })
    }

    /// Stores the runs of all jobs, in the order of the jobs and their agents. `run` builds each from the number of
    /// steps in the stream.
    pub(crate) fn put(
        &self,
        sink: &dyn UnitSink,
        RunStream { stream, start_row, not_finite }: &RunStream,
        mut run: impl FnMut(usize) -> SettingRun,
    ) -> Result<Vec<UnitRuns>, SweepError> {
        // A piece of n states has n - 1 steps.
        let steps = stream.pieces().iter().map(|piece| {
            piece.end.saturating_sub(1).min(self.options.span.steps).saturating_sub(piece.start)
        });
        let steps = steps.sum();
        let made: Vec<UnitRuns> = self
            .jobs
            .iter()
            .map(|job| UnitRuns {
                key: job.key.clone(),
                unit: job.unit.clone(),
                seed: job.seed.get(),
                start_row: start_row.0,
                not_finite: *not_finite,
                runs: job
                    .settings
                    .iter()
                    .map(|setting| (setting.to_string(), run(steps)))
                    .collect(),
            })
            .collect();
        sink.put(&made)?;
        Ok(made)
    }
}

/// Returns the baseline predictions of each agent of the job, if the agents were pre-trained on top of a baseline.
fn pretrained_baseline(job: &UnitJob<'_>, stream: &dyn Stream) -> Option<Vec<Option<Arc<[f32]>>>> {
    let fitted = job.start?.baseline.as_ref()?;
    let traces = &job.agents.first()?.agent.traces;
    let values: Arc<[f32]> = fitted.predictions(&*with_traces(stream, traces)).into();
    Some(vec![Some(values); job.agents.len()])
}
