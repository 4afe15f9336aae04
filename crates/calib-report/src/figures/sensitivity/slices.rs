//! Sweeps of several hyperparameters: one plot per hyperparameter, through the choice.

use super::{Dimension, ErrorCurve, LOWER, RankCurve, Sensitivity};
use crate::chart::{Axis, Chart, GridCell};
use crate::{Figure, ReportError, Setting};

const COLUMNS: usize = 3;
const HEIGHT: f64 = 230.0;

impl Dimension {
    /// Returns the distinct values in the order of the grid, and the index of the value of each combination.
    pub(super) fn distinct(&self) -> (Vec<&Setting>, Vec<usize>) {
        let mut seen: Vec<&Setting> = Vec::new();
        let places = self
            .values
            .iter()
            .map(|value| {
                seen.iter().position(|known| *known == value).unwrap_or_else(|| {
                    seen.push(value);
                    seen.len() - 1
                })
            })
            .collect();
        (seen, places)
    }
}

impl Sensitivity {
    /// Returns the hyperparameters with more than one value; empty unless there are several.
    pub(crate) fn varied(&self) -> Vec<&Dimension> {
        let varied = self.dimensions.iter().filter(|dimension| dimension.distinct().0.len() > 1);
        let varied: Vec<&Dimension> = varied.collect();
        if varied.len() > 1 { varied } else { Vec::new() }
    }

    /// Whether several hyperparameters have more than one value.
    pub(crate) fn is_of_several(&self) -> bool {
        !self.varied().is_empty()
    }

    /// Returns one sensitivity per hyperparameter: the combinations that differ from the choice in this one only. Without a
    /// choice, slices go through the best combination of the first curve. Ranks stay those among all combinations. Empty if
    /// only one hyperparameter is swept.
    pub fn slices(&self) -> Vec<Self> {
        let Some(centre) = self.chosen.or_else(|| self.best()) else { return Vec::new() };
        let varied = self.varied();
        // A list of combinations may contain no such combination besides the choice.
        varied
            .iter()
            .map(|along| {
                let others = varied.iter().filter(|dimension| dimension.field != along.field);
                let others: Vec<&&Dimension> = others.collect();
                let places: Vec<usize> = (0..self.values.len())
                    .filter(|place| {
                        others
                            .iter()
                            .all(|other| other.values.get(*place) == other.values.get(centre))
                    })
                    .collect();
                let values = places.iter().map(|&place| along.values[place].clone());
                self.restricted(along.field.clone(), values.collect(), &places)
            })
            .filter(|slice| slice.values.len() > 1)
            .collect()
    }

    /// Returns the best combination by the first error curve, or by the first rank curve without errors.
    fn best(&self) -> Option<usize> {
        let places = 0..self.values.len();
        match (self.errors.first(), self.worst_ranks.first()) {
            (Some(curve), _) => {
                let known =
                    places.filter_map(|place| Some((place, curve.summaries[place].as_ref()?.mean)));
                let known = known.filter(|(_, mean)| !mean.is_nan());
                known.min_by(|a, b| LOWER.compare(a.1, b.1)).map(|(place, _)| place)
            }
            (None, Some(curve)) => places.min_by_key(|&place| curve.worst_ranks[place]),
            (None, None) => None,
        }
    }

    /// Returns the combinations at `places`, which differ in the `values` of `field`.
    fn restricted(&self, field: String, values: Vec<Setting>, places: &[usize]) -> Self {
        let [chosen, default] = [self.chosen, self.default]
            .map(|candidate| places.iter().position(|&place| Some(place) == candidate));
        let errors = self.errors.iter().map(|curve| {
            let summaries = places.iter().map(|&place| curve.summaries[place]).collect();
            ErrorCurve { summaries, ..curve.clone() }
        });
        let ranks = self.worst_ranks.iter().map(|curve| {
            let worst_ranks = places.iter().map(|&place| curve.worst_ranks[place]).collect();
            RankCurve { worst_ranks, ..curve.clone() }
        });
        Self {
            sensor: self.sensor.clone(),
            field,
            values,
            errors: errors.collect(),
            worst_ranks: ranks.collect(),
            chosen,
            default,
            dimensions: Vec::new(),
        }
    }

    /// Draws the plots of `slices` side by side with common vertical axes: a steep curve marks an important hyperparameter.
    pub(super) fn sliced(&self, title: String, slices: &[Self]) -> Result<Figure, ReportError> {
        let rows = self.slice_rows(slices, None);
        let charts: Vec<&Chart> =
            rows.iter().flatten().filter_map(|cell| cell.chart.as_ref()).collect();
        let Some(mut head) = charts.first().copied().cloned() else {
            return Err(ReportError::Empty { figure: title, missing: "slices" });
        };
        head.title = title;
        head.description = slices.iter().map(Self::description).collect::<Vec<_>>().join(" ");
        if let Some(chart) = charts.iter().find(|chart| chart.diverges()) {
            head.series.clone_from(&chart.series);
        }
        Ok(Figure::with_grid(head, rows, HEIGHT))
    }

    /// Returns the rows of a figure: the plots of `slices`, with `heading` above the first plot.
    pub(super) fn slice_rows(&self, slices: &[Self], heading: Option<&str>) -> Vec<Vec<GridCell>> {
        let (left, right) = self.common_axes(slices);
        let last = slices.len() - 1;
        // Two rows of two look better than three and one.
        let columns = if slices.len() == 4 { 2 } else { COLUMNS };
        let cells: Vec<GridCell> = slices
            .iter()
            .enumerate()
            .map(|(place, slice)| {
                let mut chart = slice.chart(slice.field.clone());
                let column = place % columns;
                chart.left.scale = left.scale.clone();
                if column != 0 {
                    chart.left.label.clear();
                }
                if let (Some(axis), Some(right)) = (&mut chart.right, &right) {
                    axis.scale = right.scale.clone();
                    if column + 1 != columns && place != last {
                        axis.label.clear();
                    }
                }
                let heading = heading.filter(|_| column == 0).map(str::to_owned);
                GridCell { heading, chart: Some(chart) }
            })
            .collect();
        cells.chunks(columns).map(<[GridCell]>::to_vec).collect()
    }

    /// Returns vertical axes that hold all `slices`.
    fn common_axes(&self, slices: &[Self]) -> (Axis, Option<Axis>) {
        let mut all = slices[0].clone();
        for slice in &slices[1..] {
            all.values.extend(slice.values.iter().cloned());
            for (whole, part) in all.errors.iter_mut().zip(&slice.errors) {
                whole.summaries.extend(part.summaries.iter().copied());
            }
        }
        all.worst_ranks.clone_from(&self.worst_ranks);
        let left = if all.errors.is_empty() { self.rank_axis() } else { all.error_axis() };
        (left, self.has_two_axes().then(|| self.rank_axis()))
    }
}
