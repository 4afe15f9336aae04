//! Calibration models as arrays.

use std::{path::PathBuf, sync::Arc};

use calib_core::{Bounds, RowIndex, Seed, Segments, States, TransitionIndex, Transitions};
use calib_knn::{KnnModel, MemoryNeed, ModelConfig};
use calib_model::{Absent, StartSource, rollouts, start_states};
use calib_pipeline::{Calibration, StepError};
use pyo3::{exceptions::PyIndexError, prelude::*, types::PyDict};

use crate::{
    array::{copied, owned, require_memory, view},
    convert, errors,
    lost::LostPages,
    observer::{Watch, WatchMonitor},
    rollouts::{PyRollouts, SeenColumn},
    shared_model::SharedModel,
    study::PyJob,
    work::{Needs, watched},
};

/// A calibration model of neighbours.
#[pyclass(frozen, module = "calib_rl._calib")]
pub(crate) struct Model {
    pub(crate) shared: Arc<SharedModel>,
}

impl Model {
    fn opened(
        py: Python<'_>,
        open: impl FnOnce() -> Result<Calibration, StepError> + Send,
    ) -> PyResult<Self> {
        let lost_pages = LostPages::so_far();
        let opened = watched(py, Needs::Tables, None, |_| open())?;
        let model = opened.map_err(|error| errors::of_step(py, &error))?;
        lost_pages.check(py)?;
        Ok(Self { shared: Arc::new(SharedModel::Stored(Box::new(model), lost_pages)) })
    }

    pub(crate) fn check_member(&self, member: usize) -> PyResult<()> {
        require_member(member, self.shared.knn().members())
    }
}

/// Refuses an ensemble member that a model with `members` members does not have.
pub(crate) fn require_member(member: usize, members: usize) -> PyResult<()> {
    if member < members {
        return Ok(());
    }
    Err(PyIndexError::new_err(format!("member {member}: the model has {members}, from 0 on")))
}

#[pymethods]
impl Model {
    /// Opens the model in a folder.
    #[staticmethod]
    fn open(py: Python<'_>, directory: PathBuf) -> PyResult<Self> {
        Self::opened(py, || Calibration::in_directory(&directory))
    }

    /// Opens the model of a study.
    #[staticmethod]
    fn of_job(py: Python<'_>, job: &Bound<'_, PyJob>) -> PyResult<Self> {
        let job = &job.get().job;
        Self::opened(py, || Calibration::of_job(job))
    }

    /// Builds a model of normalised states, `[n, d]`, in segments of these lengths. `options` are keys of `[model]`.
    #[staticmethod]
    #[pyo3(signature = (states, segments, options, observer=None))]
    fn build(
        py: Python<'_>,
        states: &Bound<'_, PyAny>,
        segments: Option<Vec<usize>>,
        options: &Bound<'_, PyDict>,
        observer: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let config: ModelConfig = convert::options(options)?;
        let weights = config.weights().map_err(|error| errors::of_any(py, &error))?;
        let (values, shape) = copied::<f32>(states, "states", &[2])?;
        let rows = shape[0];
        let columns = shape[1];
        let threads = rayon::current_num_threads();
        let needed = MemoryNeed::predict(rows, columns, &config, threads).working;
        require_memory(
            needed,
            "building the model",
            "lower neighbors or members, or take fewer rows",
        )?;
        let knn = watched(
            py,
            Needs::Threads,
            observer,
            |watch: &Arc<Watch>| -> Result<KnnModel, Box<dyn std::error::Error + Send + Sync>> {
                let states = States::new(values, rows, columns)?;
                let segments = Segments::from_lengths(segments.unwrap_or_else(|| vec![rows]))?;
                let monitor = WatchMonitor(Arc::clone(watch));
                Ok(KnnModel::build(states, Transitions::new(segments), &config, &monitor)?)
            },
        )?;
        let knn = Box::new(knn.map_err(|error| errors::of_any(py, &*error))?);
        Ok(Self { shared: Arc::new(SharedModel::Built { knn, weights }) })
    }

    /// Returns the folder that the model was opened from; `None` for a model of arrays.
    #[getter]
    fn directory(&self) -> Option<PathBuf> {
        self.shared.stored().map(|model| model.directory().to_owned())
    }

    #[getter]
    fn members(&self) -> usize {
        self.shared.knn().members()
    }

    #[getter]
    fn k(&self) -> usize {
        self.shared.knn().k()
    }

    #[getter]
    fn seed(&self) -> u64 {
        self.shared.stored().map_or(0, |model| model.study().seed)
    }

    /// Returns the seconds from one row to the next; `None` for a model of arrays.
    #[getter]
    fn period(&self) -> Option<f64> {
        self.shared.stored().map(|model| model.period().as_secs())
    }

    /// Returns name, offset and scale of every column: physical = normalised × scale + offset.
    #[getter]
    fn columns(&self) -> Vec<(String, f64, f64)> {
        match self.shared.stored() {
            Some(model) => {
                let columns = model.normaliser().columns().iter();
                columns
                    .map(|column| (column.name.clone(), column.bounds.offset, column.bounds.scale))
                    .collect()
            }
            None => {
                (0..self.shared.states().columns()).map(|at| (at.to_string(), 0.0, 1.0)).collect()
            }
        }
    }

    /// Returns the normalised states, `float32 [n, d]`, a view.
    fn states<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.shared.check(py)?;
        let states = self.shared.states();
        let shape = [states.rows(), states.columns()];
        view(py, &self.shared, |shared| shared.states().as_slice(), &shape)
    }

    /// Returns the time of every row in microseconds, `int64 [n]`; `None` for a model of arrays.
    fn times<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyAny>>> {
        let Some(model) = self.shared.stored() else { return Ok(None) };
        self.shared.check(py)?;
        let times: Vec<i64> =
            model.frames().timestamps().iter().map(|time| time.as_micros()).collect();
        let rows = times.len();
        owned(py, times, &[rows]).map(Some)
    }

    /// Returns the lengths of the segments.
    fn segments(&self) -> Vec<usize> {
        self.shared.knn().transitions().segments().iter().map(calib_core::Segment::len).collect()
    }

    /// Returns the row that every transition starts from, `uint32 [t]`, a view.
    fn sources<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let count = self.shared.knn().transitions().len();
        view(py, &self.shared, |shared| shared.knn().transitions().sources(), &[count])
    }

    /// Returns the neighbours of an ensemble member, `uint32 [t, k]`, a view.
    fn neighbors<'py>(&self, py: Python<'py>, member: usize) -> PyResult<Bound<'py, PyAny>> {
        self.check_member(member)?;
        self.shared.check(py)?;
        let shape = [self.shared.knn().transitions().len(), self.shared.knn().k()];
        view(py, &self.shared, |shared| shared.knn().table(member).neighbors(), &shape)
    }

    /// Returns their distances, `float32 [t, k]`, a view.
    fn distances<'py>(&self, py: Python<'py>, member: usize) -> PyResult<Bound<'py, PyAny>> {
        self.check_member(member)?;
        self.shared.check(py)?;
        let shape = [self.shared.knn().transitions().len(), self.shared.knn().k()];
        view(py, &self.shared, |shared| shared.knn().table(member).distances(), &shape)
    }

    /// Returns the rows that `count` rollouts of an ensemble member visit, `uint32 [count, steps + 1]`.
    #[pyo3(signature = (member, count, steps, rows=None, seed=None, observer=None))]
    #[expect(clippy::too_many_arguments, reason = "what decides about rollouts")]
    fn rollout<'py>(
        &self,
        py: Python<'py>,
        member: usize,
        count: usize,
        steps: usize,
        rows: Option<Vec<usize>>,
        seed: Option<u64>,
        observer: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        self.check_member(member)?;
        let known = self.shared.states().rows();
        if let Some(row) = rows.iter().flatten().find(|row| **row >= known) {
            return Err(PyIndexError::new_err(format!("row {row}: the model has {known} rows")));
        }
        let cells = count.checked_mul(steps.saturating_add(1));
        let cells = cells.ok_or_else(|| errors::value("n × steps is too large"))?;
        let bytes = (cells as u64).saturating_mul(12);
        require_memory(bytes, "the rollouts", "take fewer or shorter ones at a time")?;
        let mut visited: Vec<u32> = Vec::new();
        visited.try_reserve_exact(cells).map_err(|_| crate::array::no_memory(4 * cells))?;
        let shared = &self.shared;
        let seed = Seed::new(seed.unwrap_or(self.seed())).child("rollout");
        let visited = watched(py, Needs::Threads, observer, |watch| {
            let member_model = shared.knn().member(member);
            let rows: Option<Vec<RowIndex>> =
                rows.map(|rows| rows.into_iter().map(RowIndex::new).collect());
            let source = match &rows {
                None => StartSource::Random,
                Some(rows) => StartSource::Rows { rows, absent: Absent::Replace },
            };
            let starts = start_states(&member_model, source, count, source.seed_of(seed, member))?;
            let monitor = WatchMonitor(Arc::clone(watch));
            let all = rollouts(&member_model, &starts, steps, shared.weights(), seed, &monitor)?;
            visited.extend(all.iter().flat_map(calib_model::Rollout::rows).map(|row| row.0));
            Ok::<_, calib_model::RolloutError>(visited)
        })?;
        let visited = visited.map_err(|error| errors::of_any(py, &error))?;
        self.shared.check(py)?;
        owned(py, visited, &[count, steps + 1])
    }

    /// Returns the rows of the `k` sources of an ensemble member that are nearest to each of `states`, `uint32 [q, k]`, and their
    /// distances, `float32 [q, k]`.
    #[pyo3(signature = (states, k, member))]
    fn nearest<'py>(
        &self,
        py: Python<'py>,
        states: &Bound<'_, PyAny>,
        k: usize,
        member: usize,
    ) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>)> {
        self.check_member(member)?;
        let most = self.shared.knn().blocks().member_len(member);
        if k > most {
            return Err(errors::value(format!(
                "k is {k}: member {member} has {most} transitions to find; lower k"
            )));
        }
        let (values, shape) = copied::<f32>(states, "states", &[2])?;
        let count = shape[0];
        let shared = &self.shared;
        let need = shared.knn().search_need(k, rayon::current_num_threads()).working;
        let cells = (count as u64).saturating_mul(k as u64);
        let needed = need.saturating_add(cells.saturating_mul(8 + 16));
        require_memory(needed, "the nearest states", "lower k, or ask for fewer states at a time")?;
        let found = watched(py, Needs::Threads, None, |watch| {
            nearest_sources(shared, values, &shape, k, member, watch)
        })?;
        let (rows, distances) = found.map_err(|error| errors::of_any(py, &*error))?;
        self.shared.check(py)?;
        Ok((owned(py, rows, &[count, k])?, owned(py, distances, &[count, k])?))
    }

    /// Returns rollouts, one for each of `members`.
    #[pyo3(signature = (members, columns, reward, steps, physical))]
    fn walkers(
        &self,
        members: Vec<usize>,
        columns: Vec<usize>,
        reward: usize,
        steps: u64,
        physical: bool,
    ) -> PyResult<PyRollouts> {
        members.iter().try_for_each(|&member| self.check_member(member))?;
        let known = self.shared.states().columns();
        if let Some(column) = columns.iter().chain([&reward]).find(|column| **column >= known) {
            return Err(PyIndexError::new_err(format!("column {column}: the model has {known}")));
        }
        let described = self.columns();
        let seen: Vec<SeenColumn> =
            columns.into_iter().map(|column| seen_column(&described, column, physical)).collect();
        let reward = seen_column(&described, reward, physical);
        Ok(PyRollouts::new(Arc::clone(&self.shared), members, seen, reward, steps))
    }

    /// Returns the smallest and the largest value of every column, `(float32 [d], float32 [d])`.
    fn extremes<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>)> {
        let states = self.shared.states();
        let columns = states.columns();
        let [low, high] = py.detach(|| states.extremes());
        self.shared.check(py)?;
        Ok((owned(py, low, &[columns])?, owned(py, high, &[columns])?))
    }

    /// Returns the positions in time order of the transitions of an ensemble member, `uint32`.
    fn transitions<'py>(&self, py: Python<'py>, member: usize) -> PyResult<Bound<'py, PyAny>> {
        self.check_member(member)?;
        let member_model = self.shared.knn().member(member);
        let all: Vec<u32> = (0..member_model.len())
            .map(|at| member_model.nth(at))
            .map(|TransitionIndex(at)| at)
            .collect();
        let count = all.len();
        owned(py, all, &[count])
    }
}

/// Returns how a column is observed, of columns with these names, offsets and scales.
fn seen_column(described: &[(String, f64, f64)], column: usize, physical: bool) -> SeenColumn {
    let (_, offset, scale) = described[column];
    SeenColumn::new(column, Bounds { offset, scale }, physical)
}

/// Returns the rows of the `k` sources of an ensemble member that are nearest to each of these states, and their distances.
fn nearest_sources(
    shared: &SharedModel,
    values: Vec<f32>,
    shape: &[usize],
    k: usize,
    member: usize,
    watch: &Arc<Watch>,
) -> Result<(Vec<u32>, Vec<f32>), Box<dyn std::error::Error + Send + Sync>> {
    let monitor = WatchMonitor(Arc::clone(watch));
    let mut states = States::new(values, shape[0], shape[1])?;
    if let Some(model) = shared.stored() {
        let columns = model.frames().states().columns();
        if columns != shape[1] {
            return Err(calib_knn::KnnError::Columns { expected: columns, got: shape[1] }.into());
        }
        states = model.in_metric(&states)?;
    }
    let found = shared.knn().member(member).nearest_sources(&states, k, &monitor)?;
    let mut rows = vec![u32::MAX; shape[0] * k];
    let mut distances = vec![f32::INFINITY; shape[0] * k];
    for (query, near) in found.iter().enumerate() {
        for (place, neighbor) in near.iter().enumerate() {
            let source = shared.knn().transitions().source(neighbor.transition);
            rows[query * k + place] = source.0;
            distances[query * k + place] = neighbor.distance;
        }
    }
    Ok((rows, distances))
}
