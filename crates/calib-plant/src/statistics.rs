//! Statistics of the pilot's mode schedule.
//!
//! Counted by `scripts/mode_statistics.py` from `november_modes.json` of
//! <https://github.com/haseebs/gvf-real-world> (MIT licence, code of Janjua et al. 2023, "GVFs in the
//! real world", Machine Learning): 2,130,723 seconds of November 2022, 3,088 segments.

use crate::Mode;

/// Probabilities at which the durations are tabulated.
pub(crate) const LEVELS: [f64; 15] =
    [0.0, 0.025, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.975, 1.0];

/// How often one mode follows another, and the duration of the first before that transition.
pub(crate) struct Passage {
    pub(crate) from: Mode,
    pub(crate) to: Mode,
    /// Count in the published month.
    pub(crate) count: u32,
    /// Quantiles of the duration of `from` in seconds, at [`LEVELS`].
    pub(crate) seconds: [f64; 15],
}

const fn passage(from: Mode, to: Mode, count: u32, seconds: [f64; 15]) -> Passage {
    Passage { from, to, count, seconds }
}

use Mode::{
    BackPulse, ChemicalClean, DrainAndRefill, IntegrityTest, Production, Restart, Standby, Stopped,
};

/// The semi-Markov kernel. The chemical clean is our addition: it is started by the calendar, not
/// drawn.
#[rustfmt::skip]
pub(crate) const PASSAGES: [Passage; 15] = [
    passage(Stopped, Restart, 4, [496.0, 527.0, 558.0, 619.0, 743.0, 866.0, 1159.0, 1538.0, 1916.0, 2310.0, 2736.0, 3161.0, 3374.0, 3481.0, 3587.0]),
    passage(Stopped, Standby, 4, [548.0, 586.0, 625.0, 701.0, 855.0, 1008.0, 1160.0, 1310.0, 1461.0, 1682.0, 2040.0, 2399.0, 2579.0, 2668.0, 2758.0]),
    passage(Restart, Stopped, 4, [18.0, 18.0, 18.0, 18.0, 18.0, 18.0, 18.0, 18.0, 18.0, 21.0, 31.0, 40.0, 45.0, 48.0, 50.0]),
    passage(Standby, Production, 403, [10.0, 10.0, 10.0, 11.0, 36.0, 42.0, 52.0, 79.0, 296.0, 656.0, 962.0, 1736.0, 2090.0, 2807.0, 8000.0]),
    passage(Production, Stopped, 4, [221.0, 255.0, 289.0, 357.0, 492.0, 628.0, 1140.0, 1840.0, 2540.0, 3182.0, 3705.0, 4229.0, 4491.0, 4622.0, 4753.0]),
    passage(Production, Standby, 359, [1.0, 80.0, 98.0, 129.0, 395.0, 489.0, 514.0, 522.0, 562.0, 1043.0, 2169.0, 3561.0, 6358.0, 6893.0, 14008.0]),
    passage(Production, BackPulse, 731, [6.0, 158.0, 284.0, 664.0, 1200.0, 1200.0, 1200.0, 1200.0, 1200.0, 1200.0, 1200.0, 2424.0, 3600.0, 3600.0, 4059.0]),
    passage(Production, IntegrityTest, 25, [45.0, 123.0, 287.0, 907.0, 1070.0, 1200.0, 1200.0, 1200.0, 1200.0, 1276.0, 2518.0, 3600.0, 3600.0, 3600.0, 3600.0]),
    passage(BackPulse, Standby, 14, [41.0, 41.0, 42.0, 42.0, 48.0, 53.0, 56.0, 64.0, 70.0, 85.0, 85.0, 87.0, 88.0, 89.0, 90.0]),
    passage(BackPulse, DrainAndRefill, 740, [101.0, 101.0, 101.0, 101.0, 101.0, 101.0, 101.0, 101.0, 101.0, 101.0, 101.0, 101.0, 102.0, 102.0, 102.0]),
    passage(DrainAndRefill, Standby, 24, [143.0, 219.0, 277.0, 281.0, 285.0, 286.0, 287.0, 288.0, 290.0, 291.0, 294.0, 298.0, 301.0, 303.0, 305.0]),
    passage(DrainAndRefill, Production, 715, [140.0, 143.0, 148.0, 277.0, 286.0, 287.0, 288.0, 289.0, 291.0, 293.0, 295.0, 298.0, 300.0, 302.0, 311.0]),
    passage(IntegrityTest, Standby, 2, [1240.0, 1240.0, 1240.0, 1240.0, 1240.0, 1240.0, 1240.0, 1240.0, 1241.0, 1241.0, 1241.0, 1241.0, 1241.0, 1241.0, 1241.0]),
    passage(IntegrityTest, BackPulse, 23, [1240.0, 1240.0, 1240.0, 1240.0, 1240.0, 1240.0, 1240.0, 1240.0, 1240.0, 1240.0, 1240.0, 1241.0, 1241.0, 1241.0, 1241.0]),
    // Our choice: five hours of soaking, between four and six.
    passage(ChemicalClean, Standby, 1, [14_400.0, 14_580.0, 14_760.0, 15_120.0, 15_840.0, 16_560.0, 17_280.0, 18_000.0, 18_720.0, 19_440.0, 20_160.0, 20_880.0, 21_240.0, 21_420.0, 21_600.0]),
];

/// Share of time, median seconds and segments per day of a mode in the published month.
#[cfg(test)]
pub(crate) const OBSERVED: [(Mode, f64, f64, f64); 5] = [
    (Standby, 0.1055, 79.0, 16.34),
    (Production, 0.7416, 1200.0, 45.38),
    (BackPulse, 0.0355, 101.0, 30.57),
    (DrainAndRefill, 0.0966, 289.0, 29.97),
    (IntegrityTest, 0.0146, 1240.0, 1.01),
];

/// Returns the quantile at `level` of a duration tabulated at [`LEVELS`], log-linear in between.
pub(crate) fn duration_at(seconds: &[f64; 15], level: f64) -> f64 {
    let after = LEVELS.iter().position(|&tabulated| tabulated > level).unwrap_or(LEVELS.len() - 1);
    let before = after - 1;
    let fraction = (level - LEVELS[before]) / (LEVELS[after] - LEVELS[before]);
    let low = seconds[before].ln();
    let high = seconds[after].ln();
    (low + (high - low) * fraction).exp()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_do_not_decrease() {
        for passage in &PASSAGES {
            assert!(passage.count > 0);
            assert!(passage.seconds.is_sorted());
            assert!(passage.seconds[0] > 0.0);
        }
    }

    #[test]
    fn every_mode_can_be_left() {
        for mode in Mode::ALL {
            assert!(PASSAGES.iter().any(|passage| passage.from == mode));
        }
    }

    #[test]
    fn durations_come_from_the_table() {
        let table = &PASSAGES[3].seconds;
        assert!((duration_at(table, 0.0) - 10.0).abs() < 1e-9);
        assert!((duration_at(table, 0.5) - 79.0).abs() < 1e-9);
        assert!((duration_at(table, 1.0) - 8000.0).abs() < 1e-6);
        // Half-way between the tabulated 79 and 296 s, on the log scale.
        assert!((duration_at(table, 0.55) - (79.0_f64 * 296.0).sqrt()).abs() < 1e-6);
    }
}
