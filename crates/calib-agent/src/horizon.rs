//! How many steps before its end a return is known.

/// Returns the number of steps at the end of an unbroken piece whose returns are truncated by more than 1 %: H = ⌈ln
/// 0.01 / ln γ⌉, and 0 for γ = 0.
///
/// # Panics
/// If `gamma` is not in [0, 1).
pub fn truncation_horizon(gamma: f64) -> usize {
    assert!((0.0..1.0).contains(&gamma), "a discount factor is in [0, 1), got {gamma}");
    if gamma == 0.0 { 0 } else { (0.01_f64.ln() / gamma.ln()).ceil() as usize }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn horizons_leave_less_than_a_hundredth() {
        assert_eq!(truncation_horizon(0.0), 0);
        assert_eq!(truncation_horizon(0.1), 2);
        assert_eq!(truncation_horizon(0.5), 7);
        assert_eq!(truncation_horizon(0.99), 459);
        for gamma in [0.1, 0.5, 0.9, 0.99, 0.999] {
            let horizon = truncation_horizon(gamma) as i32;
            let limit = 0.01 + 1e-9;
            assert!(gamma.powi(horizon) <= limit && gamma.powi(horizon - 1) > limit);
        }
    }
}
