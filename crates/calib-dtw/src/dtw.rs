//! One step pattern, ready to compare pairs.

use rayon::prelude::*;

use crate::distance::{Outcome, check, distances};
use crate::kernel::dispatch::InstructionSet;
use crate::path::{Aligned, align, bytes as path_bytes};
use crate::{
    Alignment, Distance, DtwError, Ends, LocalDistance, NoPath, Series, Settings, StepPattern,
    Window,
};

/// Dynamic time warping with one step pattern.
///
/// | parameter | default | meaning |
/// |---|---|---|
/// | [`pattern`](StepPattern) | – | steps of a path, weights, normalisation |
/// | [`local_distance`](LocalDistance) | absolute | distance of two samples |
/// | [`window`](Window) | none | cells a path may visit |
/// | [`ends`](Ends) | closed | ends of the reference that may stay unmatched |
///
/// ```
/// use calib_dtw::{Dtw, StepPattern, Window};
///
/// let dtw = Dtw::new(StepPattern::symmetric2()).window(Window::SakoeChiba { radius: 2 });
/// let distance = dtw.distance(&[0.0, 1.0, 2.0, 1.0], &[0.0, 0.0, 1.0, 2.5, 1.0])?;
/// assert_eq!(distance.raw, 1.0);
/// # Ok::<(), calib_dtw::DtwError>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Dtw {
    pattern: StepPattern,
    settings: Settings,
    instruction_set: InstructionSet,
}

impl Dtw {
    /// Creates a time warp with this pattern and default settings.
    pub fn new(pattern: StepPattern) -> Self {
        Self::with_settings(pattern, Settings::default())
    }

    /// Creates a time warp with this pattern and these settings.
    pub fn with_settings(pattern: StepPattern, settings: Settings) -> Self {
        Self { pattern, settings, instruction_set: InstructionSet::best() }
    }

    /// Sets the local distance.
    #[must_use]
    pub fn local_distance(mut self, local_distance: LocalDistance) -> Self {
        self.settings.local_distance = local_distance;
        self
    }

    /// Sets the window.
    #[must_use]
    pub fn window(mut self, window: Window) -> Self {
        self.settings.window = window;
        self
    }

    /// Sets the ends.
    #[must_use]
    pub fn ends(mut self, ends: Ends) -> Self {
        self.settings.ends = ends;
        self
    }

    /// Selects an instruction set other than the best. The results are the same.
    ///
    /// # Errors
    /// If the processor lacks it.
    pub fn instruction_set(mut self, set: InstructionSet) -> Result<Self, DtwError> {
        if !InstructionSet::available().contains(&set) {
            let instruction_set = set.name();
            return Err(DtwError::Unsupported { instruction_set });
        }
        self.instruction_set = set;
        Ok(self)
    }

    /// Returns the step pattern.
    pub fn pattern(&self) -> &StepPattern {
        &self.pattern
    }

    /// Returns the settings.
    pub fn settings(&self) -> Settings {
        self.settings
    }

    pub(crate) fn check(&self, query: Series<'_>, reference: Series<'_>) -> Result<(), DtwError> {
        check(std::slice::from_ref(&self.pattern), self.settings, query, reference)
    }

    fn no_path(&self, query: Series<'_>, reference: Series<'_>) -> NoPath {
        NoPath::new(&self.pattern, self.settings.window, query.len(), reference.len())
    }

    /// Returns the distance of a pair. Memory grows with N + M.
    ///
    /// # Errors
    /// If a series is empty, not finite or too large, the channels differ, or no path is admissible.
    pub fn distance<'a>(
        &self,
        query: impl Into<Series<'a>>,
        reference: impl Into<Series<'a>>,
    ) -> Result<Distance, DtwError> {
        self.distance_until(query, reference, &|| false)
    }

    /// Returns the distance as [`Dtw::distance`], unless `stop` returns true first. It is called every few milliseconds.
    ///
    /// # Errors
    /// As [`Dtw::distance`], and [`DtwError::Stopped`].
    pub fn distance_until<'a>(
        &self,
        query: impl Into<Series<'a>>,
        reference: impl Into<Series<'a>>,
        stop: &dyn Fn() -> bool,
    ) -> Result<Distance, DtwError> {
        let query = query.into();
        let reference = reference.into();
        self.check(query, reference)?;
        let patterns = std::slice::from_ref(&self.pattern);
        let set = self.instruction_set;
        let mut outcomes = distances(set, patterns, self.settings, query, reference, Some(stop));
        match outcomes.pop() {
            Some(Outcome::Found(distance)) => Ok(distance),
            Some(Outcome::Stopped) => Err(DtwError::Stopped),
            Some(Outcome::NoPath) | None => Err(self.no_path(query, reference).into()),
        }
    }

    /// Returns the distances of many pairs (query, reference), in parallel on rayon's current pool. The results do not depend on the
    /// number of threads.
    pub fn distances(&self, pairs: &[(Series<'_>, Series<'_>)]) -> Vec<Result<Distance, DtwError>> {
        pairs.par_iter().map(|&(query, reference)| self.distance(query, reference)).collect()
    }

    /// Returns the distance and the path. Memory grows with (N + M) log N. Parts of the rectangle are computed again to find the path,
    /// which takes about as much work again as the distance.
    ///
    /// # Errors
    /// As [`Dtw::distance`].
    pub fn align<'a>(
        &self,
        query: impl Into<Series<'a>>,
        reference: impl Into<Series<'a>>,
    ) -> Result<Alignment, DtwError> {
        self.align_until(query, reference, &|| false)
    }

    /// Returns the distance and the path as [`Dtw::align`], unless `stop` returns true first. It is called every few milliseconds.
    ///
    /// # Errors
    /// As [`Dtw::distance`], and [`DtwError::Stopped`].
    pub fn align_until<'a>(
        &self,
        query: impl Into<Series<'a>>,
        reference: impl Into<Series<'a>>,
        stop: &dyn Fn() -> bool,
    ) -> Result<Alignment, DtwError> {
        let query = query.into();
        let reference = reference.into();
        self.check(query, reference)?;
        let set = self.instruction_set;
        let pattern = &self.pattern;
        match align(set, pattern, self.settings, query, reference, Some(stop)) {
            Aligned::Found(alignment) => Ok(alignment),
            Aligned::NoPath => Err(self.no_path(query, reference).into()),
            Aligned::NoRoom { cells } => Err(DtwError::Memory { cells }),
            Aligned::Stopped => Err(DtwError::Stopped),
        }
    }

    /// Returns the maximum memory of [`Dtw::align`] for series of these lengths, in bytes, without the series.
    pub fn path_bytes(&self, query: usize, reference: usize) -> u64 {
        path_bytes(&self.pattern, query, reference)
    }
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;

    use super::*;

    fn wave(phase: f64) -> Vec<f64> {
        (0..3000).map(|t| (f64::from(t) * 0.01 + phase).sin()).collect()
    }

    #[test]
    fn what_nobody_waits_for_ends_wherever_it_is() {
        let query = wave(0.0);
        let reference = wave(0.3);
        let dtw = Dtw::new(StepPattern::symmetric2());
        let expected = dtw.align(&query, &reference).expect("a path");
        // Stops at the first call, then at the second and so on, until a run completes.
        for stops_at in 1.. {
            let asked = Cell::new(0);
            let aligned = dtw.align_until(&query, &reference, &|| {
                asked.set(asked.get() + 1);
                asked.get() == stops_at
            });
            match aligned {
                Err(DtwError::Stopped) => assert_eq!(asked.get(), stops_at, "never asked again"),
                other => {
                    assert_eq!(other, Ok(expected));
                    assert!(stops_at > 6, "every strip is one to stop at");
                    break;
                }
            }
        }
        assert_eq!(dtw.distance_until(&query, &reference, &|| true), Err(DtwError::Stopped));
    }
}
