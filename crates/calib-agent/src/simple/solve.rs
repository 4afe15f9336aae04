//! Small dense systems of equations.

/// A square matrix in row-major order.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Square {
    pub(super) size: usize,
    pub(super) values: Vec<f64>,
}

impl Square {
    pub(super) fn zeros(size: usize) -> Self {
        Self { size, values: vec![0.0; size * size] }
    }

    pub(super) fn row(&self, row: usize) -> &[f64] {
        &self.values[row * self.size..][..self.size]
    }

    pub(super) fn row_mut(&mut self, row: usize) -> &mut [f64] {
        &mut self.values[row * self.size..][..self.size]
    }

    /// Adds `factor` times `other`, which has the same size.
    pub(super) fn add(&mut self, factor: f64, other: &Self) {
        for (value, other) in self.values.iter_mut().zip(&other.values) {
            *value += factor * other;
        }
    }

    pub(super) fn times(&self, vector: &[f64]) -> Vec<f64> {
        (0..self.size).map(|row| dot(self.row(row), vector)).collect()
    }

    /// Solves `self · x = right` by Gaussian elimination with partial pivoting. `None` if the matrix is singular
    /// to working precision.
    pub(super) fn solve(mut self, right: &[f64]) -> Option<Vec<f64>> {
        let size = self.size;
        let mut right = right.to_vec();
        let largest = self.values.iter().fold(0.0, |most: f64, value| most.max(value.abs()));
        for pivot in 0..size {
            let best = (pivot..size)
                .max_by(|&a, &b| self.row(a)[pivot].abs().total_cmp(&self.row(b)[pivot].abs()))?;
            if self.row(best)[pivot].abs() <= largest * 1e-14 {
                return None;
            }
            if best != pivot {
                for column in 0..size {
                    self.values.swap(pivot * size + column, best * size + column);
                }
                right.swap(pivot, best);
            }
            let (above, below) = self.values.split_at_mut((pivot + 1) * size);
            let pivot_row = &above[pivot * size..];
            for (offset, row) in below.chunks_exact_mut(size).enumerate() {
                let factor = row[pivot] / pivot_row[pivot];
                if factor != 0.0 {
                    for (value, above) in row[pivot..].iter_mut().zip(&pivot_row[pivot..]) {
                        *value -= factor * above;
                    }
                    right[pivot + 1 + offset] -= factor * right[pivot];
                }
            }
        }
        for row in (0..size).rev() {
            let known = dot(&self.row(row)[row + 1..], &right[row + 1..]);
            right[row] = (right[row] - known) / self.row(row)[row];
        }
        right.iter().all(|value| value.is_finite()).then_some(right)
    }
}

pub(super) fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn systems_are_solved_with_pivoting() {
        let matrix =
            Square { size: 3, values: vec![0.0, 2.0, 1.0, 1.0, -2.0, -3.0, -1.0, 1.0, 2.0] };
        let x = [1.5, -2.0, 0.25];
        let solved = matrix.clone().solve(&matrix.times(&x)).expect("regular");
        for (got, expected) in solved.iter().zip(x) {
            assert!((got - expected).abs() < 1e-12);
        }
        let singular = Square { size: 2, values: vec![1.0, 2.0, 2.0, 4.0] };
        assert_eq!(singular.solve(&[1.0, 2.0]), None);
    }
}
