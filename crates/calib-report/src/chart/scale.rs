//! Scales: positions of values along an axis.

/// Spacing of values.
#[derive(Debug, Clone, PartialEq)]
pub enum ScaleKind {
    /// Even spacing.
    Linear,
    /// Even spacing, with ticks at whole numbers only.
    Whole,
    /// Logarithmic spacing.
    Log,
    /// Even spacing of instants, in seconds since 1970, with ticks at dates.
    Time,
    /// Instants as in [`Self::Time`], in stretches with a first and a last
    /// instant. The time between stretches takes little room.
    CutTime(Vec<(f64, f64)>),
    /// Value i stands for name i.
    Names(Vec<String>),
}

/// Range and spacing of an axis. `min` < `max`; both are positive on a logarithmic scale.
#[derive(Debug, Clone, PartialEq)]
pub struct Scale {
    /// Spacing.
    pub kind: ScaleKind,
    /// Value at the left or lower end.
    pub min: f64,
    /// Value at the right or upper end.
    pub max: f64,
}

/// Values that span more than this factor have a logarithmic scale.
const LOG_ABOVE: f64 = 30.0;

impl Scale {
    /// Returns a linear scale from exactly `min` to `max`, widened if they are equal.
    pub fn linear(min: f64, max: f64) -> Self {
        let (min, max) = if min < max { (min, max) } else { widened(min) };
        Self { kind: ScaleKind::Linear, min, max }
    }

    /// Returns a scale of instants, in seconds since 1970, from exactly `first` to
    /// `last`, widened by a second if they are equal.
    pub fn time(first: f64, last: f64) -> Self {
        let max = if first < last { last } else { first + 1.0 };
        Self { kind: ScaleKind::Time, min: first, max }
    }

    /// Returns a scale of instants in ascending `stretches`, which must not be empty.
    pub(crate) fn cut_time(stretches: Vec<(f64, f64)>) -> Self {
        let min = stretches.first().map_or(0.0, |stretch| stretch.0);
        let max = stretches.last().map_or(1.0, |stretch| stretch.1);
        Self { kind: ScaleKind::CutTime(stretches), min, max }
    }

    /// Returns a logarithmic scale that holds `values` with a margin; linear if a value is not positive.
    pub fn log_around(values: &[f64]) -> Self {
        match extent(values) {
            Some((low, high)) if low > 0.0 => {
                let margin = if low < high { (high / low).powf(0.05) } else { 2.0 };
                Self { kind: ScaleKind::Log, min: low / margin, max: high * margin }
            }
            _ => Self::linear_around(values),
        }
    }

    /// Returns a linear scale that holds the finite `values` with a margin. It is logarithmic if they are positive and
    /// span more than a factor of 30.
    pub fn around(values: &[f64]) -> Self {
        match extent(values) {
            Some((low, high)) if low > 0.0 && high / low > LOG_ABOVE => {
                let margin = (high / low).powf(0.06);
                Self { kind: ScaleKind::Log, min: low / margin, max: high * margin }
            }
            _ => Self::linear_around(values),
        }
    }

    /// Returns a linear scale that holds the finite `values` with a margin.
    pub fn linear_around(values: &[f64]) -> Self {
        match extent(values) {
            Some((low, high)) if low < high => {
                let margin = 0.07 * (high - low);
                // A margin must not suggest that a positive quantity can be negative.
                let min = if low >= 0.0 { (low - margin).max(0.0) } else { low - margin };
                Self::linear(min, high + margin)
            }
            Some((low, _)) => Self::linear(low, low),
            None => Self::linear(0.0, 1.0),
        }
    }

    /// Returns a scale for ranks 1 to `worst`.
    pub fn ranks(worst: usize) -> Self {
        let worst = worst.max(2) as f64;
        let margin = 0.07 * (worst - 1.0);
        Self { kind: ScaleKind::Whole, min: 1.0 - margin, max: worst + margin }
    }

    /// Whether the spacing is logarithmic.
    pub fn is_log(&self) -> bool {
        self.kind == ScaleKind::Log
    }

    /// Returns a scale with one place per name.
    pub fn names(names: Vec<String>) -> Self {
        let max = names.len().max(1) as f64 - 0.5;
        Self { kind: ScaleKind::Names(names), min: -0.5, max }
    }

    /// Returns the position of `value`: 0 at `min`, 1 at `max`, beyond them outside.
    pub fn fraction(&self, value: f64) -> f64 {
        match &self.kind {
            ScaleKind::CutTime(stretches) => cut_fraction(stretches, value),
            ScaleKind::Log => {
                let min = self.min.ln();
                let max = self.max.ln();
                // Values that a logarithmic scale cannot show lie far below it.
                if value > 0.0 { (value.ln() - min) / (max - min) } else { -1.0 }
            }
            _ => (value - self.min) / (self.max - self.min),
        }
    }
}

/// Share of the axis that a removed gap still takes.
const CUT: f64 = 0.02;

fn cut_fraction(stretches: &[(f64, f64)], value: f64) -> f64 {
    let recorded: f64 = stretches.iter().map(|(first, last)| last - first).sum();
    let share = 1.0 - CUT * (stretches.len() - 1) as f64;
    let mut at = 0.0;
    let mut before: Option<f64> = None;
    for (place, &(first, last)) in stretches.iter().enumerate() {
        if let Some(gap) = before.filter(|_| value < first) {
            return at - CUT * (first - value) / (first - gap);
        }
        let width = share * (last - first) / recorded;
        if value <= last || place + 1 == stretches.len() {
            return at + width * (value - first) / (last - first);
        }
        at += width + CUT;
        before = Some(last);
    }
    at
}

/// Returns the smallest and the largest finite value; `None` if there is no finite value.
pub(crate) fn extent(values: &[f64]) -> Option<(f64, f64)> {
    values.iter().filter(|value| value.is_finite()).fold(None, |extent, &value| match extent {
        None => Some((value, value)),
        Some((low, high)) => Some((low.min(value), high.max(value))),
    })
}

fn widened(value: f64) -> (f64, f64) {
    let margin = if value == 0.0 { 1.0 } else { 0.1 * value.abs() };
    (value - margin, value + margin)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fractions_run_from_end_to_end() {
        let linear = Scale::linear(2.0, 4.0);
        assert_eq!(
            (linear.fraction(2.0), linear.fraction(3.0), linear.fraction(4.0)),
            (0.0, 0.5, 1.0)
        );
        let log = Scale { kind: ScaleKind::Log, min: 1e-6, max: 1e-2 };
        assert!((log.fraction(1e-4) - 0.5).abs() < 1e-12);
        assert!(log.fraction(0.0) < 0.0);
    }

    #[test]
    fn wide_ranges_are_logarithmic_and_narrow_ones_are_not() {
        assert_eq!(Scale::around(&[0.1, 0.2, f64::INFINITY]).kind, ScaleKind::Linear);
        assert_eq!(Scale::around(&[0.1, 12.0]).kind, ScaleKind::Log);
        assert_eq!(Scale::around(&[-0.1, 12.0]).kind, ScaleKind::Linear);
    }

    #[test]
    fn degenerate_ranges_still_have_a_width() {
        for scale in [
            Scale::around(&[]),
            Scale::around(&[3.0]),
            Scale::around(&[0.0, 0.0]),
            Scale::log_around(&[1e-4]),
            Scale::log_around(&[0.0, 0.0]),
            Scale::ranks(1),
            Scale::time(1e9, 1e9),
            Scale::names(vec![]),
        ] {
            assert!(scale.min < scale.max, "{scale:?}");
        }
    }

    #[test]
    fn a_positive_quantity_keeps_a_positive_axis() {
        assert_eq!(Scale::around(&[0.01, 0.25]).min, 0.0);
        assert!(Scale::around(&[-1.0, 1.0]).min < -1.0);
    }
}
