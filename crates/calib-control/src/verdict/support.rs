/// The limits below which a choice is refused.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Support {
    /// The largest share of the chosen setting's steps that the log may leave uncovered.
    pub most_uncovered: f64,
    /// The fewest terminals of the log; 0 for a task without terminals.
    pub fewest_terminals: usize,
}

impl Default for Support {
    /// Half of the steps, and ten terminals. Our choice: over the logs of docs/control.md, limits from a third to six tenths keep choices
    /// of the same quality.
    fn default() -> Self {
        Self { most_uncovered: 0.5, fewest_terminals: 10 }
    }
}
