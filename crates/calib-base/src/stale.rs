//! Detects results of another study than the present one: which keys differ, and which command to
//! run.

use std::path::Path;

use calib_study::{Difference, Job, StepKind, Study};

use crate::StepError;

/// Maximum number of differences that are listed one by one.
const TOLD: usize = 3;

/// An existing result of a step.
#[derive(Clone, Copy)]
pub struct StoredArtefact<'a> {
    /// The step that made it.
    pub step: StepKind,
    /// The study that it was made from.
    pub study: &'a Study,
    /// Directory of the result.
    pub directory: &'a Path,
}

impl StoredArtefact<'_> {
    /// Refuses the result if it was made with other keys than those of the job.
    ///
    /// # Errors
    /// [`StepError::Stale`], with the keys that differ.
    pub fn check(self, job: &Job) -> Result<(), StepError> {
        self.stale_reason(job).map_or(Ok(()), |reason| Err(StepError::Stale(reason)))
    }

    /// Returns which keys differ from those of the job, and the command to run, or `None` if none
    /// differs.
    pub fn stale_reason(self, job: &Job) -> Option<String> {
        let differences = job.study().differences(self.step, self.study);
        (!differences.is_empty()).then(|| {
            format!(
                "the {} in {} {} made with {}; run `{}` again",
                self.step.result(),
                self.directory.display(),
                if self.step.is_plural() { "were" } else { "was" },
                told(&differences),
                job.command(self.step)
            )
        })
    }
}

/// The key that decides which other keys a result depends on, and so is reported first.
const DECISIVE: &str = "model.kind";

/// Formats the keys that differ, with both values.
fn told(differences: &[Difference]) -> String {
    let (decisive, others): (Vec<&Difference>, Vec<&Difference>) =
        differences.iter().partition(|difference| difference.key == DECISIVE);
    let all = decisive.into_iter().chain(others);
    let mut told: Vec<String> = all.take(TOLD).map(ToString::to_string).collect();
    match differences.len().saturating_sub(TOLD) {
        0 => {}
        1 => told.push("and one more key".to_owned()),
        more => told.push(format!("and {more} more keys")),
    }
    told.join("; ")
}

#[cfg(test)]
mod tests {
    use calib_study::Request;

    use super::*;

    fn job(text: &str) -> Job {
        Job::of_text(Request::new("s.toml"), text.to_owned()).expect("valid")
    }

    #[test]
    fn what_decides_is_told_first_and_of_many_keys_some() {
        let made = job("");
        let [without, many] = [
            "[model]\nkind = \"none\"\n",
            "seed = 4\n[agent]\ngamma = 0.5\nbatch_size = 9\nbeta1 = 0.1\nbeta2 = 0.2\n",
        ]
        .map(|text| {
            let kept = StoredArtefact {
                step: StepKind::Sweep,
                study: made.study(),
                directory: Path::new("x"),
            };
            kept.check(&job(text)).expect_err("other keys").to_string()
        });
        assert!(
            without
                .starts_with("the sweep in x was made with model.kind = \"knn\", now \"none\"; "),
            "{without}"
        );
        assert!(many.contains("agent.beta2 = 0.999, now 0.2; and 2 more keys; run"), "{many}");
    }
}
