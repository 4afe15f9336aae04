//! Models with actions: as arrays, walked through by many agents at once, and what a sweep of agents in them says.

use std::{
    path::{Path, PathBuf},
    sync::Arc,
};

use calib_control::{
    ActionModel, At, Coverage, Drift, Pessimism, Rules, Run, Support, Target, Walkers, Went, judge,
};
use calib_core::{Bounds, Normalised, Seed};
use calib_pipeline::ControlModel;
use pyo3::{exceptions::PyIndexError, prelude::*};
use serde::{Deserialize, Serialize};

use crate::{
    array::{copied, owned, view},
    errors,
    lost::Since,
    study::PyJob,
    work::{Needs, watched},
};

/// A model with actions that is mapped, since then.
struct Kept {
    of: ControlModel,
    since: Since,
}

/// A model with actions.
#[pyclass(frozen, module = "calib_rl._calib", name = "ActionModel")]
pub(crate) struct PyActionModel {
    kept: Arc<Kept>,
    directory: PathBuf,
}

impl PyActionModel {
    fn model(&self) -> &ActionModel {
        &self.kept.of.model
    }

    fn check_member(&self, member: usize) -> PyResult<()> {
        let members = self.model().blocks().members();
        if member < members {
            return Ok(());
        }
        Err(PyIndexError::new_err(format!("member {member}: the model has {members}, from 0 on")))
    }
}

#[pymethods]
impl PyActionModel {
    /// The model in a folder.
    #[staticmethod]
    fn open(py: Python<'_>, directory: PathBuf) -> PyResult<Self> {
        let since = Since::now();
        // Arrays are mapped, and no table is read: this works in a process that was forked as well.
        let opened = watched(py, Needs::Threads, None, |_| {
            ControlModel::in_directory(Path::new(&directory))
        })?;
        let of = opened.map_err(|error| errors::of_step(py, &error))?;
        since.check(py)?;
        Ok(Self { kept: Arc::new(Kept { of, since }), directory })
    }

    /// The model of a study, which was built.
    #[staticmethod]
    fn of_job(py: Python<'_>, job: &Bound<'_, PyJob>) -> PyResult<Self> {
        let job = &job.get().job;
        let since = Since::now();
        let opened = watched(py, Needs::Threads, None, |_| ControlModel::of_job(job))?;
        let of = opened.map_err(|error| errors::of_step(py, &error))?;
        since.check(py)?;
        let directory = job.layout().control_model();
        Ok(Self { kept: Arc::new(Kept { of, since }), directory })
    }

    /// The folder that it was opened from.
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

    /// Distance up to which a recorded transition covers a state.
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
        self.kept.of.names.timeout
    }

    #[getter]
    fn seed(&self) -> u64 {
        self.kept.of.names.seed
    }

    /// Seconds from one row to the next.
    #[getter]
    fn period(&self) -> f64 {
        self.kept.of.names.period.as_secs()
    }

    /// Whether actions are numbers.
    #[getter]
    fn is_continuous(&self) -> bool {
        self.model().log().settings().is_some()
    }

    /// Name, offset and scale of every column: physical = normalised × scale + offset.
    #[getter]
    fn columns(&self) -> Vec<(String, f64, f64)> {
        let columns = self.kept.of.names.columns.iter();
        columns.map(|of| (of.name.clone(), of.bounds.offset, of.bounds.scale)).collect()
    }

    /// Name, least and largest recorded value of every column of the actions.
    #[getter]
    fn action_columns(&self) -> Vec<(String, f64, f64)> {
        let names = &self.kept.of.names;
        let each = names.action_columns.iter().zip(&names.ranges);
        each.map(|(name, &[low, high])| (name.clone(), low, high)).collect()
    }

    /// What each action is called, what it sets, and how many transitions have it.
    #[getter]
    fn actions(&self) -> Vec<(String, Vec<f64>, usize)> {
        let names = &self.kept.of.names;
        let each = names.actions.iter().zip(&names.levels).zip(self.model().log().counts());
        each.map(|((name, level), count)| (name.clone(), level.clone(), count)).collect()
    }

    /// What the recorded behaviour got an episode of at most `timeout` steps: mean, and the best and the worst whole episode.
    fn recorded(&self, timeout: usize) -> PyResult<(f64, Option<f64>, Option<f64>)> {
        let recorded = self.model().log().recorded_return(timeout);
        let of = recorded.map_err(|error| errors::value(error.to_string()))?;
        Ok((of.mean, of.best, of.worst))
    }

    /// Normalised states, `float32 [n, d]`, a view.
    fn states<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.kept.since.check(py)?;
        let states = self.model().log().states();
        let shape = [states.rows(), states.columns()];
        view(py, &self.kept, |kept| kept.of.model.log().states().as_slice(), &shape)
    }

    /// Time of every row in microseconds, `int64 [n]`.
    fn times<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        view(py, &self.kept, |kept| kept.of.times.as_slice(), &[self.kept.of.times.len()])
    }

    /// Row that every transition starts from, `uint32 [t]`, a view.
    fn sources<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let count = self.model().log().len();
        view(py, &self.kept, |kept| kept.of.model.log().transitions().sources(), &[count])
    }

    /// Action, reward and whether it ends in a terminal, of every transition: `int64 [t]`, `float32 [t]`, `bool [t]`.
    fn decisions<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>, Bound<'py, PyAny>)> {
        let log = self.model().log();
        let terminal = |of: &calib_control::Ending| *of == calib_control::Ending::Terminal;
        let actions = log.actions().iter().map(|&of| i64::from(of)).collect();
        let terminals = log.endings().iter().map(terminal).collect();
        Ok((
            owned(py, actions, &[log.len()])?,
            owned(py, log.rewards().to_vec(), &[log.len()])?,
            owned(py, terminals, &[log.len()])?,
        ))
    }

    /// Neighbours of a member, `uint32 [t, actions, k]`, a view.
    fn neighbors<'py>(&self, py: Python<'py>, member: usize) -> PyResult<Bound<'py, PyAny>> {
        self.check_member(member)?;
        self.kept.since.check(py)?;
        let log = self.model().log();
        let shape = [log.len(), log.levels(), self.model().k()];
        view(py, &self.kept, |kept| kept.of.model.table(member).0, &shape)
    }

    /// Distances to them, `float32 [t, actions, k]`, a view.
    fn distances<'py>(&self, py: Python<'py>, member: usize) -> PyResult<Bound<'py, PyAny>> {
        self.check_member(member)?;
        self.kept.since.check(py)?;
        let log = self.model().log();
        let shape = [log.len(), log.levels(), self.model().k()];
        view(py, &self.kept, |kept| kept.of.model.table(member).1, &shape)
    }

    /// Smallest and largest value of every column, `(float32 [d], float32 [d])`.
    fn extremes<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>)> {
        let (states, starts) = (self.model().log().states(), self.model().starts());
        let columns = states.columns();
        let mut low = vec![f32::INFINITY; columns];
        let mut high = vec![f32::NEG_INFINITY; columns];
        for row in (0..states.rows()).map(|row| states.row(row)).chain([starts.row(0)]) {
            for (at, value) in row.iter().enumerate() {
                low[at] = low[at].min(*value);
                high[at] = high[at].max(*value);
            }
        }
        self.kept.since.check(py)?;
        Ok((owned(py, low, &[columns])?, owned(py, high, &[columns])?))
    }

    /// Walkers, one for each of `members`; `timeout` of 0 is for never.
    #[pyo3(signature = (members, columns, physical, timeout, pessimistic, worst_return, live))]
    #[expect(clippy::too_many_arguments, reason = "what decides about walks")]
    fn walkers(
        &self,
        members: Vec<usize>,
        columns: Vec<usize>,
        physical: bool,
        timeout: u64,
        pessimistic: bool,
        worst_return: f64,
        live: bool,
    ) -> PyResult<ActionWalkers> {
        members.iter().try_for_each(|&member| self.check_member(member))?;
        let names = &self.kept.of.names;
        if let Some(column) = columns.iter().find(|column| **column >= names.columns.len()) {
            let known = names.columns.len();
            return Err(PyIndexError::new_err(format!("column {column}: the model has {known}")));
        }
        let map = |column: usize| {
            let bounds = names.columns[column].bounds;
            (column, if physical { bounds } else { Bounds::IDENTITY })
        };
        let pessimism = if pessimistic { Pessimism::MinimumReturn } else { Pessimism::Nearest };
        Ok(ActionWalkers {
            walkers: Walkers::new(self.model(), &members),
            kept: Arc::clone(&self.kept),
            columns: columns.into_iter().map(map).collect(),
            rules: Rules { pessimism, worst_return },
            timeout,
            live,
        })
    }

    /// What runs of agents in the members say, as JSON: `runs` is a JSON list of them.
    #[pyo3(signature = (runs, candidates, default, timeout, most_uncovered, fewest_terminals, resamples, seed))]
    #[expect(clippy::too_many_arguments, reason = "what decides about a verdict")]
    fn judge(
        &self,
        py: Python<'_>,
        runs: &str,
        candidates: usize,
        default: Option<usize>,
        timeout: usize,
        most_uncovered: Option<f64>,
        fewest_terminals: Option<usize>,
        resamples: usize,
        seed: u64,
    ) -> PyResult<String> {
        let runs: Vec<Run> =
            serde_json::from_str(runs).map_err(|error| errors::value(error.to_string()))?;
        let names = &self.kept.of.names;
        let fewest = fewest_terminals.unwrap_or(names.fewest_terminals);
        let support = Support {
            most_uncovered: most_uncovered.unwrap_or(names.most_uncovered),
            fewest_terminals: if names.has_terminals { fewest } else { 0 },
        };
        let log = self.model().log();
        let seed = Seed::new(seed).child("control");
        let judged = watched(py, Needs::Threads, None, |_| {
            judge(&runs, candidates, default, (log, timeout), support, resamples, seed)
        })?;
        let verdict = judged.map_err(|error| errors::of_any(py, &error))?;
        let columns: Vec<String> = names.columns.iter().map(|of| of.name.clone()).collect();
        let told = |doubt| calib_pipeline::doubt_text(doubt, &names.actions, &columns);
        let reasons = verdict.doubts.iter().map(told).collect();
        serde_json::to_string(&Judged { reasons, verdict })
            .map_err(|error| errors::value(error.to_string()))
    }
}

/// A verdict, and its doubts in words.
#[derive(Serialize)]
struct Judged {
    reasons: Vec<String>,
    #[serde(flatten)]
    verdict: calib_control::ReturnVerdict,
}

/// A column of the states, and the map to what is seen of it.
type Mapped = (usize, Bounds);

/// Walks through members of a model, which actions change.
#[pyclass(module = "calib_rl._calib")]
pub(crate) struct ActionWalkers {
    kept: Arc<Kept>,
    walkers: Walkers,
    columns: Vec<Mapped>,
    rules: Rules,
    /// Steps after which an episode is cut; 0 for never.
    timeout: u64,
    /// Whether what is set is searched for.
    live: bool,
}

/// What was done by all walkers, as JSON.
#[derive(Serialize, Deserialize)]
struct Lived {
    coverage: Coverage,
    drift: Drift,
}

type Arrays<'py> = (
    Bound<'py, PyAny>,
    Bound<'py, PyAny>,
    Bound<'py, PyAny>,
    Bound<'py, PyAny>,
    Bound<'py, PyAny>,
    Bound<'py, PyAny>,
    Bound<'py, PyAny>,
    Bound<'py, PyAny>,
    Bound<'py, PyAny>,
);

/// What walkers do in a step.
enum Done {
    Levels(Vec<i64>),
    /// `[walkers, columns]`, each a share of its recorded range.
    Set(Vec<f32>, usize),
}

impl Done {
    fn of(&self, number: usize) -> Target<'_> {
        match self {
            Self::Levels(levels) => Target::Level(levels[number] as usize),
            Self::Set(set, columns) => Target::Set(&set[number * columns..][..*columns]),
        }
    }
}

impl ActionWalkers {
    /// The row that walker `number` sees.
    fn row(&self, number: usize) -> i64 {
        let of = &self.kept.of;
        match self.walkers.walks()[number].at {
            At::Start(start) => i64::from(of.start_rows[start as usize]),
            At::After(transition) => i64::from(of.model.led_to(transition).0),
        }
    }

    fn look(&self, number: usize, seen: &mut Vec<f32>, displaced: &mut Vec<f32>) {
        let state = self.kept.of.model.observed(self.walkers.walks()[number].at);
        let width = state.len();
        let moved = &self.walkers.displacements()[number * width..][..width];
        for (column, bounds) in &self.columns {
            seen.push(bounds.physical(Normalised(state[*column])).0 as f32);
            displaced.push((f64::from(moved[*column]) * bounds.scale) as f32);
        }
    }

    fn arrays<'py>(&self, py: Python<'py>, went: &[Went]) -> PyResult<Arrays<'py>> {
        let (count, width) = (went.len(), self.columns.len());
        let (mut seen, mut displaced) =
            (Vec::with_capacity(count * width), Vec::with_capacity(count * width));
        let (mut rows, mut times) = (Vec::with_capacity(count), Vec::with_capacity(count));
        for number in 0..count {
            self.look(number, &mut seen, &mut displaced);
            let row = self.row(number);
            rows.push(row);
            times.push(self.kept.of.times[row as usize]);
        }
        self.kept.since.check(py)?;
        Ok((
            owned(py, seen, &[count, width])?,
            owned(py, went.iter().map(|of| of.reward).collect::<Vec<f64>>(), &[count])?,
            owned(py, went.iter().map(|of| of.terminated).collect::<Vec<bool>>(), &[count])?,
            owned(py, went.iter().map(|of| of.truncated).collect::<Vec<bool>>(), &[count])?,
            owned(py, rows, &[count])?,
            owned(py, times, &[count])?,
            owned(py, went.iter().map(|of| of.distance).collect::<Vec<f32>>(), &[count])?,
            owned(py, went.iter().map(|of| of.covered).collect::<Vec<bool>>(), &[count])?,
            owned(py, displaced, &[count, width])?,
        ))
    }

    /// What `actions` mean, for `count` walkers.
    fn done(&self, actions: &Bound<'_, PyAny>, count: usize) -> PyResult<Done> {
        if self.live {
            return self.set(actions, count);
        }
        let (levels, _) = copied::<i64>(actions, "actions", &[1])?;
        if levels.len() != count {
            return Err(errors::value(format!("{} actions for {count} walkers", levels.len())));
        }
        levels.iter().enumerate().try_for_each(|(number, &level)| self.check(number, level))?;
        Ok(Done::Levels(levels))
    }

    fn check(&self, number: usize, level: i64) -> PyResult<()> {
        let known = self.kept.of.model.log().levels();
        if (0..known as i64).contains(&level) {
            return Ok(());
        }
        Err(errors::value(format!(
            "walker {number} takes action {level}; the model has {known}, from 0 to {}",
            known - 1
        )))
    }

    fn set(&self, actions: &Bound<'_, PyAny>, count: usize) -> PyResult<Done> {
        let ranges = &self.kept.of.names.ranges;
        let (values, shape) = copied::<f64>(actions, "actions", &[2])?;
        if shape != [count, ranges.len()] {
            return Err(errors::value(format!(
                "actions have the shape {shape:?}, expected [{count}, {}]",
                ranges.len()
            )));
        }
        let share = |(place, &value): (usize, &f64)| {
            let [low, high] = ranges[place % ranges.len()];
            if !value.is_finite() {
                let number = place / ranges.len();
                return Err(errors::value(format!(
                    "walker {number} sets {value}, which is no number"
                )));
            }
            let range = if high > low { high - low } else { 1.0 };
            Ok(((value.clamp(low, high) - low) / range) as f32)
        };
        let shares = values.iter().enumerate().map(share).collect::<PyResult<_>>()?;
        Ok(Done::Set(shares, ranges.len()))
    }
}

#[pymethods]
impl ActionWalkers {
    /// Where every walk is and what it will draw, as text.
    fn state(&self) -> PyResult<String> {
        serde_json::to_string(&self.walkers).map_err(|error| errors::value(error.to_string()))
    }

    /// Go on where other walkers through the same members were.
    fn restore(&mut self, state: &str) -> PyResult<()> {
        let walkers: Walkers =
            serde_json::from_str(state).map_err(|error| errors::value(error.to_string()))?;
        if !walkers.fits(&self.kept.of.model, &self.walkers) {
            return Err(errors::value("the state is of walkers through another model"));
        }
        self.walkers = walkers;
        Ok(())
    }

    /// Seed some walkers: walker i by seeds[i].
    fn seed(&mut self, seeds: Vec<Option<u64>>) -> PyResult<()> {
        let count = self.walkers.walks().len();
        if seeds.len() != count {
            return Err(errors::value(format!("{} seeds for {count} walkers", seeds.len())));
        }
        for (number, seed) in seeds.into_iter().enumerate() {
            if let Some(seed) = seed {
                self.walkers.seed(number, seed);
            }
        }
        Ok(())
    }

    /// Coverage and drift of all steps so far, as JSON.
    fn lived(&self) -> PyResult<String> {
        let (coverage, drift) = (self.walkers.coverage(), self.walkers.drift());
        let lived = Lived { coverage, drift };
        serde_json::to_string(&lived).map_err(|error| errors::value(error.to_string()))
    }

    /// Begin anew, all or those where `which` is true; what they see, as `step` has it.
    #[pyo3(signature = (which=None))]
    fn reset<'py>(
        &mut self,
        py: Python<'py>,
        which: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Arrays<'py>> {
        let count = self.walkers.walks().len();
        let which = match which {
            Some(which) => copied::<bool>(which, "which", &[1])?.0,
            None => vec![true; count],
        };
        if which.len() != count {
            return Err(errors::value(format!("{} marks for {count} walkers", which.len())));
        }
        let model = Arc::clone(&self.kept.of.model);
        let mut went = vec![Went::BEGAN; count];
        for (number, _) in which.iter().enumerate().filter(|(_, begins)| **begins) {
            went[number] = self.walkers.begin(&model, number);
        }
        self.arrays(py, &went)
    }

    /// A step of every walker: what they see `float32 [n, c]`, rewards `float64 [n]`, whether they ended in a terminal and whether they were cut
    /// `bool [n]`, rows and times `int64 [n]`, distances `float32 [n]`, whether the step was covered `bool [n]`, displacements `float32 [n, c]`.
    /// One that was over begins anew, and has no reward for that.
    fn step<'py>(&mut self, py: Python<'py>, actions: &Bound<'py, PyAny>) -> PyResult<Arrays<'py>> {
        let count = self.walkers.walks().len();
        let done = self.done(actions, count)?;
        let model = Arc::clone(&self.kept.of.model);
        let (rules, timeout, walkers) = (self.rules, self.timeout, &mut self.walkers);
        let step = |number: usize| walkers.step(&model, number, done.of(number), rules, timeout);
        let went: Vec<Went> = (0..count).map(step).collect();
        self.arrays(py, &went)
    }

    /// A step of the only walker, with a level: what it sees, reward, terminated, truncated, row, time, distance, covered, displacement.
    #[expect(clippy::type_complexity, reason = "what a step has")]
    fn step_one<'py>(
        &mut self,
        py: Python<'py>,
        level: i64,
    ) -> PyResult<(Bound<'py, PyAny>, f64, bool, bool, i64, i64, f32, bool, Bound<'py, PyAny>)>
    {
        self.check(0, level)?;
        let model = Arc::clone(&self.kept.of.model);
        let target = Target::Level(level as usize);
        let went = self.walkers.step(&model, 0, target, self.rules, self.timeout);
        let width = self.columns.len();
        let (mut seen, mut displaced) = (Vec::with_capacity(width), Vec::with_capacity(width));
        self.look(0, &mut seen, &mut displaced);
        let row = self.row(0);
        self.kept.since.check(py)?;
        let Went { reward, terminated, truncated, distance, covered } = went;
        let time = self.kept.of.times[row as usize];
        let (seen, displaced) = (owned(py, seen, &[width])?, owned(py, displaced, &[width])?);
        Ok((seen, reward, terminated, truncated, row, time, distance, covered, displaced))
    }
}
