//! The training runs of a sweep, for agents in Python.

use std::{collections::BTreeMap, path::PathBuf, sync::Arc};

use calib_agent::{Part, PartScore};
use calib_pipeline::{ExternalCandidate, ExternalResult, SweepStreams, Told as _};
use calib_study::Study;
use pyo3::{exceptions::PyIndexError, prelude::*};

use crate::{
    array::{copied, owned},
    errors,
    lost::LostPages,
    observer::{Watch, watch_printer},
    study::{PyJob, VerdictJson, verdict_json},
    work::{Needs, run_step, watched},
};

/// Environment, run, first row, seed, fingerprint and number of steps.
type StreamInputs = (String, usize, u32, u64, String, usize);
/// States, and their unbroken segments.
type States<'py> = (Bound<'py, PyAny>, Vec<(usize, usize)>);
/// The hyperparameters of a setting as JSON, and whether it is the default.
type Candidate = (String, bool);

/// The streams of a study's sweep: the training inputs of each run.
#[pyclass(frozen, module = "calib_rl._calib")]
pub(crate) struct Streams {
    streams: SweepStreams,
    /// The number of lost pages when the streams were opened.
    lost_pages: LostPages,
}

/// The score of an agent on a stream.
#[pyclass(frozen, module = "calib_rl._calib")]
pub(crate) struct Score {
    result: ExternalResult,
    /// The error that counts, in units of the sensor's return.
    #[pyo3(get)]
    nrmse: f64,
    /// The part of the run that counts.
    part: Part,
}

#[pymethods]
impl Score {
    /// Returns the error that counts, in normalised units of the sensor.
    #[getter]
    fn rmse(&self) -> f64 {
        self.part_score(self.part).map_or(f64::NAN, |score| score.rmse)
    }

    /// Returns the error reduction against predicting the mean return of the steps that count.
    #[getter]
    fn skill(&self) -> f64 {
        self.part_score(self.part).map_or(f64::NAN, skill)
    }

    /// Returns the errors and the returns of each part of the run that has steps to score.
    #[getter]
    fn parts(&self) -> BTreeMap<&'static str, BTreeMap<&'static str, f64>> {
        Part::ALL
            .into_iter()
            .filter_map(|part| {
                let score = self.part_score(part)?;
                let numbers = [
                    ("rmse", score.rmse),
                    ("skill", skill(score)),
                    ("scored_steps", score.scored_steps as f64),
                    ("mean_return", score.mean_return),
                    ("return_std", score.return_std),
                ];
                Some((part.name(), numbers.into()))
            })
            .collect()
    }
}

impl Score {
    /// Returns the score of a part. Its errors are infinite if a prediction was not finite.
    fn part_score(&self, part: Part) -> Option<PartScore> {
        self.result.outcome.scores.of(part)
    }
}

/// Returns the skill as the verdict defines it: 0 for predicting the mean of the returns, 1 for no error.
fn skill(score: PartScore) -> f64 {
    if score.return_std > 0.0 { 1.0 - score.rmse / score.return_std } else { f64::NAN }
}

#[pymethods]
impl Streams {
    /// Opens the streams of a study whose model was built.
    #[staticmethod]
    #[pyo3(signature = (job, observer=None))]
    fn of_job(
        py: Python<'_>,
        job: &Bound<'_, PyJob>,
        observer: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let job = &job.get().job;
        let lost_pages = LostPages::so_far();
        let streams = watched(py, Needs::Tables, observer, |watch: &Arc<Watch>| {
            SweepStreams::of_job(job, &watch_printer(watch))
        })?;
        let streams = streams.map_err(|error| errors::of_step(py, &error))?;
        lost_pages.check(py)?;
        Ok(Self { streams, lost_pages })
    }

    /// Returns the inputs of each stream.
    fn runs(&self) -> Vec<StreamInputs> {
        let runs = self.streams.runs().iter().enumerate();
        runs.map(|(at, run)| {
            let inputs = run.inputs.short().to_string();
            let environment = run.environment.to_string();
            (environment, run.run, run.start_row, run.seed.get(), inputs, self.streams.steps_of(at))
        })
        .collect()
    }

    /// Returns the sensors, each with its column.
    fn sensors(&self) -> Vec<(String, usize)> {
        self.streams.sensors().to_vec()
    }

    #[getter]
    fn gamma(&self) -> f64 {
        self.streams.gamma()
    }

    /// Returns the discount factor of a stream.
    fn gamma_of(&self, stream: usize) -> PyResult<f64> {
        self.check(stream)?;
        Ok(self.streams.runs()[stream].gamma)
    }

    /// Returns the sensors that are predicted on a stream.
    fn predicted(&self, stream: usize) -> PyResult<Vec<String>> {
        self.check(stream)?;
        let sensors = self.streams.runs()[stream].sensors.iter();
        Ok(sensors.map(|(sensor, _)| sensor.clone()).collect())
    }

    /// Returns the part of a run that is scored.
    #[getter]
    fn part(&self) -> &'static str {
        self.streams.part().name()
    }

    /// Returns the states of a stream, `float32 [m, d]`, and its unbroken segments.
    fn states<'py>(&self, py: Python<'py>, stream: usize) -> PyResult<States<'py>> {
        self.check(stream)?;
        let states = &self.streams.runs()[stream].stream;
        let count = states.len();
        let width = states.width();
        let mut values = Vec::with_capacity(count * width);
        for t in 0..count {
            values.extend_from_slice(states.state(t));
        }
        self.lost_pages.check(py)?;
        let pieces = states.pieces().iter().map(|piece| (piece.start, piece.end)).collect();
        Ok((owned(py, values, &[count, width])?, pieces))
    }

    /// Scores the predictions of a sensor on a stream, one per step.
    fn score(
        &self,
        py: Python<'_>,
        stream: usize,
        sensor: &str,
        candidate: usize,
        predictions: &Bound<'_, PyAny>,
        updates: u64,
    ) -> PyResult<Score> {
        self.check(stream)?;
        let column = self.streams.runs()[stream].sensors.iter().find(|(name, _)| name == sensor);
        let Some((_, column)) = column else {
            return Err(errors::value(format!(
                "stream {stream} is not one of {sensor}; choose one with it in Stream.sensors"
            )));
        };
        let (predictions, _) = copied::<f32>(predictions, "predictions", &[1])?;
        let outcome = self
            .streams
            .score(stream, *column, &predictions, updates)
            .map_err(|error| errors::of_step(py, &error))?;
        self.lost_pages.check(py)?;
        let part = self.streams.part();
        let rmse = outcome.scores.of(part).map_or(f64::NAN, |score| score.rmse);
        let nrmse = rmse / self.streams.scale(sensor);
        let sensor = sensor.to_owned();
        Ok(Score { result: ExternalResult { stream, sensor, candidate, outcome }, nrmse, part })
    }

    /// Writes the scores of agents as a table of runs.
    fn write(
        &self,
        py: Python<'_>,
        path: PathBuf,
        candidates: Vec<Candidate>,
        scores: Vec<Bound<'_, Score>>,
    ) -> PyResult<()> {
        let candidates = candidates.into_iter().map(|(json, is_default)| {
            let values: serde_json::Map<String, serde_json::Value> =
                serde_json::from_str(&json).map_err(errors::unusable)?;
            Ok(ExternalCandidate { values: values.into_iter().collect(), is_default })
        });
        let candidates = candidates.collect::<PyResult<Vec<_>>>()?;
        let results: Vec<ExternalResult> =
            scores.iter().map(|score| score.get().result.clone()).collect();
        if let Some(bad) = results.iter().find(|result| result.candidate >= candidates.len()) {
            return Err(errors::value(format!("there is no candidate {}", bad.candidate)));
        }
        let written = watched(py, Needs::Tables, None, |_: &_| {
            self.streams.write(&path, &candidates, &results)
        })?;
        written.map_err(|error| errors::of_step(py, &error))
    }
}

impl Streams {
    fn check(&self, stream: usize) -> PyResult<()> {
        let count = self.streams.runs().len();
        if stream < count {
            return Ok(());
        }
        Err(PyIndexError::new_err(format!("stream {stream}: there are {count}, from 0 on")))
    }
}

/// Judges the runs of a table by a study, or by the defaults. Returns the verdict.
#[pyfunction]
#[pyo3(signature = (runs, job=None, output=None, observer=None))]
pub(crate) fn evaluate_runs(
    py: Python<'_>,
    runs: PathBuf,
    job: Option<&Bound<'_, PyJob>>,
    output: Option<PathBuf>,
    observer: Option<&Bound<'_, PyAny>>,
) -> PyResult<VerdictJson> {
    let study = job.map_or_else(Study::default, |job| job.get().job.study().clone());
    let judged = run_step(py, observer, |printer| {
        calib_pipeline::evaluate_runs(&runs, &study, output.as_deref(), printer)
    })?;
    verdict_json(judged.summary(), judged.outcome())
}
