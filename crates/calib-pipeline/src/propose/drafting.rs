//! Drafts of the study that is proposed.

use calib_propose::{Asked, Cut, Draft, Horizon, Sensors, Size, horizon};

use super::look::Look;
use crate::{
    base::options::ProposeOptions,
    output::{Printer, span},
};

/// What all drafts of a study have in common.
pub(super) struct Drafting<'a> {
    pub(super) args: &'a ProposeOptions,
    /// `data.path`.
    pub(super) path: &'a str,
    pub(super) look: &'a Look,
}

impl Drafting<'_> {
    /// The study; `words` say why it has its spacing, agent and size.
    pub(super) fn text(
        &self,
        spacing: usize,
        cut: &Cut,
        sensors: &Sensors,
        horizon: Horizon,
        size: &Size,
        words: [&str; 3],
    ) -> String {
        let Self { args, path, look } = self;
        Draft {
            sketch: &look.sketch,
            path,
            scope: &look.scope,
            cut,
            cleaning: &look.cleaning,
            missing_values: &look.sentinels,
            clock: look.clock,
            spacing: (spacing, words[0]),
            sensors,
            horizon,
            size,
            agent_reason: words[1],
            size_reason: words[2],
            asked: Asked { sensors: !args.sensors.is_empty(), horizon: args.horizon.is_some() },
        }
        .text()
    }

    /// How far ahead runs of so many steps predict.
    pub(super) fn ahead(&self, spacing: usize, steps: usize) -> Horizon {
        let sketch = &self.look.sketch;
        match self.args.horizon {
            Some(secs) => Horizon::new(secs, sketch.period_secs * spacing as f64),
            None => horizon(sketch, &self.look.sensors.proposed, spacing, steps),
        }
    }

    /// Steps of a run at most.
    pub(super) fn most_steps(&self, spacing: usize) -> usize {
        Size::most_steps(self.look.cut.rows[1] / spacing)
    }

    /// What is said of a size that takes `expected_secs`, `sweep_secs` of them for the sweep, where looking and trying took
    /// `tried_secs`.
    pub(super) fn size_reason(
        &self,
        expected_secs: f64,
        sweep_secs: f64,
        tried_secs: f64,
        printer: &Printer,
    ) -> String {
        let within = self.args.within;
        let [asked, tried, expected] =
            [within, tried_secs.round(), expected_secs.round()].map(span);
        if expected_secs.round() > (within - tried_secs).max(0.0) {
            printer.warn(&format!(
                "{asked} are not enough for the smallest study that says anything: `calib init` took {tried}, and `calib run` will take about {expected}"
            ));
        }
        format!(
            "Sized to end within {asked}, of which `calib init` took {tried}: about {expected} on this machine, {} of them for the sweep",
            span(sweep_secs.round())
        )
    }
}
