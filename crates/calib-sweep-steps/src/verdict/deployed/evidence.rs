//! The common evidence of several deployments, and the choice of the study's rule from it.

use std::collections::{BTreeMap, BTreeSet, btree_map::Entry};

use calib_base::StepError;
use calib_sweep::{EnvironmentId, Judging, SensorVerdict, UnitResult, verdict};

use crate::verdict::judged_model::JudgedModel;

/// Returns the choice of the study's rule from the members of all deployments and the replayed log.
pub(super) fn choice(
    sensor: &str,
    parts: &[&JudgedModel],
    verdicts: &[&SensorVerdict],
) -> Result<usize, StepError> {
    let study = parts[0].judged.study();
    let manifest = &parts[0].judged.manifest;
    let judging = Judging::of_choice(study.part(), study.evaluate.rule, &manifest.scales);
    let results: Vec<&[UnitResult]> = parts.iter().map(|part| &part.judged.results[..]).collect();
    let raced: BTreeSet<usize> = verdicts
        .iter()
        .flat_map(|verdict| verdict.dropped.iter().map(|dropped| dropped.candidate))
        .collect();
    let evidence = evidence(&results, &raced, manifest.candidates.len());
    Ok(verdict(sensor, &manifest.candidates, &evidence, &judging)?.chosen)
}

/// Merges the results of several deployments. Each deployment keeps its own members, shared results count once, and
/// held-out results are left out. A setting that a race dropped in one deployment made too few runs to compare, so it
/// is left out too. If every setting was dropped somewhere, all are kept.
fn evidence(
    deployments: &[&[UnitResult]],
    raced: &BTreeSet<usize>,
    values: usize,
) -> Vec<UnitResult> {
    let mut seen = BTreeMap::new();
    let mut members = 0;
    let mut all: Vec<UnitResult> = Vec::new();
    for results in deployments {
        let mut next = members;
        for result in *results {
            let unit = &result.unit;
            if unit.environment == EnvironmentId::Online {
                continue;
            }
            let mut own = result.clone();
            if raced.len() < values {
                own.rows.retain(|row| !raced.contains(&row.candidate));
            }
            // Not by keys: a race may have left other settings there, which are trained on the same stream.
            match seen.entry((unit, result.seed, result.start_row)) {
                Entry::Occupied(same) => {
                    let place: &usize = same.get();
                    let rows = &mut all[*place].rows;
                    own.rows
                        .retain(|row| rows.iter().all(|other| other.candidate != row.candidate));
                    rows.extend(own.rows);
                    rows.sort_by_key(|row| row.candidate);
                    continue;
                }
                Entry::Vacant(first) => first.insert(all.len()),
            };
            if let EnvironmentId::Member(member) = &mut own.unit.environment {
                *member += members;
                next = next.max(*member + 1);
            }
            all.push(own);
        }
        members = next;
    }
    all
}

#[cfg(test)]
mod tests {
    use calib_agent::{AgentConfig, Part, PartScore, Scores};
    use calib_sweep::{Candidate, Rule, RunRow, Unit};

    use super::*;

    /// Returns one run of each of three settings in a member, with these errors.
    ///
    /// The start row depends on the key, so that each key has its own stream.
    fn result(member: usize, key: &str, errors: [f64; 3]) -> UnitResult {
        UnitResult {
            key: key.to_owned(),
            unit: Unit {
                sensor: "A".to_owned(),
                environment: EnvironmentId::Member(member),
                run: 0,
            },
            seed: 0,
            start_row: u32::from(key.as_bytes()[0]),
            not_finite: None,
            rows: errors
                .iter()
                .enumerate()
                .map(|(candidate, &rmse)| {
                    let score =
                        PartScore { scored_steps: 10, rmse, mean_return: 0.0, return_std: 1.0 };
                    RunRow {
                        candidate,
                        steps: 10,
                        updates: 1,
                        scores: Scores { whole_run: Some(score), ..Scores::default() },
                        diverged_at: None,
                        curve: Vec::new(),
                    }
                })
                .collect(),
        }
    }

    fn chosen(rule: Rule, results: &[UnitResult]) -> usize {
        let candidates: Vec<Candidate> = (0..3)
            .map(|index| Candidate {
                index,
                is_default: index == 0,
                values: vec![("learning_rate".to_owned(), (index + 1).into())],
                agent: AgentConfig::default(),
            })
            .collect();
        let judging = Judging::of_choice(Part::WholeRun, rule, &[]);
        verdict("A", &candidates, results, &judging).expect("judged").chosen
    }

    #[test]
    fn one_value_for_all_is_what_the_rule_chooses_from_all_evidence() {
        // The best setting of the first is bad in the second, and vice versa.
        let first = [result(0, "a", [0.1, 0.2, 0.3])];
        let second = [result(0, "b", [0.3, 0.2, 0.1])];
        let both = evidence(&[&first, &second], &BTreeSet::new(), 3);
        assert_eq!(
            both.iter().map(|result| result.unit.environment).collect::<Vec<_>>(),
            [0, 1].map(EnvironmentId::Member)
        );
        assert_eq!(chosen(Rule::WorstRank, &both), 1, "second in both, never third");
        // By logarithms: ln 0.1 + ln 0.3 is less than 2 ln 0.2. So the first and the last setting are better, and the
        // first one wins the tie.
        assert_eq!(chosen(Rule::Pooled, &both), 0);
        let second = [result(0, "b", [0.3, 0.2, 0.05])];
        let both = evidence(&[&first, &second], &BTreeSet::new(), 3);
        assert_eq!(chosen(Rule::Pooled, &both), 2);
        assert_eq!(chosen(Rule::WorstRank, &both), 1);
    }

    #[test]
    fn what_deployments_share_counts_once_and_what_was_held_out_not_at_all() {
        let mut online = result(0, "o", [0.5, 0.1, 0.9]);
        online.unit.environment = EnvironmentId::Online;
        let mut log = result(0, "l", [0.5, 0.1, 0.9]);
        log.unit.environment = EnvironmentId::LogReplay;
        let first = [result(0, "a", [0.1, 0.2, 0.3]), log.clone(), online];
        let second = [result(0, "a", [0.1, 0.2, 0.3]), log, result(1, "c", [0.1, 0.2, 0.3])];
        let both = evidence(&[&first, &second], &BTreeSet::new(), 3);
        let environments: Vec<_> = both.iter().map(|result| result.unit.environment).collect();
        let [own, other] = [0, 2].map(EnvironmentId::Member);
        assert_eq!(environments, [own, EnvironmentId::LogReplay, other]);
    }

    #[test]
    fn a_stream_on_which_races_left_different_values_counts_once() {
        let mut log = result(0, "l", [0.5, 0.1, 0.9]);
        log.unit.environment = EnvironmentId::LogReplay;
        let mut raced = UnitResult { key: "of fewer".to_owned(), ..log.clone() };
        raced.rows.remove(0);
        let both = evidence(&[&[raced], &[log.clone()]], &BTreeSet::new(), 3);
        assert_eq!(both.len(), 1);
        assert_eq!(both[0].rows, log.rows, "with the rows of both");
    }

    #[test]
    fn what_a_race_dropped_anywhere_is_not_compared() {
        let results = [result(0, "a", [0.1, 0.2, 0.3])];
        // Something has to be left.
        for (raced, left) in [(&[0][..], &[1, 2][..]), (&[0, 1, 2][..], &[0, 1, 2][..])] {
            let all = evidence(&[&results], &raced.iter().copied().collect(), 3);
            let rows: Vec<usize> = all[0].rows.iter().map(|row| row.candidate).collect();
            assert_eq!(rows, left, "{raced:?}");
        }
    }
}
