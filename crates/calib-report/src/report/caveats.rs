//! Caveats: what to know before relying on verdicts, each mentioned once.

use calib_core::percent;

use super::sentence::listed;
use super::{ChoiceBaseline, Grade, Separation, Verdict};

/// Rankings with a smaller correlation than this contradict each other. Our choice.
const CONTRADICTS: f64 = -0.5;

/// A smaller advantage of a random setting means nothing.
const AS_GOOD: f64 = 0.01;

/// Returns the caveats of verdicts: their notes, and held-out data that shows no differences. A caveat of all verdicts has no names.
/// Other caveats name their sensors, and their models if other models of the sensor do not have the caveat.
pub fn caveats(verdicts: &[Verdict]) -> Vec<String> {
    let mut told: Vec<(String, Vec<&Verdict>)> = Vec::new();
    for verdict in verdicts {
        for caveat in verdict.caveats() {
            match told.iter_mut().find(|(text, _)| *text == caveat) {
                Some((_, about)) => about.push(verdict),
                None => told.push((caveat, vec![verdict])),
            }
        }
    }
    told.into_iter().map(|(text, about)| placed(text, &about, verdicts)).collect()
}

/// Adds the sensors or models that a caveat is about, unless it is about all.
fn placed(text: String, noted: &[&Verdict], all: &[Verdict]) -> String {
    if noted.len() == all.len() {
        return text;
    }
    let mut about: Vec<String> = Vec::new();
    for verdict in noted {
        let sensor = &verdict.sensor;
        let own = all.iter().filter(|other| other.sensor == *sensor).count();
        let own_noted = noted.iter().filter(|other| other.sensor == *sensor).count();
        let name =
            if own_noted == own { sensor.clone() } else { format!("{sensor}, {}", verdict.model) };
        if !about.contains(&name) {
            about.push(name);
        }
    }
    let separated = about.iter().any(|name| name.contains(", "));
    let about = if separated { about.join("; ") } else { listed(&about) };
    format!("{about}: {text}")
}

impl Verdict {
    fn caveats(&self) -> Vec<String> {
        let alike = self
            .online
            .as_ref()
            .filter(|online| online.values == Separation::Alike && self.values > 1);
        let alike = alike.filter(|online| !online.stands_still && online.regret.is_some());
        let alike = alike.map(|_| {
            "on held-out data all settings have the same error, so nothing there shows which is better. This happens if the scored steps end before the first update: use a larger sweep.steps, or a smaller agent.batch_size"
                .to_owned()
        });
        let of_verdict = self.misordered().into_iter().chain(self.parts_disagree());
        alike.into_iter().chain(of_verdict).chain(self.notes.iter().cloned()).collect()
    }

    /// Returns a caveat if held-out data ranks the settings of a deployable choice in another order than the evidence did.
    fn misordered(&self) -> Option<String> {
        let is_deployed = matches!(self.grade, Grade::Good | Grade::Fair)
            && self.without_learning().is_none()
            && self.evidence == Separation::Apart;
        let online = self.online.as_ref().filter(|_| is_deployed)?;
        let random = self.regret_of(ChoiceBaseline::Random)?;
        let own = self.regret()?;
        let spearman =
            online.spearman.filter(|spearman| *spearman < CONTRADICTS && self.values > 3);
        if random < own - AS_GOOD {
            return Some(format!(
                "on held-out data a random setting would have had {} regret on average, and the choice has {}, so the log did not show which setting is best; hold out more, or use longer runs (sweep.steps)",
                percent(random),
                percent(own)
            ));
        }
        spearman.map(|spearman| {
            format!(
                "held-out data ranks the settings the other way round (Spearman {spearman:.2}), so the log did not show which setting is best; hold out more, or use longer runs (sweep.steps)"
            )
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::sentence::tests::verdict;
    use super::*;

    fn noted(sensor: &str, model: &str, notes: &[&str]) -> Verdict {
        Verdict {
            sensor: sensor.to_owned(),
            model: model.to_owned(),
            notes: notes.iter().copied().map(ToOwned::to_owned).collect(),
            ..verdict()
        }
    }

    #[test]
    fn what_holds_of_all_is_said_once() {
        let verdicts = [
            noted("A", "kNN", &["few horizons", "runs diverged"]),
            noted("A", "nn", &["few horizons", "runs diverged"]),
            noted("B", "kNN", &["few horizons", "no update"]),
            noted("B", "nn", &["few horizons"]),
        ];
        assert_eq!(caveats(&verdicts), ["few horizons", "A: runs diverged", "B, kNN: no update"]);
        let sensors = ["A", "B", "C"]
            .map(|sensor| noted(sensor, "kNN", if sensor == "C" { &[] } else { &["tie"] }));
        assert_eq!(caveats(&sensors), ["A and B: tie"]);
    }

    #[test]
    fn a_choice_that_a_random_one_would_beat_is_a_caveat() {
        let mut verdict = verdict();
        assert_eq!(caveats(std::slice::from_ref(&verdict)), [""; 0]);
        let random =
            verdict.alternatives.iter_mut().find(|other| other.baseline == ChoiceBaseline::Random);
        random.unwrap().regret.as_mut().unwrap().value = 0.002;
        let told = caveats(std::slice::from_ref(&verdict));
        assert!(told[0].contains("a random setting would have had 0.2 % regret"), "{told:?}");
        let random =
            verdict.alternatives.iter_mut().find(|other| other.baseline == ChoiceBaseline::Random);
        random.unwrap().regret.as_mut().unwrap().value = 0.9;
        verdict.online.as_mut().unwrap().spearman = Some(-0.8);
        let told = caveats(std::slice::from_ref(&verdict));
        assert!(told[0].contains("the other way round (Spearman -0.80)"), "{told:?}");
        // A choice that must not be deployed needs no warning.
        verdict.grade = Grade::Poor;
        assert_eq!(caveats(&[verdict]), [""; 0]);
    }

    #[test]
    fn held_out_data_that_tells_nothing_is_a_caveat() {
        let mut alike = verdict();
        assert_eq!(caveats(std::slice::from_ref(&alike)), [""; 0]);
        alike.online.as_mut().unwrap().values = Separation::Alike;
        let told = caveats(std::slice::from_ref(&alike));
        assert!(told[0].contains("the same error"), "{told:?}");
        // A constant sensor has a caveat of its own.
        alike.online.as_mut().unwrap().stands_still = true;
        assert_eq!(caveats(&[alike]), [""; 0]);
    }
}
