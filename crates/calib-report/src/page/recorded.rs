//! The section of what was recorded, period by period.

use maud::html;

use super::figure::still;
use super::{Part, Section};
use crate::{Report, ReportError};

/// One figure a sensor.
pub(super) fn recorded(report: &Report) -> Result<Section, ReportError> {
    let (mut stills, mut parts) = (Vec::new(), Vec::new());
    for (index, recorded) in report.recorded.iter().enumerate() {
        let figure = recorded.figure()?;
        let id = format!("recorded-{index}");
        stills.push(still(&figure, &id, &figure.chart().description));
        parts.push(Part { id, title: recorded.sensor.clone() });
    }
    let body = html! {
        p.lead {
            "What the plant showed while it was learned from, and in each deployment. All plots of a sensor have the same \
             vertical axis. What a deployment shows beyond the first plot is new to the model, whose rollouts cannot leave \
             what was recorded."
        }
        @for still in stills { (still) }
    };
    Ok(Section { id: "recorded", title: "Recorded", parts, body })
}
