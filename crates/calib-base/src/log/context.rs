//! What the steps of one command have in common.

use std::{
    collections::BTreeMap,
    ops::Deref,
    path::{Path, PathBuf},
    sync::{Arc, Mutex, PoisonError},
};

use crate::{log::prepared::Prepared, output::Printer};

/// Whom the steps of a command tell what they do, and the logs that they have opened: within a command a log is what it
/// was when it was first read, and files are compared with what was written once.
#[derive(Clone)]
pub struct RunContext {
    printer: Printer,
    opened: Arc<Mutex<Opened>>,
    /// Rows that each row of the log stands for, if it [stands in](crate::log::stand_in) for another.
    stand_in: Option<usize>,
}

/// Logs by their folders, all of the study that was opened last: others are let go.
#[derive(Default)]
struct Opened {
    root: PathBuf,
    logs: BTreeMap<PathBuf, Prepared>,
}

impl RunContext {
    /// A command begins: what an earlier one has opened may have changed meanwhile.
    pub fn new(printer: &Printer) -> Self {
        Self { printer: printer.clone(), opened: Arc::default(), stand_in: None }
    }

    /// The same for a step on the way to another result.
    #[must_use]
    pub fn talking(&self) -> Self {
        Self { printer: self.printer.talking(), ..self.clone() }
    }

    /// The same for a step that is up to date.
    #[must_use]
    pub fn in_detail(&self) -> Self {
        Self { printer: self.printer.in_detail(), ..self.clone() }
    }

    /// The same for what is done twice: nothing is said.
    #[must_use]
    pub fn silent(&self) -> Self {
        Self { printer: self.printer.silent(), ..self.clone() }
    }

    /// The same for logs that stand in for others: each row for `rows_each` of them.
    #[must_use]
    pub(crate) fn with_stand_in(&self, rows_each: usize) -> Self {
        Self { stand_in: Some(rows_each), ..Self::new(self) }
    }

    /// The rows that each row of a log stands for; none if it stands for itself.
    pub fn stands_in(&self) -> Option<usize> {
        self.stand_in
    }

    /// A log that was opened, of those below `root`.
    pub(crate) fn opened(&self, root: &Path, directory: &Path) -> Option<Prepared> {
        let opened = self.opened.lock().unwrap_or_else(PoisonError::into_inner);
        if opened.root == root { opened.logs.get(directory).cloned() } else { None }
    }

    /// Keep a log that was opened.
    pub(crate) fn remember(&self, root: &Path, directory: &Path, log: &Prepared) {
        let mut opened = self.opened.lock().unwrap_or_else(PoisonError::into_inner);
        // States that stand in for others are in memory, those of one log at a time.
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
