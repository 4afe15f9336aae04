//! Prints a proposal in a few lines.

use calib_base::{
    StepError,
    outcome::Told,
    output::{Printer, count, duration, span},
};
use calib_propose::Lacking;
use calib_study::shell_words;

use super::{Chosen, ProposedStudy, alternatives::OtherTrials};

impl Told<()> for ProposedStudy {
    fn tell(&self, _of: &(), printer: &Printer) -> Result<(), StepError> {
        if printer.is_json() {
            printer.json(&self.chosen)?;
        } else {
            lines(self).iter().try_for_each(|line| printer.result(line))?;
        }
        printer.say(&format!("looked and tried for {}", duration(self.took)));
        let study = shell_words([self.study().display().to_string()]);
        printer.next(&[format!("calib run {study}")]);
        Ok(())
    }
}

fn lines(proposed: &ProposedStudy) -> Vec<String> {
    let ProposedStudy { chosen, of_channels, lacking, learning_rates, within, .. } = proposed;
    let [train, held_out] = chosen.rows.map(count);
    let lacking = lacking.each_ref().map(|lacking| {
        lacking.as_ref().map_or_else(String::new, |Lacking { rows, channel }| {
            format!(" (less about {} that lack {channel:?} for long)", count(*rows))
        })
    });
    let time = match chosen.expected_secs {
        Some(secs) => format!("{}{}", beside_within(secs, *within), processors(chosen)),
        None => format!("how long they take was not measured in {}", span(*within)),
    };
    let mut lines = vec![
        format!(
            "{}: {} of {of_channels} channels, {train} rows to learn from{}, {held_out} held out{}",
            chosen.study.display(),
            chosen.channels,
            lacking[0],
            lacking[1]
        ),
        format!(
            "a state every {}; {} predicted {} ahead (gamma {})",
            span(chosen.state_secs),
            chosen.sensors.join(", "),
            span(chosen.horizon_secs),
            chosen.gamma
        ),
        chosen.agent_reason.clone(),
    ];
    lines.extend(chosen.other_trials.as_ref().map(OtherTrials::told));
    lines.push(format!(
        "{learning_rates} learning rates, runs of {} steps: {time}",
        count(chosen.steps)
    ));
    lines
}

/// Compares the time of a study with the requested time, in seconds.
pub(super) fn beside_within(secs: f64, within: f64) -> String {
    let [expected, asked] = [secs.round(), within].map(span);
    if secs.round() > within {
        format!("about {expected}, more than the {asked} that were asked for")
    } else {
        format!("about {expected} of the {asked} that were asked for")
    }
}

/// Returns the words on processor time.
fn processors(chosen: &Chosen) -> String {
    chosen
        .expected_processor_secs
        .map(|secs: f64| format!(" ({} of processor time)", span(secs.round())))
        .unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_study_that_takes_longer_than_was_asked_for_is_said_to() {
        assert_eq!(beside_within(3.6, 4.0), "about 4 s of the 4 s that were asked for");
        assert_eq!(beside_within(6.2, 4.0), "about 6 s, more than the 4 s that were asked for");
    }
}
