//! Whether the quality of choices depends on the task.

use calib_stats::{Interval, StatsError, mean, median};
use schemars::JsonSchema;
use serde::Serialize;

use crate::{
    Method, Pair, TaskValue,
    choices::Choices,
    comparison::{quotient, quotient_interval},
    over_plants::{OverPlants, mean_of},
};

/// Numeric features with more different values than this are split into halves.
const FEW_VALUES: usize = 4;

/// Results of a method over pairs whose tasks share one feature.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct GroupSummary {
    /// The feature, such as the optimiser.
    pub feature: String,
    /// The value of the feature that the pairs share.
    pub group: String,
    /// The method.
    pub method: Method,
    /// Number of pairs in the group in which the method has a choice.
    pub pairs: usize,
    /// Number of plants in these pairs.
    pub plants: usize,
    /// Typical regret, as in [`MethodSummary`](crate::MethodSummary).
    pub typical: f64,
    /// 95 % interval of the typical regret, over plants.
    pub interval: Option<Interval>,
    /// Geometric mean of the method's error on the held-out period divided by the error of the study's
    /// default; none without a default.
    pub against_default: Option<f64>,
    /// 95 % interval of this quotient, over plants.
    pub against_default_interval: Option<Interval>,
}

/// Pairs with the same value of a feature.
struct PairGroup {
    feature: String,
    name: String,
    /// Positions of the pairs in the list of all pairs.
    pairs: Vec<usize>,
}

/// Summarises each of `methods` over each group of each feature.
pub(crate) fn groups(
    pairs: &[Pair],
    methods: &[Choices],
    plants: &OverPlants,
) -> Result<Vec<GroupSummary>, StatsError> {
    let default = methods.iter().find(|method| method.method == Method::Default);
    let shown = methods
        .iter()
        .filter(|method| method.method.is_model() || method.method == Method::LogReplay);
    let shown: Vec<&Choices> = shown.collect();
    let mut all = Vec::new();
    for group in all_groups(pairs)? {
        for method in &shown {
            all.extend(summary(&group, method, default, plants)?);
        }
    }
    Ok(all)
}

fn summary(
    group: &PairGroup,
    method: &Choices,
    default: Option<&Choices>,
    plants: &OverPlants,
) -> Result<Option<GroupSummary>, StatsError> {
    let has = |pair: usize| group.pairs.contains(&pair) && method.regrets[pair].is_some();
    let own: Vec<usize> = group.pairs.iter().copied().filter(|&pair| has(pair)).collect();
    if own.is_empty() {
        return Ok(None);
    }
    let regret = |pair: usize| method.counted(pair).unwrap_or(f64::NAN);
    let logarithm = |pair: usize| regret(pair).ln_1p();
    let both =
        |pair: usize| has(pair) && default.is_some_and(|default| default.regrets[pair].is_some());
    let ratio = |pair: usize| {
        let other = default.and_then(|default| default.counted(pair)).unwrap_or(f64::NAN);
        quotient(regret(pair), other)
    };
    let compared: Vec<usize> = own.iter().copied().filter(|&pair| both(pair)).collect();
    let logarithms: Vec<f64> = own.iter().map(|&pair| logarithm(pair)).collect();
    Ok(Some(GroupSummary {
        feature: group.feature.clone(),
        group: group.name.clone(),
        method: method.method.clone(),
        pairs: own.len(),
        plants: plants.each(has).len(),
        typical: mean(&logarithms)?.exp_m1(),
        interval: plants.typical_interval(has, logarithm),
        against_default: mean_of(&compared, ratio).map(f64::exp),
        against_default_interval: quotient_interval(
            plants.interval(both, |pairs| mean_of(pairs, ratio)),
        ),
    }))
}

/// Returns the groups of every feature in which pairs differ.
fn all_groups(pairs: &[Pair]) -> Result<Vec<PairGroup>, StatsError> {
    let mut all =
        groups_of("optimiser", pairs, |pair: &Pair| Some(TaskValue::Name(pair.optimiser.clone())))?;
    let mut features: Vec<&String> = Vec::new();
    for (feature, _) in pairs.iter().flat_map(|pair| &pair.task) {
        if !features.contains(&feature) {
            features.push(feature);
        }
    }
    for feature in features {
        all.extend(groups_of(feature, pairs, |pair: &Pair| {
            let found = pair.task.iter().find(|(name, _)| name == feature);
            found.map(|(_, value)| value.clone())
        })?);
    }
    Ok(all)
}

/// Returns one group for each name or number, or two halves if there are many numbers. Empty if all pairs have
/// the same value.
fn groups_of(
    feature: &str,
    pairs: &[Pair],
    value_of: impl Fn(&Pair) -> Option<TaskValue>,
) -> Result<Vec<PairGroup>, StatsError> {
    let values: Vec<(usize, TaskValue)> =
        pairs.iter().enumerate().filter_map(|(pair, own)| Some((pair, value_of(own)?))).collect();
    let mut numbers: Vec<f64> = values.iter().filter_map(|(_, value)| value.number()).collect();
    numbers.sort_by(f64::total_cmp);
    let middle = if numbers.is_empty() { 0.0 } else { median(&numbers)? };
    numbers.dedup();
    let mut groups: Vec<(TaskValue, PairGroup)> = Vec::new();
    for (pair, value) in values {
        let name = group_name(&value, &numbers, middle);
        if let Some((_, group)) = groups.iter_mut().find(|(_, group)| group.name == name) {
            group.pairs.push(pair);
        } else {
            let feature = feature.to_owned();
            groups.push((value, PairGroup { feature, name, pairs: vec![pair] }));
        }
    }
    groups.sort_by(|(a, x), (b, y)| match (a.number(), b.number()) {
        (Some(a), Some(b)) => a.total_cmp(&b),
        _ => x.name.cmp(&y.name),
    });
    let groups: Vec<PairGroup> = groups.into_iter().map(|(_, group)| group).collect();
    Ok(if groups.len() > 1 { groups } else { Vec::new() })
}

/// Returns the name of a value's group. `numbers` are all different values, and `middle` is their median.
fn group_name(value: &TaskValue, numbers: &[f64], middle: f64) -> String {
    match value {
        TaskValue::Name(name) => name.clone(),
        TaskValue::Number(number) if numbers.len() <= FEW_VALUES => number.to_string(),
        TaskValue::Number(number) if *number <= middle => format!("up to {middle}"),
        TaskValue::Number(_) => format!("above {middle}"),
    }
}

impl TaskValue {
    fn number(&self) -> Option<f64> {
        match self {
            Self::Number(number) => Some(*number),
            Self::Name(_) => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::validity::tests::pair;

    fn groups_by(values: &[TaskValue]) -> Vec<(String, Vec<usize>)> {
        let pairs: Vec<Pair> = values
            .iter()
            .map(|value| Pair {
                task: vec![("x".to_owned(), value.clone())],
                ..pair("plant", "s", [0.0; 3])
            })
            .collect();
        let groups = all_groups(&pairs).expect("numbers");
        assert!(groups.iter().all(|group| group.feature == "x"), "all have one optimiser");
        groups.into_iter().map(|group| (group.name, group.pairs)).collect()
    }

    fn numbers(numbers: &[f64]) -> Vec<TaskValue> {
        numbers.iter().map(|&number| TaskValue::Number(number)).collect()
    }

    #[test]
    fn few_values_are_groups_and_many_are_halves() {
        let few = groups_by(&numbers(&[0.9, 0.8, 0.9]));
        assert_eq!(few, [("0.8".to_owned(), vec![1]), ("0.9".to_owned(), vec![0, 2])]);
        let many = groups_by(&numbers(&[5.0, 1.0, 2.0, 4.0, 3.0, 1.0]));
        assert_eq!(
            many,
            [("up to 2.5".to_owned(), vec![1, 2, 5]), ("above 2.5".to_owned(), vec![0, 3, 4])]
        );
        let names = ["sgd", "adam"].map(|name| TaskValue::Name(name.to_owned()));
        assert_eq!(groups_by(&names), [("adam".to_owned(), vec![1]), ("sgd".to_owned(), vec![0])]);
        assert!(groups_by(&numbers(&[1.0, 1.0])).is_empty(), "all alike");
    }
}
