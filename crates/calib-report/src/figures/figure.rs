//! A drawn figure.

use crate::ReportError;
use crate::chart::{
    Chart, GridCell, LegendPlace, NARROW, Scene, WIDE, draw, draw_grid, draw_panels, draw_stacked,
    png, svg,
};

/// One of several plots below each other.
#[derive(Debug, Clone, PartialEq)]
pub struct Panel {
    /// Text above the plot.
    pub heading: String,
    /// The plot.
    pub chart: Chart,
}

/// Height of one of several panels in pixels.
const PANEL_HEIGHT: f64 = 100.0;

/// A figure that can be written as SVG or PNG.
#[derive(Debug, Clone, PartialEq)]
pub struct Figure {
    chart: Chart,
    layout: Layout,
}

/// Arrangement of the plots in the files of a figure.
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
    /// Creates the figure of one chart.
    pub const fn new(chart: Chart) -> Self {
        Self { chart, layout: Layout::Single }
    }

    /// Creates a figure whose files show `panels` below each other, instead of all curves of `chart` in one plot.
    pub(crate) const fn with_panels(chart: Chart, panels: Vec<Chart>) -> Self {
        Self { chart, layout: Layout::Stack(panels) }
    }

    /// Creates a figure of `rows` of small plots, with title and legend of `chart`.
    pub(crate) const fn with_grid(chart: Chart, rows: Vec<Vec<GridCell>>, height: f64) -> Self {
        Self { chart, layout: Layout::Grid(rows, height) }
    }

    /// Creates a figure of `panels` below each other, with the title of `chart`.
    pub(crate) fn of_panels(chart: Chart, panels: &[Panel]) -> Self {
        let rows = panels.iter().map(|Panel { heading, chart }| {
            vec![GridCell { heading: Some(heading.clone()), chart: Some(chart.clone()) }]
        });
        Self::with_grid(chart, rows.collect(), PANEL_HEIGHT)
    }

    /// The chart of the figure, with all curves in one plot.
    pub const fn chart(&self) -> &Chart {
        &self.chart
    }

    /// Returns the figure as a stand-alone SVG document, 960 pixels wide, on white.
    pub fn svg(&self) -> String {
        self.element(&self.scene(LegendPlace::Inside), "figure")
    }

    /// Returns the figure without title as two SVG elements of a page, for wide and
    /// narrow screens. `id` must be unique in the page.
    pub(crate) fn elements(&self, id: &str) -> [String; 2] {
        let narrow = match &self.layout {
            Layout::Grid(rows, height) => draw_stacked(&self.chart, rows, *height),
            _ => draw(&self.chart.thinned(), LegendPlace::Outside, NARROW),
        };
        let wide = self.scene(LegendPlace::Outside);
        [self.element(&wide, id), self.element(&narrow, &format!("{id}-narrow"))]
    }

    fn element(&self, scene: &Scene, id: &str) -> String {
        svg(scene, id, &self.chart.title, &self.chart.description)
    }

    /// Returns the figure as the bytes of a PNG file, 1920 pixels wide, on white.
    ///
    /// # Errors
    ///
    /// If the drawing library cannot encode it.
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
