use aligned_vec::{AVec, ConstAlign};

/// Size of a cache line and of the widest vectors, in bytes.
pub(crate) const LINE: usize = 64;

/// A vector that starts at a cache line, so that no vector register is loaded from two lines.
///
/// Large allocations start sixteen bytes after a page.
pub(crate) type Aligned<T> = AVec<T, ConstAlign<LINE>>;

/// Returns `count` copies of `value`, aligned.
pub(crate) fn filled<T: Clone>(value: T, count: usize) -> Aligned<T> {
    Aligned::from_iter(LINE, std::iter::repeat_n(value, count))
}

/// Returns an aligned copy of `values`.
pub(crate) fn aligned<T: Clone>(values: &[T]) -> Aligned<T> {
    Aligned::from_slice(LINE, values)
}
