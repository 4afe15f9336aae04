//! The report as one self-contained HTML document.

mod charts;
mod learning;
mod tables;
mod verdicts;

use maud::{DOCTYPE, Markup, PreEscaped, html};

use crate::{Report, ReportError};

const STYLE: &str = include_str!("style.css");
const SCRIPT: &str = include_str!("script.js");
/// Nothing may be loaded from anywhere, whatever a label contains.
const POLICY: &str =
    "default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'; img-src data:";

/// Renders `report`.
pub(crate) fn html(report: &Report) -> Result<String, ReportError> {
    let sections = sections(report)?;
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                meta http-equiv="Content-Security-Policy" content=(POLICY);
                meta name="generator" content="calib";
                title { (report.title) " – calib report" }
                link rel="icon" href="data:,";
                style { (PreEscaped(STYLE)) }
            }
            body {
                a.skip href="#verdict" { "Skip to the verdict" }
                header.top {
                    div {
                        h1 { (report.title) }
                        @if let Some(subtitle) = &report.subtitle { p.subtitle { (subtitle) } }
                    }
                    button.theme type="button" aria-label="Switch between light and dark" { "◐ Theme" }
                }
                nav aria-label="Sections" {
                    @for section in &sections { a href={ "#" (section.id) } { (section.title) } }
                }
                main {
                    @for section in &sections {
                        section id=(section.id) aria-labelledby={ (section.id) "-title" } {
                            h2 id={ (section.id) "-title" } { (section.title) }
                            (section.body)
                        }
                    }
                }
                footer { "Made by calib. This file is complete: it loads nothing from the network." }
                script { (PreEscaped(SCRIPT)) }
            }
        }
    };
    Ok(page.into_string())
}

struct Section {
    id: &'static str,
    title: &'static str,
    body: Markup,
}

/// The sections that have something to show, in order.
fn sections(report: &Report) -> Result<Vec<Section>, ReportError> {
    let mut sections =
        vec![Section { id: "verdict", title: "Verdict", body: verdicts::verdicts(report) }];
    if !report.sensitivities.is_empty() {
        let body = charts::sensitivities(report)?;
        sections.push(Section { id: "sensitivity", title: "Sensitivity curves", body });
    }
    if !report.learning.is_empty() {
        let body = learning::curves(report)?;
        sections.push(Section { id: "learning", title: "Learning curves", body });
    }
    if !report.rollouts.is_empty() {
        let body = charts::rollouts(report)?;
        sections.push(Section { id: "rollouts", title: "Rollouts", body });
    }
    if !report.jumps.is_empty() || !report.tables.is_empty() {
        let body = tables::statistics(report);
        sections.push(Section { id: "tables", title: "Tables", body });
    }
    if let Some(data) = &report.data {
        sections.push(Section { id: "data", title: "Data", body: tables::data(data) });
    }
    let body = tables::reproduction(&report.reproduction);
    sections.push(Section { id: "reproduce", title: "Reproduce", body });
    Ok(sections)
}
