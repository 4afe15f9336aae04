//! The single value that is best for several pairs.

use schemars::JsonSchema;
use serde::Serialize;

use crate::{Pair, pair::capped};

/// The best default over the pairs with one optimiser.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, JsonSchema)]
pub struct OptimiserDefault {
    /// The optimiser.
    pub optimiser: String,
    /// Index of the setting.
    pub value: usize,
}

/// Returns the value with the smallest typical regret over the pairs for which `counts` is true: the smallest mean of
/// ln(1 + regret), with capped regrets. Ties go to the first. `None` if no pair counts.
pub(crate) fn best_default(
    pairs: &[Pair],
    regrets: &[Vec<f64>],
    counts: impl Fn(&Pair) -> bool,
) -> Option<usize> {
    let counted = pairs.iter().zip(regrets).filter(|(pair, _)| counts(pair));
    let rows: Vec<&Vec<f64>> = counted.map(|(_, regrets)| regrets).collect();
    let sums: Vec<f64> = (0..rows.first()?.len())
        .map(|value: usize| rows.iter().map(|row| capped(row[value]).ln_1p()).sum::<f64>())
        .collect();
    (0..sums.len()).min_by(|&a, &b| sums[a].total_cmp(&sums[b]))
}

/// Returns the best default for each optimiser, in alphabetical order.
pub(crate) fn of_optimisers(pairs: &[Pair], regrets: &[Vec<f64>]) -> Vec<OptimiserDefault> {
    let mut optimisers: Vec<&String> = pairs.iter().map(|pair| &pair.optimiser).collect();
    optimisers.sort();
    optimisers.dedup();
    optimisers
        .into_iter()
        .filter_map(|optimiser| {
            let value = best_default(pairs, regrets, |pair| pair.optimiser == *optimiser)?;
            Some(OptimiserDefault { optimiser: optimiser.clone(), value })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::validity::tests::pair;

    #[test]
    fn a_default_is_best_typically_not_on_average() {
        let pairs = [("a", "adam"), ("b", "adam"), ("c", "sgd")].map(|(plant, optimiser)| Pair {
            optimiser: optimiser.to_owned(),
            ..pair(plant, "s", [0.0, 0.0, 0.0])
        });
        // Means are 2 and 1; geometric means of 1 + regret are (1 · 1 · 7)^⅓ = 1.91 and 2.
        let regrets = [vec![0.0, 1.0], vec![0.0, 1.0], vec![6.0, 1.0]];
        assert_eq!(best_default(&pairs, &regrets, |_| true), Some(0));
        assert_eq!(best_default(&pairs, &regrets, |pair| pair.plant == "c"), Some(1));
        assert_eq!(best_default(&pairs, &regrets, |_| false), None);
        let each = of_optimisers(&pairs, &regrets);
        let each: Vec<(&str, usize)> =
            each.iter().map(|default| (default.optimiser.as_str(), default.value)).collect();
        assert_eq!(each, [("adam", 0), ("sgd", 1)]);
    }

    #[test]
    fn what_diverged_counts_as_the_cap() {
        let pairs = [pair("a", "s", [0.0; 3]), pair("b", "s", [0.0; 3])];
        // (11 · 1)^½ = 3.3 against (4 · 4)^½ = 4: divergence is bad, but does not decide alone.
        let regrets = [vec![f64::INFINITY, 3.0], vec![0.0, 3.0]];
        assert_eq!(best_default(&pairs, &regrets, |_| true), Some(0));
    }
}
