use super::Coverage;
use crate::{Drift, Environment};

/// Models of one log that agents act in: neighbours or networks, a sweep cannot tell them apart.
pub trait Ensemble: Sync {
    /// A walk in one of them.
    type Walk<'a>: Walked
    where
        Self: 'a;

    /// Number of members.
    fn members(&self) -> usize;

    /// A walk in member `member`.
    ///
    /// # Panics
    /// If there is no such member.
    fn walk(&self, member: usize) -> Self::Walk<'_>;
}

/// An environment that knows what its steps rested on.
pub trait Walked: Environment {
    /// What they rested on so far.
    fn coverage(&self) -> Coverage;

    /// How far its whole episodes were moved by jumps, or the one that is not over; nothing where steps are no jumps.
    fn drift(&self) -> Drift {
        Drift::default()
    }
}
