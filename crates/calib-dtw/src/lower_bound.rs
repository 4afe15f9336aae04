//! Lower bounds of a distance that cost a few passes over the series instead of N × M cells.

use std::{collections::VecDeque, ops::Range};

use crate::{LocalDistance, Series, Settings, StepPattern, Window};

/// Weights that every path pays at least.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct LeastWeights {
    /// In every query sample after the first.
    query: f64,
    /// In every reference sample after the first.
    reference: f64,
    /// In the last cell of a path.
    last: f64,
}

impl LeastWeights {
    pub(crate) fn of(pattern: &StepPattern) -> Self {
        let mut least =
            Self { query: f64::INFINITY, reference: f64::INFINITY, last: f64::INFINITY };
        for branch in pattern.branches() {
            let (rows, columns) = branch.origin();
            for row in 0..rows {
                let cells = branch.cells().filter(|cell| cell.query == row);
                least.query = least.query.min(cells.map(|cell| cell.weight).sum());
            }
            for column in 0..columns {
                let cells = branch.cells().filter(|cell| cell.reference == column);
                least.reference = least.reference.min(cells.map(|cell| cell.weight).sum());
            }
            let last = branch.steps().last().map_or(0.0, |step| step.weight);
            least.last = least.last.min(last);
        }
        // A series of one sample only is never advanced.
        if least.query == f64::INFINITY {
            least.query = 0.0;
        }
        if least.reference == f64::INFINITY {
            least.reference = 0.0;
        }
        least
    }
}

/// Reference samples that each query sample may be matched with, also in the middle of a branch.
/// Both ends never decrease.
pub(crate) fn partners(
    pattern: &StepPattern,
    settings: Settings,
    n: usize,
    m: usize,
) -> Vec<Range<usize>> {
    if settings.window == Window::None {
        return vec![0..m; n];
    }
    let single_steps = pattern.branches().iter().all(|branch| branch.steps().len() == 1);
    let (halo, reach) = if single_steps { (0, 0) } else { pattern.reach() };
    // The first branch of an open begin comes from a row that has no window.
    let early = if settings.ends.open_begin() { reach } else { 0 };
    (0..n)
        .map(|row| {
            let first = settings.window.columns(row.saturating_sub(halo), n, m).start;
            let last = settings.window.columns((row + halo).min(n - 1), n, m).end;
            first.saturating_sub(early)..last
        })
        .collect()
}

/// The same the other way round: query samples for each of `m` reference samples.
pub(crate) fn transposed(partners: &[Range<usize>], m: usize) -> Vec<Range<usize>> {
    let (mut first, mut last) = (0, 0);
    (0..m)
        .map(|column| {
            while first < partners.len() && partners[first].end <= column {
                first += 1;
            }
            while last < partners.len() && partners[last].start <= column {
                last += 1;
            }
            first..last
        })
        .collect()
}

/// Least and greatest partner of every sample, channel by channel.
pub(crate) struct Envelope {
    /// `[samples, channels]` of (least, greatest).
    limits: Vec<(f64, f64)>,
    channels: usize,
}

impl Envelope {
    /// Envelope of `series` over `ranges`, whose ends must never decrease. An empty range, which
    /// no path can pass, gets no limits.
    pub(crate) fn new(series: Series<'_>, ranges: &[Range<usize>]) -> Self {
        let channels = series.channels();
        let unlimited = (f64::NEG_INFINITY, f64::INFINITY);
        let mut limits = vec![unlimited; ranges.len() * channels];
        for channel in 0..channels {
            let value = |index: usize| series.sample(index)[channel];
            let (mut least, mut greatest) = (VecDeque::new(), VecDeque::new());
            let mut entered = 0;
            for (at, range) in ranges.iter().enumerate() {
                while entered < range.end {
                    while least.back().is_some_and(|&i| value(i) >= value(entered)) {
                        least.pop_back();
                    }
                    while greatest.back().is_some_and(|&i| value(i) <= value(entered)) {
                        greatest.pop_back();
                    }
                    least.push_back(entered);
                    greatest.push_back(entered);
                    entered += 1;
                }
                while least.front().is_some_and(|&i| i < range.start) {
                    least.pop_front();
                }
                while greatest.front().is_some_and(|&i| i < range.start) {
                    greatest.pop_front();
                }
                if let (Some(&low), Some(&high)) = (least.front(), greatest.front()) {
                    limits[at * channels + channel] = (value(low), value(high));
                }
            }
        }
        Self { limits, channels }
    }

    /// Local distances from the samples of `series` to the envelope: first one, and sum of the others.
    fn outside(&self, series: Series<'_>, local_distance: LocalDistance) -> (f64, f64) {
        let mut nearest = vec![0.0; self.channels];
        let mut distances =
            self.limits.chunks_exact(self.channels).enumerate().map(|(at, limits)| {
                let sample = series.sample(at);
                for (channel, &(low, high)) in limits.iter().enumerate() {
                    nearest[channel] = sample[channel].max(low).min(high);
                }
                local_distance.between(sample, &nearest)
            });
        let first = distances.next().unwrap_or(0.0);
        (first, distances.sum())
    }
}

/// What is known of a query before any reference is looked at; good for references of one length.
pub(crate) struct Bounds<'a> {
    query: Series<'a>,
    settings: Settings,
    weights: LeastWeights,
    partners: Vec<Range<usize>>,
    /// Of the query, one entry a reference sample.
    envelope: Envelope,
    reference: usize,
}

impl<'a> Bounds<'a> {
    pub(crate) fn new(
        pattern: &StepPattern,
        settings: Settings,
        query: Series<'a>,
        reference: usize,
    ) -> Self {
        let partners = partners(pattern, settings, query.len(), reference);
        let envelope = Envelope::new(query, &transposed(&partners, reference));
        Self { query, settings, weights: LeastWeights::of(pattern), partners, envelope, reference }
    }

    /// Samples of the references these bounds are for.
    pub(crate) fn reference(&self) -> usize {
        self.reference
    }

    /// A sum of at least 0 that no rounding lifts above the distance.
    fn rounded_down(&self, bound: f64) -> f64 {
        let cells = (self.query.len() + self.reference) as f64;
        (bound * (1.0 - 8.0 * cells * f64::EPSILON)).max(0.0)
    }

    /// First and last cell (after Kim).
    pub(crate) fn corners(&self, reference: Series<'_>) -> f64 {
        let local = |i: usize, j: usize| {
            let (x, y) = (self.query.sample(i), reference.sample(j));
            self.settings.local_distance.between(x, y)
        };
        let (last_row, last_column) = (self.query.len() - 1, self.reference - 1);
        let ends = self.settings.ends;
        let mut bound = 0.0;
        if !ends.open_begin() {
            bound += local(0, 0);
        }
        if !ends.open_end() && (last_row, last_column) != (0, 0) {
            bound += self.weights.last * local(last_row, last_column);
        }
        self.rounded_down(bound)
    }

    /// Every reference sample to the envelope of the query (after Keogh); 0 with open ends.
    pub(crate) fn reference_outside(&self, reference: Series<'_>) -> f64 {
        if self.settings.ends.open_begin() || self.settings.ends.open_end() {
            return 0.0;
        }
        let (first, others) = self.envelope.outside(reference, self.settings.local_distance);
        self.rounded_down(first + self.weights.reference * others)
    }

    /// Every query sample to the envelope of the reference (after Keogh).
    pub(crate) fn query_outside(&self, reference: Series<'_>) -> f64 {
        let envelope = Envelope::new(reference, &self.partners);
        let (first, others) = envelope.outside(self.query, self.settings.local_distance);
        let first = first * if self.settings.ends.open_begin() { self.weights.query } else { 1.0 };
        self.rounded_down(first + self.weights.query * others)
    }
}
