//! A page on several studies: charts and tables with what they mean.

use crate::{Chart, Table};

/// Charts and tables on one page, as self-contained as a report.
#[derive(Debug, Clone, PartialEq)]
pub struct Overview {
    /// Title of the page.
    pub title: String,
    /// One line below the title.
    pub subtitle: Option<String>,
    /// What was found, one paragraph each.
    pub findings: Vec<String>,
    /// What the reader should know before relying on it.
    pub warnings: Vec<String>,
    /// The charts.
    pub figures: Vec<OverviewFigure>,
    /// The tables.
    pub tables: Vec<Table>,
    /// What to type to make the page again.
    pub command: String,
}

/// A chart with its caption and its numbers.
#[derive(Debug, Clone, PartialEq)]
pub struct OverviewFigure {
    /// The chart.
    pub chart: Chart,
    /// What it shows and how to read it.
    pub caption: String,
    /// Its numbers.
    pub table: Table,
}

impl Overview {
    /// The page as one HTML document that loads nothing from anywhere.
    pub fn html(&self) -> String {
        crate::page::overview(self)
    }
}
