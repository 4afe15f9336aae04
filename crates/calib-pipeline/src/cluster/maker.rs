//! The maker of a plan or shard. Results of different calib versions, or of processors that compute other numbers, are
//! never combined.

use calib_base::{StepError, artefact::TOOL, bail};
use calib_sweep::RESULT_VERSION;
use serde::{Deserialize, Serialize};

use crate::cluster::arithmetic;

/// The properties of a process that its results depend on, besides their inputs.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Maker {
    /// The version of calib.
    pub(crate) tool: String,
    /// The commit that it was built from, if the build set `CALIB_COMMIT`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) commit: Option<String>,
    /// Version of the results.
    pub(crate) results: u32,
    /// Class of the processor's arithmetic.
    pub(crate) arithmetic: String,
}

impl Maker {
    pub(crate) fn here() -> Result<Self, StepError> {
        Ok(Self {
            tool: TOOL.to_owned(),
            commit: option_env!("CALIB_COMMIT").map(str::to_owned),
            results: RESULT_VERSION,
            arithmetic: arithmetic::class()?,
        })
    }

    /// Returns an error if this process differs from the maker of the plan.
    pub(crate) fn check(&self) -> Result<(), StepError> {
        match self.difference(&Self::here()?) {
            Some(difference) => {
                bail!("the plan is of {difference}; results of both would not belong together")
            }
            None => Ok(()),
        }
    }

    /// Describes how another maker differs, if it does.
    pub(crate) fn difference(&self, other: &Self) -> Option<String> {
        let own = self.program();
        let others = other.program();
        if own != others {
            return Some(format!("{own}, and this is {others}; use the same program"));
        }
        (self.arithmetic != other.arithmetic).then(|| {
            format!(
                "processors that compute numbers of the class {}, and this one's are of {}: another processor, system or \
                 library; use machines of one class, or plan again on one of the others",
                self.arithmetic, other.arithmetic
            )
        })
    }

    /// Returns the name of the program, with its commit if known.
    fn program(&self) -> String {
        match &self.commit {
            Some(commit) => format!("{} (commit {commit}, results {})", self.tool, self.results),
            None => format!("{} (results {})", self.tool, self.results),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn versions_commits_and_processors_are_told_apart() {
        let own = Maker::here().expect("computed");
        assert_eq!(own.difference(&own), None);
        let others = [
            (Maker { tool: "calib 9.0.0".to_owned(), ..own.clone() }, "calib 9.0.0"),
            (Maker { commit: Some("abc".to_owned()), ..own.clone() }, "commit abc"),
            (Maker { results: 0, ..own.clone() }, "results 0"),
            (Maker { arithmetic: "other".to_owned(), ..own.clone() }, "the class other"),
        ];
        for (other, told) in others {
            let difference = other.difference(&own).expect("another");
            assert!(difference.contains(told), "{difference}");
        }
    }
}
