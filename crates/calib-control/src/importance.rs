//! Importance sampling and the doubly robust estimator: they estimate the value of a policy from a log whose policy is known, without a
//! model. They are baselines.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{Decisions, Ending, evaluation::StepValues};

/// The estimated return of a setting's policy by importance sampling.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Importance {
    /// Estimated return per episode; none if no recorded episode takes the actions of the policy.
    pub value: Option<f64>,
    /// Effective number of episodes in the estimate: (Σ w)² / Σ w² over the weights w of whole episodes. One episode in a hundred may
    /// outweigh all others.
    pub effective_episodes: f64,
}

/// A recorded episode.
#[derive(Clone, Debug)]
pub(crate) struct Episode<'a> {
    /// ln π(a | s) − ln b(a | s) of each step.
    log_ratios: Vec<f64>,
    rewards: &'a [f32],
    /// Fitted values of each step; empty if there are no fitted values.
    values: &'a [StepValues],
    ending: Ending,
}

/// The weight and the value of an episode at one step.
#[derive(Clone, Copy, Debug)]
struct Weighted {
    log_weight: f64,
    value: f64,
}

/// Returns ln π(a | s) − ln b(a | s) of each transition. `policies` has π(· | s), `[transitions, actions]`, and `logged` has b(a | s).
pub(crate) fn log_ratios(log: &Decisions, logged: &[f64], policies: &[f64]) -> Vec<f64> {
    policies
        .chunks(log.levels())
        .enumerate()
        .map(|(number, policy)| {
            let own = policy[usize::from(log.actions()[number])];
            // A policy that diverged never takes the recorded action.
            if own > 0.0 { own.ln() - logged[number].ln() } else { f64::NEG_INFINITY }
        })
        .collect()
}

/// Returns the episodes of `log` with the `log_ratios` of their transitions, and with their `values` unless these are empty.
pub(crate) fn episodes<'a>(
    log: &'a Decisions,
    log_ratios: &[f64],
    values: &'a [StepValues],
) -> Vec<Episode<'a>> {
    log.episodes()
        .map(|steps| Episode {
            log_ratios: log_ratios[steps.clone()].to_vec(),
            rewards: &log.rewards()[steps.clone()],
            values: values.get(steps.clone()).unwrap_or_default(),
            ending: log.endings()[steps.end - 1],
        })
        .collect()
}

/// Estimates the value of a policy π by weighted per-decision importance sampling. With fitted values it is the doubly robust estimate.
///
/// With ρᵢₜ = Π π / b over the steps of episode i up to t, the value is Σₜ γᵗ (Σᵢ ρᵢₜ (rᵢₜ − q̂ᵢₜ) / Σᵢ ρᵢₜ + Σᵢ ρᵢₜ₋₁ v̂ᵢₜ / Σᵢ ρᵢₜ₋₁).
/// Here q̂ᵢₜ and v̂ᵢₜ are the fitted values of the recorded action and of the state, or 0 without fitted values. Without them the estimate
/// is that of Precup, Sutton & Singh 2000, whose weighted form is consistent (Thomas & Brunskill 2016). With them it is the recursion v̂ +
/// ρ (r + γ V' − q̂) of Jiang & Li 2016, weighted as in Thomas & Brunskill 2016. After a terminal, an episode continues with rewards and
/// values of 0 and its last ratio. A cut episode counts up to its cut, in all four sums.
pub(crate) fn estimate(episodes: &[Episode<'_>], gamma: f64, timeout: usize) -> Importance {
    let longest =
        episodes.iter().map(|episode| episode.rewards.len()).max().unwrap_or(0).min(timeout);
    let mut log_weights = vec![0.0; episodes.len()];
    let mut value = 0.0;
    let mut discount = 1.0;
    for step in 0..longest {
        let mut expected = Vec::with_capacity(episodes.len());
        let mut corrected = Vec::with_capacity(episodes.len());
        for (episode, log_weight) in episodes.iter().zip(&mut log_weights) {
            if let Some(ratio) = episode.log_ratios.get(step) {
                let fitted = episode.values.get(step).copied().unwrap_or_default();
                expected.push(Weighted { log_weight: *log_weight, value: fitted.expected });
                *log_weight += ratio;
                let beyond = f64::from(episode.rewards[step]) - fitted.taken;
                corrected.push(Weighted { log_weight: *log_weight, value: beyond });
            } else if episode.ending == Ending::Terminal {
                let nothing = Weighted { log_weight: *log_weight, value: 0.0 };
                expected.push(nothing);
                corrected.push(nothing);
            }
        }
        let (Some(expected), Some(corrected)) = (mean(&expected), mean(&corrected)) else {
            return Importance { value: None, effective_episodes: 0.0 };
        };
        value += discount * (expected + corrected);
        discount *= gamma;
    }
    Importance { value: Some(value), effective_episodes: effective(&log_weights) }
}

/// Returns Σ w x / Σ w, or `None` if all weights are 0.
fn mean(all: &[Weighted]) -> Option<f64> {
    // Products of hundreds of ratios overflow or underflow, so weights are taken relative to the largest.
    let largest = all.iter().map(|one| one.log_weight).fold(f64::NEG_INFINITY, f64::max);
    if largest == f64::NEG_INFINITY {
        return None;
    }
    let mut weights = 0.0;
    let mut sum = 0.0;
    for one in all {
        let weight = (one.log_weight - largest).exp();
        weights += weight;
        sum += weight * one.value;
    }
    Some(sum / weights)
}

/// Returns (Σ w)² / Σ w² of weights with these logarithms, or 0 if all weights are 0.
fn effective(log_weights: &[f64]) -> f64 {
    let largest = log_weights.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if largest == f64::NEG_INFINITY {
        return 0.0;
    }
    let weights = log_weights.iter().map(|weight| (weight - largest).exp());
    weights.clone().sum::<f64>().powi(2) / weights.map(|weight| weight * weight).sum::<f64>()
}

#[cfg(test)]
mod tests;
