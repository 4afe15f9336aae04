//! Rank correlation within groups.

use crate::error::check_pair;
use crate::{StatsError, average_ranks};

/// Returns Spearman's correlation within groups, pooled: differences between groups do not count.
///
/// In each group `(x, y)` both are replaced by their average ranks r, centred and scaled to r/(n + 1) − 1/2, so that
/// groups count equally whatever the size of their values. Then ρ = Σxy / √(Σx² Σy²) over all groups. With one group it
/// is Spearman's ρ. `None` if x or y is constant in every group. Source: stratified ranks as in van Elteren (1960);
/// their pooled correlation is derived.
///
/// # Errors
///
/// A group is empty or holds NaN, or its inputs differ in length.
pub fn pooled_spearman(groups: &[(&[f64], &[f64])]) -> Result<Option<f64>, StatsError> {
    let mut xy = 0.0;
    let mut xx = 0.0;
    let mut yy = 0.0;
    for &(x, y) in groups {
        check_pair(("x", x), ("y", y))?;
        let scale = (x.len() + 1) as f64;
        let x = average_ranks(x)?;
        let y = average_ranks(y)?;
        for (x, y) in x.iter().zip(&y) {
            let x = x / scale - 0.5;
            let y = y / scale - 0.5;
            xy += x * y;
            xx += x * x;
            yy += y * y;
        }
    }
    if xx == 0.0 || yy == 0.0 {
        return Ok(None);
    }
    Ok(Some((xy / (xx * yy).sqrt()).clamp(-1.0, 1.0)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_group_is_spearman() {
        let x = [3.0, 1.0, 2.0, 2.0];
        let y = [0.1, 0.5, 0.2, 0.9];
        let pooled = pooled_spearman(&[(&x, &y)]).unwrap().unwrap();
        let plain = crate::spearman(&x, &y).unwrap().unwrap();
        assert!((pooled - plain).abs() < 1e-12, "{pooled} {plain}");
    }

    #[test]
    fn differences_between_groups_do_not_count() {
        // Inside each group y falls as x rises. Between the groups, both are far larger in the second.
        let falling = pooled_spearman(&[
            (&[1.0, 2.0, 3.0], &[0.3, 0.2, 0.1]),
            (&[101.0, 102.0, 103.0], &[9.3, 9.2, 9.1]),
        ]);
        assert_eq!(falling, Ok(Some(-1.0)));
    }

    #[test]
    fn groups_are_pooled_by_hand() {
        // Ranks / (n + 1) - 1/2: (-1/4, 0, 1/4) twice in agreement, Σxy = 1/8; (-1/6, 1/6) against (1/6, -1/6), -1/18.
        let pooled = pooled_spearman(&[
            (&[1.0, 2.0, 3.0], &[10.0, 20.0, 30.0]),
            (&[1.0, 2.0], &[20.0, 10.0]),
        ]);
        let expected = (1.0 / 8.0 - 1.0 / 18.0) / (1.0 / 8.0 + 1.0 / 18.0);
        assert!((pooled.unwrap().unwrap() - expected).abs() < 1e-12);
    }

    #[test]
    fn constants_have_no_correlation() {
        assert_eq!(pooled_spearman(&[(&[1.0, 1.0], &[1.0, 2.0]), (&[1.0], &[4.0])]), Ok(None));
        assert_eq!(pooled_spearman(&[]), Ok(None));
    }
}
