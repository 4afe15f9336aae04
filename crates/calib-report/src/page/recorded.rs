//! The section of recorded values, period by period.

use maud::html;

use super::charts::common_caption;
use super::document::{Section, SectionEntry};
use super::figure::still;
use crate::{Report, ReportError};

/// Caption of the plots of a sensor.
const CAPTION: &str = "In the unit of the log. Of each short stretch of time the smallest and the largest value are shown, so that every peak is. Long gaps are cut out, at the dotted lines.";

/// Returns the section, with one figure per sensor.
pub(super) fn recorded(report: &Report) -> Result<Section, ReportError> {
    let mut stills = Vec::new();
    let mut parts = Vec::new();
    for (index, recorded) in report.recorded.iter().enumerate() {
        let figure = recorded.figure()?;
        let id = format!("recorded-{index}");
        stills.push(still(&figure, &id));
        parts.push(SectionEntry { id, title: recorded.sensor.clone() });
    }
    let body = html! {
        p.lead {
            "What the plant showed while it was learned from, and in each deployment. All plots of a sensor have the same \
             vertical axis. What a deployment shows beyond what was learned from is new to the "
            @if report.has_models() { "models" } @else { "agents" } "."
        }
        (common_caption(CAPTION))
        @for still in stills { (still) }
    };
    Ok(Section { id: "recorded", title: "Recorded", parts, body })
}
