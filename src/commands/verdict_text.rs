//! The verdict in words.

use calib_sweep::{Agreement, Candidate, SensorVerdict};

use crate::output::{percent, significant};

/// What to deploy for one sensor, and why: one line of advice and a few of evidence.
pub(super) fn lines(
    verdict: &SensorVerdict,
    candidates: &[Candidate],
    top_k: usize,
) -> Vec<String> {
    let label = |candidate: usize| candidates[candidate].label();
    let selection = &verdict.selection;
    let chosen = selection.chosen;
    let grid = selection.worst_ranks.len();
    let mut lines = vec![format!(
        "{}: use {} (worst rank {} of {grid} over {} members{})",
        verdict.sensor,
        label(chosen),
        selection.worst_ranks[chosen],
        verdict.members.len(),
        ties(selection.tie_set.iter().filter(|&&tied| tied != chosen).map(|&tied| label(tied))),
    )];
    if let (Some(model), Some(best)) = (&verdict.model_agreement, verdict.best_online) {
        let online =
            verdict.online.as_ref().map_or(f64::NAN, |online| online.candidates[best].mean);
        lines.push(format!(
            "Online: NRMSE {} against {} of the best ({}); regret {}; {}",
            significant(model.online_error),
            significant(online),
            label(best),
            cost(model.regret),
            if model.top_k_hit {
                format!("among the best {top_k}")
            } else {
                format!("not among the best {top_k}")
            },
        ));
        lines.push(format!(
            "agreement of the ranking with Online: Spearman {}, Kendall {}",
            correlation(model.spearman),
            correlation(model.kendall),
        ));
    } else {
        lines.push("no held-out range: how well this agrees with Online is unknown".to_owned());
    }
    if let Some(default) = &verdict.default_agreement {
        lines.push(format!(
            "the default ({}) would have: {}",
            label(default.chosen),
            outcome(default)
        ));
    }
    if let Some(replay) = &verdict.log_replay_agreement {
        lines.push(format!(
            "log replay would choose {}: {}",
            label(replay.chosen),
            outcome(replay)
        ));
    }
    lines.extend(verdict.warnings.iter().map(|warning| format!("note: {warning}")));
    lines
}

fn ties(others: impl Iterator<Item = String>) -> String {
    let others: Vec<String> = others.collect();
    if others.is_empty() { String::new() } else { format!("; tied with {}", others.join(", ")) }
}

fn outcome(agreement: &Agreement) -> String {
    format!("NRMSE {}, regret {}", significant(agreement.online_error), cost(agreement.regret))
}

fn cost(regret: Option<f64>) -> String {
    regret.map_or_else(|| "unknown".to_owned(), percent)
}

fn correlation(value: Option<f64>) -> String {
    value.map_or_else(|| "undefined".to_owned(), |value| format!("{value:.2}"))
}
