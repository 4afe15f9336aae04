use std::{
    path::{Component, Path},
    sync::Arc,
};

use crate::{
    Layout, Policy, Request, Rollouts, Study, StudyError,
    profiles::Results,
    written::{RESULTS, WrittenStudy},
};

/// A resolved study: the text of the file, the chosen model and deployment, the folders of the results, and the
/// policy for existing results. All steps of a command share it.
#[derive(Clone, Debug)]
pub struct Job {
    pub(crate) written: Arc<WrittenStudy>,
    pub(crate) study: Arc<Study>,
    pub(crate) layout: Layout,
    pub(crate) model: Option<String>,
    pub(crate) deployment: Option<String>,
}

impl Job {
    /// Reads the study file that `request` names, applies the profile and the overrides, checks every section, and
    /// finds the folders of the results.
    ///
    /// # Errors
    /// If the file cannot be read, a key does not exist, or a value is not valid. The error gives the place.
    pub fn resolve(request: Request) -> Result<Self, StudyError> {
        Self::of(WrittenStudy::read(request)?)
    }

    /// Resolves `text` as if it were the content of the study file, as [`Job::resolve`] does.
    ///
    /// # Errors
    /// If a key does not exist, or a value is not valid.
    pub fn of_text(request: Request, text: String) -> Result<Self, StudyError> {
        Self::of(WrittenStudy::of_text(request, text)?)
    }

    fn of(written: WrittenStudy) -> Result<Self, StudyError> {
        let Request { model, deployment, .. } = written.request.clone();
        Self::choose_of(Arc::new(written), model, deployment)
    }

    fn choose_of(
        written: Arc<WrittenStudy>,
        model: Option<String>,
        deployment: Option<String>,
    ) -> Result<Self, StudyError> {
        let study = written.study(model.as_deref(), deployment.as_deref())?;
        let layout = layout(&written, &study, model.as_deref(), deployment.as_deref());
        Ok(Self { written, study: Arc::new(study), layout, model, deployment })
    }

    /// Chooses another model and deployment of the same study; `None` stands for all of them.
    ///
    /// # Errors
    /// If the study has no model or deployment of that name, or a value is not valid there.
    pub fn choose(
        &self,
        model: Option<&str>,
        deployment: Option<&str>,
    ) -> Result<Self, StudyError> {
        let model = model.map(str::to_owned);
        let deployment = deployment.map(str::to_owned);
        Self::choose_of(Arc::clone(&self.written), model, deployment)
    }

    /// Returns one sentence for each renamed key in the file, with its place and the new name.
    pub fn renamed_keys(&self) -> Vec<String> {
        self.written
            .source
            .renamed()
            .into_iter()
            .map(|(place, new)| {
                format!("{place}: this key is now called {new}; the old name still works")
            })
            .collect()
    }

    /// Returns the same job with another policy.
    #[must_use]
    pub fn under(&self, policy: Policy) -> Self {
        let mut written = WrittenStudy::clone(&self.written);
        written.request.policy = policy;
        Self { written: Arc::new(written), ..self.clone() }
    }

    /// The study of the chosen model and deployment.
    pub fn study(&self) -> &Study {
        &self.study
    }

    /// Returns the study as written, with all its models and deployments.
    ///
    /// # Errors
    /// If a value is valid only together with a model or a deployment.
    pub fn whole(&self) -> Result<Study, StudyError> {
        self.written.study(None, None)
    }

    /// The request that this job was resolved from.
    pub fn request(&self) -> &Request {
        &self.written.request
    }

    /// The text of the study file when it was read.
    pub fn text(&self) -> &str {
        self.written.text()
    }

    /// The folders of the results.
    pub fn layout(&self) -> &Layout {
        &self.layout
    }

    /// The policy for existing and missing results.
    pub fn policy(&self) -> Policy {
        self.written.request.policy
    }

    /// Name of the profile that was applied to the study.
    pub fn profile(&self) -> Option<&str> {
        self.written.request.profile.as_deref()
    }

    /// Name of the chosen model, if the study has several.
    pub fn model(&self) -> Option<&str> {
        self.model.as_deref()
    }

    /// Name of the model: the one in the study, or its kind if the study has only one model.
    pub fn model_name(&self) -> &str {
        self.model().unwrap_or_else(|| self.study().model_name())
    }

    /// Name of the chosen deployment, if the study has several.
    pub fn deployment(&self) -> Option<&str> {
        self.deployment.as_deref()
    }

    /// Returns the title for reports: the title in the study, the name of its file, the name of its log, or its sensors.
    /// Names that would fit any study are skipped.
    pub fn title(&self) -> String {
        self.own_title().unwrap_or_else(|| self.sensors())
    }

    /// Returns the title unless only the sensors are left to name the study.
    pub fn own_title(&self) -> Option<String> {
        let title = self.study.evaluate.title.clone();
        title
            .or_else(|| file_stem(&self.written.request).filter(|stem| says_something(stem)))
            .or_else(|| self.log_name())
    }

    /// Returns the last part of the log's path that identifies it: neither a pattern nor a general word such as `data`.
    fn log_name(&self) -> Option<String> {
        let [path] = &self.study.data.path.0[..] else { return None };
        let parts = Path::new(path).components().rev();
        let stems = parts.filter_map(|part| match part {
            Component::Normal(name) => {
                Some(Path::new(name).file_stem()?.to_string_lossy().into_owned())
            }
            _ => None,
        });
        stems.into_iter().find(|stem| says_something(stem))
    }

    /// Lists the sensors: "PIT300, TIT101 and 3 more sensors".
    fn sensors(&self) -> String {
        const NAMED: usize = 3;
        let sensors = &self.study.sweep.sensors;
        match sensors.split_at_checked(NAMED) {
            Some((first, more @ [_, _, ..])) => {
                format!("{} and {} more sensors", first.join(", "), more.len())
            }
            _ if sensors.is_empty() => "A study".to_owned(),
            _ => match sensors.split_last() {
                Some((last, others @ [_, ..])) => format!("{} and {last}", others.join(", ")),
                _ => sensors.concat(),
            },
        }
    }
}

/// Whether a file name identifies its study or log. General words and patterns do not.
fn says_something(stem: &str) -> bool {
    const ANY: [&str; 10] =
        ["study", "log", "logs", "data", "results", "raw", "input", "history", "export", "test"];
    let is_pattern = stem.contains(['*', '?', '{', '$']);
    !stem.is_empty() && !is_pattern && !ANY.contains(&stem.to_lowercase().as_str())
}

fn file_stem(request: &Request) -> Option<String> {
    request.study.file_stem().map(|stem| stem.to_string_lossy().into_owned())
}

/// Returns the folders of the results of a model and a deployment.
fn layout(
    written: &WrittenStudy,
    study: &Study,
    model: Option<&str>,
    deployment: Option<&str>,
) -> Layout {
    let WrittenStudy { request, results, .. } = written;
    let folder = request.study.parent().unwrap_or(Path::new(""));
    let own = study.output.clone().unwrap_or_else(|| {
        let stem = file_stem(request).unwrap_or_else(|| "study".to_owned());
        format!("{stem}{RESULTS}").into()
    });
    let root = match (&request.output, &request.profile, results) {
        (Some(output), ..) => output.clone(),
        (None, Some(name), Results::InOwnFolder) => folder.join(own).join(name),
        (None, ..) => folder.join(own),
    };
    let layout = Layout::new(request.study.clone(), root);
    let layout = match model {
        Some(name) => layout.of_model(name),
        None => layout,
    };
    let rollouts = if study.starts_follow_from_deployment() {
        Rollouts::OfDeployment
    } else {
        Rollouts::OfModel
    };
    match deployment {
        Some(name) => layout.of_deployment(name, rollouts),
        None => layout,
    }
}

#[cfg(test)]
mod tests;
