//! One job per model and deployment of a study.

use crate::{Job, Scope, StudyError};

impl Job {
    /// Returns one job per compared model, with the chosen deployment. Returns the job itself if a model is chosen,
    /// or if the study has only one model, which has no name.
    ///
    /// # Errors
    /// If a value is not valid in a model.
    pub fn models(&self) -> Result<Vec<Self>, StudyError> {
        let names = match self.model {
            Some(_) => Vec::new(),
            None => crate::models::names(&self.written.table),
        };
        if names.is_empty() {
            return Ok(vec![self.clone()]);
        }
        names.iter().map(|name| self.choose(Some(name), self.deployment())).collect()
    }

    /// Returns the jobs that a step of this scope runs on: the job itself if the study has no several parts.
    ///
    /// # Errors
    /// If a value is not valid in one of the jobs, or a deployment is chosen where the scope has none.
    pub fn parts(&self, scope: Scope) -> Result<Vec<Self>, StudyError> {
        match scope {
            Scope::Study => {
                self.refuse_deployment()?;
                Ok(vec![self.clone()])
            }
            Scope::Model => {
                self.refuse_deployment()?;
                self.models()
            }
            Scope::Deployment => self.of_deployments(),
            Scope::Rollouts => once_where_shared(self.of_deployments()?),
        }
    }

    fn of_deployments(&self) -> Result<Vec<Self>, StudyError> {
        let models = self.models()?;
        let names = match self.deployment {
            Some(_) => Vec::new(),
            None => self.whole()?.deployment_names(),
        };
        if names.is_empty() {
            return Ok(models);
        }
        models
            .iter()
            .flat_map(|model| {
                names.iter().map(|name| model.choose(model.model(), Some(name))).collect::<Vec<_>>()
            })
            .collect()
    }

    /// Refuses a chosen deployment. Steps before the rollouts do not depend on deployments.
    ///
    /// # Errors
    /// If a deployment is chosen.
    pub fn refuse_deployment(&self) -> Result<(), StudyError> {
        match self.deployment {
            None => Ok(()),
            Some(_) => Err(StudyError::Value(
                "--deployment is for rollout, sweep and evaluate: what this command makes is the same for every \
                 deployment; leave it out"
                    .to_owned(),
            )),
        }
    }

    /// Returns the same job without a chosen deployment.
    ///
    /// # Errors
    /// If a value is valid only together with a deployment.
    pub fn before_deployment(&self) -> Result<Self, StudyError> {
        self.choose(self.model(), None)
    }

    /// Returns the name of this part of the study: `model a, deployment april`.
    pub fn name(&self) -> String {
        let model = self.model.as_ref().map(|name| format!("model {name}"));
        let deployment = self.deployment.as_ref().map(|name| format!("deployment {name}"));
        model.into_iter().chain(deployment).collect::<Vec<_>>().join(", ")
    }

    /// Whether both jobs have the same model and deployment chosen, if any.
    pub fn is_same_part(&self, other: &Self) -> bool {
        self.model == other.model && self.deployment == other.deployment
    }

    /// Lists the options that would choose one of several `parts`: `--model NAME (a, b)`.
    pub fn missing_names(&self, parts: &[Self]) -> Vec<String> {
        let model = self.model.is_none().then(|| named_once(parts, Self::model));
        let deployment = self.deployment.is_none().then(|| named_once(parts, Self::deployment));
        [("--model", model), ("--deployment", deployment)]
            .into_iter()
            .filter_map(|(option, names)| Some((option, names.filter(|names| !names.is_empty())?)))
            .map(|(option, names)| format!("{option} NAME ({names})"))
            .collect()
    }
}

/// Lists the names that the parts have, each once.
fn named_once(parts: &[Job], name_of: fn(&Job) -> Option<&str>) -> String {
    let mut once: Vec<&str> = Vec::new();
    for name in parts.iter().filter_map(name_of) {
        if !once.contains(&name) {
            once.push(name);
        }
    }
    once.join(", ")
}

/// Keeps the first of the parts that share their rollouts. It then has no deployment.
fn once_where_shared(parts: Vec<Job>) -> Result<Vec<Job>, StudyError> {
    let mut directories = Vec::new();
    let mut kept = Vec::new();
    for part in parts {
        let directory = part.layout().rollout();
        if !directories.contains(&directory) {
            directories.push(directory);
            let follow = part.study().starts_follow_from_deployment();
            kept.push(if follow { part } else { part.before_deployment()? });
        }
    }
    Ok(kept)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Request;

    const STUDY: &str = "[data]\npath = \"logs\"\ntrain = { end = 2023-04-01 }\n\
        [deployments.july]\nstart = 2023-07-01\nend = 2023-08-01\n\
        [deployments.april]\nstart = 2023-04-01\nend = 2023-05-01\n\
        [models.a]\nmodel.members = 4\n[models.b]\nrollout.start = \"recent\"\n";

    fn names(jobs: Result<Vec<Job>, StudyError>) -> Vec<String> {
        jobs.expect("valid").iter().map(Job::name).collect()
    }

    #[test]
    fn parts_are_models_and_deployments_in_order() {
        let job = Job::of_text(Request::new("s.toml"), STUDY.to_owned()).expect("valid");
        assert_eq!(names(job.parts(Scope::Model)), ["model a", "model b"]);
        let all = [
            "model a, deployment april",
            "model a, deployment july",
            "model b, deployment april",
            "model b, deployment july",
        ];
        assert_eq!(names(job.parts(Scope::Deployment)), all);
        // All deployments share rollouts from random start states.
        assert_eq!(names(job.parts(Scope::Rollouts)), ["model a", all[2], all[3]]);
        let one = job.choose(Some("b"), Some("july")).expect("valid");
        assert_eq!(names(one.parts(Scope::Deployment)), ["model b, deployment july"]);
        assert_eq!(
            one.layout().sweep(),
            std::path::Path::new("s-results/models/b/deployments/july/sweep")
        );
        assert!(one.parts(Scope::Model).is_err() && one.models().is_ok());
        assert_eq!(
            one.study().data.held_out.as_ref().map(ToString::to_string).as_deref(),
            Some("2023-07-01 .. 2023-08-01")
        );
        let missing = job.missing_names(&job.parts(Scope::Deployment).expect("valid"));
        assert_eq!(missing, ["--model NAME (a, b)", "--deployment NAME (april, july)"]);
    }

    #[test]
    fn a_study_without_several_is_one_part() {
        let job = Job::of_text(Request::new("s.toml"), "[data]\npath = \"logs\"\n".to_owned());
        let job = job.expect("valid");
        let parts = job.parts(Scope::Rollouts).expect("valid");
        assert!(parts.len() == 1 && parts[0].is_same_part(&job) && parts[0].name().is_empty());
        let unknown = job.choose(Some("a"), None).expect_err("no models").to_string();
        assert_eq!(
            unknown,
            "s.toml: --model a: the study has no [models.a], nor any other [models] section; add it, or leave --model out"
        );
    }
}
