//! A drawn figure.

use crate::ReportError;
use crate::chart::{Chart, LegendPlace, Scene, draw, draw_panels, png, svg};

/// A figure ready to be written in either format.
#[derive(Debug, Clone, PartialEq)]
pub struct Figure {
    chart: Chart,
    panels: Vec<Chart>,
}

impl Figure {
    pub(crate) const fn new(chart: Chart) -> Self {
        Self { chart, panels: Vec::new() }
    }

    /// A figure whose files show `panels` below each other instead of all curves of `chart` in one plot.
    pub(crate) const fn with_panels(chart: Chart, panels: Vec<Chart>) -> Self {
        Self { chart, panels }
    }

    /// The chart behind it, with all curves in one plot.
    pub const fn chart(&self) -> &Chart {
        &self.chart
    }

    /// The figure as a stand-alone SVG document, 960 pixels wide, on white.
    pub fn svg(&self) -> String {
        svg(&self.scene(), "figure", &self.chart.title, &self.chart.description)
    }

    /// The figure as the bytes of a PNG file, 1920 pixels wide, on white.
    ///
    /// # Errors
    ///
    /// The drawing library could not encode it.
    pub fn png(&self) -> Result<Vec<u8>, ReportError> {
        png(&self.scene())
    }

    fn scene(&self) -> Scene {
        if self.panels.len() > 1 {
            draw_panels(&self.chart, &self.panels)
        } else {
            draw(&self.chart, LegendPlace::Inside)
        }
    }
}
