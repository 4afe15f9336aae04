//! Rejects logs of which nothing remains, or that contradict the study, with the reason.

use std::collections::BTreeMap;

use crate::{
    ChannelProfile, Contradictions, DataConfig, DataError, DropReason, PartProfile,
    PreprocessConfig, Sketch, contradicted_period, log::interval, survey::Survey,
};

impl Survey {
    /// Rejects a log with different values at one time, unless the study selects one of them.
    pub(crate) fn refuse_contradictions(&self, keep: Contradictions) -> Result<(), DataError> {
        let found = &self.profile.contradictions;
        if found.count == 0 || !keep.refuses() {
            return Ok(());
        }
        Err(DataError::Contradictions {
            count: found.count,
            examples: found.examples.clone(),
            cause: found.cause.clone(),
        })
    }

    /// Rejects a period that nearly all steps of the training range contradict, or that leaves no transition in it.
    /// This check comes first, because a wrong period hides other faults.
    pub(crate) fn refuse_period(&self) -> Result<(), DataError> {
        let profile = &self.profile;
        match profile.recorded_period_secs {
            Some(recorded)
                if self.log.other_interval().is_some() || profile.train.transitions == 0 =>
            {
                Err(refused_period(profile.period_secs, recorded))
            }
            _ => Ok(()),
        }
    }

    /// Rejects a log without channels, or a range without transitions.
    pub(crate) fn refuse_empty(
        &self,
        data: &DataConfig,
        preprocess: &PreprocessConfig,
    ) -> Result<(), DataError> {
        let profile = &self.profile;
        if self.sensors.is_empty() {
            let mut reasons: BTreeMap<&str, usize> = BTreeMap::new();
            for reason in profile.channels.iter().filter_map(|channel| channel.dropped.as_ref()) {
                *reasons.entry(category(reason)).or_default() += 1;
            }
            let reasons: Vec<String> =
                reasons.into_iter().map(|(reason, count)| format!("{count} {reason}")).collect();
            return Err(DataError::NoChannels {
                channels: profile.channels.len(),
                reasons: reasons.join(", "),
            });
        }
        let parts = [("train", Some(&profile.train)), ("held_out", profile.held_out.as_ref())];
        for (key, part) in parts {
            if let Some(part) = part
                && part.transitions == 0
            {
                return Err(DataError::NoTransitions {
                    key,
                    rows: part.log_rows as usize,
                    dropped: part.dropped_rows as usize,
                    segments: part.segments as usize,
                    culprits: self.culprits(key, part, data, preprocess.subsample),
                });
            }
        }
        Ok(())
    }

    /// Lists the channels that cost most rows of the range `key`. A limit on the training range drops no channel whose
    /// values are missing only in the held-out range.
    fn culprits(
        &self,
        key: &str,
        part: &PartProfile,
        data: &DataConfig,
        subsample: usize,
    ) -> String {
        if let Some(recorded) = self.profile.recorded_period_secs {
            return format!(": {}", contradicted_period(self.profile.period_secs, recorded));
        }
        if subsample > 1 && part.dropped_rows + 1 < part.log_rows {
            return format!(
                ". preprocess.subsample keeps one row in {subsample}: lower it, or check data.period_secs and data.gap_tolerance"
            );
        }
        let mut channels: Vec<&ChannelProfile> =
            self.profile.kept().filter(|channel| channel.unfilled > 0).collect();
        if part.dropped_rows == 0 || channels.is_empty() {
            let fraction = match data.train {
                Some(_) => "",
                None => ", and data.train_fraction, which says where the training range ends",
            };
            return format!(". Check data.period_secs and data.gap_tolerance{fraction}");
        }
        channels.sort_by_key(|channel| (u64::MAX - channel.unfilled, channel.name.as_str()));
        let worst: Vec<String> = channels
            .iter()
            .take(3)
            .map(|channel| format!("{} misses {} values", channel.name, channel.unfilled))
            .collect();
        format!(
            ". {}: leave such channels out with data.exclude,{} or raise preprocess.fill_limit",
            worst.join(", "),
            if key == "train" { " lower preprocess.max_missing," } else { "" }
        )
    }
}

impl Sketch {
    /// Rejects a period that nearly all steps contradict, or that turns all steps into gaps: the changes of channels
    /// would be unknown.
    ///
    /// # Errors
    /// [`DataError::ContradictedPeriod`].
    pub fn require_period(&self, gap_tolerance: f64) -> Result<(), DataError> {
        let Some(recorded) = self.recorded_period_secs else { return Ok(()) };
        let longest = gap_tolerance * self.period_secs * 1e6;
        let mut steps = self.timestamps.windows(2).map(|pair| pair[1].micros_since(pair[0]));
        if interval(&self.timestamps).is_none() && steps.any(|step| step as f64 <= longest) {
            return Ok(());
        }
        Err(refused_period(self.period_secs, recorded))
    }
}

fn refused_period(period_secs: f64, recorded_secs: f64) -> DataError {
    DataError::ContradictedPeriod { told: contradicted_period(period_secs, recorded_secs) }
}

fn category(reason: &DropReason) -> &'static str {
    match reason {
        DropReason::NotIncluded => "not included",
        DropReason::Excluded { .. } => "excluded",
        DropReason::WrongType { .. } | DropReason::Text => "not numbers",
        DropReason::AllMissing => "without a value in the training range",
        DropReason::Missing { .. } => "missing too often",
        DropReason::Constant { .. } => "constant",
        DropReason::NoSpread { .. } => "without spread",
        DropReason::OneHot { .. } => "modes",
    }
}
