//! What results are known by.

use std::borrow::Cow;

use calib_agent::{Accelerator, AgentConfig};
use calib_core::Seed;
use calib_files::{Fingerprint, Fingerprinter};
use serde::Serialize;

use super::{Plan, RESULT_VERSION};
use crate::{Baselines, Candidate, Program, Span, Start, Unit};

impl Plan<'_> {
    /// Fingerprint of everything that a unit's result follows from.
    pub(super) fn key(
        &self,
        unit: &Unit,
        column: usize,
        agents: &[&Candidate],
        start: Option<&Start>,
        seed: Seed,
        inputs: &Fingerprint,
    ) -> String {
        #[derive(Serialize)]
        struct Key<'k> {
            format: u32,
            unit: &'k Unit,
            column: usize,
            agents: Vec<(usize, Cow<'k, AgentConfig>)>,
            span: Span,
            curve_points: usize,
            seed: Seed,
            inputs: &'k Fingerprint,
            #[serde(skip_serializing_if = "Option::is_none")]
            start: Option<&'k Fingerprint>,
            #[serde(skip_serializing_if = "Option::is_none")]
            baselines: Option<&'k Fingerprint>,
            #[serde(skip_serializing_if = "Option::is_none")]
            program: Option<&'k Fingerprint>,
            #[serde(skip_serializing_if = "Option::is_none")]
            arithmetic: Option<&'k str>,
        }
        let is_fitted = agents.iter().any(|candidate| candidate.agent.baseline.is_some());
        let baselines = self.baselines.filter(|_| is_fitted).map(Baselines::fingerprint);
        let key = Key {
            format: RESULT_VERSION,
            unit,
            column,
            agents: agents.iter().map(|agent| (agent.index, agent.agent.identity())).collect(),
            span: self.options.span,
            curve_points: self.options.curve_points,
            seed,
            inputs,
            start: start.map(|start| &start.fingerprint),
            baselines,
            program: self.program.map(Program::fingerprint),
            arithmetic: self.accelerator.map(Accelerator::class),
        };
        let text = serde_json::to_vec(&key).unwrap_or_else(|_| unreachable!("plain data"));
        Fingerprinter::default().add(&text).finish().to_string()
    }
}
