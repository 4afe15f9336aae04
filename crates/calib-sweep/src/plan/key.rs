//! Keys of results: fingerprints of their inputs.

use std::{borrow::Cow, sync::Arc};

use calib_agent::AgentConfig;
use calib_core::Seed;
use calib_files::{Fingerprint, Fingerprinter};
use serde::Serialize;

use super::{Plan, RESULT_VERSION, SensorGroup, unit_inputs::UnitInputs};
use crate::{Baselines, Program, Span, Unit};

impl Plan<'_> {
    /// Returns the fingerprint of all inputs of a unit's runs except their settings.
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
            /// The discount factor, where it differs from that of the settings.
            #[serde(skip_serializing_if = "Option::is_none")]
            gamma: Option<f64>,
        }
        /// The settings whose networks an accelerator stacks in one product. The size of the product may decide how it
        /// rounds, so each run depends on all of them.
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

    /// Returns the discount factor of a group, if it differs from that of the plan's settings.
    fn own_gamma(&self, group: &SensorGroup<'_>) -> Option<f64> {
        let [own, all] = [group.candidates, self.candidates]
            .map(|candidates| candidates.first().map(|candidate| candidate.agent.gamma));
        own.filter(|_| own != all)
    }

    /// Returns the key of each setting, in order. A key is the fingerprint of all inputs of a run except its unit. It
    /// does not depend on the other settings.
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
