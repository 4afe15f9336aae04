//! A chart of the page: heading, tools, legend as buttons, the picture, and its numbers as a table.

use maud::{Markup, PreEscaped, html};

use super::tables::rows;
use super::text::prose;
use crate::chart::{
    Detail, Key, LegendPlace, NARROW, WIDE, chart_data, draw, keys, sample_svg, svg,
};
use crate::{Chart, Figure, OverviewFigure, Table};

/// A chart of the page with its parts.
pub(super) struct Drawn<'a> {
    pub(super) chart: &'a Chart,
    /// Identifier, unique in the page.
    pub(super) id: &'a str,
    /// Caption that explains the chart.
    pub(super) caption: &'a str,
    /// Numbers of the chart.
    pub(super) table: &'a Table,
    pub(super) numbers: Numbers,
    /// Number of curves that are on at first.
    pub(super) shown: usize,
    /// All values of its curves; empty if the drawn points are all values.
    pub(super) details: &'a [Detail<'a>],
}

/// Content of the table of a chart.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Numbers {
    /// All numbers of the chart.
    All,
    /// A sample of the numbers; copying and saving give all.
    Sampled,
}

impl Drawn<'_> {
    pub(super) fn markup(&self) -> Markup {
        let Self { chart, id, caption, .. } = *self;
        let scene = draw(chart, LegendPlace::Outside, WIDE);
        let narrow = draw(&chart.thinned(), LegendPlace::Outside, NARROW);
        let wide_picture = svg(&scene, id, &chart.title, &chart.description);
        let narrow_picture =
            svg(&narrow, &format!("{id}-narrow"), &chart.title, &chart.description);
        html! {
            figure.chart id=(id) data-shown=(self.shown) {
                div.figure-head {
                    figcaption { h3 { (chart.title) } (caption_line(caption)) }
                    (tools(chart))
                }
                div.legend role="group" aria-label={ "Curves of " (chart.title) } {
                    @for (index, key) in keys(chart).iter().enumerate() { (legend_entry(index, key)) }
                }
                div.plot tabindex="0" role="group" aria-label={
                    (chart.title) ". Arrow keys read the values, plus and minus zoom, 0 shows all."
                } {
                    (wide_and_narrow(&wide_picture, &narrow_picture))
                    div.tip hidden {}
                }
                p.hidden aria-live="polite" {}
                script type="application/json" { (PreEscaped(chart_data(chart, [&scene, &narrow], self.details))) }
                (self.numbers())
            }
        }
    }

    fn numbers(&self) -> Markup {
        let sampled = self.numbers == Numbers::Sampled;
        html! {
            details.data.sampled[sampled] {
                summary { "Data table" }
                button.copy type="button" data-copy=[sampled.then_some("points")] {
                    @if sampled { "Copy all points" } @else { "Copy table" }
                }
                (rows(self.table))
            }
        }
    }
}

/// Returns a figure without interaction: many small plots.
pub(super) fn still(figure: &Figure, id: &str) -> Markup {
    let title = &figure.chart().title;
    html! {
        figure.still id=(id) {
            div.figure-head {
                figcaption { h3 { (title) } }
                (still_tools(title))
            }
            (still_plot(figure, id))
        }
    }
}

/// Returns plots below each other, without interaction, and their numbers.
pub(super) fn with_panels(figure: &OverviewFigure, caption: &str, id: &str) -> Markup {
    let title = &figure.chart.title;
    html! {
        figure.still id=(id) {
            div.figure-head {
                figcaption { h3 { (title) } (caption_line(caption)) }
                (still_tools(title))
            }
            (still_plot(&figure.figure(), id))
            details.data {
                summary { "Data table" }
                button.copy type="button" { "Copy table" }
                (rows(&figure.table))
            }
        }
    }
}

/// Returns the buttons to save a figure without interaction.
pub(super) fn still_tools(title: &str) -> Markup {
    html! {
        div.tools role="group" aria-label={ "Tools of " (title) } {
            @for format in ["svg", "png"] { (save(format)) }
        }
    }
}

/// Returns the picture of a figure without interaction.
pub(super) fn still_plot(figure: &Figure, id: &str) -> Markup {
    let [wide, narrow] = figure.elements(id);
    html! {
        div.plot tabindex="0" role="group" aria-label=(figure.chart().title) { (wide_and_narrow(&wide, &narrow)) }
    }
}

/// Returns both layouts of a picture. The style sheet shows the one that fits the screen.
fn wide_and_narrow(wide: &str, narrow: &str) -> Markup {
    html! {
        div.wide { (PreEscaped(wide)) }
        div.narrow { (PreEscaped(narrow)) }
    }
}

/// Returns the caption of a figure, unless a common caption stands above the section.
fn caption_line(caption: &str) -> Markup {
    html! { @if !caption.is_empty() { p { (prose(caption)) } } }
}

/// Returns the legend of a chart whose curves cannot be switched off.
pub(super) fn legend(chart: &Chart) -> Markup {
    html! {
        div.legend role="group" aria-label={ "Curves of " (chart.title) } {
            @for key in keys(chart) {
                span.key {
                    (PreEscaped(sample_svg(&key)))
                    span { (key.label) @if key.line.is_none() { ", at the upper edge" } }
                }
            }
        }
    }
}

/// Returns the buttons to zoom and to save. They are hidden without
/// the script, because they would do nothing.
fn tools(chart: &Chart) -> Markup {
    html! {
        div.tools role="group" aria-label={ "Tools of " (chart.title) } {
            button.reset type="button" hidden { "Reset zoom" }
            button.zoom type="button" data-zoom="out" aria-label="Zoom out" title="Zoom out (−)" { "−" }
            button.zoom type="button" data-zoom="in" aria-label="Zoom in" title="Zoom in (+)" { "+" }
            @for format in ["svg", "png", "csv"] { (save(format)) }
        }
    }
}

fn save(format: &str) -> Markup {
    let name = format.to_uppercase();
    html! {
        button.save type="button" data-format=(format) title={ "Download as " (name) } {
            span.hidden { "Download as " } (name)
        }
    }
}

/// Returns a legend entry. Curves can be switched off; the sign for
/// diverged values only has an explanation.
fn legend_entry(index: usize, key: &Key) -> Markup {
    let sample = PreEscaped(sample_svg(key));
    html! {
        @if key.line.is_some() {
            button.key type="button" aria-pressed="true" data-series=(index) { (sample) span { (key.label) } }
        } @else {
            span.key { (sample) span { (key.label) ", at the upper edge" } }
        }
    }
}
