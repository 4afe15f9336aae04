//! A complete page of sections.

use maud::{DOCTYPE, Markup, PreEscaped, html};

use super::text::prose;

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

/// A section of a page.
pub(super) struct Section {
    pub(super) id: &'static str,
    pub(super) title: &'static str,
    /// Figures and tables of the section, in order.
    pub(super) parts: Vec<SectionEntry>,
    pub(super) body: Markup,
}

/// A figure or table that the contents of its section link to.
pub(super) struct SectionEntry {
    pub(super) id: String,
    pub(super) title: String,
}

/// Returns a complete page. `skip` names the first section for users of screen readers.
pub(super) fn document(
    title: &str,
    subtitle: Option<&str>,
    skip: &str,
    sections: &[Section],
) -> String {
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
                        @if let Some(subtitle) = subtitle { p.subtitle { (prose(subtitle)) } }
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
