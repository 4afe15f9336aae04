//! A chart of the page: heading, tools, legend as buttons, the picture, and its numbers as a table.

use maud::{Markup, PreEscaped, html};

use super::tables::rows;
use super::text::prose;
use crate::chart::{
    Detail, Key, LegendPlace, NARROW, WIDE, chart_data, draw, keys, sample_svg, svg,
};
use crate::{Chart, Figure, Table};

/// What belongs to a chart of the page.
pub(super) struct Drawn<'a> {
    pub(super) chart: &'a Chart,
    /// Unique in the page.
    pub(super) id: &'a str,
    /// How to read it.
    pub(super) caption: &'a str,
    /// Its numbers.
    pub(super) table: &'a Table,
    pub(super) numbers: Numbers,
    /// How many curves are on at first.
    pub(super) shown: usize,
    /// All values of its curves, or nothing where the points that are drawn are all there is.
    pub(super) details: &'a [Detail<'a>],
}

/// What the table of a chart holds.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Numbers {
    /// All numbers of the chart.
    All,
    /// A few of them; copying and saving give all.
    Sampled,
}

impl Drawn<'_> {
    pub(super) fn markup(&self) -> Markup {
        let Self { chart, id, caption, .. } = *self;
        let scene = draw(chart, LegendPlace::Outside, WIDE);
        let narrow = draw(&chart.thinned(), LegendPlace::Outside, NARROW);
        let picture = |scene, id: &str| svg(scene, id, &chart.title, &chart.description);
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
                    (wide_and_narrow(&picture(&scene, id), &picture(&narrow, &format!("{id}-narrow"))))
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

/// A figure that is only looked at: many small plots.
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

/// Ways to take a figure away that is only looked at.
pub(super) fn still_tools(title: &str) -> Markup {
    html! {
        div.tools role="group" aria-label={ "Tools of " (title) } {
            @for format in ["svg", "png"] { (save(format)) }
        }
    }
}

/// The picture of a figure that is only looked at.
pub(super) fn still_plot(figure: &Figure, id: &str) -> Markup {
    let [wide, narrow] = figure.elements(id);
    html! {
        div.plot tabindex="0" role="group" aria-label=(figure.chart().title) { (wide_and_narrow(&wide, &narrow)) }
    }
}

/// Both layouts of a picture; the style sheet shows the one that the screen has room for.
fn wide_and_narrow(wide: &str, narrow: &str) -> Markup {
    html! {
        div.wide { (PreEscaped(wide)) }
        div.narrow { (PreEscaped(narrow)) }
    }
}

/// How to read a figure, unless that stands above all of its kind.
fn caption_line(caption: &str) -> Markup {
    html! { @if !caption.is_empty() { p { (prose(caption)) } } }
}

/// The signs of a chart's curves, where they cannot be switched.
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

/// Zooming, and ways to take the chart away; without the script there are none, as they would do nothing.
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

/// Curves can be switched off; the sign for diverged values is only explained.
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
