//! A page on several studies: charts and tables with their explanations.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{Chart, Figure, Panel, Table};

/// Charts and tables on one page, as self-contained as a report.
#[derive(Debug, Clone, PartialEq)]
pub struct Overview {
    /// Title of the page.
    pub title: String,
    /// One line below the title.
    pub subtitle: Option<String>,
    /// The decision, if the page has one.
    pub decision: Option<Decision>,
    /// Findings, one paragraph each.
    pub findings: Vec<String>,
    /// Warnings to read before relying on the findings.
    pub warnings: Vec<String>,
    /// Sections of text after the findings.
    pub texts: Vec<OverviewText>,
    /// The charts.
    pub figures: Vec<OverviewFigure>,
    /// The tables.
    pub tables: Vec<Table>,
    /// Command that makes the page again.
    pub command: String,
}

/// A section of text.
#[derive(Debug, Clone, PartialEq)]
pub struct OverviewText {
    /// Name of the section in links, another one for each section of the page.
    pub id: &'static str,
    /// Title of the section.
    pub title: &'static str,
    /// The text.
    pub paragraphs: Vec<String>,
    /// A list below it, with one sentence or more in each item.
    pub items: Vec<String>,
}

/// The decision of a report, shown as a card.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Decision {
    /// How well the evidence supports the decision.
    pub support: Support,
    /// The support in a few words.
    pub badge: String,
    /// The recommended action, in one sentence.
    pub headline: String,
    /// The reason.
    pub plain: String,
}

/// How well the evidence supports a decision.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Support {
    /// It is supported.
    Supported,
    /// The evidence gives no reason to change the default.
    KeepDefault,
    /// It is not supported.
    Unsupported,
}

impl Support {
    /// Returns the colour of its card, by the name in the style sheet.
    pub(crate) const fn class(self) -> &'static str {
        match self {
            Self::Supported => "good",
            Self::KeepDefault => "simpler",
            Self::Unsupported => "poor",
        }
    }
}

/// A chart with its caption and its numbers.
#[derive(Debug, Clone, PartialEq)]
pub struct OverviewFigure {
    /// The chart.
    pub chart: Chart,
    /// Plots below each other that are shown under the title of `chart`, in place of its curves. Empty if the chart is
    /// the only plot.
    pub panels: Vec<Panel>,
    /// Explanation of the chart.
    pub caption: String,
    /// The numbers of the chart.
    pub table: Table,
}

impl OverviewFigure {
    /// Returns the figure for a file.
    pub fn figure(&self) -> Figure {
        if self.panels.is_empty() {
            Figure::new(self.chart.clone())
        } else {
            Figure::of_panels(self.chart.clone(), &self.panels)
        }
    }
}
