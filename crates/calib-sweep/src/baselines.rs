//! Simple predictors that agents start from. Each is fitted on the part of the log that the run does not replay.

use std::{
    collections::{BTreeMap, HashMap},
    sync::{Arc, Mutex},
};

use calib_agent::{
    AgentConfig, CurveRule, FittedPredictor, Fitter, Scores, SimplePredictor, score_predictions,
    with_traces,
};
use calib_core::{Cancelled, Frames, Monitor, RowStream, Stream, locked};
use calib_files::{Fingerprint, Fingerprinter};
use rayon::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{Environment, EnvironmentId, FittingRows, Span, SweepError};

/// Version of the fitting method. Raise it when the same log gives other coefficients.
const FIT_VERSION: u8 = 2;

/// Smallest share of the log that predictors are fitted on. If fewer rows are left, they are fitted on the whole log,
/// including the rows that the run replays.
const LEAST_SHARE: f64 = 0.2;

/// The log that simple predictors are fitted on, with a cache of those already fitted.
pub struct Baselines<'a> {
    log: &'a Frames,
    fingerprint: Fingerprint,
    /// One lock per group: runs that need the same predictors wait for each other, other runs do not.
    fitted: Mutex<HashMap<FittingGroup, Arc<Mutex<Fits>>>>,
}

/// The key of predictors that are fitted on the same numbers. γ and trace decays are compared bit by bit.
#[derive(Clone, PartialEq, Eq, Hash)]
struct FittingGroup {
    gamma: u64,
    traces: Vec<u64>,
    rows: FittingRows,
}

/// A predictor kind and the column that it predicts.
type WantedPredictor = (SimplePredictor, usize);

type Fits = BTreeMap<WantedPredictor, Arc<FittedPredictor>>;

impl<'a> Baselines<'a> {
    /// Creates an empty cache of predictors for the training log `log`.
    pub fn new(log: &'a Frames) -> Self {
        let mut fingerprint = Fingerprinter::default();
        fingerprint.add(&[FIT_VERSION]).add(bytemuck::cast_slice(log.states().as_slice()));
        for segment in log.segments().iter() {
            fingerprint.add(&(segment.rows().end as u64).to_le_bytes());
        }
        Self { log, fingerprint: fingerprint.finish(), fitted: Mutex::default() }
    }

    /// Returns the fingerprint of the log and the fitting method. The rows that a run replays belong to the inputs of
    /// its stream instead.
    pub fn fingerprint(&self) -> &Fingerprint {
        &self.fingerprint
    }

    /// Returns the `wanted` predictors for an agent like `agent`, fitted on `rows`. A fit on a wide log takes seconds,
    /// so the `monitor` is checked before each fit.
    fn fitted(
        &self,
        wanted: &[WantedPredictor],
        agent: &AgentConfig,
        rows: &FittingRows,
        monitor: &dyn Monitor,
    ) -> Result<Vec<Arc<FittedPredictor>>, Cancelled> {
        let group = FittingGroup {
            gamma: agent.gamma.to_bits(),
            traces: agent.traces.iter().map(|decay| decay.to_bits()).collect(),
            rows: rows.clone(),
        };
        let fits = Arc::clone(locked(&self.fitted).entry(group).or_default());
        let mut fits = locked(&fits);
        let missing: Vec<WantedPredictor> =
            wanted.iter().copied().filter(|wanted| !fits.contains_key(wanted)).collect();
        if !missing.is_empty() {
            monitor.check()?;
            let replay = RowStream::replay(self.log.states().clone(), self.log.segments());
            let stream = with_traces(&replay, &agent.traces);
            let excluded = rows.excluded(self.log.rows());
            let mut fitter = Fitter::new(&*stream, agent.gamma, &excluded);
            if let FittingRows::AllBut(_) = rows {
                let all = Fitter::new(&*stream, agent.gamma, &[]);
                if (fitter.rows() as f64) < LEAST_SHARE * all.rows() as f64 {
                    fitter = all;
                }
            }
            for (predictor, column) in missing {
                monitor.check()?;
                fits.insert((predictor, column), Arc::new(fitter.fit(predictor, column)));
            }
        }
        Ok(wanted.iter().map(|wanted| Arc::clone(&fits[wanted])).collect())
    }

    /// Fits every simple predictor for each sensor on `rows`. `sensors` holds names and state columns.
    ///
    /// # Errors
    /// Returns an error if the `monitor` asks to stop.
    pub fn simple(
        &self,
        sensors: &[(String, usize)],
        gamma: f64,
        rows: &FittingRows,
        monitor: &dyn Monitor,
    ) -> Result<Vec<FittedSimple>, Cancelled> {
        let agent = AgentConfig { gamma, ..AgentConfig::default() };
        let each = sensors.iter().flat_map(|(sensor, column)| {
            SimplePredictor::ALL.into_iter().map(move |predictor| (sensor, (predictor, *column)))
        });
        let wanted: Vec<WantedPredictor> = each.clone().map(|(_, wanted)| wanted).collect();
        // One call for all predictors, so that shared sums over the log are computed once.
        let fitted = self.fitted(&wanted, &agent, rows, monitor)?;
        let named = each.zip(fitted).map(|((sensor, (predictor, column)), fitted)| FittedSimple {
            sensor: sensor.clone(),
            column,
            predictor,
            fitted: (*fitted).clone(),
        });
        Ok(named.collect())
    }

    /// Returns the best simple predictor of each sensor, fitted on the whole log. An agent with `baseline = "best"`
    /// starts from it at deployment. Sensors with too few rows to compare predictors have no entry. `sensors` holds
    /// names and state columns.
    ///
    /// # Errors
    /// Returns an error if the `monitor` asks to stop.
    pub fn best(
        &self,
        sensors: &[(String, usize)],
        gamma: f64,
        monitor: &dyn Monitor,
    ) -> Result<BTreeMap<String, SimplePredictor>, Cancelled> {
        monitor.check()?;
        let stream = RowStream::replay(self.log.states().clone(), self.log.segments());
        let fitter = Fitter::new(&stream, gamma, &[]);
        let mut all = BTreeMap::new();
        for (sensor, column) in sensors {
            monitor.check()?;
            if let Some(best) = fitter.best_of(*column) {
                all.insert(sensor.clone(), best);
            }
        }
        Ok(all)
    }

    /// Returns the baseline predictions at each state of a run's stream, for each agent and its predicted column. An
    /// agent without a baseline gets `None`. `rows` are those that the run's predictors may be fitted on.
    pub(crate) fn predictions(
        &self,
        agents: &[(&AgentConfig, usize)],
        stream: &dyn Stream,
        rows: &FittingRows,
        monitor: &dyn Monitor,
    ) -> Result<Vec<Option<Arc<[f32]>>>, Cancelled> {
        let mut made: Vec<Option<Arc<[f32]>>> = vec![None; agents.len()];
        for place in 0..agents.len() {
            let (agent, _) = agents[place];
            if made[place].is_some() || agent.baseline.is_none() {
                continue;
            }
            let mut wanted: Vec<WantedPredictor> =
                agents[place..].iter().filter_map(|&other| wanted_beside(agent, other)).collect();
            wanted.sort_unstable();
            wanted.dedup();
            let seen = with_traces(stream, &agent.traces);
            let fitted = self.fitted(&wanted, agent, rows, monitor)?;
            let values: Vec<Arc<[f32]>> =
                fitted.iter().map(|fitted| fitted.predictions(&*seen).into()).collect();
            for (other, made) in made.iter_mut().enumerate().skip(place) {
                if let Some(own) = wanted_beside(agent, agents[other]) {
                    let at = wanted.partition_point(|wanted| *wanted < own);
                    *made = Some(Arc::clone(&values[at]));
                }
            }
        }
        Ok(made)
    }
}

/// Returns the baseline of an agent and its predicted column, if it has the discount factor and the traces of `agent`.
fn wanted_beside(
    agent: &AgentConfig,
    (other, column): (&AgentConfig, usize),
) -> Option<WantedPredictor> {
    let is_alike = other.gamma == agent.gamma && other.traces == agent.traces;
    is_alike.then_some((other.baseline?, column))
}

/// A simple predictor of a sensor, with its coefficients. Inputs are normalised states, outputs normalised returns.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct FittedSimple {
    /// The predicted sensor.
    pub sensor: String,
    /// Index of its column in the states.
    pub column: usize,
    /// Kind of the predictor.
    pub predictor: SimplePredictor,
    /// Its coefficients.
    pub fitted: FittedPredictor,
}

/// The error of a simple predictor over one recorded window.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct SimpleScore {
    /// The predicted sensor.
    pub sensor: String,
    /// Kind of the predictor.
    pub predictor: SimplePredictor,
    /// Whether the window is of the held-out range or of the log.
    pub environment: EnvironmentId,
    /// Row of this range at which the window begins.
    pub start_row: u32,
    /// Its errors, over the same steps as those of agents.
    pub scores: Scores,
}

/// A window of a recorded log that predictors are scored on.
pub struct RecordedWindow {
    /// Whether the window is from the held-out range or the training log.
    pub environment: EnvironmentId,
    /// Row of that range at which the window begins.
    pub start_row: u32,
    /// The rows to fit on: those outside the window.
    pub fitting_rows: FittingRows,
    /// The states of the window.
    pub stream: Box<dyn Stream>,
}

/// Returns the distinct recorded windows of these environments.
///
/// # Errors
/// Returns an error if a stream cannot be made.
pub fn recorded_windows(
    environments: &[Box<dyn Environment + '_>],
) -> Result<Vec<RecordedWindow>, SweepError> {
    let mut windows: Vec<RecordedWindow> = Vec::new();
    for environment in environments {
        let id = environment.id();
        if matches!(id, EnvironmentId::Member(_)) {
            continue;
        }
        for run in 0..environment.runs() {
            let streamed = environment.stream(run)?;
            let start_row = streamed.start_row.0;
            if !windows
                .iter()
                .any(|window| window.environment == id && window.start_row == start_row)
            {
                let fitting_rows = environment.fitting_rows(run);
                let stream = streamed.stream;
                windows.push(RecordedWindow { environment: id, start_row, fitting_rows, stream });
            }
        }
    }
    Ok(windows)
}

/// Scores every simple predictor on these windows. Scores are ordered by window, sensor and predictor. Predictors see
/// the state and are fitted on rows outside the window.
///
/// # Errors
/// Returns an error if a window has no step to score, or the `monitor` asks to stop.
pub fn simple_scores(
    baselines: &Baselines<'_>,
    windows: &[RecordedWindow],
    sensors: &[(String, usize)],
    gamma: f64,
    span: Span,
    monitor: &dyn Monitor,
) -> Result<Vec<SimpleScore>, SweepError> {
    let scores: Result<Vec<Vec<SimpleScore>>, SweepError> = windows
        .par_iter()
        .map(|window| window_scores(baselines, window, sensors, gamma, span, monitor))
        .collect();
    Ok(scores?.into_iter().flatten().collect())
}

/// Scores the predictors on one window, as [`simple_scores`] does.
fn window_scores(
    baselines: &Baselines<'_>,
    window: &RecordedWindow,
    sensors: &[(String, usize)],
    gamma: f64,
    span: Span,
    monitor: &dyn Monitor,
) -> Result<Vec<SimpleScore>, SweepError> {
    let stream = &*window.stream;
    let steps = span.steps_in(stream.len());
    let fitted = baselines.simple(sensors, gamma, &window.fitting_rows, monitor)?;
    let mut scores = Vec::with_capacity(fitted.len());
    for FittedSimple { sensor, column, predictor, fitted } in fitted {
        let predictions = fitted.predictions(stream);
        let curve = CurveRule { windows: 0 };
        let run = score_predictions(stream, column, gamma, &predictions[..steps], 0, curve)
            .map_err(SweepError::Together)?;
        scores.push(SimpleScore {
            sensor,
            predictor,
            environment: window.environment,
            start_row: window.start_row,
            scores: run.scores,
        });
    }
    Ok(scores)
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

    use calib_core::{Segments, Silent, States, Timestamp};

    use super::*;

    /// A monitor that asks to stop after this many checks.
    struct StopsAfter(AtomicUsize);

    impl Monitor for StopsAfter {
        fn interrupted(&self) -> bool {
            let left = self.0.load(Relaxed);
            self.0.store(left.saturating_sub(1), Relaxed);
            left == 0
        }
    }

    /// Returns a log with two oscillating columns.
    fn log(rows: usize) -> Frames {
        let values = (0..rows).flat_map(|row| [row as f32 / 7.0, row as f32 / 11.0]);
        let states = States::new(values.map(f32::sin).collect(), rows, 2).expect("valid");
        let times = (0..rows as i64).map(|row| Timestamp::from_micros(1_000_000 * row)).collect();
        let segments = Segments::from_lengths([rows]).expect("valid");
        Frames::new(times, segments, states).expect("valid")
    }

    #[test]
    fn fits_stop_between_predictors_and_go_on_from_there() {
        let log = log(400);
        let baselines = Baselines::new(&log);
        let sensors = [("A".to_owned(), 0), ("B".to_owned(), 1)];
        let fitted =
            |monitor: &dyn Monitor| baselines.simple(&sensors, 0.5, &FittingRows::All, monitor);
        assert_eq!(fitted(&StopsAfter(AtomicUsize::new(0))), Err(Cancelled));
        // The monitor is checked once at the start and once before each of the two fits.
        assert_eq!(fitted(&StopsAfter(AtomicUsize::new(3))), Err(Cancelled));
        let kept: usize = locked(&baselines.fitted).values().map(|fits| locked(fits).len()).sum();
        assert_eq!(kept, 2);
        let all = fitted(&Silent).expect("time enough");
        assert_eq!(all.len(), 2 * SimplePredictor::ALL.len());
        let at_once = Baselines::new(&log).simple(&sensors, 0.5, &FittingRows::All, &Silent);
        assert_eq!(Ok(all), at_once);
        let stopped = baselines.best(&sensors, 0.5, &StopsAfter(AtomicUsize::new(2)));
        assert_eq!(stopped, Err(Cancelled), "between two sensors");
    }
}
