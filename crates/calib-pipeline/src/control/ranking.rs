//! Ranks settings by the available runs, before a sweep is finished.

use std::collections::BTreeMap;

use calib_base::StepError;
use calib_control::{ActionModelKind, Run};
use calib_files::read_sealed_json;
use calib_stats::{Direction, Selection, select_by};
use calib_study::Job;
use schemars::JsonSchema;
use serde::Serialize;

use super::{
    agents::ComparedAgents,
    evaluation::{ControlEvaluation, setting_name},
    files::{VERDICT, VerdictStanding, key},
    show,
    units::{self, StoredRuns},
};

/// Current ranking of the settings of agents that act. It is provisional while runs are missing. It is not a verdict: it does not
/// check for reasons against deployment.
#[derive(Debug, Serialize, JsonSchema)]
pub(crate) struct ControlRanking {
    /// Number of finished runs, and of all runs.
    pub(crate) runs: [usize; 2],
    /// Stored runs that belong to other values of the study's keys, or to another log.
    pub(crate) other_runs: usize,
    /// Number of ensemble members, of all kinds of models, in which every setting has a run. The ranking uses only these.
    pub(crate) members: usize,
    /// The settings, best first; empty while no ensemble member has a run of every setting.
    pub(crate) settings: Vec<ControlRanked>,
}

/// A setting in the ranking.
#[derive(Debug, PartialEq, Serialize, JsonSchema)]
pub(crate) struct ControlRanked {
    pub(crate) setting: String,
    pub(crate) is_default: bool,
    /// Whether the program failed with the setting.
    pub(crate) has_failed: bool,
    pub(crate) mean_rank: f64,
    /// Mean return per episode in the models; none if the setting diverged in one, or failed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) mean_return: Option<f64>,
}

impl ControlRanked {
    /// Returns a setting that did not fail. `default` is the number of the default.
    fn new(
        candidate: usize,
        default: Option<usize>,
        selection: &Selection,
        setting: String,
    ) -> Self {
        Self {
            setting,
            is_default: default == Some(candidate),
            has_failed: false,
            mean_rank: selection.mean_ranks[candidate],
            mean_return: Some(selection.mean_errors[candidate]).filter(|mean| mean.is_finite()),
        }
    }
}

/// Ranks the settings of a study with this verdict. `None` if there are no runs.
///
/// # Errors
/// Returns an error if the settings are invalid.
pub(crate) fn ranking(
    job: &Job,
    verdict: &VerdictStanding,
) -> Result<Option<ControlRanking>, StepError> {
    let Some(config) = &job.study().control else { return Ok(None) };
    let agents = ComparedAgents::of_study(job, config)?;
    let all = config.runs_of_a_setting() * agents.count();
    let default = agents.default(config);
    // A finished sweep has its runs in one table and its ranks in the verdict. Files beside it add nothing: they hold
    // runs of settings that did not fail, or of a share that ended later.
    let is_current = matches!(verdict, VerdictStanding::Current);
    let found = read_sealed_json::<ControlEvaluation>(&job.layout().control().join(VERDICT)).ok();
    if let Some(found) = found.filter(|_| is_current) {
        let selection = &found.verdict().selection;
        let settings = show::best(&found, found.agents().len());
        let settings = settings.into_iter().map(|candidate| ControlRanked {
            has_failed: found.has_failed(candidate),
            ..ControlRanked::new(candidate, default, selection, found.setting_name(candidate))
        });
        let members = config.all_members();
        let settings = settings.collect();
        return Ok(Some(ControlRanking { runs: [all; 2], other_runs: 0, members, settings }));
    }
    let StoredRuns { own: runs, others } = units::stored(&job.layout().control_units(), |log| {
        key(job.study(), log, agents.program_identity())
    })?;
    if runs.is_empty() && others == 0 {
        return Ok(None);
    }
    let members = complete(&runs, agents.count());
    let mut settings = Vec::new();
    if !members.is_empty() {
        let selection = select_by(config.rule, &members, Direction::HigherIsBetter)?;
        let fields = agents.fields(config);
        settings = show::by_rank(&selection, config.rule)
            .into_iter()
            .map(|candidate| {
                let setting = setting_name(&fields[candidate]);
                ControlRanked::new(candidate, default, &selection, setting)
            })
            .collect();
    }
    Ok(Some(ControlRanking {
        runs: [runs.len().min(all), all],
        other_runs: others,
        members: members.len(),
        settings,
    }))
}

/// Returns the mean returns of the members, `[members][settings]`. Only runs that every setting has count.
fn complete(runs: &[Run], candidates: usize) -> Vec<Vec<f64>> {
    let mut by_run: BTreeMap<(ActionModelKind, usize, usize), Vec<Option<f64>>> = BTreeMap::new();
    for run in runs.iter().filter(|run| run.candidate < candidates) {
        let returns = by_run.entry((run.kind, run.member, run.run));
        returns.or_insert_with(|| vec![None; candidates])[run.candidate] = Some(run.mean_return);
    }
    let mut members: BTreeMap<(ActionModelKind, usize), Vec<Vec<f64>>> = BTreeMap::new();
    for ((kind, member, _), returns) in by_run {
        if let Some(returns) = returns.into_iter().collect::<Option<Vec<f64>>>() {
            members.entry((kind, member)).or_default().push(returns);
        }
    }
    members
        .into_values()
        .map(|runs| {
            (0..candidates)
                .map(|candidate| {
                    runs.iter().map(|returns| returns[candidate]).sum::<f64>() / runs.len() as f64
                })
                .collect()
        })
        .collect()
}
