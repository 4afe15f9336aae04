//! The context that the steps of one command share.

use std::{
    collections::{BTreeMap, BTreeSet},
    ops::Deref,
    path::{Path, PathBuf},
    sync::{Arc, Mutex},
};

use calib_core::locked;
use calib_study::{Job, StepKind};

use crate::{
    cost::{ExpectedStep, StepCost},
    log::prepared_log::Prepared,
    output::Printer,
};

/// The observer of a command's steps, the logs that they have opened, and the costs that they expect. Within a command,
/// a log is as it was when it was first read, and files are compared with their recorded fingerprints once.
#[derive(Clone)]
pub struct RunContext {
    printer: Printer,
    opened: Arc<Mutex<Opened>>,
    expected: Arc<Mutex<Vec<ExpectedStep>>>,
    /// The texts of [`warn_once`](Self::warn_once) and [`say_once`](Self::say_once).
    told: Arc<Mutex<BTreeSet<String>>>,
    /// Number of rows that each row of the log represents, if it is a [stand-in](crate::log::stand_in) for another log.
    stand_in: Option<usize>,
}

/// Logs by folder, all of the study that was opened last. Logs of other studies are dropped.
#[derive(Default)]
struct Opened {
    root: PathBuf,
    logs: BTreeMap<PathBuf, Prepared>,
}

impl RunContext {
    /// Returns the context of a new command. Logs may have changed since an earlier command opened them.
    pub fn new(printer: &Printer) -> Self {
        Self {
            printer: printer.clone(),
            opened: Arc::default(),
            expected: Arc::default(),
            told: Arc::default(),
            stand_in: None,
        }
    }

    /// Returns the context for a step on the way to another result.
    #[must_use]
    pub fn talking(&self) -> Self {
        Self { printer: self.printer.talking(), ..self.clone() }
    }

    /// Returns the context for a step that is up to date.
    #[must_use]
    pub fn in_detail(&self) -> Self {
        Self { printer: self.printer.in_detail(), ..self.clone() }
    }

    /// Returns the context for repeated work, which reports nothing.
    #[must_use]
    pub fn silent(&self) -> Self {
        Self { printer: self.printer.silent(), told: Arc::default(), ..self.clone() }
    }

    /// Warns, unless the command has already given this warning. A log is read once for every deployment.
    pub(crate) fn warn_once(&self, text: &str) {
        if self.is_new(text) {
            self.printer.warn(text);
        }
    }

    /// Reports a line, unless the command has already reported it.
    pub(crate) fn say_once(&self, text: &str) {
        if self.is_new(text) {
            self.printer.say(text);
        }
    }

    fn is_new(&self, text: &str) -> bool {
        locked(&self.told).insert(text.to_owned())
    }

    /// Returns the context for a stand-in log, each row of which represents `rows_each` rows.
    #[must_use]
    pub(crate) fn with_stand_in(&self, rows_each: usize) -> Self {
        Self { stand_in: Some(rows_each), ..Self::new(self) }
    }

    /// Returns the number of rows that each row of a stand-in log represents, or `None` for an ordinary log.
    pub fn stands_in(&self) -> Option<usize> {
        self.stand_in
    }

    /// Reports and records the expected cost of a step for this part of a study, in a dry run.
    pub fn tell_cost(&self, step: StepKind, part: &Job, cost: StepCost) {
        self.say(&cost.line());
        self.expect(step, part, cost);
    }

    /// Records the expected cost of a step for this part of a study, in a dry run.
    pub fn expect(&self, step: StepKind, part: &Job, cost: StepCost) {
        let model = part.model().map(str::to_owned);
        let deployment = part.deployment().map(str::to_owned);
        locked(&self.expected).push(ExpectedStep { step, model, deployment, cost });
    }

    /// Returns the recorded costs.
    pub fn expected(&self) -> Vec<ExpectedStep> {
        locked(&self.expected).clone()
    }

    /// Returns a log below `root` that was opened before.
    pub(crate) fn opened(&self, root: &Path, directory: &Path) -> Option<Prepared> {
        let opened = locked(&self.opened);
        if opened.root == root { opened.logs.get(directory).cloned() } else { None }
    }

    /// Stores a log that was opened.
    pub(crate) fn remember(&self, root: &Path, directory: &Path, log: &Prepared) {
        let mut opened = locked(&self.opened);
        // States of stand-in logs are in memory, so only those of one log are kept.
        if opened.root != root || self.stands_in().is_some() {
            *opened = Opened { root: root.to_owned(), logs: BTreeMap::new() };
        }
        opened.logs.insert(directory.to_owned(), log.clone());
    }
}

impl Deref for RunContext {
    type Target = Printer;

    fn deref(&self) -> &Printer {
        &self.printer
    }
}
