//! Exchanges arrays through NumPy's [array interface](https://numpy.org/doc/stable/reference/arrays.interface.html), which the stable ABI
//! of every Python version has. Arrays from Python are copied once, with a conversion. The memory of returned arrays belongs to the
//! array, or to the owner of the viewed values.
//!
//! Arrays of a step are short, and NumPy takes longer to ask for their memory than to copy it. So up to [`SHORT`] bytes go through
//! Python's own bytes.

use std::{any::Any, sync::Arc};

use bytemuck::{CheckedBitPattern, NoUninit};
use pyo3::{
    exceptions::{PyTypeError, PyValueError},
    intern,
    prelude::*,
    sync::PyOnceLock,
    types::{PyByteArray, PyBytes, PyDict, PyTuple},
};

/// The most bytes of an array that are copied through Python's own bytes.
const SHORT: usize = 1 << 16;

/// A type of numbers of NumPy.
pub(crate) trait Number:
    Copy + Default + Send + Sync + NoUninit + CheckedBitPattern + 'static
{
    /// Its `typestr` in the array interface.
    const TYPE: &'static str;
    /// Its name in messages.
    const NAME: &'static str;
}

macro_rules! numbers {
    ($($type:ty => $little:literal, $big:literal, $name:literal);+) => {
        $(impl Number for $type {
            const TYPE: &'static str = if cfg!(target_endian = "little") { $little } else { $big };
            const NAME: &'static str = $name;
        })+
    };
}

numbers! {
    f32 => "<f4", ">f4", "float32"; f64 => "<f8", ">f8", "float64"; u32 => "<u4", ">u4", "uint32";
    i64 => "<i8", ">i8", "int64"; bool => "|b1", "|b1", "bool"
}

/// Whether an array may be written to.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Access {
    /// The array belongs to Python.
    Writable,
    /// The array is a view of values that calib reads.
    ReadOnly,
}

/// The memory of an array, and its owner, which keeps it alive.
#[pyclass(frozen, module = "calib_rl._calib")]
pub(crate) struct Memory {
    address: usize,
    shape: Vec<usize>,
    kind: &'static str,
    access: Access,
    _kept: Option<Arc<dyn Any + Send + Sync>>,
}

#[pymethods]
impl Memory {
    #[getter]
    fn __array_interface__<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let interface = PyDict::new(py);
        interface.set_item("shape", PyTuple::new(py, &self.shape)?)?;
        interface.set_item("typestr", self.kind)?;
        interface.set_item("data", (self.address, self.access == Access::ReadOnly))?;
        interface.set_item("version", 3)?;
        Ok(interface)
    }
}

fn numpy(py: Python<'_>) -> PyResult<&Bound<'_, PyModule>> {
    static NUMPY: PyOnceLock<Py<PyModule>> = PyOnceLock::new();
    Ok(NUMPY.get_or_try_init(py, || py.import("numpy").map(Bound::unbind))?.bind(py))
}

fn shown(py: Python<'_>, memory: Memory) -> PyResult<Bound<'_, PyAny>> {
    numpy(py)?.call_method1(intern!(py, "asarray"), (Bound::new(py, memory)?,))
}

/// Returns an array that owns these values.
pub(crate) fn owned<'py, T: Number>(
    py: Python<'py>,
    values: Vec<T>,
    shape: &[usize],
) -> PyResult<Bound<'py, PyAny>> {
    debug_assert_eq!(values.len(), shape.iter().product::<usize>());
    let bytes: &[u8] = bytemuck::cast_slice(&values);
    if bytes.len() <= SHORT {
        let memory = (PyTuple::new(py, shape)?, T::TYPE, PyByteArray::new(py, bytes));
        return numpy(py)?.call_method1(intern!(py, "ndarray"), memory);
    }
    // calib does not read the values again, so the array may be written to.
    let address = values.as_ptr() as usize;
    let shape = shape.to_vec();
    let kind = T::TYPE;
    let kept: Option<Arc<dyn Any + Send + Sync>> = Some(Arc::new(values));
    shown(py, Memory { address, shape, kind, access: Access::Writable, _kept: kept })
}

/// Returns a read-only array over values that `keeper` holds: a part of a mapped file, or of a model.
pub(crate) fn view<'py, T: Number, K: Any + Send + Sync>(
    py: Python<'py>,
    keeper: &Arc<K>,
    values: impl FnOnce(&K) -> &[T],
    shape: &[usize],
) -> PyResult<Bound<'py, PyAny>> {
    let values = values(keeper);
    if values.len() != shape.iter().product::<usize>() {
        return Err(PyValueError::new_err("a view of another shape than its values"));
    }
    let address = values.as_ptr() as usize;
    let shape = shape.to_vec();
    let kind = T::TYPE;
    let kept: Arc<dyn Any + Send + Sync> = Arc::clone(keeper) as _;
    shown(py, Memory { address, shape, kind, access: Access::ReadOnly, _kept: Some(kept) })
}

/// Copies an array of numbers with a conversion. Returns the values and the shape, whose number of dimensions must be allowed.
///
/// The array may have any layout and any type of real numbers. Other objects are converted as NumPy converts them.
///
/// # Errors
/// `TypeError` if there are no real numbers, `ValueError` for another number of dimensions.
pub(crate) fn copied<T: Number>(
    array: &Bound<'_, PyAny>,
    name: &str,
    dimensions: &[usize],
) -> PyResult<(Vec<T>, Vec<usize>)> {
    let py = array.py();
    let numpy = numpy(py)?;
    let array = numpy.call_method1(intern!(py, "asarray"), (array,))?;
    let dtype = array.getattr(intern!(py, "dtype"))?;
    let kind: String = dtype.getattr(intern!(py, "kind"))?.extract()?;
    if !matches!(kind.as_str(), "f" | "i" | "u" | "b") {
        return Err(PyTypeError::new_err(format!(
            "{name} has dtype {}; expected real numbers, such as {}",
            dtype.str()?,
            T::NAME
        )));
    }
    let shape: Vec<usize> = array.getattr(intern!(py, "shape"))?.extract()?;
    if !dimensions.contains(&shape.len()) {
        let expected: Vec<String> = dimensions.iter().map(ToString::to_string).collect();
        return Err(PyValueError::new_err(format!(
            "{name} has {} dimensions, expected {}",
            shape.len(),
            expected.join(" or ")
        )));
    }
    let count = shape.iter().try_fold(1_usize, |count, side| count.checked_mul(*side));
    let count = count.ok_or_else(|| PyValueError::new_err(format!("{name} is too large")))?;
    let is_short = count.checked_mul(size_of::<T>()).is_some_and(|bytes| bytes <= SHORT);
    if is_short && dtype.getattr(intern!(py, "str"))?.eq(T::TYPE)? {
        let bytes = array.call_method0(intern!(py, "tobytes"))?.cast_into::<PyBytes>()?;
        let values = bytes.as_bytes().chunks_exact(size_of::<T>());
        let values =
            values.map(bytemuck::checked::try_pod_read_unaligned).collect::<Result<_, _>>();
        return Ok((values.map_err(crate::errors::unusable)?, shape));
    }
    let mut values: Vec<T> = Vec::new();
    values.try_reserve_exact(count).map_err(|_| no_memory(count * size_of::<T>()))?;
    values.resize(count, T::default());
    // NumPy writes to the values while this function holds no reference to them, only their address. NumPy forgets that address
    // when `target` is dropped, before the values are used again.
    let target = Memory {
        address: values.as_mut_ptr() as usize,
        shape: shape.clone(),
        kind: T::TYPE,
        access: Access::Writable,
        _kept: None,
    };
    let target = shown(py, target)?;
    let unsafely = PyDict::new(py);
    unsafely.set_item("casting", "unsafe")?;
    // A number beyond the range of the narrower type becomes infinite. Whatever uses it then refuses it.
    let quiet = PyDict::new(py);
    quiet.set_item("over", "ignore")?;
    quiet.set_item("invalid", "ignore")?;
    let state = numpy.call_method("errstate", (), Some(&quiet))?;
    state.call_method0("__enter__")?;
    let done = numpy.call_method("copyto", (target, array), Some(&unsafely));
    let none = py.None();
    state.call_method1("__exit__", (&none, &none, &none))?;
    done?;
    Ok((values, shape))
}

/// Refuses an allocation beyond the free memory. Otherwise the system would kill the process instead of reporting an error.
///
/// # Errors
/// `MemoryError` with the required amount.
pub(crate) fn require_memory(bytes: u64, what: &str, remedy: &str) -> PyResult<()> {
    calib_pipeline::require_memory(bytes, what, remedy)
        .map_err(|refused| pyo3::exceptions::PyMemoryError::new_err(refused.to_string()))
}

/// Does the same for callers in Python.
#[pyfunction]
#[pyo3(name = "require_memory")]
pub(crate) fn require_memory_of(bytes: f64, what: &str, remedy: &str) -> PyResult<()> {
    require_memory(bytes as u64, what, remedy)
}

pub(crate) fn no_memory(bytes: usize) -> PyErr {
    pyo3::exceptions::PyMemoryError::new_err(format!("cannot allocate {bytes} bytes"))
}
