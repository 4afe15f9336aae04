//! Commands that a message suggests to continue a job.

use crate::{Job, Request, Rollouts, Scope, StepKind, shell::shell_words};

impl Job {
    /// Returns the command that runs `step` on this job, with the same options and the same output folder.
    /// It can be pasted into a shell.
    pub fn command(&self, step: StepKind) -> String {
        let output = self.written.request.output.as_ref();
        // The study itself gives the path of a simulated log.
        let output = output.filter(|_| step != StepKind::Simulate);
        let output = output.map(|path| ["--output".to_owned(), path.display().to_string()]);
        shell_words(self.words(step).into_iter().chain(output.into_iter().flatten()))
    }

    /// Returns the command that runs every step.
    pub fn run_command(&self) -> String {
        self.command(StepKind::Prepare)
    }

    /// Returns the command that reproduces the results anywhere: [`Job::command`] without the output folder.
    pub fn reproduction(&self, step: StepKind) -> String {
        shell_words(self.words(step))
    }

    /// Returns the commands that can follow a step of this job.
    pub fn next_commands(&self, step: StepKind) -> Vec<String> {
        let next = step.next().iter().filter(|next| self.study().needs(**next));
        next.map(|next| self.command(*next)).collect()
    }

    fn words(&self, step: StepKind) -> Vec<String> {
        let Request { study, set, profile, .. } = &self.written.request;
        let scope = step.scope();
        let model = self.model.as_ref().filter(|_| scope != Scope::Study);
        let deployment = self.deployment.as_ref().filter(|_| match scope {
            Scope::Study | Scope::Model => false,
            Scope::Rollouts => self.layout.rollouts() == Some(Rollouts::OfDeployment),
            Scope::Deployment => true,
        });
        let options = [("--profile", profile.as_ref())]
            .into_iter()
            .chain(set.iter().map(|text| ("--set", Some(text))))
            .chain([("--model", model), ("--deployment", deployment)]);
        let options =
            options.filter_map(|(option, value)| Some([option.to_owned(), value?.clone()]));
        ["calib".to_owned(), step.command().to_owned(), study.display().to_string()]
            .into_iter()
            .chain(options.flatten())
            .collect()
    }
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
        let job = job(|request| {
            request.set = vec!["sweep.sensors=[\"A\"]".to_owned(), "agent.gamma=0.9".to_owned()];
            request.profile = Some("tiny".to_owned());
            request.model = Some("b".to_owned());
            request.deployment = Some("april".to_owned());
            request.output = Some("it's here".into());
        });
        let given =
            "'a study.toml' --profile tiny --set 'sweep.sensors=[\"A\"]' --set 'agent.gamma=0.9'";
        let output = "--output \"it's here\"";
        assert_eq!(
            job.command(StepKind::Sweep),
            format!("calib sweep {given} --model b --deployment april {output}")
        );
        assert_eq!(
            job.command(StepKind::BuildModel),
            format!("calib build-model {given} --model b {output}")
        );
        assert_eq!(job.command(StepKind::Pretrain), format!("calib pretrain {given} {output}"));
        assert_eq!(job.command(StepKind::Simulate), format!("calib simulate {given}"));
        assert_eq!(job.reproduction(StepKind::Prepare), format!("calib run {given}"));
    }

    fn names_deployment(start: &str) -> bool {
        let job = job(|request| {
            request.set = vec![format!("rollout.start={start}")];
            request.deployment = Some("april".to_owned());
        });
        job.command(StepKind::Rollout).contains("--deployment")
    }

    #[test]
    fn rollouts_name_the_deployment_that_they_follow_from() {
        assert!(names_deployment("recent") && !names_deployment("random"));
    }
}
