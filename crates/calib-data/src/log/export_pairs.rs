//! Decides whether files of one column that were recorded at the same time are exports of one sensor or of a tag each.

use super::series::{Sink, Sorted, Tag};
use crate::DataError;

/// Two files are recorded at the same time if they share at least this part of the shorter one's time span. Successive
/// exports may overlap a little. Our choice, like the other limits here.
const BESIDE: f64 = 0.5;
/// Two exports of one sensor have at least this part of the rows of the shorter one at the same times.
const SHARED: f64 = 0.5;
/// Two exports of one sensor have the same value in at least this part of their shared rows.
const ALIKE: f64 = 0.9;
/// Two files with fewer equal rows certainly belong to two tags.
const HARDLY_ANY: f64 = 0.1;
/// Two files with more equal rows certainly belong to one sensor.
const NEARLY_ALL: f64 = 0.99;

/// Two files of one column that were recorded at the same time.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct ExportPair {
    names: [String; 2],
    /// Number of rows with a shared time; 0 if the files share too few to be of one sensor.
    shared: usize,
    /// The part of the shared rows with equal values, from 0 to 1.
    equal: f64,
}

impl ExportPair {
    /// Compares `one` with `other`, which begins no earlier than `one` does. `of_one` and `of_other` are all their
    /// samples.
    fn of([one, other]: [&Tag; 2], [of_one, of_other]: [&Sorted; 2]) -> Self {
        let window = other.first..one.last.min(other.last).saturating_add(1);
        let rows = SharedRows::of(of_one.inside(&window), of_other.inside(&window));
        let are_enough = rows.count > 0 && rows.count as f64 >= SHARED * rows.fewer as f64;
        Self {
            names: [one.name.clone(), other.name.clone()],
            shared: if are_enough { rows.count } else { 0 },
            equal: if are_enough { rows.equal as f64 / rows.count as f64 } else { 0.0 },
        }
    }

    /// Whether they are exports of one sensor, rather than of a tag each.
    pub(super) fn is_of_one_sensor(&self) -> bool {
        self.equal >= ALIKE
    }

    /// Returns a sentence that explains how such files are read, if their rows leave a doubt.
    pub(super) fn doubt(&self) -> Option<String> {
        if !(HARDLY_ANY..NEARLY_ALL).contains(&self.equal) {
            return None;
        }
        let [one, other] = &self.names;
        let reading = if self.is_of_one_sensor() {
            "exports of one sensor. If each is of a tag of its own, set data.shape = \"file_per_tag\""
        } else {
            "a tag each. If they are exports of one sensor, set data.shape = \"wide\""
        };
        Some(format!(
            "the files {one:?} and {other:?} have the same value in {:.0} % of their {} shared rows, and are read as {reading}",
            100.0 * self.equal,
            self.shared
        ))
    }
}

/// Rows of two files with the same time.
#[derive(Debug, PartialEq, Eq)]
struct SharedRows {
    count: usize,
    /// Number of shared rows with the same value.
    equal: usize,
    /// Number of rows of the file with fewer rows.
    fewer: usize,
}

impl SharedRows {
    /// Compares times and cells of two files in order of time. The n-th row at a time in one file is compared with the
    /// n-th row at that time in the other.
    fn of(one: (&[i64], &[u64]), other: (&[i64], &[u64])) -> Self {
        let (fewer, more) = if one.0.len() <= other.0.len() { (one, other) } else { (other, one) };
        let (times, cells) = more;
        let mut rows = Self { count: 0, equal: 0, fewer: fewer.0.len() };
        let mut at = 0;
        for (&time, &cell) in fewer.0.iter().zip(fewer.1) {
            // A sparse file beside a dense one must not cost a pass through the dense one.
            at += times[at..].partition_point(|&other| other < time);
            if times.get(at) == Some(&time) {
                rows.count += 1;
                rows.equal += usize::from(cells[at] == cell);
                at += 1;
            }
        }
        rows
    }
}

impl Sink {
    /// Returns the two simultaneously recorded files with the fewest equal rows, or the first two that certainly belong
    /// to two tags. Returns `None` if all files follow one another.
    pub(super) fn least_alike(&mut self) -> Result<Option<ExportPair>, DataError> {
        self.flush()?;
        least_alike(&self.tags, |tag| tag.sorted(&self.store))
    }
}

/// Does the work of [`Sink::least_alike`], with `read` for the samples of a tag. In order of their beginnings, each tag
/// is compared with the earlier one that ends last.
fn least_alike(
    tags: &[Tag],
    mut read: impl FnMut(&Tag) -> Result<Sorted, DataError>,
) -> Result<Option<ExportPair>, DataError> {
    let mut order: Vec<&Tag> = tags.iter().filter(|tag| !tag.is_empty()).collect();
    order.sort_by_key(|tag| tag.first);
    let mut order = order.into_iter();
    let Some(mut longest) = order.next() else { return Ok(None) };
    // Each tag is read once: a merged log may have thousands of parts beside it.
    let mut of_longest: Option<Sorted> = None;
    let mut least: Option<ExportPair> = None;
    for tag in order {
        let mut of_tag = None;
        if is_beside(longest, tag) {
            let earlier = match of_longest.take() {
                Some(samples) => samples,
                None => read(longest)?,
            };
            let later = read(tag)?;
            let pair = ExportPair::of([longest, tag], [&earlier, &later]);
            if pair.equal < HARDLY_ANY {
                return Ok(Some(pair));
            }
            if least.as_ref().is_none_or(|least| pair.equal < least.equal) {
                least = Some(pair);
            }
            of_longest = Some(earlier);
            of_tag = Some(later);
        }
        if tag.last > longest.last {
            longest = tag;
            of_longest = of_tag;
        }
    }
    Ok(least)
}

/// Whether `one` was recorded at the same time as `later`, which begins no earlier.
fn is_beside(one: &Tag, later: &Tag) -> bool {
    let shorter = (one.last - one.first).min(later.last - later.first);
    let shared = one.last.min(later.last) - later.first;
    shared > 0 && shared as f64 >= BESIDE * shorter as f64
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::{DataConfig, log::store::Store, text::Cell};

    /// Returns a sink with a sample at every microsecond from the first time of each file on.
    fn sink(files: &[(i64, &[f64])]) -> Sink {
        let mut sink = Sink::new(Store::new(&DataConfig::default()).expect("memory"));
        for (number, (first, values)) in files.iter().enumerate() {
            let tag = sink.tag(&number.to_string()).expect("memory");
            for (time, &value) in (*first..).zip(*values) {
                sink.push(tag, time, Cell::Number(value).encode()).expect("memory");
            }
        }
        sink
    }

    fn pair(files: &[(i64, &[f64])]) -> Option<ExportPair> {
        sink(files).least_alike().expect("memory")
    }

    #[test]
    fn each_file_is_read_once() {
        let values = [7.0; 1_000];
        let parts = (0_i64..50).map(|part| (20 * part, &values[..20]));
        let files: Vec<(i64, &[f64])> = [(0, &values[..])].into_iter().chain(parts).collect();
        let mut sink = sink(&files);
        sink.flush().expect("memory");
        let mut reads = 0;
        let found = least_alike(&sink.tags, |tag| {
            reads += 1;
            tag.sorted(&sink.store)
        });
        let found = found.expect("memory").expect("parts beside the whole");
        assert_eq!((found.equal, found.shared, reads), (1.0, 20, files.len()));
    }

    #[test]
    fn two_files_that_differ_tell_of_all() {
        let whole = [1.0, 2.0, 3.0, 4.0];
        let half = [1.0, 2.0, 0.0, 0.0];
        assert_eq!(pair(&[(0, &whole), (4, &whole)]), None, "one after the other");
        let found = pair(&[(0, &whole), (0, &whole), (0, &half)]).expect("all at once");
        assert_eq!((found.names, found.equal), (["0".to_owned(), "2".to_owned()], 0.5));
        let found = pair(&[(0, &whole), (0, &half), (0, &[9.0; 4])]).expect("all at once");
        assert_eq!((found.equal, found.doubt()), (0.0, None));
    }

    #[test]
    fn a_file_that_ends_later_is_compared_with_what_follows() {
        let first = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0];
        let second = [3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0];
        let third = [7.0, 8.0, 0.0, 0.0];
        let found = pair(&[(0, &first), (2, &second), (6, &third)]).expect("some beside others");
        assert_eq!((found.names, found.equal), (["1".to_owned(), "2".to_owned()], 0.5));
    }

    #[test]
    fn files_with_few_shared_times_are_of_two_tags() {
        // Two of five rows are shared, and three of five.
        for (times, expected) in [([0, 1, 3, 5, 8], (0, 0.0)), ([0, 2, 3, 5, 8], (3, 1.0))] {
            let mut sink = sink(&[]);
            for (name, times) in [("even", [0, 2, 4, 6, 8]), ("other", times)] {
                let tag = sink.tag(name).expect("memory");
                for time in times {
                    sink.push(tag, time, Cell::Number(5.0).encode()).expect("memory");
                }
            }
            let found = sink.least_alike().expect("memory").expect("one beside the other");
            assert_eq!((found.shared, found.equal), expected, "{times:?}");
        }
    }

    fn told(equal: f64) -> Option<String> {
        let names = ["a", "b"].map(str::to_owned);
        ExportPair { names, shared: 200, equal }.doubt()
    }

    #[test]
    fn only_shares_between_hardly_any_and_nearly_all_leave_a_doubt() {
        assert_eq!([told(0.0), told(0.09), told(0.99), told(1.0)], [None, None, None, None]);
        let tags = told(0.1).expect("a doubt");
        assert!(tags.contains("in 10 % of their 200 shared rows"), "{tags}");
        assert!(tags.ends_with("set data.shape = \"wide\""), "{tags}");
        let sensor = told(0.9).expect("a doubt");
        assert!(sensor.ends_with("set data.shape = \"file_per_tag\""), "{sensor}");
    }

    proptest! {
        #[test]
        fn shared_rows_are_those_of_a_comparison_time_by_time(
            one in prop::collection::vec((0_i64..8, 0_u64..3), 0..20),
            other in prop::collection::vec((0_i64..8, 0_u64..3), 0..20),
        ) {
            let [one, other] = [one, other].map(|mut rows| {
                rows.sort_by_key(|row| row.0);
                rows.into_iter().unzip::<i64, u64, Vec<i64>, Vec<u64>>()
            });
            let fewer = one.0.len().min(other.0.len());
            let mut expected = SharedRows { count: 0, equal: 0, fewer };
            for time in 0..8 {
                let [here, there] = [&one, &other].map(|(times, cells)| {
                    let rows = times.iter().zip(cells).filter(|(at, _)| **at == time);
                    rows.map(|(_, cell)| *cell).collect::<Vec<u64>>()
                });
                expected.count += here.len().min(there.len());
                expected.equal += here.iter().zip(&there).filter(|(a, b)| a == b).count();
            }
            prop_assert_eq!(SharedRows::of((&one.0, &one.1), (&other.0, &other.1)), expected);
        }
    }
}
