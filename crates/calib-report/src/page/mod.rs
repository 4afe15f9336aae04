//! The report as one self-contained HTML document.

mod charts;
mod figure;
mod learning;
mod overview;
mod recorded;
mod several;
mod tables;
mod text;
mod verdicts;

use maud::{DOCTYPE, Markup, PreEscaped, html};

use crate::{Report, ReportError};

pub(crate) use overview::overview;

const STYLE: &str = include_str!("style.css");
/// The script. A block keeps its names out of the page's scope.
const SCRIPT: &str = concat!(
    "\"use strict\";\n{\n",
    include_str!("script/numbers.js"),
    include_str!("script/chart.js"),
    include_str!("script/zoom.js"),
    include_str!("script/read.js"),
    include_str!("script/save.js"),
    include_str!("script/page.js"),
    "}\n"
);
/// Content security policy: nothing may be loaded, whatever a label contains.
const POLICY: &str =
    "default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'; img-src data:";

/// Renders `report` as HTML.
pub(crate) fn html(report: &Report) -> Result<String, ReportError> {
    let sections = sections(report)?;
    Ok(document(&report.title, report.subtitle.as_deref(), "Skip to the verdict", &sections))
}

/// Returns a complete page. `skip` names the first section for users of screen readers.
fn document(title: &str, subtitle: Option<&str>, skip: &str, sections: &[Section]) -> String {
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                meta http-equiv="Content-Security-Policy" content=(POLICY);
                meta name="generator" content="calib";
                title { (title) " – calib report" }
                link rel="icon" href="data:,";
                style { (PreEscaped(STYLE)) }
            }
            body {
                @if let Some(first) = sections.first() { a.skip href={ "#" (first.id) } { (skip) } }
                header.top {
                    div {
                        p.kind { "Calibration report" }
                        h1 { (title) }
                        @if let Some(subtitle) = subtitle { p.subtitle { (text::prose(subtitle)) } }
                    }
                    button.theme type="button" aria-label="Switch between light and dark" { "◐ Theme" }
                }
                nav aria-label="Sections" {
                    @for section in sections { a href={ "#" (section.id) } { (section.title) } }
                }
                main {
                    @for section in sections {
                        section id=(section.id) aria-labelledby={ (section.id) "-title" } {
                            h2 id={ (section.id) "-title" } { (section.title) }
                            @if section.parts.len() > 1 { (contents(section)) }
                            (section.body)
                        }
                    }
                }
                footer { "Made by calib. This file is complete: it loads nothing from the network." }
                script { (PreEscaped(SCRIPT)) }
            }
        }
    };
    page.into_string()
}

/// Returns links to the parts of a section.
fn contents(section: &Section) -> Markup {
    html! {
        ul.contents aria-label={ "In this section: " (section.title) } {
            @for part in &section.parts { li { a href={ "#" (part.id) } { (part.title) } } }
        }
    }
}

struct Section {
    id: &'static str,
    title: &'static str,
    /// Figures and tables of the section, in order.
    parts: Vec<SectionEntry>,
    body: Markup,
}

/// A figure or table that the contents of its section link to.
struct SectionEntry {
    id: String,
    title: String,
}

/// Returns the sections that have content: the verdict, its evidence, then data and reproduction.
fn sections(report: &Report) -> Result<Vec<Section>, ReportError> {
    let mut sections = vec![verdicts::verdicts(report)];
    if !report.sensitivities.is_empty() {
        sections.push(charts::sensitivities(report)?);
    }
    if !report.recorded.is_empty() {
        sections.push(recorded::recorded(report)?);
    }
    if !report.rollouts.is_empty() || !report.rollout_grids.is_empty() {
        sections.push(charts::rollouts(report)?);
    }
    if !report.jumps.is_empty() || !report.tables.is_empty() {
        sections.push(tables::statistics(report));
    }
    if !report.learning.is_empty() {
        sections.push(learning::curves(report)?);
    }
    if let Some(data) = &report.data {
        sections.push(tables::data(data));
    }
    sections.push(tables::reproduction(&report.reproduction));
    Ok(sections)
}
