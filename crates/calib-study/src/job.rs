use std::{
    path::{Component, Path},
    sync::Arc,
};

use crate::{
    Layout, Policy, Request, Rollouts, Study, StudyError,
    profiles::Results,
    written::{RESULTS, WrittenStudy},
};

/// A study that was resolved: the file as it was read once, the model and deployment that are chosen of it, where
/// results lie, and what may be done about them. Every step of a command has it from the one before.
#[derive(Clone, Debug)]
pub struct Job {
    pub(crate) written: Arc<WrittenStudy>,
    pub(crate) study: Arc<Study>,
    pub(crate) layout: Layout,
    pub(crate) model: Option<String>,
    pub(crate) deployment: Option<String>,
}

impl Job {
    /// Read the study file that `request` names, lay what it asks for over it, check every section, and say where results
    /// lie.
    ///
    /// # Errors
    /// A file that cannot be read, a key that does not exist, a value that is not valid: each with its place.
    pub fn resolve(request: Request) -> Result<Self, StudyError> {
        Self::of(WrittenStudy::read(request)?)
    }

    /// As [`Job::resolve`], of a `text` that stands in the file, or is going to.
    ///
    /// # Errors
    /// A key that does not exist, or a value that is not valid.
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

    /// Another choice of the same study; `None` is all of it.
    ///
    /// # Errors
    /// A name that the study does not have, or a value that is not valid there.
    pub fn choose(
        &self,
        model: Option<&str>,
        deployment: Option<&str>,
    ) -> Result<Self, StudyError> {
        let model = model.map(str::to_owned);
        let deployment = deployment.map(str::to_owned);
        Self::choose_of(Arc::clone(&self.written), model, deployment)
    }

    /// What to write instead of keys that have a new name, a sentence each with its place.
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

    /// The same under another policy.
    #[must_use]
    pub fn under(&self, policy: Policy) -> Self {
        let mut written = WrittenStudy::clone(&self.written);
        written.request.policy = policy;
        Self { written: Arc::new(written), ..self.clone() }
    }

    /// The study of the model and deployment that are chosen.
    pub fn study(&self) -> &Study {
        &self.study
    }

    /// The study as it was written, with all its models and deployments.
    ///
    /// # Errors
    /// A value that is valid only with a model or deployment.
    pub fn whole(&self) -> Result<Study, StudyError> {
        self.written.study(None, None)
    }

    /// What was asked for.
    pub fn request(&self) -> &Request {
        &self.written.request
    }

    /// What stood in the study file when it was read.
    pub fn text(&self) -> &str {
        self.written.text()
    }

    /// Where results lie.
    pub fn layout(&self) -> &Layout {
        &self.layout
    }

    /// What may be done about them.
    pub fn policy(&self) -> Policy {
        self.written.request.policy
    }

    /// The profile that was laid over the study.
    pub fn profile(&self) -> Option<&str> {
        self.written.request.profile.as_deref()
    }

    /// The model that is chosen, of several.
    pub fn model(&self) -> Option<&str> {
        self.model.as_deref()
    }

    /// What the model is called: as the study calls it, or by its kind where it has one only.
    pub fn model_name(&self) -> &str {
        self.model().unwrap_or_else(|| self.study().model_name())
    }

    /// The deployment that is chosen, of several.
    pub fn deployment(&self) -> Option<&str> {
        self.deployment.as_deref()
    }

    /// What the study is called in reports: its title, or the name of its file, or where that says nothing the name of its log,
    /// or else its sensors.
    pub fn title(&self) -> String {
        self.own_title().unwrap_or_else(|| self.sensors())
    }

    /// The same, where the study, its file or its log has a name.
    pub fn own_title(&self) -> Option<String> {
        let title = self.study.evaluate.title.clone();
        title
            .or_else(|| file_stem(&self.written.request).filter(|stem| says_something(stem)))
            .or_else(|| self.log_name())
    }

    /// The last part of the path of the log that is a name rather than a pattern or a word for any log.
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

    /// "PIT300, TIT101 and 3 more sensors".
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

/// Whether a file's name tells its content from that of any other study or log.
fn says_something(stem: &str) -> bool {
    const ANY: [&str; 10] =
        ["study", "log", "logs", "data", "results", "raw", "input", "history", "export", "test"];
    let is_pattern = stem.contains(['*', '?', '{', '$']);
    !stem.is_empty() && !is_pattern && !ANY.contains(&stem.to_lowercase().as_str())
}

fn file_stem(request: &Request) -> Option<String> {
    request.study.file_stem().map(|stem| stem.to_string_lossy().into_owned())
}

/// Where the results of a model and a deployment lie.
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
