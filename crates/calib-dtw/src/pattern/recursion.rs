//! A step pattern written out as a formula.

use std::fmt;

use super::{Normalisation, StepPattern};

/// Displays the recursion of a step pattern, one branch per line.
///
/// ```
/// # use calib_dtw::StepPattern;
/// assert_eq!(StepPattern::symmetric2().recursion().to_string(), "\
/// symmetric2: g(i,j) = min of
///   g(i-1,j-1) + 2 d(i,j)
///   g(i,j-1) + d(i,j)
///   g(i-1,j) + d(i,j)
/// normalised by N + M");
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Recursion<'a>(&'a StepPattern);

impl StepPattern {
    /// Returns the recursion, for printing.
    pub fn recursion(&self) -> Recursion<'_> {
        Recursion(self)
    }
}

struct At(usize, usize);

impl fmt::Display for At {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self(0, 0) => f.write_str("(i,j)"),
            Self(0, b) => write!(f, "(i,j-{b})"),
            Self(a, 0) => write!(f, "(i-{a},j)"),
            Self(a, b) => write!(f, "(i-{a},j-{b})"),
        }
    }
}

impl fmt::Display for Recursion<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}: g(i,j) = min of", self.0.name())?;
        for branch in self.0.branches() {
            let (query, reference) = branch.origin();
            write!(f, "  g{}", At(query, reference))?;
            for cell in branch.cells() {
                let at = At(cell.query, cell.reference);
                if cell.weight == 1.0 {
                    write!(f, " + d{at}")?;
                } else if cell.weight.fract() == 0.0 {
                    write!(f, " + {} d{at}", cell.weight)?;
                } else {
                    write!(f, " + {:.4} d{at}", cell.weight)?;
                }
            }
            writeln!(f)?;
        }
        f.write_str(match self.0.normalisation() {
            Normalisation::Query => "normalised by N",
            Normalisation::Reference => "normalised by M",
            Normalisation::Sum => "normalised by N + M",
            Normalisation::None => "not normalisable",
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_and_offsets_are_written_out() {
        let text = "rabinerJuang:6c".parse::<StepPattern>().unwrap();
        assert_eq!(
            text.recursion().to_string(),
            "rabinerJuang:6c: g(i,j) = min of\n  \
             g(i-3,j-2) + d(i-2,j-1) + d(i-1,j) + d(i,j)\n  \
             g(i-1,j-1) + d(i,j)\n  \
             g(i-2,j-3) + d(i-1,j-2) + d(i,j-1) + 0 d(i,j)\n\
             normalised by N"
        );
        let third = StepPattern::asymmetric_p05().recursion().to_string();
        assert!(third.contains("g(i-1,j-3) + 0.3333 d(i,j-2) + 0.3333 d(i,j-1) + 0.3333 d(i,j)"));
    }
}
