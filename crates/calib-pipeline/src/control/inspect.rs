use calib_base::{
    StepError,
    output::{Printer, counted, number},
};
use calib_control::{ActionModel, ControlConfig, Decisions, Distance};
use calib_model_steps::represent::decisions;
use calib_study::Job;
use schemars::JsonSchema;
use serde::Serialize;

use super::{
    advice::beyond_whole_episodes,
    described::{ActionLogSummary, described},
    log, rare, show,
};

/// A log with actions, as inspected before any training.
#[derive(Debug, Serialize, JsonSchema)]
pub struct InspectedActions {
    /// The recorded actions, and where the log covers each of them.
    #[serde(flatten)]
    log: ActionLogSummary,
    /// Statistics of the rewards.
    reward: RewardSummary,
}

/// Statistics of the rewards of a log with actions, in their unit.
#[derive(Debug, Serialize, JsonSchema)]
struct RewardSummary {
    /// Mean reward per step.
    mean: f64,
    /// Smallest reward of a step.
    least: f64,
    /// Largest reward of a step.
    largest: f64,
    /// Mean return of recorded episodes, cut after `control.timeout` steps.
    mean_return: f64,
    /// Why that mean lies outside the range of all whole episodes, if it does.
    #[serde(skip_serializing_if = "Option::is_none")]
    beyond_whole_episodes: Option<&'static str>,
    /// Standard deviation of recorded returns with `control.agent.gamma`, cut after `control.timeout` steps. Step sizes, temperatures
    /// and initial weights are in its unit. Default: all returns are equal.
    #[serde(skip_serializing_if = "Option::is_none")]
    return_spread: Option<f64>,
    /// `control.agent.gamma`.
    gamma: f64,
}

impl RewardSummary {
    fn of_log(log: &Decisions, config: &ControlConfig) -> Result<Self, StepError> {
        let recorded = log.recorded_return(config.longest_episode())?;
        let [mut least, mut largest] = [f64::INFINITY, f64::NEG_INFINITY];
        for &reward in log.rewards() {
            least = least.min(f64::from(reward));
            largest = largest.max(f64::from(reward));
        }
        Ok(Self {
            mean: log.mean_reward(),
            least,
            largest,
            mean_return: recorded.mean,
            beyond_whole_episodes: beyond_whole_episodes(&recorded),
            return_spread: log.return_spread(config.agent.gamma, config.longest_episode()),
            gamma: config.agent.gamma,
        })
    }

    /// Returns a line such as "reward: mean 1.2, from 0 to 3 a step; recorded episodes: mean return 36; spread of returns 12
    /// (gamma 1)".
    fn line(&self) -> String {
        let Self { mean, least, largest, mean_return, .. } = self;
        let spread = self.return_spread.map_or_else(String::new, |spread| {
            format!("; spread of returns {} (gamma {})", number(spread), self.gamma)
        });
        format!(
            "reward: mean {}, from {} to {} a step; recorded episodes: mean return {}{spread}{}",
            number(*mean),
            number(*least),
            number(*largest),
            number(*mean_return),
            self.beyond_whole_episodes.map_or_else(String::new, |reason| format!(". {reason}"))
        )
    }
}

/// Describes the actions and rewards in the log of a study with `[control]`, and where it shows the effect of an
/// action. `None` for other studies.
pub(crate) fn inspect(job: &Job, printer: &Printer) -> Result<Option<InspectedActions>, StepError> {
    let Some(config) = &job.study().control else { return Ok(None) };
    let log = log::read(job, config, printer)?;
    log.tell_codes_beside(printer);
    if let Some(told) = rare::only_action(&log.names.actions, config.every) {
        printer.warn(&told);
    }
    let represented = match config.model.distance {
        Distance::Euclidean => None,
        Distance::Laplacian => {
            let kept = decisions::kept(job, log.material())?;
            if kept.is_none() {
                printer.say("the representation is trained by `calib control`; here distances are those of states");
            }
            kept
        }
    };
    let (distance, metric) = match represented {
        None => (Distance::Euclidean, log.decisions.states().clone()),
        Some(psi) => (Distance::Laplacian, psi),
    };
    log::require_model(&log.decisions, config)?;
    let starts = log::starts(&log.decisions, &metric, config.start)?;
    let reward = RewardSummary::of_log(&log.decisions, config)?;
    let worst = config.worst_return.unwrap_or(0.0);
    let progress = printer.progress();
    let model =
        ActionModel::build(log.decisions, &metric, starts, &config.model, worst, &progress)?;
    let log = described(&model, distance, &log.names)?;
    Ok(Some(InspectedActions { log, reward }))
}

impl InspectedActions {
    /// Prints it for people.
    ///
    /// # Errors
    /// Returns an error if it cannot be printed.
    pub fn show(&self, printer: &Printer) -> Result<(), StepError> {
        let Self { log, reward } = self;
        let columns = counted(log.columns.len(), "column");
        printer.result("")?;
        printer.result(&format!(
            "for agents that act: {}; states of {columns}, without what they do and get",
            show::line(log)
        ))?;
        printer.result(&reward.line())?;
        printer.lines(&show::actions(log))?;
        printer.lines(&show::states(log))?;
        Ok(())
    }
}
