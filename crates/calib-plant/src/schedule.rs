use calib_core::{Rng, Seed};

use crate::{
    Mode, Settings,
    change::Timeline,
    options::SECONDS_PER_DAY,
    statistics::{PASSAGES, Passage, duration_at},
};

/// Days from one chemical clean to the next are uniform in this range (our choice).
const DAYS_BETWEEN_CLEANS: (f64, f64) = (18.0, 24.0);

/// The operating modes as a semi-Markov process in continuous time.
///
/// When a mode is entered, its successor j is drawn with `p_ij = n_ij / Σ_j n_ij`. Its duration is then drawn from
/// the tabulated quantiles of the passages i → j ([`PASSAGES`]). Instants are in seconds since the start of the
/// plant, and do not depend on the sampling interval.
#[derive(Clone, Debug)]
pub(crate) struct Schedule {
    rng: Rng,
    settings: Timeline<Settings>,
    mode: Mode,
    next: Mode,
    began: f64,
    ends: f64,
    clean_due: f64,
}

impl Schedule {
    /// Returns a schedule that enters production at time zero. `settings` scale the waiting time for a back-pulse.
    pub(crate) fn new(seed: Seed, settings: Timeline<Settings>) -> Self {
        let mut rng = seed.rng();
        let clean_due = rng.uniform(4.0, DAYS_BETWEEN_CLEANS.1) * SECONDS_PER_DAY;
        let mut schedule = Self {
            rng,
            settings,
            mode: Mode::Production,
            next: Mode::Production,
            began: 0.0,
            ends: 0.0,
            clean_due,
        };
        schedule.enter(Mode::Production, 0.0);
        schedule
    }

    pub(crate) fn mode(&self) -> Mode {
        self.mode
    }

    /// Returns the start of the present mode.
    pub(crate) fn began(&self) -> f64 {
        self.began
    }

    pub(crate) fn ends(&self) -> f64 {
        self.ends
    }

    /// Advances to the next mode, at the instant the present one ends.
    pub(crate) fn advance(&mut self) {
        let at = self.ends;
        if self.mode == Mode::Production && at >= self.clean_due {
            let (least, most) = DAYS_BETWEEN_CLEANS;
            self.clean_due = at + self.rng.uniform(least, most) * SECONDS_PER_DAY;
            self.enter(Mode::ChemicalClean, at);
        } else {
            self.enter(self.next, at);
        }
    }

    fn enter(&mut self, mode: Mode, at: f64) {
        let level = self.rng.unit();
        let passage = self.draw_passage(mode);
        self.mode = mode;
        self.next = passage.to;
        self.began = at;
        self.ends = at + duration_at(&passage.seconds, level) * self.factor(passage, at);
    }

    /// Returns the factor on the duration of a mode that is entered at `at`.
    fn factor(&self, passage: &Passage, at: f64) -> f64 {
        match (passage.from, passage.to) {
            (Mode::Production, Mode::BackPulse) => {
                self.settings.at(at).map_or(1.0, |settings| settings.value.back_pulse_interval)
            }
            _ => 1.0,
        }
    }

    fn draw_passage(&mut self, from: Mode) -> &'static Passage {
        let all = PASSAGES.iter().filter(move |passage| passage.from == from);
        let total: u32 = all.clone().map(|passage| passage.count).sum();
        let mut left = self.rng.below(total as usize) as u32;
        for passage in all {
            if left < passage.count {
                return passage;
            }
            left -= passage.count;
        }
        unreachable!("the counts sum to the total")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::statistics::OBSERVED;

    /// Returns the segments (mode, next mode, seconds) of `days` days.
    fn segments(seed: u64, days: f64) -> Vec<(Mode, Mode, f64)> {
        let mut schedule = Schedule::new(Seed::new(seed), Timeline::default());
        let mut segments = Vec::new();
        while schedule.ends() < days * SECONDS_PER_DAY {
            let mode = schedule.mode();
            let began = schedule.began();
            let seconds = schedule.ends() - began;
            schedule.advance();
            segments.push((mode, schedule.mode(), seconds));
        }
        segments
    }

    #[test]
    fn time_in_the_modes_matches_the_pilot() {
        let days = 1000.0;
        let segments = segments(1, days);
        for (mode, share, median, per_day) in OBSERVED {
            let mut lengths: Vec<f64> = segments
                .iter()
                .filter(|segment| segment.0 == mode)
                .map(|segment| segment.2)
                .collect();
            lengths.sort_unstable_by(f64::total_cmp);
            let got_share = lengths.iter().sum::<f64>() / (days * SECONDS_PER_DAY);
            let got_median = lengths[lengths.len() / 2];
            let got_rate = lengths.len() as f64 / days;
            assert!((got_share / share - 1.0).abs() < 0.08, "{mode:?} share {got_share}");
            assert!((got_median / median - 1.0).abs() < 0.15, "{mode:?} median {got_median}");
            assert!((got_rate / per_day - 1.0).abs() < 0.08, "{mode:?} rate {got_rate}");
        }
    }

    fn is_near(share: f64, count: f64, all: f64) -> bool {
        (share - count / all).abs() < 0.01
    }

    #[test]
    fn successors_have_their_frequencies() {
        let segments = segments(2, 1000.0);
        let share = |from: Mode, to: Mode| {
            let own = segments.iter().filter(|segment| segment.0 == from);
            own.clone().filter(|segment| segment.1 == to).count() as f64 / own.count() as f64
        };
        assert!(is_near(share(Mode::Production, Mode::BackPulse), 731.0, 1119.0));
        assert!(is_near(share(Mode::Production, Mode::Standby), 359.0, 1119.0));
        assert!(is_near(share(Mode::BackPulse, Mode::DrainAndRefill), 740.0, 754.0));
        assert!(is_near(share(Mode::DrainAndRefill, Mode::Production), 715.0, 739.0));
    }

    #[test]
    fn cleans_come_about_every_three_weeks() {
        let cleans =
            segments(3, 1000.0).iter().filter(|segment| segment.0 == Mode::ChemicalClean).count();
        assert!((42..=56).contains(&cleans), "{cleans} cleans in 1000 days");
    }
}
