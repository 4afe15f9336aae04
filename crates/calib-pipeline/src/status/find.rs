//! Finds what a path refers to: a study, the folder of its results, or a plan for a cluster.

use std::{
    fs,
    path::{Path, PathBuf},
};

use calib_base::{StepError, bail, ensure};
use calib_study::{Job, Request, study_files};

use crate::cluster;

/// A request for the status of a study or plan.
#[derive(Clone, Debug, Default)]
pub struct StatusRequest {
    /// A study file, a folder of results, or a plan for a cluster.
    pub path: PathBuf,
    /// Overridden keys of the study.
    pub set: Vec<String>,
    /// The profile to apply to the study.
    pub profile: Option<String>,
    /// The folder of results, if it differs from that in the study.
    pub output: Option<PathBuf>,
}

pub(super) enum Subject {
    Study(Box<Job>),
    Cluster(PathBuf),
}

/// Finds the subject of a request.
///
/// # Errors
/// Returns an error if the path is none of these, or the study is wrong.
pub(super) fn find(request: &StatusRequest) -> Result<Subject, StepError> {
    let path = &request.path;
    if let Some(job) = study_unless_folder(study_request(request, path))? {
        return Ok(Subject::Study(Box::new(job)));
    }
    if cluster::is_plan(path) {
        return Ok(Subject::Cluster(path.clone()));
    }
    // A study lies beside its results, or in a folder that was made for it.
    let wanted = fs::canonicalize(path)?;
    let parent = wanted.parent().unwrap_or(&wanted);
    for study in study_files(parent).unwrap_or_default() {
        let Ok(found) = Job::resolve(study_request(request, &study)) else { continue };
        let results = fs::canonicalize(found.layout().of_study());
        if results.is_ok_and(|results| results == wanted) {
            return Ok(Subject::Study(Box::new(found)));
        }
    }
    match study_files(path).unwrap_or_default().as_slice() {
        [study] => Ok(Subject::Study(Box::new(Job::resolve(study_request(request, study))?))),
        [] => bail!(
            "{} holds no study, and none beside it writes its results there; name the study: `calib status STUDY`, \
             with --output if it was run so",
            path.display()
        ),
        [first, ..] => bail!(
            "{} holds several files that may be studies; name one, such as `calib status {}`",
            path.display(),
            first.display()
        ),
    }
}

/// Resolves a study if its path is a file. Returns `None` if the path is a folder.
///
/// # Errors
/// Returns an error if the path is neither, or the study is wrong.
pub(crate) fn study_unless_folder(request: Request) -> Result<Option<Job>, StepError> {
    if request.study.is_file() {
        return Ok(Some(Job::resolve(request)?));
    }
    ensure!(
        request.study.is_dir(),
        "{} does not exist; give a study file, or the folder of its results",
        request.study.display()
    );
    Ok(None)
}

fn study_request(request: &StatusRequest, study: &Path) -> Request {
    Request {
        study: study.to_owned(),
        set: request.set.clone(),
        profile: request.profile.clone(),
        output: request.output.clone(),
        ..Request::default()
    }
}
