//! The ends of a grid, beyond which better settings may lie.

/// An end of the numbers of a grid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GridEnd {
    /// No number is smaller, and it is above 0: nothing lies below a step size or a temperature of 0.
    Smallest,
    /// No number is larger.
    Largest,
}

impl GridEnd {
    /// Returns the end at which `own` is among the numbers of a grid, if it is at one and at least three numbers differ.
    pub fn at(own: f64, mut numbers: Vec<f64>) -> Option<Self> {
        numbers.sort_by(f64::total_cmp);
        numbers.dedup();
        // Of two numbers, each would be at an end.
        let [smallest, _, .., largest] = numbers[..] else { return None };
        if own >= largest {
            Some(Self::Largest)
        } else if own > 0.0 && own <= smallest {
            Some(Self::Smallest)
        } else {
            None
        }
    }

    /// Returns "smallest" or "largest".
    pub fn name(self) -> &'static str {
        match self {
            Self::Smallest => "smallest",
            Self::Largest => "largest",
        }
    }
}
