//! Drafts of the proposed study.

use calib_agent::Part;
use calib_base::{
    StepError, bail,
    options::ProposeOptions,
    output::{Printer, rounded, span},
};
use calib_core::Segments;
use calib_propose::{
    Asked, Cut, Draft, Horizon, LogDraft, MOST_WINDOWS, ProposedAgent, ProposedModel, Sensors,
    Size, horizon, mean_step_secs,
};
use calib_sweep::{ENOUGH_WINDOWS, ScoringDemand, Span, Windows};

use super::{look::ExaminedLog, trial};

/// Required length of held-out data, in horizons. A return is known after 4.6 horizons. Our choice.
const SCORED_HORIZONS: f64 = 10.0;

/// Rounds up to whole days, hours or minutes, if there are at least three of them.
fn rounded_up(secs: f64) -> f64 {
    let units = [86_400.0, 3_600.0, 60.0];
    let unit = units.into_iter().find(|unit| secs >= 3.0 * unit).unwrap_or(1.0);
    (secs / unit).ceil() * unit
}

/// Returns the longest horizon in whole units, as an argument, that `calib init` rounds to at most `states` states.
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

/// Warns if a study takes `expected_secs` and this is more than the rest of the requested time.
pub(super) fn warn_of_time(within: f64, tried_secs: f64, expected_secs: f64, printer: &Printer) {
    if expected_secs.round() <= (within - tried_secs).max(0.0) {
        return;
    }
    let [asked, tried, expected] = [within, tried_secs.round(), expected_secs.round()].map(span);
    printer.warn(&format!(
        "{asked} are not enough for the smallest study that says anything: `calib init` took {tried}, and `calib run` will take about {expected}"
    ));
}

/// Warns that the requested time ended before the study's time was measured. Returns the reason for the small study.
pub(super) fn unmeasured(within: f64, printer: &Printer) -> String {
    let asked = span(within);
    printer.warn(&format!(
        "the {asked} of --within ended before `calib init` could measure how long a study takes, so the study is the smallest that says \
         anything: `calib run --dry-run` estimates its time, and a longer --within allows a larger one"
    ));
    format!("the {asked} of --within ended before it was measured how long a study takes")
}

/// The inputs that all drafts of a study share.
pub(super) struct Drafting<'a> {
    pub(super) args: &'a ProposeOptions,
    /// The options as the user gave them, without the channels that calib excludes.
    pub(super) asked: &'a ProposeOptions,
    /// `data.path`.
    pub(super) path: &'a str,
    pub(super) look: &'a ExaminedLog,
    /// The held-out states, once they are known. Before that, every held-out row is taken to have values.
    pub(super) held_out: Option<Segments>,
}

impl Drafting<'_> {
    /// Returns the text of a trial within the training range.
    pub(super) fn trial_text(
        &self,
        model: ProposedModel,
        agent: ProposedAgent,
        spacing: usize,
        sensors: &Sensors,
        horizon: Horizon,
    ) -> String {
        let times = &self.look.sketch.timestamps;
        let inside = self.look.cut.shortened(times, trial::ROWS * spacing).inside(times);
        let steps = Size::most_steps(inside.rows[1] / spacing, horizon.states);
        let size = Size::comparison(agent, model, steps, sensors.proposed.len());
        self.text(spacing, &inside, sensors, horizon, &size, [""; 4])
    }

    /// Returns the text of the study. `words` are the reasons for its spacing, agent and size, and the simple predictor
    /// that agents start from.
    pub(super) fn text(
        &self,
        spacing: usize,
        cut: &Cut,
        sensors: &Sensors,
        horizon: Horizon,
        size: &Size,
        words: [&str; 4],
    ) -> String {
        let Self { args, path, look, .. } = self;
        let held_out = self.held_out_states(cut, spacing);
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
            held_out_states: held_out,
            windows: windows(self.held_out.as_ref(), held_out, horizon, size),
            agent_reason: words[1],
            baseline: words[3],
            size_reason: words[2],
            asked: Asked { sensors: !args.sensors.is_empty(), horizon: args.horizon },
            given: &args.set,
        }
        .text()
    }

    /// Returns the horizon of the agents.
    pub(super) fn ahead(&self, spacing: usize) -> Horizon {
        let sketch = &self.look.sketch;
        if let Some(secs) = self.args.horizon {
            return Horizon::new(secs, sketch.period_secs * spacing as f64);
        }
        // Longer runs allow longer horizons. The horizon for runs of four windows shows whether four windows fit.
        self.proposed_horizon(spacing, self.proposed_horizon(spacing, 0.0).states)
    }

    /// Returns the horizon for runs as long as a horizon of this many states allows.
    fn proposed_horizon(&self, spacing: usize, states: f64) -> Horizon {
        let ExaminedLog { sketch, sensors, cut, .. } = self.look;
        horizon(sketch, &sensors.proposed, spacing, Size::most_steps(cut.rows[1] / spacing, states))
    }

    /// Returns the number of held-out states of a cut. It is an estimate until the held-out states are known.
    fn held_out_states(&self, cut: &Cut, spacing: usize) -> usize {
        self.held_out.as_ref().map_or(cut.rows[1] / spacing, Segments::rows)
    }

    /// Returns the largest number of steps per run for this horizon.
    pub(super) fn most_steps(&self, spacing: usize, horizon: Horizon) -> usize {
        Size::most_steps(self.held_out_states(&self.look.cut, spacing), horizon.states)
    }

    /// Returns a warning if the horizon is shorter than one state.
    pub(super) fn too_near(&self, spacing: usize) -> Option<String> {
        let apart = self.look.sketch.period_secs * spacing as f64;
        // The sampling interval of a log is known to about a thousandth.
        let secs = self.args.horizon.filter(|secs| *secs < 0.99 * apart)?;
        let [asked, apart] = [secs, apart].map(span);
        Some(format!(
            "--horizon {asked} is shorter than one state, which is {apart}: the study predicts one state ahead, {apart} (gamma 0)"
        ))
    }

    /// Refuses a horizon that is longer than all held-out data.
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

    /// Returns a warning if the requested horizon was too long for the log.
    pub(super) fn too_far(&self, horizon: Horizon) -> Option<String> {
        let asked = self.args.horizon.filter(|secs| horizon.is_shorter_than(*secs))?;
        let [asked, used] = [asked, horizon.secs].map(span);
        Some(format!(
            "--horizon {asked} is too long for this log: no held-out step could be scored that far ahead, so the study predicts {used} ahead"
        ))
    }

    /// Returns a warning if the study has too few held-out windows to show a difference.
    pub(super) fn few_windows(
        &self,
        spacing: usize,
        horizon: Horizon,
        size: &Size,
    ) -> Option<String> {
        let state_secs = self.look.sketch.period_secs * spacing as f64;
        let held_out = self.held_out_states(&self.look.cut, spacing);
        let windows = windows(self.held_out.as_ref(), held_out, horizon, size);
        if windows >= ENOUGH_WINDOWS {
            return None;
        }
        let log = Size::states_of_four_windows(horizon.states) / calib_propose::HELD_OUT;
        let row_secs = mean_step_secs(&self.look.sketch, &self.look.scope);
        // The next proposal divides the log slightly differently, hence the margin.
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

    /// Returns the reason for a size that takes `expected_secs`, with `sweep_secs` for the sweep. Examining the log and
    /// trials took `tried_secs`.
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

/// Counts the windows of a sweep of this size, as the sweep does. Without known held-out states, they are `estimated` states
/// without a gap.
fn windows(held_out: Option<&Segments>, estimated: usize, horizon: Horizon, size: &Size) -> usize {
    let Some(states) = held_out else { return size.windows(estimated, horizon) };
    let demand = ScoringDemand {
        span: Span::new(size.steps, [horizon.gamma]),
        gamma: horizon.gamma,
        part: Part::WholeRun,
    };
    Windows::held_out(states, demand, MOST_WINDOWS.min(size.online_runs)).starts.len()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the number of windows of 444 steps for pieces of these lengths.
    fn windows_of(pieces: &[usize], horizon_states: f64) -> usize {
        let states = Segments::from_lengths(pieces.iter().copied()).expect("valid");
        let horizon = Horizon::new(horizon_states, 1.0);
        let size = Size {
            online_runs: 4,
            ..Size::trial(ProposedAgent::Linear, ProposedModel::None, 444, 1)
        };
        windows(Some(&states), 0, horizon, &size)
    }

    #[test]
    fn windows_that_gaps_leave_nothing_of_do_not_count() {
        // A window has 465 states: returns of a horizon of 5 states need 21 states after the 444 steps.
        assert_eq!(windows_of(&[1_000], 5.0), 2);
        assert_eq!(windows_of(&[10_000], 5.0), 4, "no more than runs");
        let short = [10_usize; 47];
        assert_eq!(windows_of(&[&short[..], &[1_000]].concat(), 5.0), 2);
    }
}
