//! Models with actions: their arrays, rollouts of many agents at once, and the verdict on a sweep of agents in them.

use std::{
    path::PathBuf,
    sync::{Arc, OnceLock},
};

use calib_control::{
    ActionModel, ActionRollouts, ConstantReturns, ControlError, Doubt, FixedRollouts, Increments,
    NetworkModel, Pessimism, Question, ReturnVerdict, Rules, Run, RunLength, StepModel, Support,
    judge,
};
use calib_core::{Monitor, Seed};
use calib_pipeline::{Advice, ControlModel, PYTHON, Reason, StepError, unstored_networks};
use calib_report::Decision;
use pyo3::{exceptions::PyIndexError, prelude::*};
use serde::Serialize;

use crate::{
    acting_rollouts::PyActionRollouts,
    array::{owned, view},
    errors,
    lost::LostPages,
    model::require_member,
    observer::WatchMonitor,
    rollouts::SeenColumn,
    shared_action_model::SharedActionModel,
    study::PyJob,
    work::{Needs, watched},
};

/// A model with actions.
#[pyclass(frozen, module = "calib_rl._calib", name = "ActionModel")]
pub(crate) struct PyActionModel {
    shared: Arc<SharedActionModel>,
    directory: PathBuf,
}

impl PyActionModel {
    /// Opens a model. Arrays are mapped and no table is read, so this also works in a forked process.
    fn opened(
        py: Python<'_>,
        directory: PathBuf,
        open: impl FnOnce() -> Result<ControlModel, StepError> + Send,
    ) -> PyResult<Self> {
        let lost_pages = LostPages::so_far();
        let opened = watched(py, Needs::Threads, None, |_| open())?;
        let opened = opened.map_err(|error| errors::of_step(py, &error))?;
        lost_pages.check(py)?;
        let (increments, networks) = (OnceLock::new(), OnceLock::new());
        let shared = SharedActionModel { opened, lost_pages, increments, networks };
        Ok(Self { shared: Arc::new(shared), directory })
    }

    pub(crate) fn model(&self) -> &ActionModel {
        &self.shared.opened.model
    }

    /// Returns the name of each action, and the values that it sets.
    pub(crate) fn described_actions(&self) -> Vec<(String, Vec<f64>)> {
        let names = &self.shared.opened.names;
        names.actions.iter().cloned().zip(names.levels.iter().cloned()).collect()
    }

    /// Returns the increments of the model. They are made at their first use.
    fn increments(&self, py: Python<'_>) -> PyResult<Arc<Increments>> {
        let coverage = self.shared.opened.coverage;
        made_once(py, &self.shared.increments, |monitor| {
            Increments::new(self.model(), coverage, monitor)
        })
    }

    /// Returns the networks of the model. They are read, or trained at their first use.
    fn networks(&self, py: Python<'_>) -> PyResult<Arc<NetworkModel>> {
        made_once(py, &self.shared.networks, |monitor| self.shared.opened.networks(monitor))
    }

    fn check_member(&self, member: usize) -> PyResult<()> {
        require_member(member, self.model().blocks().members())
    }
}

/// Returns the value in `cell`. `make` makes it at its first use; Ctrl-C ends it.
fn made_once<T: Send + Sync>(
    py: Python<'_>,
    cell: &OnceLock<Arc<T>>,
    make: impl FnOnce(&dyn Monitor) -> Result<T, ControlError> + Send,
) -> PyResult<Arc<T>> {
    if let Some(value) = cell.get() {
        return Ok(Arc::clone(value));
    }
    let made = watched(py, Needs::Threads, None, |watch| make(&WatchMonitor(Arc::clone(watch))))?;
    let made = Arc::new(made.map_err(|error| errors::of_any(py, &error))?);
    Ok(Arc::clone(cell.get_or_init(|| made)))
}

#[pymethods]
impl PyActionModel {
    /// Opens the model in a folder.
    #[staticmethod]
    fn open(py: Python<'_>, directory: PathBuf) -> PyResult<Self> {
        let place = directory.clone();
        Self::opened(py, directory, || ControlModel::in_directory(&place))
    }

    /// Opens the model of a study, which must have been built.
    #[staticmethod]
    fn of_job(py: Python<'_>, job: &Bound<'_, PyJob>) -> PyResult<Self> {
        let job = &job.get().job;
        Self::opened(py, job.layout().control_model(), || ControlModel::of_job(job))
    }

    /// Returns the folder that the model was opened from.
    #[getter]
    fn directory(&self) -> PathBuf {
        self.directory.clone()
    }

    #[getter]
    fn members(&self) -> usize {
        self.model().blocks().members()
    }

    #[getter]
    fn k(&self) -> usize {
        self.model().k()
    }

    #[getter]
    fn transitions(&self) -> usize {
        self.model().log().len()
    }

    /// Returns the distance up to which a recorded transition covers a state.
    #[getter]
    fn radius(&self) -> f32 {
        self.model().radius()
    }

    #[getter]
    fn worst_return(&self) -> f64 {
        self.model().worst_return()
    }

    #[getter]
    fn timeout(&self) -> usize {
        self.shared.opened.names.timeout
    }

    #[getter]
    fn seed(&self) -> u64 {
        self.shared.opened.names.seed
    }

    /// Returns the seconds from one row to the next, which is from one decision to the next.
    #[getter]
    fn period(&self) -> f64 {
        self.shared.opened.names.period.as_secs()
    }

    /// Returns whether actions are continuous.
    #[getter]
    fn is_continuous(&self) -> bool {
        self.model().log().settings().is_some()
    }

    /// Returns name, offset and scale of every column: physical = normalised × scale + offset.
    #[getter]
    pub(crate) fn columns(&self) -> Vec<(String, f64, f64)> {
        let columns = self.shared.opened.names.columns.iter();
        columns
            .map(|column| (column.name.clone(), column.bounds.offset, column.bounds.scale))
            .collect()
    }

    /// Returns name, least and largest recorded value of every column of the actions.
    #[getter]
    fn action_columns(&self) -> Vec<(String, f64, f64)> {
        let names = &self.shared.opened.names;
        let each = names.action_columns.iter().zip(&names.ranges);
        each.map(|(name, &[low, high])| (name.clone(), low, high)).collect()
    }

    /// Returns the name of each action, the values that it sets, and its number of transitions.
    #[getter]
    fn actions(&self) -> Vec<(String, Vec<f64>, usize)> {
        let names = &self.shared.opened.names;
        let each = names.actions.iter().zip(&names.levels).zip(self.model().log().counts());
        each.map(|((name, level), count)| (name.clone(), level.clone(), count)).collect()
    }

    /// Returns why agents have nothing to choose, if the log has only one action.
    #[getter]
    fn only_action(&self) -> Option<String> {
        self.shared.opened.only_action()
    }

    /// Returns a warning if networks were trained and could not be stored.
    #[getter]
    fn unstored_networks(&self) -> Option<String> {
        unstored_networks(self.shared.networks.get()?)
    }

    /// Returns the recorded behaviour's return per episode of at most `timeout` steps: the mean, and the best and the worst whole episode.
    fn recorded(&self, timeout: usize) -> PyResult<(f64, Option<f64>, Option<f64>)> {
        let recorded = self.model().log().recorded_return(timeout);
        let recorded = recorded.map_err(errors::unusable)?;
        Ok((recorded.mean, recorded.best, recorded.worst))
    }

    /// Returns the normalised states, `float32 [n, d]`, a view.
    fn states<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.shared.lost_pages.check(py)?;
        let states = self.model().log().states();
        let shape = [states.rows(), states.columns()];
        view(py, &self.shared, |shared| shared.opened.model.log().states().as_slice(), &shape)
    }

    /// Returns the time of every row in microseconds, `int64 [n]`.
    fn times<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let count = self.shared.opened.times.len();
        view(py, &self.shared, |shared| shared.opened.times.as_slice(), &[count])
    }

    /// Returns the row that every transition starts from, `uint32 [t]`, a view.
    fn sources<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let count = self.model().log().len();
        view(py, &self.shared, |shared| shared.opened.model.log().transitions().sources(), &[count])
    }

    /// Returns for every transition its action, its reward, and whether it ends in a terminal: `int64 [t]`, `float32 [t]`, `bool [t]`.
    fn decisions<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>, Bound<'py, PyAny>)> {
        let log = self.model().log();
        let actions = log.actions().iter().map(|&action| i64::from(action)).collect();
        let terminals =
            log.endings().iter().map(|ending| *ending == calib_control::Ending::Terminal).collect();
        Ok((
            owned(py, actions, &[log.len()])?,
            owned(py, log.rewards().to_vec(), &[log.len()])?,
            owned(py, terminals, &[log.len()])?,
        ))
    }

    /// Returns the neighbours of an ensemble member, `uint32 [t, actions, k]`, a view.
    fn neighbors<'py>(&self, py: Python<'py>, member: usize) -> PyResult<Bound<'py, PyAny>> {
        self.check_member(member)?;
        self.shared.lost_pages.check(py)?;
        let log = self.model().log();
        let shape = [log.len(), log.levels(), self.model().k()];
        view(py, &self.shared, |shared| shared.opened.model.table(member).0, &shape)
    }

    /// Returns their distances, `float32 [t, actions, k]`, a view.
    fn distances<'py>(&self, py: Python<'py>, member: usize) -> PyResult<Bound<'py, PyAny>> {
        self.check_member(member)?;
        self.shared.lost_pages.check(py)?;
        let log = self.model().log();
        let shape = [log.len(), log.levels(), self.model().k()];
        view(py, &self.shared, |shared| shared.opened.model.table(member).1, &shape)
    }

    /// Returns the smallest and the largest value of every column, `(float32 [d], float32 [d])`.
    fn extremes<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>)> {
        let states = self.model().log().states();
        let columns = states.columns();
        // Start states are rows of the same states.
        let [low, high] = py.detach(|| states.extremes());
        self.shared.lost_pages.check(py)?;
        Ok((owned(py, low, &[columns])?, owned(py, high, &[columns])?))
    }

    /// Returns rollouts, one for each of `members`. A `timeout` of 0 means no limit.
    #[pyo3(signature = (members, columns, physical, timeout, pessimistic, worst_return, live, kind))]
    #[expect(clippy::too_many_arguments, reason = "what decides about rollouts")]
    fn walkers(
        &self,
        py: Python<'_>,
        members: Vec<usize>,
        columns: Vec<usize>,
        physical: bool,
        timeout: u64,
        pessimistic: bool,
        worst_return: f64,
        live: bool,
        kind: &str,
    ) -> PyResult<PyActionRollouts> {
        members.iter().try_for_each(|&member| self.check_member(member))?;
        let names = &self.shared.opened.names;
        if let Some(column) = columns.iter().find(|column| **column >= names.columns.len()) {
            let known = names.columns.len();
            return Err(PyIndexError::new_err(format!("column {column}: the model has {known}")));
        }
        let pessimism = if pessimistic { Pessimism::MinimumReturn } else { Pessimism::Nearest };
        let mut rollouts = ActionRollouts::new(self.model(), &members);
        rollouts = rollouts.with_step_model(match kind {
            "neighbors" => StepModel::Recorded,
            "increments" => StepModel::Increments(self.increments(py)?),
            "network" => StepModel::by_network(self.networks(py)?),
            _ => {
                let expected = "expected \"neighbors\", \"increments\" or \"network\"";
                return Err(errors::value(format!("kind is {kind:?}, {expected}")));
            }
        });
        Ok(PyActionRollouts {
            rollouts,
            shared: Arc::clone(&self.shared),
            columns: columns
                .into_iter()
                .map(|column: usize| {
                    SeenColumn::new(column, names.columns[column].bounds, physical)
                })
                .collect(),
            rules: Rules { pessimism, worst_return },
            timeout,
            live,
        })
    }

    /// Returns the numbers of rollouts of random actions, and of each constant action, in one ensemble member. Agents have `runs` runs
    /// of `steps` steps.
    fn fixed_walks(&self, runs: usize, steps: usize, timeout: usize) -> (usize, usize) {
        let span = RunLength { steps, timeout };
        let FixedRollouts { random, constant } =
            FixedRollouts::new(runs, span, self.shared.opened.names.actions.len());
        (random, constant)
    }

    /// Returns the verdict on runs of agents in the ensemble members, as JSON. `runs` is a JSON list of runs, `settings` has the name of
    /// each setting, and `fields` has the arguments of each with their values. `default_failed` is whether the default was tried and is
    /// missing because it failed. `constants` is a JSON list of the returns of constant actions in each kind of model.
    #[pyo3(signature = (runs, settings, fields, default, default_failed, timeout, most_uncovered, fewest_terminals, resamples, seed, constants, members))]
    #[expect(clippy::too_many_arguments, reason = "what decides about a verdict")]
    fn judge(
        &self,
        py: Python<'_>,
        runs: &str,
        settings: Vec<String>,
        fields: Vec<Vec<(String, String)>>,
        default: Option<usize>,
        default_failed: bool,
        timeout: usize,
        most_uncovered: Option<f64>,
        fewest_terminals: Option<usize>,
        resamples: usize,
        seed: u64,
        constants: &str,
        members: Vec<usize>,
    ) -> PyResult<String> {
        let runs: Vec<Run> = serde_json::from_str(runs).map_err(errors::unusable)?;
        let constants: Vec<ConstantReturns> =
            serde_json::from_str(constants).map_err(errors::unusable)?;
        let names = &self.shared.opened.names;
        let fewest = fewest_terminals.unwrap_or(names.fewest_terminals);
        let support = Support {
            most_uncovered: most_uncovered.unwrap_or(names.most_uncovered),
            fewest_terminals: if names.has_terminals { fewest } else { 0 },
        };
        let log = self.model().log();
        let seed = Seed::new(seed).child("control");
        let judged = watched(py, Needs::Threads, None, |_| {
            let new = Question::new(log, timeout, settings.len());
            let question = Question { default, support, resamples, constants: &constants, ..new };
            judge(&runs, &question, seed)
        })?;
        let mut verdict = judged.map_err(|error| errors::of_any(py, &error))?;
        if default_failed {
            verdict.doubts.push(Doubt::DefaultFailed);
        }
        let outlying = verdict.random_actions.as_mut().and_then(|random| random.outlying.as_mut());
        if let Some(outlying) = outlying {
            // Runs number the members among those that were asked for, so map the number back.
            outlying.member = members.get(outlying.member).copied().unwrap_or(outlying.member);
        }
        let columns: Vec<String> = names.columns.iter().map(|column| column.name.clone()).collect();
        let advice = Advice {
            verdict: &verdict,
            settings: &settings,
            fields: &fields,
            actions: &names.actions,
            columns: &columns,
            vocabulary: PYTHON,
        };
        let judged = Judged {
            decision: advice.decision(),
            findings: advice.findings(),
            reasons: advice.reasons().iter().map(Reason::whole).collect(),
            summary: advice.summary(),
            why: advice.why(),
            is_ahead_of_default: verdict.is_ahead_of_default(),
            kinds_agreement: verdict.kinds_agreement(),
            verdict: &verdict,
        };
        serde_json::to_string(&judged).map_err(errors::unusable)
    }
}

/// A verdict, and its text.
#[derive(Serialize)]
struct Judged<'a> {
    decision: Decision,
    findings: Vec<String>,
    reasons: Vec<String>,
    summary: Vec<String>,
    why: Vec<String>,
    is_ahead_of_default: bool,
    kinds_agreement: Option<f64>,
    #[serde(flatten)]
    verdict: &'a ReturnVerdict,
}
