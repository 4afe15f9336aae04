//! Importance sampling: the value of a policy from a log whose policy is known, without a model. A baseline.

use calib_core::{Cancelled, Monitor, TransitionIndex};
use rayon::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{
    AgentConfig, ControlError, Decisions, Ending,
    evaluation::{from_log, policies},
};

/// What a candidate's policy would get, by importance sampling.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Importance {
    /// Its return an episode; none where no recorded episode does what the policy does.
    pub value: Option<f64>,
    /// On how many episodes that rests: (Σ w)² / Σ w² over the weights of whole episodes. One of a hundred may outweigh all others.
    pub effective_episodes: f64,
}

/// An episode as it was recorded.
#[derive(Clone, Debug)]
struct Episode<'a> {
    /// ln π(a | s) − ln b(a | s) of each step.
    log_ratios: Vec<f64>,
    rewards: &'a [f32],
    ending: Ending,
}

/// The value of each candidate by weighted per-decision importance sampling, `[candidates]`; `None` of a log without probabilities.
///
/// The policy π is what the candidate learns from the log, as in [`fitted_q_evaluation`](crate::fitted_q_evaluation); b is the policy that was
/// logged. With ρᵢₜ = Π π / b over the steps of episode i up to t, the value is Σₜ γᵗ Σᵢ ρᵢₜ rᵢₜ / Σᵢ ρᵢₜ (Precup, Sutton & Singh 2000; this form, which is
/// consistent, Thomas & Brunskill 2016). After a terminal an episode goes on with rewards of nought and the ratio that it had; one that was cut
/// counts up to there. It is the return from where the recorded episodes begin, of up to `timeout` steps. π was learnt from the same log, which flatters it.
///
/// # Errors
/// If the monitor interrupts.
pub fn importance_sampling(
    log: &Decisions,
    candidates: &[AgentConfig],
    updates: usize,
    timeout: usize,
    monitor: &dyn Monitor,
) -> Result<Option<Vec<Importance>>, ControlError> {
    let Some(logged) = log.probabilities() else { return Ok(None) };
    monitor.begin("importance sampling", candidates.len() as u64);
    let values: Result<Vec<Importance>, Cancelled> = candidates
        .par_iter()
        .map(|&config| {
            monitor.check()?;
            let ratios = log_ratios(log, logged, config, updates);
            monitor.advance(1);
            Ok(estimate(&episodes(log, &ratios), config.gamma, timeout))
        })
        .collect();
    Ok(Some(values?))
}

/// ln π(a | s) − ln b(a | s) of each transition for the policy that the candidate learns from the log.
fn log_ratios(log: &Decisions, logged: &[f64], config: AgentConfig, updates: usize) -> Vec<f64> {
    let mut agent = from_log(log, config, updates);
    let all = policies(
        &mut agent,
        &config,
        (0..log.len()).map(|number: usize| {
            log.states().row(log.transitions().source(TransitionIndex::new(number)).get())
        }),
    );
    all.chunks(log.levels())
        .enumerate()
        .map(|(number, policy)| {
            let own = policy[usize::from(log.actions()[number])];
            // A policy that diverged does nothing that was recorded.
            if own > 0.0 { own.ln() - logged[number].ln() } else { f64::NEG_INFINITY }
        })
        .collect()
}

fn episodes<'a>(log: &'a Decisions, log_ratios: &[f64]) -> Vec<Episode<'a>> {
    log.episodes()
        .map(|steps| Episode {
            log_ratios: log_ratios[steps.clone()].to_vec(),
            rewards: &log.rewards()[steps.clone()],
            ending: log.endings()[steps.end - 1],
        })
        .collect()
}

/// The estimate of [`importance_sampling`] from the episodes.
fn estimate(episodes: &[Episode<'_>], gamma: f64, timeout: usize) -> Importance {
    let longest =
        episodes.iter().map(|episode| episode.rewards.len()).max().unwrap_or(0).min(timeout);
    let mut weights = vec![0.0; episodes.len()];
    let mut value = 0.0;
    let mut discount = 1.0;
    for step in 0..longest {
        let mut counted: Vec<(f64, f64)> = Vec::with_capacity(episodes.len());
        for (episode, weight) in episodes.iter().zip(&mut weights) {
            if let Some(ratio) = episode.log_ratios.get(step) {
                *weight += ratio;
                counted.push((*weight, f64::from(episode.rewards[step])));
            } else if episode.ending == Ending::Terminal {
                counted.push((*weight, 0.0));
            }
        }
        // Products of hundreds of ratios leave the range of numbers: only what they are beside the largest matters.
        let largest = counted.iter().map(|weighted| weighted.0).fold(f64::NEG_INFINITY, f64::max);
        if largest == f64::NEG_INFINITY {
            return Importance { value: None, effective_episodes: 0.0 };
        }
        let beside = |weight: f64| (weight - largest).exp();
        let sum: f64 = counted.iter().map(|weighted| beside(weighted.0)).sum();
        value += discount
            * counted.iter().map(|weighted| beside(weighted.0) * weighted.1).sum::<f64>()
            / sum;
        discount *= gamma;
    }
    Importance { value: Some(value), effective_episodes: effective(&weights) }
}

/// (Σ w)² / Σ w² of weights whose logarithms are given; 0 if all are 0.
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
