//! Agents that act: logs of decisions, models with actions, control agents, sweeps and verdicts of returns.
//!
//! - [`Environment`], [`Outcome`]: the interface to a simulator or a model, which look the same to an agent.
//! - [`Task`], [`Acrobot`], [`CartPole`], [`Membrane`], [`Pendulum`], [`PuddleWorld`]: tasks with known answers.
//! - [`ActionModel`]: a model with actions, in memory or mapped from a folder; [`ActionRollouts`]: many
//!   rollouts through it.
//! - [`Agent`], [`AgentConfig`]: Expected Sarsa(λ) and Q-learning, linear in tile coding, and Q-learning with a network.

mod action_rollouts;
mod agent;
mod agent_run;
mod behaviour;
mod column_findings;
mod config;
mod constant;
mod decision_rows;
mod drift;
mod environment;
mod error;
mod evaluation;
mod grid;
mod importance;
mod level_grid;
mod levels;
mod log;
mod model;
mod off_policy;
mod outlying;
mod proposed;
mod recorded;
mod reward;
mod settings;
mod step_rows;
mod sweep;
mod task;
mod trajectory;
mod usage;
mod verdict;

pub use action_rollouts::{ActionRollout, ActionRollouts, RolloutStep, StepModel};
pub use agent::{Agent, AgentConfig, Algorithm};
pub use agent_run::{Actor, AgentRun, RunLength, run_agent};
pub use behaviour::{Behaviour, Quality, Recorded, record};
pub use column_findings::{ColumnFindings, LaggedDecisions, TerminalCells, UnendedGaps};
pub use config::{ControlConfig, RewardRow, StartRows};
pub use constant::{ConstantReturns, FixedPolicy, FixedRollouts, constant_returns};
pub use decision_rows::{ChangedDecisions, DecisionRows, RowsWithoutReward};
pub use drift::Drift;
pub use environment::{Ending, Environment, Outcome};
pub use error::ControlError;
pub use grid::Grid;
pub use importance::Importance;
pub use levels::{FEW_STEPS, LEAST_LEVELS, Levels};
pub use log::{Columns, Decisions};
pub use model::{
    ActionModel, ActionModelConfig, ActionModelKind, ActionModelRecord, At, Coverage, Covered,
    Distance, Ensemble, IncrementModel, IncrementRollout, Increments, ModelEnvironment,
    NeighborRollout, NetworkConfig, NetworkFiles, NetworkModel, NetworkRollout, NetworkWorkplace,
    Pessimism, Rules, Starts, Step, Target, open_action_model, write_action_model,
};
pub use off_policy::{FittedQValue, OffPolicyValues, off_policy_bytes, off_policy_values};
pub use outlying::OutlyingActions;
pub use proposed::{
    PAIRED_COLUMNS, ProposedSettings, is_below_returns, is_beyond_returns, is_nearly_greedy,
    is_random, two_digits,
};
pub use recorded::RecordedReturn;
pub use reward::{Reward, RewardColumns, SetPoint, Term};
pub use settings::Settings;
pub use sweep::{
    ActingAgents, NotKept, Run, RunBudget, RunId, RunKeeper, runs_here, sweep, sweep_keeping, truth,
};
pub use task::{
    Acrobot, Begin, CartPole, Membrane, Pendulum, PuddleWorld, Rule, Simulated, Task, TaskKind,
};
pub use trajectory::{Trajectory, trajectory};
pub use usage::{CoverageMap, Spread, hardly_taken};
pub use verdict::{
    BestConstant, Doubt, FEWEST_BLOCKS, KINDS_AGREE, KindMean, KindReturns, OutlyingMember,
    Question, RandomActions, Regret, ReturnVerdict, StepRates, Support, judge, regret,
};
