//! The decision about a verdict.

use calib_control::{Doubt, KINDS_AGREE};
use calib_report::{Decision, Support};

use super::{
    Advice,
    words::{difference, rank_name},
};

impl Advice<'_> {
    /// Returns the decision, as the card of a report shows it.
    pub fn decision(&self) -> Decision {
        let Self { verdict, settings, vocabulary, .. } = self;
        let chosen = &settings[verdict.chosen];
        let rank = rank_name(verdict.rule);
        let default = vocabulary.default;
        let other_default = verdict.default.filter(|&default| default != verdict.chosen);
        let (support, badge, headline, plain) = if settings.len() < 2 {
            (
                Support::Unsupported,
                "Nothing to choose",
                "There is one setting, so nothing was chosen.".to_owned(),
                vocabulary.add_settings.to_owned(),
            )
        } else if verdict.is_supported() {
            let (headline, plain) = if verdict.default == Some(verdict.chosen) {
                (format!("Keep the default: {chosen}."), format!(", and {default}."))
            } else {
                let over = verdict.over_default.as_ref().map_or_else(String::new, |over| {
                    format!(
                        " Its return beside that of the default: {}. Here {default}.",
                        difference(over)
                    )
                });
                let unless = self.early_ends().map_or("", |_| ", unless a terminal is a failure");
                (format!("Deploy {chosen}{unless}."), format!(".{over}"))
            };
            let plain = format!("It has the best {rank}{plain}");
            (Support::Supported, "Supported by the log", headline, plain)
        } else if let Some(other) = other_default.filter(|_| self.doubts_only_the_default()) {
            (
                Support::KeepDefault,
                "No clear difference",
                format!("Keep the default: {}.", settings[other]),
                format!("{chosen} is first by {rank}, but may be no better. Here {default}."),
            )
        } else {
            let plain = if self.has_diverged() {
                format!("Every setting diverged in a model. First by {rank} is {chosen}.")
            } else if let Some(agreement) = self.disagreement() {
                format!(
                    "First by {rank} is {chosen}, but the kinds of models disagree on the order of the settings (Spearman {agreement:.2} on average). Why not to deploy it is listed below."
                )
            } else if self.is_arbitrary() {
                format!("First by {rank} is {chosen}. Why not to deploy it is listed below.")
            } else {
                let ahead = if verdict.is_ahead_of_default() {
                    ", and clearly ahead of the default by rank or by return"
                } else {
                    ""
                };
                format!(
                    "First by {rank} is {chosen}{ahead}. If you have a trial in which nothing can be harmed, begin with this one. Why not to deploy it is listed below."
                )
            };
            (
                Support::Unsupported,
                "Not supported by the log",
                "Deploy nothing on this evidence.".to_owned(),
                plain,
            )
        };
        Decision { support, badge: badge.to_owned(), headline, plain }
    }

    /// Whether the only doubt is that the choice may be no better than the default.
    fn doubts_only_the_default(&self) -> bool {
        let mut doubts = self.verdict.doubts.iter();
        doubts.all(|doubt| matches!(doubt, Doubt::NotBetterThanDefault | Doubt::NotToldApart))
    }

    /// Returns the agreement of the kinds of models on the order of the settings, if it is too low to prefer a setting.
    fn disagreement(&self) -> Option<f64> {
        let agreement = self.verdict.kinds_agreement().filter(|_| !self.all_tie());
        agreement.filter(|agreement| *agreement < KINDS_AGREE)
    }
}
