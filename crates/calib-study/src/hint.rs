//! What to type to go on with a job.

use std::borrow::Cow;

use crate::{Job, Request, Rollouts};

/// Whose results a command makes.
enum Makes {
    /// Of the whole study, whatever model or deployment.
    OfStudy,
    /// Of a model.
    OfModel,
    /// Of a deployment of a model, unless the models' own serve for all.
    Rollouts,
    /// Of a deployment of a model.
    OfDeployment,
}

impl Makes {
    fn of(command: &str) -> Self {
        match command {
            "rollout" => Self::Rollouts,
            "sweep" | "evaluate" => Self::OfDeployment,
            "represent" | "build-model" => Self::OfModel,
            _ => Self::OfStudy,
        }
    }
}

impl Job {
    /// What to type to run `command` on this job: the same study with all that was given beside it, and the same results.
    /// It can be pasted into a shell.
    pub fn command(&self, command: &str) -> String {
        let output = self.written.request.output.as_ref().filter(|_| command != "simulate");
        let output = output.map(|path| ["--output".to_owned(), path.display().to_string()]);
        shell_words(self.words(command).into_iter().chain(output.into_iter().flatten()))
    }

    /// What makes the same results anywhere: [`Job::command`] without the place that they were to go to.
    pub fn reproduction(&self, command: &str) -> String {
        shell_words(self.words(command))
    }

    fn words(&self, command: &str) -> Vec<String> {
        let Request { study, set, profile, .. } = &self.written.request;
        let makes = Makes::of(command);
        let model = self.model.as_ref().filter(|_| !matches!(makes, Makes::OfStudy));
        let deployment = self.deployment.as_ref().filter(|_| match makes {
            Makes::OfStudy | Makes::OfModel => false,
            Makes::Rollouts => self.layout.rollouts() == Some(Rollouts::OfDeployment),
            Makes::OfDeployment => true,
        });
        let options = [("--profile", profile.as_ref())]
            .into_iter()
            .chain(set.iter().map(|text| ("--set", Some(text))))
            .chain([("--model", model), ("--deployment", deployment)]);
        let options =
            options.filter_map(|(option, value)| Some([option.to_owned(), value?.clone()]));
        ["calib".to_owned(), command.to_owned(), study.display().to_string()]
            .into_iter()
            .chain(options.flatten())
            .collect()
    }
}

/// Words as one types them in a shell.
pub fn shell_words<I: IntoIterator<Item: AsRef<str>>>(words: I) -> String {
    let quoted = |word: I::Item| {
        // Only a word with a null character cannot be typed, and none can be given either.
        shlex::try_quote(word.as_ref()).map_or_else(|_| word.as_ref().to_owned(), Cow::into_owned)
    };
    words.into_iter().map(quoted).collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    const STUDY: &str = "[data]\npath = \"logs\"\ntrain = { end = 2023-04-01 }\n[rollout]\nstart = \"recent\"\n\
        [deployments.april]\nstart = 2023-04-01\nend = 2023-05-01\n[models.b]\nmodel.members = 4\n\
        [profiles.tiny]\nseed = 2\n";

    fn job(change: impl FnOnce(&mut Request)) -> Job {
        let mut request = Request::new("a study.toml");
        change(&mut request);
        Job::of_text(request, STUDY.to_owned()).expect("valid")
    }

    #[test]
    fn a_command_carries_what_was_given() {
        let job = job(|of| {
            of.set = vec!["sweep.sensors=[\"A\"]".to_owned(), "agent.gamma=0.9".to_owned()];
            of.profile = Some("tiny".to_owned());
            of.model = Some("b".to_owned());
            of.deployment = Some("april".to_owned());
            of.output = Some("it's here".into());
        });
        let given =
            "'a study.toml' --profile tiny --set 'sweep.sensors=[\"A\"]' --set 'agent.gamma=0.9'";
        let output = "--output \"it's here\"";
        assert_eq!(
            job.command("sweep"),
            format!("calib sweep {given} --model b --deployment april {output}")
        );
        assert_eq!(
            job.command("build-model"),
            format!("calib build-model {given} --model b {output}")
        );
        assert_eq!(job.command("pretrain"), format!("calib pretrain {given} {output}"));
        assert_eq!(job.command("simulate"), format!("calib simulate {given}"));
        assert_eq!(job.reproduction("run"), format!("calib run {given}"));
    }

    #[test]
    fn rollouts_name_the_deployment_that_they_follow_from() {
        let of = |start: &str| {
            let job = job(|of| {
                of.set = vec![format!("rollout.start={start}")];
                of.deployment = Some("april".to_owned());
            });
            job.command("rollout").contains("--deployment")
        };
        assert!(of("recent") && !of("random"));
    }
}
