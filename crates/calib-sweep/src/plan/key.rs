//! What results are known by.

use std::{borrow::Cow, sync::Arc};

use calib_agent::AgentConfig;
use calib_core::Seed;
use calib_files::{Fingerprint, Fingerprinter};
use serde::Serialize;

use super::{Plan, RESULT_VERSION, SensorGroup};
use crate::{Baselines, Candidate, Program, Span, Start, Unit};

/// What the runs of a unit follow from, beside their settings and what holds for the whole plan.
pub(super) struct UnitInputs<'i> {
    pub(super) group: &'i SensorGroup<'i>,
    /// Column of the states that is predicted.
    pub(super) column: usize,
    pub(super) agents: &'i [&'i Candidate],
    /// What the agents start from, if they were pre-trained.
    pub(super) start: Option<&'i Start>,
    pub(super) seed: Seed,
    /// Of what the stream is made from.
    pub(super) stream: &'i Fingerprint,
}

impl Plan<'_> {
    /// Fingerprint of everything that the runs of a unit follow from beside their settings.
    pub(super) fn key(
        &self,
        unit: &Unit,
        &UnitInputs { group, column, agents, start, seed, stream }: &UnitInputs<'_>,
    ) -> String {
        #[derive(Serialize)]
        struct Key<'k> {
            format: u32,
            unit: &'k Unit,
            column: usize,
            span: Span,
            curve_points: usize,
            seed: Seed,
            inputs: &'k Fingerprint,
            #[serde(skip_serializing_if = "Option::is_none")]
            start: Option<&'k Fingerprint>,
            #[serde(skip_serializing_if = "Option::is_none")]
            program: Option<&'k Fingerprint>,
            #[serde(skip_serializing_if = "Option::is_none")]
            stacked: Option<Stacked<'k>>,
            /// Where it is not that of the settings.
            #[serde(skip_serializing_if = "Option::is_none")]
            gamma: Option<f64>,
        }
        /// An accelerator stacks the networks of all settings in one product, whose size may decide how it rounds. Its
        /// runs are those of all of them.
        #[derive(Serialize)]
        struct Stacked<'k> {
            arithmetic: &'k str,
            agents: Vec<Cow<'k, AgentConfig>>,
        }
        let stacked = self.accelerator.map(|accelerator| Stacked {
            arithmetic: accelerator.class(),
            agents: agents.iter().map(|candidate| candidate.agent.identity()).collect(),
        });
        fingerprint(&Key {
            format: RESULT_VERSION,
            unit,
            column,
            span: group.span,
            curve_points: self.options.curve_points,
            seed,
            inputs: stream,
            start: start.map(|start| &start.fingerprint),
            program: self.program.map(Program::fingerprint),
            stacked,
            gamma: self.own_gamma(group),
        })
    }

    /// The discount factor of a group, if it is not that of the plan's candidates.
    fn own_gamma(&self, group: &SensorGroup<'_>) -> Option<f64> {
        let [own, all] = [group.candidates, self.candidates]
            .map(|candidates| candidates.first().map(|candidate| candidate.agent.gamma));
        own.filter(|_| own != all)
    }

    /// The key of each candidate's setting, in their order: a fingerprint of what a run follows from beside its unit. It
    /// does not depend on which other candidates there are.
    pub fn settings(&self) -> &[Arc<str>] {
        #[derive(Serialize)]
        struct Key<'k> {
            agent: Cow<'k, AgentConfig>,
            #[serde(skip_serializing_if = "Option::is_none")]
            baselines: Option<&'k Fingerprint>,
        }
        self.settings.get_or_init(|| {
            self.candidates
                .iter()
                .map(|candidate| {
                    let fitted = self.baselines.filter(|_| candidate.agent.baseline.is_some());
                    let baselines = fitted.map(Baselines::fingerprint);
                    fingerprint(&Key { agent: candidate.agent.identity(), baselines }).into()
                })
                .collect()
        })
    }
}

fn fingerprint(key: &impl Serialize) -> String {
    let text = serde_json::to_vec(key).unwrap_or_else(|_| unreachable!("plain data"));
    Fingerprinter::default().add(&text).finish().to_string()
}
