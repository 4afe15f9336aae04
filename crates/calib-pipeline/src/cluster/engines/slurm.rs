//! Scripts for Slurm: one array per stage, each after the one before, and a final job that merges.

use std::fmt::Write as _;

use calib_study::shell_words;

use super::TaskDemand;
use crate::cluster::{config::ClusterConfig, shard_ranges::ranges};

/// Returns the script of an array whose tasks are shards.
///
/// USR1 comes before the time limit. Only the shell receives it, and passes it on as TERM. A task that then saved its
/// state (exit code 75) is queued again. Slurm itself requeues a task that is preempted or loses its node. Nothing else
/// is retried.
pub(crate) fn array(
    plan: &str,
    stage: usize,
    shards: &[usize],
    demand: TaskDemand,
    config: &ClusterConfig,
) -> String {
    let mut options = vec![
        ("job-name".to_owned(), format!("calib-{stage}")),
        ("array".to_owned(), array_of(shards, config)),
        ("cpus-per-task".to_owned(), config.threads.to_string()),
        ("signal".to_owned(), format!("B:USR1@{}", config.grace_secs)),
        ("open-mode".to_owned(), "append".to_owned()),
        ("output".to_owned(), format!("{plan}/slurm/shard-%a.out")),
    ];
    options.extend(limits(demand));
    let calib = &config.calib;
    let body = format!(
        r#"plan={place}
threads=${{SLURM_CPUS_PER_TASK:-{threads}}}
{calib} --quiet --threads "$threads" cluster run "$plan" --shard "$SLURM_ARRAY_TASK_ID" &
shard=$!
trap 'kill -TERM "$shard"' USR1 TERM
# A signal ends the first wait; the last one gives the code with which the shard ended.
wait "$shard"
while kill -0 "$shard" 2>/dev/null; do wait "$shard"; done
code=0
wait "$shard" || code=$?
if [ "$code" = 75 ] && [ "${{SLURM_RESTART_COUNT:-0}}" -lt {requeues} ]; then
    echo "shard $SLURM_ARRAY_TASK_ID kept its state, and is put back" >&2
    scontrol requeue "${{SLURM_ARRAY_JOB_ID}}_${{SLURM_ARRAY_TASK_ID}}"
    # The system ends this attempt; what follows must not be taken for the end of the task.
    sleep 60
fi
exit "$code"
"#,
        place = shell_words([plan]),
        threads = config.threads,
        requeues = config.requeues,
    );
    script(&options, &["requeue"], config, &body)
}

/// Returns the script of the job after all shards.
pub(crate) fn merge(
    plan: &str,
    evaluate: Option<&str>,
    demand: TaskDemand,
    config: &ClusterConfig,
) -> String {
    let mut options = vec![
        ("job-name".to_owned(), "calib-merge".to_owned()),
        ("ntasks".to_owned(), "1".to_owned()),
        ("open-mode".to_owned(), "append".to_owned()),
        ("output".to_owned(), format!("{plan}/slurm/merge.out")),
    ];
    options.extend(limits(demand));
    let mut body = format!("{} cluster merge {}\n", config.calib, shell_words([plan]));
    if let Some(evaluate) = evaluate {
        let _ = writeln!(
            body,
            "# 1 is an answer: there is no clear difference between the settings.\n{evaluate} || [ $? = 1 ]"
        );
    }
    script(&options, &[], config, &format!("set -e\n{body}"))
}

fn limits(demand: TaskDemand) -> [(String, String); 2] {
    [
        ("time".to_owned(), demand.minutes.to_string()),
        ("mem".to_owned(), format!("{}M", demand.memory_mb)),
    ]
}

fn array_of(shards: &[usize], config: &ClusterConfig) -> String {
    match config.at_once {
        Some(most) => format!("{}%{most}", ranges(shards)),
        None => ranges(shards),
    }
}

/// Renders a script. Options in the configuration replace those given here.
fn script(
    options: &[(String, String)],
    flags: &[&str],
    config: &ClusterConfig,
    body: &str,
) -> String {
    let mut text = "#!/bin/bash\n".to_owned();
    let own = options.iter().filter(|(name, _)| !config.slurm.contains_key(name));
    for (name, value) in own.map(|(name, value)| (name, value)).chain(&config.slurm) {
        let _ = writeln!(text, "#SBATCH --{name}={value}");
    }
    for flag in flags {
        let _ = writeln!(text, "#SBATCH --{flag}");
    }
    for line in &config.setup {
        let _ = writeln!(text, "{line}");
    }
    text + body
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_configured_replaces_what_is_planned() {
        let mut config = ClusterConfig { at_once: Some(50), ..ClusterConfig::default() };
        config.setup.push("module load calib".to_owned());
        config.slurm.insert("time".to_owned(), "7".to_owned());
        config.slurm.insert("account".to_owned(), "abc".to_owned());
        let demand = TaskDemand { minutes: 62, memory_mb: 900 };
        let text = array("/a plan", 1, &[3, 4, 7], demand, &config);
        for line in [
            "#SBATCH --array=3-4,7%50",
            "#SBATCH --time=7",
            "#SBATCH --mem=900M",
            "#SBATCH --account=abc",
            "#SBATCH --signal=B:USR1@120",
            "#SBATCH --requeue",
            "module load calib",
            "plan='/a plan'",
        ] {
            assert!(text.lines().any(|other| other == line), "{line} is not in\n{text}");
        }
        assert!(!text.contains("--time=62"), "{text}");
        let merge = merge("/a plan", Some("calib evaluate s.toml"), demand, &config);
        assert!(merge.contains("cluster merge '/a plan'") && merge.contains("evaluate s.toml || "));
    }
}
