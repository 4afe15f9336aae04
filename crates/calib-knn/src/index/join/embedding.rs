//! An embedding into few dimensions that never lengthens a distance by more than a known error.

use calib_core::Seed;
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

use crate::{
    Sources,
    groups::Groups,
    index::{covariance, leading_axes, mean},
};

use super::far::{FAR, Far};

/// Maximum number of coordinates of an embedding.
pub(super) const MOST: usize = 32;
/// The number of stored coordinates is a multiple of this; the padding is zero.
const STEP: usize = 16;
/// Maximum number of rows from which the axes are estimated. Any axes are correct; better ones prune more.
const SAMPLE: usize = 16_384;
/// Limit on the work of the estimate, rows × columns². The sample never has fewer than `LEAST_SAMPLE` rows. Fewer rows than columns are
/// no loss, because the rows still span many more dimensions than the axes.
const SAMPLE_WORK: usize = 2_000_000_000;
const LEAST_SAMPLE: usize = 1024;

/// Returns the number of coordinates of an image, with padding.
pub(crate) fn width(columns: usize) -> usize {
    columns.min(MOST).next_multiple_of(STEP)
}

/// Coordinates along the axes of largest variance and, if some axes are omitted, the distance from their span:
/// `e(x) = (A(x − μ), √(‖x − μ‖² − ‖A(x − μ)‖²))`.
///
/// `A` has orthonormal rows. By the triangle inequality in the complement, `‖e(x) − e(y)‖ ≤ ‖x − y‖`. The coordinates are computed in
/// f64 and stored in f32, so the stored images may be further apart than the states by [`slack`](Self::slack).
#[derive(Debug)]
pub(super) struct Embedding {
    mean: Vec<f64>,
    /// The axes, `[columns, MOST]`, padded with zeros.
    axes: Vec<f64>,
    /// The coordinate that stores each axis, and last the one that stores the distance from the span.
    places: Vec<usize>,
    width: usize,
    spans: bool,
    /// The median distance from the mean; infinite if no states are kept apart.
    usual: f64,
}

impl Embedding {
    /// Fits an embedding to the sources.
    pub(super) fn new(sources: &Sources<'_>, groups: &Groups) -> Self {
        let columns = sources.columns();
        let most = SAMPLE.min(SAMPLE_WORK / (columns * columns).max(1)).max(LEAST_SAMPLE);
        let stride = groups.len().div_ceil(most).max(1);
        let sample: Vec<&[f32]> = (0..groups.len())
            .step_by(stride)
            .map(|group| sources.states.row(groups.row(group)))
            .collect();
        let (sample, usual) = without_far(sample, columns, Far::most(groups.len()) / stride);
        let (mean, covariance) = covariance(&sample, columns);
        let spans = columns <= MOST;
        let count = if spans { columns } else { MOST - 1 };
        let axes = leading_axes(&covariance, columns, count, Seed::new(0));
        let used = count + usize::from(!spans);
        let mut padded = vec![0.0; columns * MOST];
        for (to, from) in padded.chunks_exact_mut(MOST).zip(axes.chunks_exact(count)) {
            to[..count].copy_from_slice(from);
        }
        let places = (0..used).collect();
        let width = width(columns);
        let mut this = Self { mean, axes: padded, places, width, spans, usual };
        this.sort_by_variance(&sample);
        this
    }

    /// Sorts the coordinates by descending variance, so that sums of squares grow early.
    fn sort_by_variance(&mut self, sample: &[&[f32]]) {
        let used = self.places.len();
        let images: Vec<f32> = sample
            .par_iter()
            .flat_map_iter(|state| {
                let mut image = vec![0.0; self.width];
                self.map(state, &mut image);
                image
            })
            .collect();
        let variances: Vec<f64> = (0..used)
            .map(|place: usize| {
                let values = images.iter().skip(place).step_by(self.width).map(|&v| f64::from(v));
                let mut sum = 0.0;
                let mut squares = 0.0;
                for value in values {
                    sum += value;
                    squares += value * value;
                }
                squares - sum * sum / sample.len() as f64
            })
            .collect();
        let mut order: Vec<usize> = (0..used).collect();
        order.sort_by(|&a, &b| variances[b].total_cmp(&variances[a]));
        for (place, &coordinate) in order.iter().enumerate() {
            self.places[coordinate] = place;
        }
    }

    /// Returns the number of coordinates of an image, a multiple of 16.
    pub(super) fn width(&self) -> usize {
        self.width
    }

    /// Returns the number of coordinates after which all are zero, a multiple of 4.
    pub(super) fn used(&self) -> usize {
        self.places.len().next_multiple_of(4)
    }

    /// Returns the distance from the mean beyond which states are kept apart.
    pub(super) fn far(&self) -> f64 {
        FAR * self.usual
    }

    /// Writes the image of `state` and returns `‖x − μ‖`.
    pub(super) fn map(&self, state: &[f32], image: &mut [f32]) -> f64 {
        Arch::new().dispatch(Map { embedding: self, state, image })
    }

    /// Returns a bound on how far the distance of two stored images may exceed the distance of their states, if these are at most `a`
    /// and `b` from the mean.
    ///
    /// Storing a coordinate has a relative error of `2⁻²⁴`, so an image has an error of `2⁻²⁴ ‖x − μ‖`. In f64 the axes, the sums and
    /// the squared norms err by less than `4(d + 64)·2⁻⁵³` of `‖x − μ‖²`. The square root of the difference of two such numbers errs by
    /// the root of that. All bounds are doubled.
    pub(super) fn slack(&self, a: f64, b: f64) -> f64 {
        let double = 4.0 * (self.mean.len() as f64 + 64.0) * f64::EPSILON;
        let stored = f64::from(f32::EPSILON);
        let root = if self.spans { 0.0 } else { double.sqrt() };
        2.0 * (a + b) * (stored + double + root)
    }
}

/// Returns the sample without outliers, and the usual distance from the mean. Outliers lie many times that distance from the mean. The
/// axes of largest variance should describe the plant and not a few spikes. If there are more than `most` outliers, they are no
/// exceptions: all states are kept, and no state counts as far.
fn without_far(all: Vec<&[f32]>, columns: usize, most: usize) -> (Vec<&[f32]>, f64) {
    let mut sample = all.clone();
    loop {
        let mean = mean(&sample, columns);
        let norms: Vec<f64> = sample
            .par_iter()
            .map(|state: &&[f32]| {
                let centred = state.iter().zip(&mean).map(|(&value, mean)| f64::from(value) - mean);
                centred.map(|value| value * value).sum::<f64>().sqrt()
            })
            .collect();
        let mut sorted = norms.clone();
        sorted.sort_unstable_by(f64::total_cmp);
        let usual = sorted.get(sorted.len() / 2).copied().unwrap_or(0.0);
        let near = sample.iter().zip(&norms).filter(|&(_, &norm)| norm <= FAR * usual);
        let near: Vec<&[f32]> = near.map(|(state, _)| *state).collect();
        if near.len() + most < all.len() {
            return (all, f64::INFINITY);
        }
        // Removing outliers moves the mean, so other states may now be far from it.
        if near.len() == sample.len() {
            return (sample, usual);
        }
        sample = near;
    }
}

/// The work of [`Embedding::map`], for any instruction set.
struct Map<'a> {
    embedding: &'a Embedding,
    state: &'a [f32],
    image: &'a mut [f32],
}

impl WithSimd for Map<'_> {
    type Output = f64;

    #[inline(always)]
    #[expect(clippy::inline_always, reason = "takes the instruction set of its caller")]
    fn with_simd<S: Simd>(self, simd: S) -> f64 {
        let Embedding { mean, axes, places, spans, .. } = self.embedding;
        let mut sums = [0.0_f64; MOST];
        let mut norm = 0.0;
        let columns = self.state.iter().zip(mean).zip(axes.as_chunks::<MOST>().0);
        for ((&value, mean), axes) in columns {
            let centred = f64::from(value) - mean;
            norm += centred * centred;
            let centred = simd.splat_f64s(centred);
            let sums = S::as_mut_simd_f64s(&mut sums).0;
            for (sum, &axis) in sums.iter_mut().zip(S::as_simd_f64s(axes).0) {
                *sum = simd.mul_add_e_f64s(centred, axis, *sum);
            }
        }
        let count = places.len() - usize::from(!spans);
        let mut inside = 0.0;
        for (&sum, &place) in sums.iter().zip(&places[..count]) {
            inside += sum * sum;
            self.image[place] = sum as f32;
        }
        if !spans {
            self.image[places[count]] = (norm - inside).max(0.0).sqrt() as f32;
        }
        norm.sqrt()
    }
}

#[cfg(test)]
mod tests {
    use calib_core::{Segments, Silent, States, Transitions};

    use super::*;
    use crate::{Blocks, distance::squared};

    #[test]
    fn images_are_no_further_apart_than_states() {
        for columns in [1, 5, 32, 33, 70] {
            let mut rng = Seed::new(4).number(columns as u64).rng();
            let rows = 200;
            // Few directions of variation, copies, and points that almost coincide.
            let factors: Vec<f64> = (0..3 * columns).map(|_| rng.normal()).collect();
            let mut values = Vec::new();
            for row in 0..rows {
                let f: Vec<f64> =
                    (0..3).map(|_| if row % 5 == 0 { 1.0 } else { rng.normal() }).collect();
                for column in 0..columns {
                    let mixed: f64 = (0..3).map(|i| f[i] * factors[i * columns + column]).sum();
                    values.push((1000.0 + mixed + 1e-5 * rng.normal()) as f32);
                }
            }
            let states = States::new(values, rows, columns).expect("valid");
            let transitions = Transitions::new(Segments::from_lengths([rows]).expect("valid"));
            let blocks = Blocks::new(&transitions, 2).expect("valid");
            let sources = Sources::new(&states, &transitions, &blocks).expect("valid");
            let embedding =
                Embedding::new(&sources, &Groups::new(&sources, &Silent).expect("not interrupted"));
            let mut images = vec![vec![0.0; embedding.width()]; rows];
            let norms: Vec<f64> =
                (0..rows).map(|row| embedding.map(states.row(row), &mut images[row])).collect();
            let mut best = 0.0_f64;
            for a in 0..rows {
                for b in 0..a {
                    let image = squared(&images[a], &images[b]).sqrt();
                    let state = squared(states.row(a), states.row(b)).sqrt();
                    assert!(image <= state + embedding.slack(norms[a], norms[b]));
                    best = best.max(image / state);
                }
            }
            assert!(best > 0.9, "the leading axes carry the distance: {best}");
        }
    }
}
