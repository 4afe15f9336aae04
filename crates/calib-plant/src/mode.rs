/// Operating mode, with the number that the pilot's controller writes.
///
/// Numbers and frequencies are those of the plant of Janjua et al. (see [`crate`]); mode 61 is our
/// name for the chemical clean, which the published month does not contain.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Mode {
    /// Stopped.
    Stopped = 1,
    /// Restarting after a stop.
    Restart = 3,
    /// Standby.
    Standby = 4,
    /// Production; the permeate pump draws through the membrane and fouling builds up.
    Production = 13,
    /// Back-pulse; permeate is pushed back through the membrane.
    BackPulse = 31,
    /// The membrane tank is drained and filled again.
    DrainAndRefill = 33,
    /// Integrity test; the membrane holds air pressure.
    IntegrityTest = 45,
    /// Chemical clean.
    ChemicalClean = 61,
}

impl Mode {
    /// All modes, in the order of their numbers.
    pub const ALL: [Self; 8] = [
        Self::Stopped,
        Self::Restart,
        Self::Standby,
        Self::Production,
        Self::BackPulse,
        Self::DrainAndRefill,
        Self::IntegrityTest,
        Self::ChemicalClean,
    ];

    /// Whether the plant is stopped, so that parts can be exchanged.
    pub(crate) const fn stands_still(self) -> bool {
        matches!(self, Self::Stopped | Self::Standby | Self::ChemicalClean)
    }

    /// Returns the number in the channel `MODE`.
    pub const fn number(self) -> u8 {
        self as u8
    }
}
