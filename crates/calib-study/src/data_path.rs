use std::path::{Path, PathBuf};

use calib_data::DataConfig;

use crate::{Job, Study, StudyError};

impl Job {
    /// Returns the `[data]` section with paths that can be opened.
    /// `variable` looks up environment variables and replaces `${NAME}`. Relative paths start from the study file.
    /// The study itself keeps the paths as written, so that results do not depend on the working directory.
    ///
    /// # Errors
    /// If a path is empty, or names a variable that is not set.
    pub fn data_to_read(
        &self,
        variable: impl Fn(&str) -> Option<String>,
    ) -> Result<DataConfig, StudyError> {
        let study = self.layout().study();
        let refused =
            |message: String| StudyError::Given { study: study.display().to_string(), message };
        let mut data = self.study().data.clone();
        for path in &mut data.path.0 {
            if path.is_empty() {
                return Err(refused(
                    "data.path is empty; name a file, a folder or a pattern of logs".to_owned(),
                ));
            }
            *path = expand(path, &variable).map_err(|reason| match reason {
                Reason::Unclosed => refused(format!("data.path = \"{path}\": `${{` without `}}`")),
                Reason::Unset(name) => {
                    StudyError::UnsetVariable { study: study.to_owned(), path: path.clone(), name }
                }
            })?;
        }
        data.resolve(self.folder());
        Ok(data)
    }

    /// Whether both studies certainly read the same log: equal paths, and no path contains an environment variable.
    pub fn reads_the_log_of(&self, other: &Study) -> bool {
        let paths = &self.study().data.path;
        *paths == other.data.path && !paths.0.iter().any(|path| path.contains("${"))
    }

    /// Resolves a path that the study gives, relative to the folder of the study file.
    pub fn beside(&self, path: impl AsRef<Path>) -> PathBuf {
        self.folder().join(path)
    }

    /// Returns the folder of the study file. It is empty for a bare file name, so that paths below it stay as short
    /// as they were written.
    fn folder(&self) -> &Path {
        self.layout().study().parent().unwrap_or(Path::new(""))
    }
}

/// Replaces each `${NAME}` in a path by the environment variable that `variable` looks up.
///
/// # Errors
/// If a variable is not set, or `${` has no closing `}`. The error is the message.
pub fn with_variables(
    path: &str,
    variable: impl Fn(&str) -> Option<String>,
) -> Result<String, String> {
    expand(path, &variable).map_err(|reason| match reason {
        Reason::Unclosed => format!("{path}: `${{` without `}}`"),
        Reason::Unset(name) => format!("{path}: the environment variable {name} is not set"),
    })
}

/// Reason why a path cannot be expanded.
enum Reason {
    Unclosed,
    /// This variable is not set.
    Unset(String),
}

fn expand(text: &str, variable: &impl Fn(&str) -> Option<String>) -> Result<String, Reason> {
    let Some(start) = text.find("${") else { return Ok(text.to_owned()) };
    let length = text[start..].find('}').ok_or(Reason::Unclosed)?;
    let name = &text[start + 2..start + length];
    let value = variable(name).ok_or_else(|| Reason::Unset(name.to_owned()))?;
    let rest = expand(&text[start + length + 1..], variable)?;
    Ok(format!("{}{value}{rest}", &text[..start]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Request;

    fn read(path: &str) -> Result<Vec<String>, String> {
        let text = format!("[data]\npath = \"{path}\"\n");
        let job = Job::of_text(Request::new("folder/study.toml"), text).expect("valid");
        assert_eq!(job.study().data.path.0, [path], "the study keeps what was written");
        job.data_to_read(|name| (name == "PLANT").then(|| "/plant".to_owned()))
            .map(|data| data.path.0)
            .map_err(|error| error.to_string())
    }

    #[test]
    fn data_is_found_from_the_study_file_and_the_environment() {
        assert_eq!(read("logs"), Ok(vec!["folder/logs".to_owned()]));
        assert_eq!(read("${PLANT}/${PLANT}"), Ok(vec!["/plant//plant".to_owned()]));
        let unset = read("${OTHER}/x").expect_err("not set");
        assert!(unset.contains("the environment variable OTHER is not set"), "{unset}");
        let unclosed = read("${PLANT").expect_err("no end");
        assert!(unclosed.ends_with("`${` without `}`"), "{unclosed}");
        assert!(read("").expect_err("empty").contains("data.path is empty"));
    }
}
