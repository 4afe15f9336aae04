use aligned_vec::{AVec, ConstAlign};

/// Bytes of a cache line and of the widest vectors.
pub(crate) const LINE: usize = 64;

/// A vector that begins with a cache line, so that no vector register is loaded from two of them.
///
/// Large allocations begin sixteen bytes after a page.
pub(crate) type Aligned<T> = AVec<T, ConstAlign<LINE>>;

/// So many times `value`.
pub(crate) fn filled<T: Clone>(value: T, count: usize) -> Aligned<T> {
    Aligned::from_iter(LINE, std::iter::repeat_n(value, count))
}

/// The same values, aligned.
pub(crate) fn aligned<T: Clone>(values: &[T]) -> Aligned<T> {
    Aligned::from_slice(LINE, values)
}
