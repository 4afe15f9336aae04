//! An Indexed Job for Kubernetes. It is rendered, but was never run.

use super::TaskDemand;
use crate::cluster::config::ClusterConfig;

/// Returns the manifest of a stage, with one pod per shard. Exit code 2 is not retried, because it
/// would fail again.
///
/// Indexes of such a job have no gaps, so all shards are in it. Finished shards end at once.
pub(crate) fn job(
    stage: usize,
    shards: usize,
    first: usize,
    demand: TaskDemand,
    config: &ClusterConfig,
) -> String {
    let ClusterConfig { image, volume, threads, at_once, requeues, .. } = config;
    let parallel = at_once.unwrap_or(shards).min(shards);
    let TaskDemand { memory_mb, .. } = demand;
    format!(
        r#"# Rendered by calib and not run here: look it over before you apply it. The volume holds the plan at /plan.
apiVersion: batch/v1
kind: Job
metadata:
  name: calib-stage-{stage}
spec:
  completionMode: Indexed
  completions: {shards}
  parallelism: {parallel}
  backoffLimitPerIndex: {requeues}
  maxFailedIndexes: {shards}
  podFailurePolicy:
    rules:
      - action: FailIndex
        onExitCodes:
          operator: In
          values: [2]
      - action: Ignore
        onPodConditions:
          - type: DisruptionTarget
  template:
    spec:
      restartPolicy: Never
      terminationGracePeriodSeconds: 60
      containers:
        - name: calib
          image: "{image}"
          command: ["sh", "-c"]
          # The shell is replaced, so that TERM reaches calib, which keeps its state.
          args: ['exec calib --quiet --threads {threads} cluster run /plan --shard "$((JOB_COMPLETION_INDEX + {first}))"']
          resources:
            requests: {{ cpu: "{threads}", memory: "{memory_mb}Mi" }}
            limits: {{ memory: "{memory_mb}Mi" }}
          volumeMounts:
            - {{ name: plan, mountPath: /plan }}
      volumes:
        - name: plan
          persistentVolumeClaim: {{ claimName: "{volume}" }}
"#
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pod_is_a_shard_and_what_is_in_vain_is_not_tried_again() {
        let demand = TaskDemand { minutes: 9, memory_mb: 700 };
        let text = job(1, 40, 12, demand, &ClusterConfig::default());
        for part in
            ["completions: 40", "values: [2]", "JOB_COMPLETION_INDEX + 12", "memory: \"700Mi\""]
        {
            assert!(text.contains(part), "{part} is not in\n{text}");
        }
    }
}
