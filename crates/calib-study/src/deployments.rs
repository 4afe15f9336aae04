//! Named held-out periods: `[deployments.NAME]` gives the time at which an agent starts at the plant.

use calib_data::{Moment, TimeRange};

use crate::{
    Study,
    error::{Problem, refuse, require},
    overlay::check_names,
};

impl Study {
    /// Returns the names of the deployments in order of time.
    pub fn deployment_names(&self) -> Vec<String> {
        let mut all: Vec<(&String, &TimeRange)> = self.deployments.iter().collect();
        all.sort_by_key(|(name, range)| {
            let start = range.start.as_ref().map(Moment::instant);
            let end = range.end.as_ref().map(Moment::instant);
            (start, end, *name)
        });
        all.into_iter().map(|(name, _)| name.clone()).collect()
    }

    /// Makes the deployment called `name` the held-out period of the study, and removes all deployments.
    /// Without a name, all deployments stay.
    pub(crate) fn choose_deployment(&mut self, name: Option<&str>) -> Result<(), Problem> {
        let Some(name) = name else { return Ok(()) };
        let names = self.deployment_names();
        let mut deployments = std::mem::take(&mut self.deployments);
        let Some(range) = deployments.remove(name) else {
            if names.is_empty() {
                refuse!("--deployment {name}: the study has no [deployments]");
            }
            refuse!("--deployment {name}: the study's deployments are {}", names.join(", "));
        };
        self.data.held_out = Some(range);
        Ok(())
    }

    /// Checks that each name can be the name of a directory, and that no deployment overlaps a training period.
    pub(crate) fn check_deployments(&self) -> Result<(), Problem> {
        if self.deployments.is_empty() {
            return Ok(());
        }
        check_names("deployments", self.deployments.keys())?;
        require!(
            self.data.held_out.is_none(),
            "data.held_out and [deployments] are both given: data.held_out is the one deployment of a study that \
             names none; make it a [deployments.NAME] of its own, and remove it from [data]"
        );
        let Some(train) = &self.data.train else {
            refuse!(
                "[deployments] want data.train, so that it is clear what is before them: \
                 give it, such as train = {{ start = 2022-04-01, end = 2023-04-01 }}"
            )
        };
        let learnt = [
            ("data.train", Some(train)),
            ("pretrain.period", self.pretrain.period.as_ref().filter(|_| self.pretrain.is_on())),
            ("model.period", self.model.period.as_ref()),
        ];
        for (name, range) in &self.deployments {
            if let TimeRange { start: Some(start), end: Some(end) } = range {
                require!(
                    start.instant() < end.instant(),
                    "deployments.{name} must start before it ends, got {range}"
                );
            }
            for (key, other) in learnt {
                require!(
                    !other.is_some_and(|other| overlap(range, other)),
                    "deployments.{name} ({range}) overlaps {key} ({}): an agent would be judged on rows that it learned from; move one of them",
                    other.map(ToString::to_string).unwrap_or_default()
                );
            }
        }
        Ok(())
    }
}

/// Whether two time ranges share an instant.
fn overlap(one: &TimeRange, other: &TimeRange) -> bool {
    !is_before(one, other) && !is_before(other, one)
}

/// Whether `one` ends before `other` starts, or exactly then.
fn is_before(one: &TimeRange, other: &TimeRange) -> bool {
    let end = one.end.as_ref();
    end.zip(other.start.as_ref()).is_some_and(|(end, start)| end.instant() <= start.instant())
}

#[cfg(test)]
mod tests {
    use super::*;

    const STUDY: &str = "[data]\ntrain = { end = 2023-04-01 }\n[deployments.july]\nstart = 2023-07-01\nend = 2023-08-01\n\
        [deployments.april]\nstart = 2023-04-01\nend = 2023-05-01\n";

    fn study(text: &str) -> Study {
        toml::from_str(text).expect("valid")
    }

    fn refused(text: &str) -> String {
        study(text).check_deployments().expect_err("refused").to_string()
    }

    #[test]
    fn one_deployment_is_what_is_held_out() {
        let all = study(STUDY);
        all.check_deployments().expect("valid");
        assert_eq!(all.deployment_names(), ["april", "july"]);
        let mut one = all.clone();
        one.choose_deployment(Some("july")).expect("there is one");
        let held_out = "[data]\ntrain = { end = 2023-04-01 }\nheld_out = { start = 2023-07-01, end = 2023-08-01 }";
        assert_eq!(one, study(held_out));
        let unknown = all.clone().choose_deployment(Some("may")).expect_err("unknown").to_string();
        assert_eq!(unknown, "--deployment may: the study's deployments are april, july");
        let none = study("").choose_deployment(Some("may")).expect_err("none").to_string();
        assert!(none.ends_with("has no [deployments]"), "{none}");
    }

    #[test]
    fn windows_lie_outside_what_is_learnt_from() {
        let early = refused(&STUDY.replace("start = 2023-04-01\n", "start = 2023-03-31\n"));
        assert!(
            early.starts_with("deployments.april (2023-03-31 .. 2023-05-01) overlaps data.train (beginning of the log .. 2023-04-01)"),
            "{early}"
        );
        let open = refused(&STUDY.replace("start = 2023-04-01\n", ""));
        assert!(open.contains("overlaps data.train"), "{open}");
        let pretrain = format!(
            "{STUDY}[pretrain]\nepochs = 1\nperiod = {{ start = 2023-07-30, end = 2023-09-01 }}\n"
        );
        assert!(
            refused(&pretrain).contains("deployments.july")
                && refused(&pretrain).contains("pretrain.period")
        );
        let backwards = refused(&STUDY.replace("end = 2023-08-01", "end = 2023-06-01"));
        assert!(backwards.contains("must start before it ends"), "{backwards}");
    }

    #[test]
    fn there_is_one_way_to_hold_out() {
        let both =
            refused(&STUDY.replacen("[data]\n", "[data]\nheld_out = { start = 2023-09-01 }\n", 1));
        assert!(both.contains("both given"), "{both}");
        let without = refused(&STUDY.replacen("train = { end = 2023-04-01 }\n", "", 1));
        assert!(without.contains("want data.train"), "{without}");
        let name = refused(&STUDY.replace("deployments.july", "deployments.\"a/b\""));
        assert!(name.contains("[deployments.\"a/b\"]"), "{name}");
    }
}
