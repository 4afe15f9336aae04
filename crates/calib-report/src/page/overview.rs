//! The page on several studies.

use maud::html;

use super::{
    document::{Section, SectionEntry, document},
    figure::{Drawn, Numbers, with_panels},
    tables::table,
    text::prose,
};
use crate::{Overview, OverviewFigure, OverviewText};

/// Returns the caption of a figure, unless it equals that of the previous figure.
fn own_caption(figures: &[OverviewFigure], number: usize) -> &str {
    let caption = &figures[number].caption;
    let before = number.checked_sub(1).map(|before| &figures[before].caption);
    if before == Some(caption) { "" } else { caption }
}

impl Overview {
    /// Returns the page as one HTML document that loads nothing.
    pub fn html(&self) -> String {
        html_of(self)
    }
}

fn html_of(overview: &Overview) -> String {
    let Overview { title, subtitle, decision, findings, warnings, texts, figures, tables, command } =
        overview;
    let mut sections = vec![Section {
        id: "findings",
        title: "What was found",
        parts: Vec::new(),
        body: html! {
            @if let Some(decision) = decision {
                div.cards {
                    article class={ "card " (decision.support.class()) } {
                        p.badge { (decision.badge) }
                        h3 { (prose(&decision.headline)) }
                        p.plain { (prose(&decision.plain)) }
                    }
                }
            }
            @for finding in findings { p { (prose(finding)) } }
            @if !warnings.is_empty() {
                div.warnings role="note" {
                    h3 { "Before you rely on this" }
                    ul { @for warning in warnings { li { (prose(warning)) } } }
                }
            }
        },
    }];
    sections.extend(texts.iter().map(section_of_text));
    if !figures.is_empty() {
        let parts = figures.iter().enumerate();
        let parts = parts.map(|(number, figure)| SectionEntry {
            id: figure_id(number),
            title: figure.chart.title.clone(),
        });
        let body = html! {
            @for (number, figure) in figures.iter().enumerate() {
                @if figure.panels.is_empty() {
                    (Drawn {
                        chart: &figure.chart,
                        id: &figure_id(number),
                        caption: own_caption(figures, number),
                        table: &figure.table,
                        numbers: Numbers::All,
                        shown: figure.chart.series.len(),
                        details: &[],
                    }.markup())
                } @else {
                    (with_panels(figure, own_caption(figures, number), &figure_id(number)))
                }
            }
        };
        sections.push(Section { id: "figures", title: "Figures", parts: parts.collect(), body });
    }
    if !tables.is_empty() {
        let parts = tables.iter().enumerate();
        let parts = parts.map(|(number, table)| SectionEntry {
            id: table_id(number),
            title: table.title.clone(),
        });
        let body = html! {
            @for (number, own) in tables.iter().enumerate() { (table(own, &table_id(number))) }
        };
        sections.push(Section { id: "tables", title: "Tables", parts: parts.collect(), body });
    }
    let body = html! { pre { code { (command) } } };
    sections.push(Section { id: "reproduce", title: "Reproduce", parts: Vec::new(), body });
    document(title, subtitle.as_deref(), "Skip to what was found", &sections)
}

fn section_of_text(text: &OverviewText) -> Section {
    let &OverviewText { id, title, ref paragraphs, ref items } = text;
    let body = html! {
        @for paragraph in paragraphs { p { (prose(paragraph)) } }
        @if !items.is_empty() {
            ul { @for item in items { li { (prose(item)) } } }
        }
    };
    Section { id, title, parts: Vec::new(), body }
}

fn figure_id(number: usize) -> String {
    format!("figure-{number}")
}

fn table_id(number: usize) -> String {
    format!("table-{number}")
}
