//! The assignment of images to leaves.

use std::ops::Range;

use calib_core::Monitor;

use crate::KnnError;

/// Number of images from which a node chooses its widest coordinate.
const SAMPLE: usize = 512;

/// Spreads images, `[n, width]`, over leaves of at most `size` near images. Returns the start of each leaf with the end of the last,
/// and the image at each position.
///
/// Progress counts each image.
///
/// # Errors
/// If the monitor interrupts.
pub(crate) fn leaves(
    images: &[f32],
    width: usize,
    size: usize,
    monitor: &dyn Monitor,
) -> Result<(Vec<u32>, Vec<u32>), KnnError> {
    let count = images.len() / width;
    let leaves = count.div_ceil(size).max(1);
    let mut order: Vec<u32> = (0..count as u32).collect();
    let spread = Spread { images, width, count, leaves, strip: size, monitor };
    spread.arrange(&mut order, 0..leaves);
    monitor.check()?;
    Ok(((0..=leaves).map(|leaf| boundary(count, leaves, leaf) as u32).collect(), order))
}

/// Returns the first position of `leaf` when `count` images are spread evenly over `leaves`.
pub(super) fn boundary(count: usize, leaves: usize, leaf: usize) -> usize {
    (leaf as u128 * count as u128 / leaves as u128) as usize
}

/// The recursive assignment of images to leaves.
pub(super) struct Spread<'a> {
    pub(super) images: &'a [f32],
    pub(super) width: usize,
    pub(super) count: usize,
    pub(super) leaves: usize,
    /// Number of images that are adjacent inside a leaf.
    pub(super) strip: usize,
    pub(super) monitor: &'a dyn Monitor,
}

impl Spread<'_> {
    /// Sorts the images of `order`, which fill `leaves`, by leaf and by strip.
    pub(super) fn arrange(&self, order: &mut [u32], leaves: Range<usize>) {
        if self.monitor.interrupted() {
            return;
        }
        if leaves.len() <= 1 {
            self.arrange_strips(order);
            self.monitor.advance(order.len() as u64);
            return;
        }
        let middle = leaves.start + leaves.len() / 2;
        let [start, end] =
            [leaves.start, middle].map(|leaf| boundary(self.count, self.leaves, leaf));
        let (left, right) = self.split(order, end - start);
        rayon::join(
            || self.arrange(left, leaves.start..middle),
            || self.arrange(right, middle..leaves.end),
        );
    }

    /// Sorts the images of one leaf by strip. All strips but the last are full.
    fn arrange_strips(&self, order: &mut [u32]) {
        if order.len() > self.strip {
            let at = (order.len() / 2).next_multiple_of(self.strip);
            let (left, right) = self.split(order, at);
            self.arrange_strips(left);
            self.arrange_strips(right);
        }
    }

    /// Splits along the coordinate of largest variance: the `at` images with the smaller coordinates come first.
    fn split<'o>(&self, order: &'o mut [u32], at: usize) -> (&'o mut [u32], &'o mut [u32]) {
        let images = self.images;
        let width = self.width;
        let coordinate = widest(images, width, order);
        if at < order.len() {
            order.select_nth_unstable_by(at, |&a, &b| {
                let values = [a, b].map(|image| images[image as usize * width + coordinate]);
                values[0].total_cmp(&values[1]).then(a.cmp(&b))
            });
        }
        order.split_at_mut(at)
    }
}

/// Returns the coordinate of largest variance over a sample of the images.
fn widest(images: &[f32], width: usize, order: &[u32]) -> usize {
    let stride = order.len().div_ceil(SAMPLE);
    let mut sums = vec![0.0_f64; width];
    let mut squares = vec![0.0_f64; width];
    let mut sampled = 0.0;
    for &image in order.iter().step_by(stride) {
        sampled += 1.0;
        let image = &images[image as usize * width..][..width];
        for ((sum, square), &value) in sums.iter_mut().zip(&mut squares).zip(image) {
            let value = f64::from(value);
            *sum += value;
            *square += value * value;
        }
    }
    let variances: Vec<f64> =
        (0..width).map(|c| squares[c] - sums[c] * sums[c] / sampled).collect();
    (0..width).max_by(|&a, &b| variances[a].total_cmp(&variances[b]).then(b.cmp(&a))).unwrap_or(0)
}
