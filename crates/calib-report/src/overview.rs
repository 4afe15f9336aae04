//! A page on several studies: charts and tables with what they mean.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{Chart, Table};

/// Charts and tables on one page, as self-contained as a report.
#[derive(Debug, Clone, PartialEq)]
pub struct Overview {
    /// Title of the page.
    pub title: String,
    /// One line below the title.
    pub subtitle: Option<String>,
    /// What to do, where the page says that.
    pub decision: Option<Decision>,
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

/// What to do, as a card.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Decision {
    /// How far it can be relied on.
    pub support: Support,
    /// That in a few words.
    pub badge: String,
    /// What to do, in a sentence.
    pub headline: String,
    /// Why.
    pub plain: String,
}

/// How far a decision can be relied on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Support {
    /// It is supported.
    Supported,
    /// Nothing speaks for a change.
    KeepDefault,
    /// It is not supported.
    Unsupported,
}

impl Support {
    /// The colour of its card, by the name in the style sheet.
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
