/// The class of every transition: its action, for example. Without classes, all transitions are of class 0.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Classes<'a> {
    given: Option<&'a [u16]>,
    count: usize,
}

impl<'a> Classes<'a> {
    /// All transitions are of one class.
    pub(crate) const NONE: Self = Self { given: None, count: 1 };

    /// Creates `count` classes from the class of every transition.
    pub(crate) fn new(given: &'a [u16], count: usize) -> Self {
        Self { given: Some(given), count }
    }

    /// Whether lists are kept for each class.
    pub(crate) fn are_given(self) -> bool {
        self.given.is_some()
    }

    /// Returns the number of classes.
    pub(crate) fn count(self) -> usize {
        self.count
    }

    /// Returns the class of a transition.
    pub(crate) fn class(self, transition: u32) -> usize {
        self.given.map_or(0, |given| usize::from(given[transition as usize]))
    }
}
