//! Claims that were stated before the study was run.

use calib_stats::Interval;
use schemars::JsonSchema;
use serde::Serialize;

use crate::{Comparison, GOOD, MARGIN, Method, MethodSummary};

/// A claim about the choices of a model.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Claim {
    /// The mean regret is at most [`GOOD`].
    SmallRegret,
    /// Less error than the other method.
    Better,
    /// At most [`MARGIN`] more error than the other method.
    NoWorse,
}

/// Result of testing a claim.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// The whole 95 % interval satisfies the claim; for a mean regret, its upper bound does.
    Holds,
    /// The whole 95 % interval contradicts the claim; for a mean regret, the interval of the typical regret does,
    /// which is never larger.
    Fails,
    /// Neither, or there is no interval.
    Open,
}

/// The test of a claim.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Test {
    /// The claim.
    pub claim: Claim,
    /// The method that the claim is about.
    pub method: Method,
    /// The method that it is compared with; none for a regret.
    pub against: Option<Method>,
    /// The mean regret, or the quotient of errors.
    pub value: f64,
    /// 95 % interval of a quotient, over plants.
    pub interval: Option<Interval>,
    /// 95 % upper bound of a mean regret, over plants.
    pub upper: Option<f64>,
    /// Result of the test.
    pub outcome: Outcome,
}

/// Returns all claims of every model for which there is a comparison: a small mean regret; less error than the
/// alternatives; no more error than log replay. For models other than `networks`, the networks are among the
/// alternatives.
pub(crate) fn all(
    summaries: &[MethodSummary],
    comparisons: &[Comparison],
    networks: &[String],
) -> Vec<Test> {
    let is_network =
        |method: &Method| matches!(method, Method::Model(name) if networks.contains(name));
    let mut tests = Vec::new();
    for summary in summaries.iter().filter(|other| other.method.is_model()) {
        tests.push(Test {
            claim: Claim::SmallRegret,
            method: summary.method.clone(),
            against: None,
            value: summary.mean,
            interval: None,
            upper: summary.upper,
            outcome: outcome_of_mean(summary),
        });
        let own = comparisons.iter().filter(|comparison| comparison.method == summary.method);
        let claims = own.filter_map(|comparison| {
            let claim = match &comparison.against {
                Method::LogReplay => Claim::NoWorse,
                Method::Default
                | Method::BestDefault
                | Method::BestDefaultOfOptimiser
                | Method::OtherPlants
                | Method::OtherPlantsWithOptimiser
                | Method::Random => Claim::Better,
                network if is_network(network) && !is_network(&comparison.method) => Claim::Better,
                _ => return None,
            };
            Some((claim, comparison))
        });
        tests.extend(claims.map(|(claim, comparison)| Test {
            claim,
            method: comparison.method.clone(),
            against: Some(comparison.against.clone()),
            value: comparison.error_ratio,
            interval: comparison.error_ratio_interval,
            upper: None,
            outcome: outcome(comparison.error_ratio_interval, claim.limit()),
        }));
    }
    tests
}

impl Claim {
    /// Returns the upper limit of the value for the claim.
    pub const fn limit(self) -> f64 {
        match self {
            Self::SmallRegret => GOOD,
            Self::Better => 1.0,
            Self::NoWorse => 1.0 + MARGIN,
        }
    }
}

fn outcome_of_mean(summary: &MethodSummary) -> Outcome {
    match (summary.upper, summary.typical_interval) {
        (Some(upper), _) if upper < GOOD => Outcome::Holds,
        (_, Some(Interval { low, .. })) if low > GOOD => Outcome::Fails,
        _ => Outcome::Open,
    }
}

fn outcome(interval: Option<Interval>, limit: f64) -> Outcome {
    match interval {
        Some(Interval { high, .. }) if high < limit => Outcome::Holds,
        Some(Interval { low, .. }) if low > limit => Outcome::Fails,
        _ => Outcome::Open,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn outcome_of_interval(low: f64, high: f64, claim: Claim) -> Outcome {
        outcome(Some(Interval { low, high }), claim.limit())
    }

    #[test]
    fn a_claim_holds_where_all_of_its_interval_does() {
        assert_eq!(outcome_of_interval(0.9, 1.009, Claim::NoWorse), Outcome::Holds);
        assert_eq!(outcome_of_interval(0.9, 1.0, Claim::Better), Outcome::Open);
        assert_eq!(outcome_of_interval(1.001, 1.2, Claim::Better), Outcome::Fails);
        assert_eq!(outcome(None, 1.0), Outcome::Open);
    }

    /// Returns the outcome for a mean regret with this upper bound, where the interval of the typical regret begins at
    /// `low`.
    fn outcome_of_bounds(upper: Option<f64>, low: f64) -> Outcome {
        outcome_of_mean(&MethodSummary {
            method: Method::LogReplay,
            pairs: 9,
            diverged: 0,
            capped: 0,
            mean: 0.04,
            upper,
            typical: 0.03,
            typical_interval: Some(Interval { low, high: 0.2 }),
            worst_tenth: 0.06,
            median: 0.02,
            good: 0.5,
        })
    }

    #[test]
    fn a_mean_regret_is_small_by_its_bound_and_large_by_the_typical_one() {
        assert_eq!(outcome_of_bounds(Some(0.049), 0.01), Outcome::Holds);
        assert_eq!(outcome_of_bounds(Some(0.051), 0.01), Outcome::Open);
        assert_eq!(outcome_of_bounds(None, 0.01), Outcome::Open);
        assert_eq!(outcome_of_bounds(Some(0.3), 0.051), Outcome::Fails);
    }
}
