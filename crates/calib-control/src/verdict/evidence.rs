//! The evidence for a choice, and the doubts if it is too weak.

use calib_stats::Selection;

use super::{BestConstant, Doubt, RandomActions, StepRates, Support};
use crate::{Coverage, Decisions, Drift, RecordedReturn};

/// The evidence for a choice.
pub(super) struct Evidence<'a> {
    /// Blocks of the log. One ensemble member of every kind of model lacks each of them.
    pub(super) blocks: usize,
    pub(super) selection: &'a Selection,
    /// Coverage of the chosen setting's steps.
    pub(super) coverage: Coverage,
    /// Terminals and rewards of the chosen setting's steps.
    pub(super) step_rates: StepRates,
    /// Displacement of the chosen setting's episodes.
    pub(super) drift: &'a Drift,
    /// Whether the chosen setting is surely ahead of the default, by ranks or by returns; `None` if the default is the choice, is not in
    /// the grid, or diverged as well.
    pub(super) is_ahead: Option<bool>,
    pub(super) constant: Option<&'a BestConstant>,
    pub(super) random_actions: Option<RandomActions>,
    pub(super) behaviour: RecordedReturn,
}

/// With fewer blocks there is no interval.
const FEWEST_OF_AN_INTERVAL: usize = 2;

/// The least distance of a displacement from 0, in standard errors. A rollout in a noisy column moves far in an episode, but not always to
/// the same side.
const DISPLACEMENT_ERRORS: f64 = 4.0;

/// The largest accepted displacement in an episode, in recorded ranges of a column: through the whole range and back. Our
/// choice, set on eleven logs of Acrobot and Cart-pole and on a made-up log. In the former, choices are displaced by up to 1.2.
/// In the latter, an actuator of increments is held against the edge, and they are displaced by 3.5 and more.
const FARTHEST_DISPLACEMENT: f64 = 2.0;

/// Returns the doubt about the column with the largest displacement, if that is too large.
pub(super) fn displaced(drift: &Drift) -> Option<Doubt> {
    let means = drift.means();
    let each = means.iter().enumerate().map(|(column, &[mean, error])| (column, mean, error));
    let (column, mean, error) = each.max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()))?;
    let is_far = mean.abs() > FARTHEST_DISPLACEMENT && mean.abs() > DISPLACEMENT_ERRORS * error;
    is_far.then_some(Doubt::Displaced { column, mean, error })
}

impl Support {
    /// Returns the doubt about a held-out period of whose decisions a share `uncovered` was made in states that the log does not cover.
    /// A choice may be made for it if no more of them are than may be of the chosen setting's own steps.
    pub fn doubt_about_held_out(&self, deployment: Option<&str>, uncovered: f64) -> Option<Doubt> {
        (uncovered > self.most_uncovered).then(|| Doubt::HeldOutUncovered {
            deployment: deployment.map(str::to_owned),
            share: uncovered,
        })
    }
}

impl Evidence<'_> {
    pub(super) fn doubts(&self, log: &Decisions, support: Support) -> Vec<Doubt> {
        let Self { selection, coverage, .. } = self;
        let mut doubts = Vec::new();
        // Similar settings stand for a level that was never set. There coverage is what counts.
        let has_levels = log.settings().is_none();
        let never =
            log.counts().into_iter().enumerate().filter(|&(_, count)| count == 0 && has_levels);
        doubts.extend(never.map(|(action, _)| Doubt::ActionNeverTaken { action }));
        let share = coverage.uncovered();
        if share > support.most_uncovered {
            doubts.push(Doubt::Uncovered { share });
        }
        let terminals = log.terminals();
        if terminals < support.fewest_terminals {
            doubts.push(Doubt::FewTerminals { terminals });
        }
        let alike = selection.tie_set.len() == selection.worst_ranks.len();
        let several = selection.worst_ranks.len() > 1;
        if several && alike && selection.mean_ranks.windows(2).all(|pair| pair[0] == pair[1]) {
            doubts.push(Doubt::NotToldApart);
        }
        let promised = selection.mean_errors[selection.chosen];
        if !promised.is_finite() {
            doubts.push(Doubt::Diverged);
            return doubts;
        }
        if self.blocks < FEWEST_OF_AN_INTERVAL {
            doubts.push(Doubt::OneMember);
        }
        if self.is_ahead == Some(false) {
            doubts.push(Doubt::NotBetterThanDefault);
        }
        doubts.extend(self.beside_a_constant(promised));
        doubts.extend(self.beside_random_actions(promised));
        doubts.extend(self.beside_the_log(promised));
        doubts.extend(displaced(self.drift));
        doubts
    }

    /// Returns a doubt if always taking one action gets more. The action need not be surely better: nothing then shows that
    /// the choice is better.
    fn beside_a_constant(&self, promised: f64) -> Option<Doubt> {
        let &BestConstant { action, mean_return: constant, over, .. } = self.constant?;
        let is_worse = over?.mean < 0.0;
        is_worse.then_some(Doubt::WorseThanConstant { action, constant, promised })
    }

    /// Returns a doubt if random actions may do as well. Where a model is wrong about the outcomes of actions, agents that hardly
    /// learn can come first in it, and no other check may show that.
    ///
    /// With one ensemble member there is no interval, and the mean alone decides. The missing interval is a doubt of its own.
    fn beside_random_actions(&self, promised: f64) -> Option<Doubt> {
        let RandomActions { mean_return: random, over, .. } = self.random_actions?;
        let over = over?;
        let is_more = over.interval.map_or(over.mean, |interval| interval.low) > 0.0;
        (!is_more).then_some(Doubt::NotBetterThanRandomActions { random, promised })
    }

    /// Returns the doubts about results in the model that differ from the record.
    fn beside_the_log(&self, promised: f64) -> Vec<Doubt> {
        let mut doubts = Vec::new();
        let recorded = self.behaviour.mean;
        if promised < recorded {
            doubts.push(Doubt::BelowRecorded { promised, recorded });
        }
        if let Some(best) = self.behaviour.best.filter(|&best| promised > best) {
            doubts.push(Doubt::AboveRecorded { promised, best });
        }
        let StepRates { terminals_in_model: in_model, terminals_in_log: in_log, .. } =
            self.step_rates;
        if in_model < in_log / RARER {
            doubts.push(Doubt::RareTerminals { in_model, in_log });
        }
        doubts
    }
}

/// Terminals that are rarer than in the log by this factor raise a doubt: an order of magnitude.
const RARER: f64 = 10.0;
