//! Shares of the work: typed by the user, or set in the environment
//! by a system that runs many processes.

use calib_pipeline::{Context as _, StepError, ensure};
use calib_study::{Job, Policy, Share};

use crate::cli::StudyArgs;

/// Environment variables with the number of a task, each with the number of the first task.
const NUMBERS: [(&str, usize); 5] = [
    ("SLURM_ARRAY_TASK_ID", 0),
    ("JOB_COMPLETION_INDEX", 0),
    ("PBS_ARRAY_INDEX", 0),
    ("PBS_ARRAYID", 0),
    ("PARALLEL_SEQ", 1),
];

/// Reads an environment variable.
pub(super) fn environment(name: &str) -> Option<String> {
    std::env::var(name).ok()
}

/// Reads the number given for `option`, or for "auto" the number of the task from the environment.
pub(super) fn number(
    option: &str,
    typed: &str,
    environment: impl Fn(&str) -> Option<String>,
) -> Result<usize, StepError> {
    if typed != "auto" {
        return typed.parse().ok().with_context(|| {
            format!("{option} must be a whole number from 0 on, or auto, got '{typed}'")
        });
    }
    let found = NUMBERS.iter().find_map(|&(name, first)| Some((name, first, environment(name)?)));
    let (name, first, value) = found.with_context(|| {
        let names: Vec<&str> = NUMBERS.iter().map(|(name, _)| *name).collect();
        format!("{option} auto: none of {} is in the environment; give a number", names.join(", "))
    })?;
    let number: Option<usize> = value.trim().parse().ok();
    number.and_then(|number| number.checked_sub(first)).with_context(|| {
        format!("{option} auto: {name} is '{value}', expected a number from {first} on")
    })
}

/// Reads a share: "3/8", or "auto/8".
pub(super) fn share(
    typed: &str,
    environment: impl Fn(&str) -> Option<String>,
) -> Result<Share, StepError> {
    let form = format!(
        "--share must be a share and how many there are, such as 0/8 or auto/8, got '{typed}'"
    );
    let (own, count) = typed.split_once('/').context(&form)?;
    let count: usize = count.parse().ok().filter(|count| *count > 0).context(&form)?;
    let number: usize = match own {
        "auto" => number("--share", own, environment)?,
        own => own.parse().ok().context(&form)?,
    };
    Share::new(number, count)
        .with_context(|| {
            format!("there is no share {number} of {count}: they are 0 to {}; of an array of tasks, ask for --array=0-{}", count - 1, count - 1)
        })
}

/// Returns the job, limited to a share if one was given.
pub(super) fn shared(job: Job, typed: Option<&str>) -> Result<Job, StepError> {
    let Some(typed) = typed else { return Ok(job) };
    let policy = job.policy();
    ensure!(
        !policy.redoes(),
        "--force makes everything again, also what other shares have made; remove the results, and run the shares without it"
    );
    let share = share(typed, environment)?;
    Ok(job.under(Policy { share: Some(share), ..policy }))
}

/// Refuses `--json` for a share, because a share has no verdict. A
/// dry run of a share prints its plan.
pub(super) fn refuse_verdict(study: &StudyArgs, typed: Option<&str>) -> Result<(), StepError> {
    ensure!(
        typed.is_none() || !study.json || study.dry_run,
        "--share with --json: a share has no verdict to print; leave --json out, or add --dry-run to print the plan of the share"
    );
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn with(name: &'static str, value: &'static str) -> impl Fn(&str) -> Option<String> {
        move |asked: &str| (asked == name).then(|| value.to_owned())
    }

    fn nothing(_name: &str) -> Option<String> {
        None
    }

    #[test]
    fn systems_say_which_task_it_is() {
        let key = "--shard";
        assert_eq!(number(key, "17", nothing).expect("typed"), 17);
        assert_eq!(number(key, "auto", with("SLURM_ARRAY_TASK_ID", "3")).expect("an array"), 3);
        assert_eq!(number(key, "auto", with("JOB_COMPLETION_INDEX", "0")).expect("a job"), 0);
        // GNU parallel counts from 1.
        assert_eq!(number(key, "auto", with("PARALLEL_SEQ", "1")).expect("parallel"), 0);
        for refused in [
            number(key, "auto", nothing),
            number(key, "auto", with("PARALLEL_SEQ", "0")),
            number(key, "auto", with("SLURM_ARRAY_TASK_ID", "1-3")),
            number(key, "-1", nothing),
        ] {
            assert!(refused.is_err());
        }
        let told = number(key, "-1", nothing).expect_err("refused").to_string();
        assert_eq!(told, "--shard must be a whole number from 0 on, or auto, got '-1'");
    }

    #[test]
    fn shares_are_typed_or_found() {
        assert_eq!(share("3/8", nothing).expect("typed"), Share::new(3, 8).expect("valid"));
        let found = share("auto/8", with("PARALLEL_SEQ", "8")).expect("found");
        assert_eq!(found, Share::new(7, 8).expect("valid"));
        for refused in ["8/8", "3", "a/8", "3/0", "3/", "/8", "-1/8", "auto/8", "0/a"] {
            assert!(share(refused, nothing).is_err(), "{refused}");
        }
        for typed in ["-1/3", "a/3", "3"] {
            let told = share(typed, nothing).expect_err("refused").to_string();
            assert!(told.ends_with(&format!("such as 0/8 or auto/8, got '{typed}'")), "{told}");
        }
    }
}
