//! Finds what a path refers to: a study, the folder of its results, or a plan for a cluster.

use std::{
    fs,
    path::{Path, PathBuf},
};

use calib_base::{StepError, bail};
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
    if path.is_file() {
        return Ok(Subject::Study(Box::new(job(request, path)?)));
    }
    if !path.is_dir() {
        bail!("{} does not exist; give a study file, or the folder of its results", path.display());
    }
    if cluster::is_plan(path) {
        return Ok(Subject::Cluster(path.clone()));
    }
    // A study lies beside its results, or in a folder that was made for it.
    let wanted = fs::canonicalize(path)?;
    let parent = wanted.parent().unwrap_or(&wanted);
    for study in study_files(parent).unwrap_or_default() {
        let Ok(found) = job(request, &study) else { continue };
        let results = fs::canonicalize(found.layout().of_study());
        if results.is_ok_and(|results| results == wanted) {
            return Ok(Subject::Study(Box::new(found)));
        }
    }
    match study_files(path).unwrap_or_default().as_slice() {
        [study] => Ok(Subject::Study(Box::new(job(request, study)?))),
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

fn job(request: &StatusRequest, study: &Path) -> Result<Job, StepError> {
    Ok(Job::resolve(Request {
        study: study.to_owned(),
        set: request.set.clone(),
        profile: request.profile.clone(),
        output: request.output.clone(),
        ..Request::default()
    })?)
}
