//! Advice by each part of the runs.

use calib_agent::SimplePredictor;

use super::sentence::listed;
use super::{PartRow, Recommendation, Verdict};

impl PartRow {
    /// Returns the advice in a word or two.
    pub(crate) fn advice(&self) -> String {
        match self.recommendation {
            Recommendation::Deploy => "deploy the choice".to_owned(),
            Recommendation::KeepDefault => "keep the default".to_owned(),
            Recommendation::UseSimplePredictor => format!("use {}", self.predictor()),
            Recommendation::DoNotDeploy => "deploy nothing".to_owned(),
            Recommendation::NotChecked => "not checked".to_owned(),
        }
    }

    /// Returns what is advised, as a noun.
    fn advised(&self) -> &'static str {
        match self.recommendation {
            Recommendation::Deploy => "an agent",
            Recommendation::KeepDefault => "the default",
            Recommendation::UseSimplePredictor => self.predictor(),
            Recommendation::DoNotDeploy => "nothing",
            Recommendation::NotChecked => "an agent that is not checked",
        }
    }

    fn predictor(&self) -> &'static str {
        self.simple.map_or("a simple predictor", SimplePredictor::label)
    }
}

impl Verdict {
    /// Returns a caveat if the advice is of another kind by some part of the runs. Another simple predictor is not.
    pub(super) fn parts_disagree(&self) -> Option<String> {
        let first = self.parts.first()?;
        if self.parts.iter().all(|part| part.recommendation == first.recommendation) {
            return None;
        }
        let mut groups: Vec<(&str, Vec<String>)> = Vec::new();
        for part in &self.parts {
            let name = format!("the {}", part.part);
            match groups.iter_mut().find(|(advised, _)| *advised == part.advised()) {
                Some((_, names)) => names.push(name),
                None => groups.push((part.advised(), vec![name])),
            }
        }
        let each: Vec<String> = groups
            .iter()
            .map(|(advised, names)| format!("{advised} over {}", listed(names)))
            .collect();
        Some(format!(
            "the advice depends on the part of each run that counts (sweep.scored): {}",
            each.join(", and ")
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::super::{caveats, sentence::tests::verdict};
    use super::*;
    use crate::Setting;

    fn part(
        part: &'static str,
        recommendation: Recommendation,
        simple: Option<SimplePredictor>,
    ) -> PartRow {
        PartRow {
            part,
            chosen: Setting::from(1e-4),
            error: Some(0.4),
            recommendation,
            simple,
            compared: simple,
            ratio: None,
        }
    }

    #[test]
    fn advice_that_differs_between_parts_is_a_caveat() {
        let deploy = Recommendation::Deploy;
        let simple = Recommendation::UseSimplePredictor;
        let persistence = Some(SimplePredictor::Persistence);
        let mut verdict = verdict();
        verdict.parts = vec![
            part("whole run", deploy, None),
            part("last three quarters", deploy, None),
            part("final quarter", simple, persistence),
        ];
        assert_eq!(
            caveats(std::slice::from_ref(&verdict)),
            [
                "the advice depends on the part of each run that counts (sweep.scored): an agent over the whole run and the last three quarters, and persistence over the final quarter"
            ]
        );
        assert_eq!(verdict.parts[2].advice(), "use persistence");
        // Two simple predictors are the same kind of advice.
        for (own, line) in verdict.parts.iter_mut().zip([true, false, false]) {
            let predictor = if line { SimplePredictor::Line } else { SimplePredictor::Persistence };
            *own = part(own.part, simple, Some(predictor));
        }
        assert_eq!(caveats(&[verdict]), [""; 0]);
    }
}
