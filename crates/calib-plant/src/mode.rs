/// Operating mode, with the number that the pilot's controller writes.
///
/// Numbers and frequencies are those of the plant of Janjua et al. (see [`crate`]); mode 61 is our
/// name for the chemical clean, which the published month does not contain.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Mode {
    /// 1: stopped.
    Stopped,
    /// 3: restarting after a stop.
    Restart,
    /// 4: standby.
    Standby,
    /// 13: production; the permeate pump draws through the membrane and fouling builds up.
    Production,
    /// 31: back-pulse; permeate is pushed back through the membrane.
    BackPulse,
    /// 33: the membrane tank is drained and filled again.
    DrainAndRefill,
    /// 45: integrity test; the membrane holds air pressure.
    IntegrityTest,
    /// 61: chemical clean.
    ChemicalClean,
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

    /// Whether the plant can be opened.
    pub(crate) const fn stands_still(self) -> bool {
        matches!(self, Self::Stopped | Self::Standby | Self::ChemicalClean)
    }

    /// The number in the channel `MODE`.
    pub const fn number(self) -> u8 {
        match self {
            Self::Stopped => 1,
            Self::Restart => 3,
            Self::Standby => 4,
            Self::Production => 13,
            Self::BackPulse => 31,
            Self::DrainAndRefill => 33,
            Self::IntegrityTest => 45,
            Self::ChemicalClean => 61,
        }
    }
}
