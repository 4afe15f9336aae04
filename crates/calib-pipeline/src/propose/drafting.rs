//! Drafts of the study that is proposed.

use calib_base::{
    StepError, bail,
    options::ProposeOptions,
    output::{Printer, rounded, span},
};
use calib_propose::{Asked, Cut, Draft, Horizon, LogDraft, Sensors, Size, horizon, mean_step_secs};
use calib_sweep::ENOUGH_WINDOWS;

use super::look::ExaminedLog;

/// Held-out data should be so many times as long as a horizon: returns take 4.6 horizons to be known. Our choice.
const SCORED_HORIZONS: f64 = 10.0;

/// To whole days of several, else to whole hours or minutes.
fn rounded_up(secs: f64) -> f64 {
    let units = [86_400.0, 3_600.0, 60.0];
    let unit = units.into_iter().find(|unit| secs >= 3.0 * unit).unwrap_or(1.0);
    (secs / unit).ceil() * unit
}

/// The longest horizon in whole units, as an argument, that is at most so many states as `calib init` rounds it.
fn within_states(states: f64, state_secs: f64) -> Option<String> {
    let secs = states * state_secs;
    let units = [(86_400.0, "d"), (3_600.0, "h"), (60.0, "m")];
    let (size, unit) = units.into_iter().find(|unit| secs >= 10.0 * unit.0).unwrap_or((1.0, "s"));
    let whole = (secs / size).floor() as u64;
    (1..=whole)
        .rev()
        .find(|count| Horizon::new(*count as f64 * size, state_secs).states <= states)
        .map(|count| format!("{count}{unit}"))
}

/// Say that a study takes `expected_secs`, where this is more than is left of the time asked for.
pub(super) fn warn_of_time(within: f64, tried_secs: f64, expected_secs: f64, printer: &Printer) {
    if expected_secs.round() <= (within - tried_secs).max(0.0) {
        return;
    }
    let [asked, tried, expected] = [within, tried_secs.round(), expected_secs.round()].map(span);
    printer.warn(&format!(
        "{asked} are not enough for the smallest study that says anything: `calib init` took {tried}, and `calib run` will take about {expected}"
    ));
}

/// Say that the time asked for was over before it was known what a study takes, and why the study is as small as it is.
pub(super) fn unmeasured(within: f64, printer: &Printer) -> String {
    let asked = span(within);
    printer.warn(&format!(
        "the {asked} of --within ended before `calib init` could measure how long a study takes, so the study is the smallest that says \
         anything: `calib run --dry-run` estimates its time, and a longer --within allows a larger one"
    ));
    format!("the {asked} of --within ended before it was measured how long a study takes")
}

/// What all drafts of a study have in common.
pub(super) struct Drafting<'a> {
    pub(super) args: &'a ProposeOptions,
    /// `data.path`.
    pub(super) path: &'a str,
    pub(super) look: &'a ExaminedLog,
}

impl Drafting<'_> {
    /// The study; `words` say why it has its spacing, agent and size, and what agents start from.
    pub(super) fn text(
        &self,
        spacing: usize,
        cut: &Cut,
        sensors: &Sensors,
        horizon: Horizon,
        size: &Size,
        words: [&str; 4],
    ) -> String {
        let Self { args, path, look } = self;
        Draft {
            log: LogDraft {
                sketch: &look.sketch,
                path,
                scope: &look.scope,
                cleaning: &look.cleaning,
                missing_values: &look.sentinels,
                angles: &look.angles,
                clock: look.clock,
            },
            cut,
            spacing: (spacing, words[0]),
            sensors,
            horizon,
            size,
            agent_reason: words[1],
            baseline: words[3],
            size_reason: words[2],
            asked: Asked { sensors: !args.sensors.is_empty(), horizon: args.horizon },
        }
        .text()
    }

    /// How far ahead agents predict.
    pub(super) fn ahead(&self, spacing: usize) -> Horizon {
        let sketch = &self.look.sketch;
        if let Some(secs) = self.args.horizon {
            return Horizon::new(secs, sketch.period_secs * spacing as f64);
        }
        let proposed = |states: f64| {
            let steps = Size::most_steps(self.look.cut.rows[1] / spacing, states);
            horizon(sketch, &self.look.sensors.proposed, spacing, steps)
        };
        // How far runs of four windows look says whether there are four: longer runs look further.
        proposed(proposed(0.0).states)
    }

    /// Steps of a run at most, of agents that predict so far ahead.
    pub(super) fn most_steps(&self, spacing: usize, horizon: Horizon) -> usize {
        Size::most_steps(self.look.cut.rows[1] / spacing, horizon.states)
    }

    /// What is said of a horizon that is nearer than the next state.
    pub(super) fn too_near(&self, spacing: usize) -> Option<String> {
        let apart = self.look.sketch.period_secs * spacing as f64;
        // The sampling interval of a log is known to a thousandth or so.
        let secs = self.args.horizon.filter(|secs| *secs < 0.99 * apart)?;
        let [asked, apart] = [secs, apart].map(span);
        Some(format!(
            "--horizon {asked} is shorter than one state, which is {apart}: the study predicts one state ahead, {apart} (gamma 0)"
        ))
    }

    /// Refuse a horizon that is longer than all held-out data.
    pub(super) fn refuse_beyond_held_out(&self) -> Result<(), StepError> {
        let [start, end] = self.look.cut.held_out;
        let held_out = end.micros_since(start) as f64 / 1e6;
        if let Some(asked) = self.args.horizon.filter(|secs| *secs > held_out) {
            bail!(
                "--horizon {}: that is too far for {} of held-out data. Ask for at most about {}, or export a longer log",
                span(asked),
                span(held_out),
                span(rounded(held_out / SCORED_HORIZONS, 1))
            );
        }
        Ok(())
    }

    /// What is said of a horizon that was too long for the log.
    pub(super) fn too_far(&self, horizon: Horizon) -> Option<String> {
        let asked = self.args.horizon.filter(|secs| horizon.is_shorter_than(*secs))?;
        let [asked, used] = [asked, horizon.secs].map(span);
        Some(format!(
            "--horizon {asked} is too long for this log: no held-out step could be scored that far ahead, so the study predicts {used} ahead"
        ))
    }

    /// What is said of a study that has too few held-out windows to show anything.
    pub(super) fn few_windows(
        &self,
        spacing: usize,
        horizon: Horizon,
        size: &Size,
    ) -> Option<String> {
        let state_secs = self.look.sketch.period_secs * spacing as f64;
        let held_out = self.look.cut.rows[1] / spacing;
        let windows = size.windows(held_out, horizon);
        if windows >= ENOUGH_WINDOWS {
            return None;
        }
        let log = Size::states_of_four_windows(horizon.states) / calib_propose::HELD_OUT;
        let row_secs = mean_step_secs(&self.look.sketch, &self.look.scope);
        // The next proposal cuts the log a little differently.
        let nearer = Size::longest_horizon_of_four_windows(held_out).map(|states| 0.9 * states);
        let nearer = nearer.filter(|states| *states >= 1.0 && *states < horizon.states);
        let shorter = nearer.and_then(|states| within_states(states, state_secs));
        let shorter = shorter.map_or_else(String::new, |nearer| format!(", or --horizon {nearer}"));
        let counted = if windows == 1 {
            "1 held-out window".to_owned()
        } else {
            format!("{windows} held-out windows")
        };
        Some(format!(
            "{counted}: hardly any difference can be shown with fewer than four. A log of {}{shorter} would give four",
            span(rounded_up(log * spacing as f64 * row_secs))
        ))
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
        warn_of_time(within, tried_secs, expected_secs, printer);
        let [asked, tried, expected] =
            [within, tried_secs.round(), expected_secs.round()].map(span);
        format!(
            "Sized to end within {asked}, of which `calib init` took {tried}: about {expected} on this machine, {} of them for the sweep",
            span(sweep_secs.round())
        )
    }
}
