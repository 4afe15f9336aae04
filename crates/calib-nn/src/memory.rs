//! Prediction of the memory for training.

/// Copies of the parameters during training: parameters, gradient and two moments; the best so far; and a checkpoint
/// during writing, as values and as bytes.
const COPIES: u128 = 4 + 1 + 6;

/// Returns the maximum memory for training a network with these layer sizes on mini-batches of `rows`, in bytes. It covers
/// copies of the parameters, and the values and gradients of each layer. It does not include the training data.
pub fn training_bytes(sizes: &[usize], rows: usize) -> u64 {
    let sizes: Vec<u128> = sizes.iter().map(|&size| size as u128).collect();
    let parameters: u128 = sizes.windows(2).map(|pair| pair[1] * (pair[0] + 1)).sum();
    let widest = sizes.iter().copied().max().unwrap_or(0);
    let values = rows as u128 * (sizes.iter().sum::<u128>() + 2 * widest);
    u64::try_from(4 * (COPIES * parameters + values)).unwrap_or(u64::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parameters_and_batches_count() {
        // 3 · 5 + 5 + 5 · 2 + 2 = 32 parameters; 4 rows of 3 + 5 + 2 values and two of 5.
        assert_eq!(training_bytes(&[3, 5, 2], 4), 4 * (11 * 32 + 4 * 20));
        assert_eq!(training_bytes(&[usize::MAX; 3], usize::MAX), u64::MAX);
        assert_eq!(training_bytes(&[], 4), 0);
    }
}
