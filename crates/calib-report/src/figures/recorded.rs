//! Recorded values of a sensor, period by period: the training range and each deployment.

use calib_core::number;
use calib_stats::{median, quantile};

use super::rollout::axis_label;
use crate::chart::{Axis, Chart, Colour, Dash, GridCell, Point, Rule, Scale, Series, Side, extent};
use crate::duration::duration;
use crate::{Figure, ReportError};

const HEIGHT: f64 = 110.0;
/// Gaps longer than this share of the recorded time are cut out: our choice.
const LONG_GAP: f64 = 0.1;
/// Most gaps whose lengths are shown: more labels would hide each other.
const NAMED_GAPS: usize = 3;
/// A median that is this many training spreads from the training median is another level: our choice, as for the error
/// of the training mean.
const OTHER_LEVEL: f64 = 2.0;
/// Values that deviate this many times as much from their median are far more spread: our choice.
const FAR_MORE_SPREAD: f64 = 2.0;

/// One sensor in several periods, in plots below each other with the same vertical axis.
#[derive(Debug, Clone, PartialEq)]
pub struct RecordedFigure {
    /// The sensor.
    pub sensor: String,
    /// Its physical unit: "kPa".
    pub unit: Option<String>,
    /// The periods, in the order of their plots.
    pub periods: Vec<RecordedPeriod>,
}

/// Recorded values of one period.
#[derive(Debug, Clone, PartialEq)]
pub struct RecordedPeriod {
    /// Name of the period: "training", "april".
    pub name: String,
    /// Use of the period.
    pub used_for: PeriodUse,
    /// Times of the first and the last value, as text.
    pub times: [String; 2],
    /// Instants, in seconds since 1970, and values in physical units; NaN breaks the line.
    pub points: Vec<(f64, f64)>,
}

/// Use of a period.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PeriodUse {
    /// Training range.
    Learning,
    /// Held-out period of a deployment.
    Deployment,
}

/// Level of a sensor's values, by the middles between neighbouring values that are drawn. These are the smallest and
/// the largest value of each stretch of time, so excursions count more than in all values.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RecordedLevel {
    /// Median.
    pub median: f64,
    /// Half the range between the 16 % and the 84 % quantile. Excursions hardly count.
    pub spread: f64,
    /// Root of the mean square distance from the median. Excursions count.
    pub deviation: f64,
}

impl RecordedLevel {
    /// Whether the median is at least two spreads of `learned` away from that of `learned`.
    pub fn is_apart_from(&self, learned: &Self) -> bool {
        let distance = (self.median - learned.median).abs();
        distance > 0.0 && distance >= OTHER_LEVEL * learned.spread
    }

    /// Whether values deviate at least twice as much from their median as those of `learned`.
    pub fn is_far_more_spread_than(&self, learned: &Self) -> bool {
        self.deviation > 0.0 && self.deviation >= FAR_MORE_SPREAD * learned.deviation
    }
}

impl RecordedFigure {
    /// Returns the share of deployment values outside the range of all training
    /// values; `None` if there are no values of either kind.
    pub fn outside_training(&self) -> Option<f64> {
        let (low, high) = extent(&self.finite_values(PeriodUse::Learning))?;
        let held_out = self.finite_values(PeriodUse::Deployment);
        let outside = held_out.iter().filter(|value| !(low..=high).contains(*value)).count();
        (!held_out.is_empty()).then(|| outside as f64 / held_out.len() as f64)
    }

    /// Returns the finite values of all periods of this use.
    fn finite_values(&self, used_for: PeriodUse) -> Vec<f64> {
        let own = self.periods.iter().filter(|period| period.used_for == used_for);
        let values = own.flat_map(|period| &period.points).map(|point| point.1);
        values.filter(|value| value.is_finite()).collect()
    }

    /// Returns the level of the training values and that of the held-out values; `None` if
    /// there are no values of either kind.
    pub fn levels(&self) -> Option<[RecordedLevel; 2]> {
        let learned = self.level(PeriodUse::Learning)?;
        Some([learned, self.level(PeriodUse::Deployment)?])
    }

    /// Returns the level of all periods of this use.
    fn level(&self, used_for: PeriodUse) -> Option<RecordedLevel> {
        let periods = self.periods.iter().filter(|period| period.used_for == used_for);
        let middles: Vec<f64> = periods.flat_map(RecordedPeriod::middles).collect();
        let median = median(&middles).ok()?;
        let low = quantile(&middles, 0.16).ok()?;
        let high = quantile(&middles, 0.84).ok()?;
        let squares = middles.iter().map(|value| (value - median).powi(2));
        let deviation = (squares.sum::<f64>() / middles.len() as f64).sqrt();
        Some(RecordedLevel { median, spread: (high - low) / 2.0, deviation })
    }

    /// Draws the figure: one plot over its dates per period that has values.
    ///
    /// # Errors
    ///
    /// If no period has a value.
    pub fn figure(&self) -> Result<Figure, ReportError> {
        let title = format!("{}: recorded in each period", self.sensor);
        let shown: Vec<(&RecordedPeriod, PeriodBounds)> =
            self.periods.iter().filter_map(|period| Some((period, period.bounds()?))).collect();
        let values: Vec<f64> =
            shown.iter().flat_map(|(_, bounds)| [bounds.values.0, bounds.values.1]).collect();
        if values.is_empty() {
            return Err(ReportError::Empty { figure: title, missing: "values" });
        }
        let scale = Scale::linear_around(&values);
        let label = axis_label(&self.sensor, self.unit.as_deref());
        let rows = shown
            .iter()
            .map(|(period, bounds)| {
                let cell = GridCell {
                    heading: Some(period.heading(bounds)),
                    chart: Some(period.plot(bounds, &scale)),
                };
                vec![cell]
            })
            .collect();
        let ranges: Vec<String> =
            shown.iter().map(|(period, bounds)| period.heading(bounds)).collect();
        let description = format!("{label}. {}.", ranges.join("; "));
        let x = Axis { label: String::new(), scale: Scale::linear(0.0, 1.0) };
        let left = Axis { label, scale };
        let head = Chart { title, description, ..Chart::of(x, left, Vec::new()) };
        Ok(Figure::with_grid(head, rows, HEIGHT))
    }
}

/// The lowest and the highest time and value of a period.
struct PeriodBounds {
    secs: (f64, f64),
    values: (f64, f64),
}

impl RecordedPeriod {
    /// Returns the middles between neighbouring values, and a value without a neighbour as it is.
    fn middles(&self) -> Vec<f64> {
        let mut middles = Vec::with_capacity(self.points.len());
        for unbroken in self.points.split(|(_, value)| !value.is_finite()) {
            match unbroken {
                [(_, alone)] => middles.push(*alone),
                _ => middles
                    .extend(unbroken.windows(2).map(|pair| f64::midpoint(pair[0].1, pair[1].1))),
            }
        }
        middles
    }

    fn bounds(&self) -> Option<PeriodBounds> {
        let known = self.points.iter().copied().filter(|(_, value)| value.is_finite());
        let (secs, values): (Vec<f64>, Vec<f64>) = known.unzip();
        Some(PeriodBounds { secs: extent(&secs)?, values: extent(&values)? })
    }

    /// "april: 2023-04-07 00:00 to 2023-04-13 23:50, between 3.1 and 7.8"
    fn heading(&self, bounds: &PeriodBounds) -> String {
        let (low, high) = bounds.values;
        format!("{}: {}, between {} and {}", self.name, self.span(), number(low), number(high))
    }

    /// Returns the time span as text. Seconds are left out if both times have none.
    fn span(&self) -> String {
        let minutes = self
            .times
            .each_ref()
            .map(|time| time.strip_suffix(":00").filter(|minutes| minutes.contains(':')));
        match (minutes, &self.times) {
            ([Some(first), Some(last)], _) => format!("{first} to {last}"),
            (_, [first, last]) => format!("{first} to {last}"),
        }
    }

    fn plot(&self, bounds: &PeriodBounds, scale: &Scale) -> Chart {
        let colour = match self.used_for {
            PeriodUse::Learning => Colour::Ink,
            // Same colour as the curve of the held-out period in sensitivity figures.
            PeriodUse::Deployment => Colour::Curve(0),
        };
        let series = Series {
            label: self.name.clone(),
            side: Side::Left,
            colour,
            dash: Dash::Solid,
            width: 1.0,
            marker: None,
            points: self.broken_points(),
        };
        let x = Axis { label: String::new(), scale: self.dates(bounds) };
        let left = Axis { label: String::new(), scale: scale.clone() };
        Chart { rules: self.cuts(), ..Chart::of(x, left, vec![series]) }
    }

    /// Returns all points, with a break at each gap that is cut out.
    fn broken_points(&self) -> Vec<Point> {
        let ends: Vec<f64> = self.stretches().iter().skip(1).map(|stretch| stretch.0).collect();
        let mut points = Vec::with_capacity(self.points.len() + ends.len());
        for &(x, y) in &self.points {
            if y.is_finite() && ends.contains(&x) {
                points.push(Point { x, y: f64::NAN, interval: None });
            }
            points.push(Point { x, y, interval: None });
        }
        points
    }

    /// Returns the scale of the dates, without long gaps.
    fn dates(&self, bounds: &PeriodBounds) -> Scale {
        match self.stretches().as_slice() {
            [] | [_] => Scale::time(bounds.secs.0, bounds.secs.1),
            stretches => Scale::cut_time(stretches.to_vec()),
        }
    }

    /// Returns the stretches between long gaps: the first and the last instant of each.
    fn stretches(&self) -> Vec<(f64, f64)> {
        let known = self.points.iter().filter(|(_, value)| value.is_finite());
        let times: Vec<f64> = known.map(|&(secs, _)| secs).collect();
        let mut steps: Vec<f64> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
        let whole: f64 = steps.iter().sum();
        // The longest gap comes first. A gap is long relative to the time that is not in longer gaps.
        steps.sort_by(|a, b| b.total_cmp(a));
        let mut left = whole;
        let mut shortest = f64::INFINITY;
        for &step in &steps {
            if step <= LONG_GAP * (left - step) {
                break;
            }
            left -= step;
            shortest = step;
        }
        let mut stretches: Vec<(f64, f64)> = Vec::new();
        for &at in &times {
            match stretches.last_mut() {
                Some((_, last)) if at - *last < shortest => *last = at,
                _ => stretches.push((at, at)),
            }
        }
        // A stretch of a single instant has no dates to show.
        let has_length = stretches.iter().all(|(first, last)| first < last);
        if has_length { stretches } else { Vec::new() }
    }

    /// Returns lines at the gaps that are cut out, with their lengths if there is room.
    fn cuts(&self) -> Vec<Rule> {
        let stretches = self.stretches();
        let mut cuts: Vec<Rule> = stretches
            .windows(2)
            .map(|pair: &[(f64, f64)]| {
                let from = pair[0].1;
                let to = pair[1].0;
                let label = format!("gap of {}", duration(to - from));
                Rule { x: f64::midpoint(from, to), label, dash: Dash::Dotted }
            })
            .collect();
        if cuts.len() > NAMED_GAPS {
            for cut in &mut cuts {
                cut.label.clear();
            }
        }
        cuts
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn period(times: impl Iterator<Item = f64>) -> RecordedPeriod {
        RecordedPeriod {
            name: "training".to_owned(),
            used_for: PeriodUse::Learning,
            times: ["a", "b"].map(str::to_owned),
            points: times.map(|secs| (secs, 1.0)).collect(),
        }
    }

    const DAY: f64 = 86_400.0;

    fn days(from: u32, to: u32) -> impl Iterator<Item = f64> {
        (from..to).map(|day| f64::from(day) * DAY)
    }

    fn with(used_for: PeriodUse, values: &[f64]) -> RecordedPeriod {
        RecordedPeriod {
            used_for,
            points: values.iter().map(|value| (0.0, *value)).collect(),
            ..period(std::iter::empty())
        }
    }

    fn figure(periods: Vec<RecordedPeriod>) -> RecordedFigure {
        RecordedFigure { sensor: "A".to_owned(), unit: None, periods }
    }

    #[test]
    fn levels_are_of_what_was_learned_from_and_of_the_deployment() {
        let learned = with(PeriodUse::Learning, &[1.0, 3.0, f64::NAN, 4.0, f64::NAN, 5.0, 7.0]);
        let held_out = with(PeriodUse::Deployment, &[10.0, 30.0]);
        let levels = figure(vec![learned.clone(), held_out]).levels().expect("values of both");
        assert_eq!(levels.map(|level| level.median), [4.0, 20.0], "middles 2, 4, 6 and 20");
        assert!((levels[0].spread - 1.36).abs() < 1e-12, "{levels:?}");
        assert!((levels[0].deviation - (8.0_f64 / 3.0).sqrt()).abs() < 1e-12, "{levels:?}");
        assert_eq!(figure(vec![learned]).levels(), None, "nothing is held out");
    }

    /// Returns whether held-out values are apart from those of `learned`, and whether they are far more spread.
    fn beside(learned: &RecordedPeriod, held_out: &[f64]) -> [bool; 2] {
        let held_out = with(PeriodUse::Deployment, held_out);
        let [learned, held_out] =
            figure(vec![learned.clone(), held_out]).levels().expect("values of both");
        [held_out.is_apart_from(&learned), held_out.is_far_more_spread_than(&learned)]
    }

    #[test]
    fn excursions_are_no_other_level() {
        let quiet: Vec<f64> = (0_u32..100).map(|at| f64::from(at % 4)).collect();
        let learned = with(PeriodUse::Learning, &quiet);
        let excursions: Vec<f64> =
            (0..quiet.len()).map(|at| if at % 10 == 0 { -200.0 } else { quiet[at] }).collect();
        let shifted: Vec<f64> = quiet.iter().map(|value| value + 10.0).collect();
        assert_eq!(beside(&learned, &excursions), [false, true]);
        assert_eq!(beside(&learned, &shifted), [true, false]);
        assert_eq!(beside(&learned, &quiet), [false, false]);
    }

    #[test]
    fn long_gaps_are_cut_out() {
        let gapped = period(days(0, 10).chain(days(310, 320)));
        assert_eq!(gapped.stretches(), [(0.0, 9.0 * DAY), (310.0 * DAY, 319.0 * DAY)]);
        let cuts = gapped.cuts();
        assert_eq!((cuts.len(), cuts[0].label.as_str()), (1, "gap of 301 d"));
        let bounds = gapped.bounds().expect("values");
        let scale = gapped.dates(&bounds);
        let places = [0.0, 9.0 * DAY, 310.0 * DAY, 319.0 * DAY].map(|at| scale.fraction(at));
        assert_eq!((places[0], places[3]), (0.0, 1.0));
        assert!(places[1] > 0.45 && places[2] < 0.55 && places[1] < places[2], "{places:?}");
        let whole = period(days(0, 100).chain(days(105, 200)));
        assert!(whole.cuts().is_empty());
    }

    #[test]
    fn what_a_sensor_showed_beyond_training_is_counted() {
        let mut figure = RecordedFigure {
            sensor: "A".to_owned(),
            unit: None,
            periods: vec![period([0.0, 1.0].into_iter()), period([2.0, 3.0].into_iter())],
        };
        assert_eq!(figure.outside_training(), None);
        figure.periods[1].used_for = PeriodUse::Deployment;
        figure.periods[1].points[1].1 = 5.0;
        assert_eq!(figure.outside_training(), Some(0.5));
    }
}
