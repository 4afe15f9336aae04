//! What a sensor showed in each period: while it was learned from, and in each deployment.

use super::rollout::axis_label;
use crate::chart::{Axis, Chart, Colour, Dash, GridCell, Point, Scale, Series, Side, extent};
use crate::number::number;
use crate::{Figure, ReportError};

const HEIGHT: f64 = 110.0;

/// One sensor in several periods, in plots below each other with the same vertical axis.
#[derive(Debug, Clone, PartialEq)]
pub struct RecordedFigure {
    /// The sensor.
    pub sensor: String,
    /// Its physical unit: "kPa".
    pub unit: Option<String>,
    /// The periods, in the order in which they are shown.
    pub periods: Vec<RecordedPeriod>,
}

/// What was recorded in a period.
#[derive(Debug, Clone, PartialEq)]
pub struct RecordedPeriod {
    /// What it is called: "training", "april".
    pub name: String,
    /// What it is for.
    pub used_for: PeriodUse,
    /// Time of the first value and of the last, as text.
    pub times: [String; 2],
    /// Instants, in seconds since 1970, and values in physical units; NaN where the line breaks.
    pub points: Vec<(f64, f64)>,
}

/// What a period is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PeriodUse {
    /// It was learned from.
    Learning,
    /// It was held out: a deployment.
    Deployment,
}

impl RecordedFigure {
    /// Draws the figure: a plot for each period that has values, over its dates.
    ///
    /// # Errors
    ///
    /// No period has a value.
    pub fn figure(&self) -> Result<Figure, ReportError> {
        let title = format!("{}: recorded in each period", self.sensor);
        let shown: Vec<(&RecordedPeriod, Extent)> =
            self.periods.iter().filter_map(|period| Some((period, period.extent()?))).collect();
        let values: Vec<f64> =
            shown.iter().flat_map(|(_, extent)| [extent.values.0, extent.values.1]).collect();
        if values.is_empty() {
            return Err(ReportError::Empty { figure: title, missing: "values" });
        }
        let scale = Scale::linear_around(&values);
        let label = axis_label(&self.sensor, self.unit.as_deref());
        let cell = |(period, extent): &(&RecordedPeriod, Extent)| {
            let cell = GridCell {
                heading: Some(period.heading(extent)),
                chart: Some(period.plot(extent, &scale)),
            };
            vec![cell]
        };
        let rows = shown.iter().map(cell).collect();
        let ranges: Vec<String> =
            shown.iter().map(|(period, extent)| period.heading(extent)).collect();
        let head = Chart {
            title,
            description: format!("{label}. {}.", ranges.join("; ")),
            x: Axis { label: String::new(), scale: Scale::linear(0.0, 1.0) },
            left: Axis { label, scale },
            right: None,
            series: Vec::new(),
            rules: Vec::new(),
        };
        Ok(Figure::with_grid(head, rows, HEIGHT))
    }
}

/// The ends of what is known of a period.
struct Extent {
    secs: (f64, f64),
    values: (f64, f64),
}

impl RecordedPeriod {
    fn extent(&self) -> Option<Extent> {
        let ends = |pick: fn(&(f64, f64)) -> f64| {
            let known = self.points.iter().filter(|(_, value)| value.is_finite());
            extent(&known.map(pick).collect::<Vec<_>>())
        };
        Some(Extent { secs: ends(|point| point.0)?, values: ends(|point| point.1)? })
    }

    /// "april: 2023-04-07 00:00 to 2023-04-13 23:50, between 3.1 and 7.8"
    fn heading(&self, extent: &Extent) -> String {
        let (low, high) = extent.values;
        format!("{}: {}, between {} and {}", self.name, self.span(), number(low), number(high))
    }

    /// From the first value to the last one; seconds are left out where neither has any.
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

    fn plot(&self, extent: &Extent, scale: &Scale) -> Chart {
        let colour = match self.used_for {
            PeriodUse::Learning => Colour::Ink,
            // What Online replays has its colour.
            PeriodUse::Deployment => Colour::Curve(0),
        };
        let point = |&(x, y): &(f64, f64)| Point { x, y, interval: None };
        let series = Series {
            label: self.name.clone(),
            side: Side::Left,
            colour,
            dash: Dash::Solid,
            width: 1.0,
            marker: None,
            points: self.points.iter().map(point).collect(),
        };
        let (first, last) = extent.secs;
        Chart {
            title: String::new(),
            description: String::new(),
            x: Axis { label: String::new(), scale: Scale::time(first, last) },
            left: Axis { label: String::new(), scale: scale.clone() },
            right: None,
            series: vec![series],
            rules: Vec::new(),
        }
    }
}
