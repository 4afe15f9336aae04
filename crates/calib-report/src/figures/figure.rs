//! A drawn figure.

use crate::ReportError;
use crate::chart::{
    Chart, GridCell, LegendPlace, NARROW, Scene, WIDE, draw, draw_grid, draw_panels, draw_stacked,
    png, svg,
};

/// A figure ready to be written in either format.
#[derive(Debug, Clone, PartialEq)]
pub struct Figure {
    chart: Chart,
    layout: Layout,
}

/// What the files of a figure show.
#[derive(Debug, Clone, PartialEq)]
enum Layout {
    /// All curves in one plot.
    Single,
    /// Plots below each other.
    Stack(Vec<Chart>),
    /// Small plots of this height in rows and columns.
    Grid(Vec<Vec<GridCell>>, f64),
}

impl Figure {
    /// The figure of one chart.
    pub const fn new(chart: Chart) -> Self {
        Self { chart, layout: Layout::Single }
    }

    /// A figure whose files show `panels` below each other instead of all curves of `chart` in one plot.
    pub(crate) const fn with_panels(chart: Chart, panels: Vec<Chart>) -> Self {
        Self { chart, layout: Layout::Stack(panels) }
    }

    /// A figure of `rows` of small plots, with title and legend of `chart`.
    pub(crate) const fn with_grid(chart: Chart, rows: Vec<Vec<GridCell>>, height: f64) -> Self {
        Self { chart, layout: Layout::Grid(rows, height) }
    }

    /// The chart behind it, with all curves in one plot.
    pub const fn chart(&self) -> &Chart {
        &self.chart
    }

    /// The figure as a stand-alone SVG document, 960 pixels wide, on white.
    pub fn svg(&self) -> String {
        svg(&self.scene(LegendPlace::Inside), "figure", &self.chart.title, &self.chart.description)
    }

    /// The figure without its title as two SVG elements of a page, for a wide screen and a narrow one. `id` is unique in the page.
    pub(crate) fn elements(&self, id: &str) -> [String; 2] {
        let narrow = match &self.layout {
            Layout::Grid(rows, height) => draw_stacked(&self.chart, rows, *height),
            _ => draw(&self.chart.thinned(), LegendPlace::Outside, NARROW),
        };
        let element =
            |scene: &Scene, id: &str| svg(scene, id, &self.chart.title, &self.chart.description);
        [element(&self.scene(LegendPlace::Outside), id), element(&narrow, &format!("{id}-narrow"))]
    }

    /// The figure as the bytes of a PNG file, 1920 pixels wide, on white.
    ///
    /// # Errors
    ///
    /// The drawing library could not encode it.
    pub fn png(&self) -> Result<Vec<u8>, ReportError> {
        png(&self.scene(LegendPlace::Inside))
    }

    fn scene(&self, legend_place: LegendPlace) -> Scene {
        match &self.layout {
            Layout::Stack(panels) if panels.len() > 1 => draw_panels(&self.chart, panels),
            Layout::Grid(rows, height) => draw_grid(&self.chart, rows, *height, legend_place),
            _ => draw(&self.chart, legend_place, WIDE),
        }
    }
}
