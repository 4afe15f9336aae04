//! Distances of one pair, for one or several patterns.

use crate::kernel::dispatch::InstructionSet;
use crate::kernel::sweep::{Purpose, Stop, Sweep, entry};
use crate::{Branch, DtwError, Ends, NoPath, Normalisation, Role, Series, Settings, StepPattern};

/// A warping distance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Distance {
    /// Cumulated distance along the best path, in units of the local distance.
    pub raw: f64,
    /// The raw distance divided by the pattern's normalisation: a mean local distance. `None` for
    /// patterns without normalisation.
    pub normalised: Option<f64>,
    /// Reference sample at which the path ends: the last one, unless the end is open.
    pub end: usize,
}

/// Checks that the pair can be compared.
pub(crate) fn check(
    patterns: &[StepPattern],
    settings: Settings,
    query: Series<'_>,
    reference: Series<'_>,
) -> Result<(), DtwError> {
    let largest = f64::max(query.checked(Role::Query)?, reference.checked(Role::Reference)?);
    if query.channels() != reference.channels() {
        return Err(DtwError::Channels {
            query: query.channels(),
            reference: reference.channels(),
        });
    }
    let steps = patterns.iter().flat_map(StepPattern::branches).flat_map(Branch::steps);
    let weight = steps.map(|step| step.weight).fold(1.0, f64::max);
    let cells = (query.len() + reference.len()) as f64;
    let local = settings.local_distance.at_most(2.0 * largest, query.channels());
    if !(local * weight * cells).is_finite() {
        return Err(DtwError::TooLarge { largest });
    }
    if settings.ends.open_begin()
        && let Some(pattern) = patterns.iter().find(|p| p.normalisation() != Normalisation::Query)
    {
        return Err(DtwError::OpenBegin {
            pattern: pattern.name().to_owned(),
            normalisation: pattern.normalisation(),
        });
    }
    Ok(())
}

/// The search for the best end of a path, from the cumulated distances of the last query sample.
struct BestEnd<'a> {
    pattern: &'a StepPattern,
    ends: Ends,
    query: usize,
    reference: usize,
    best: Option<Distance>,
}

impl BestEnd<'_> {
    fn offer(&mut self, column: usize, raw: f64) {
        if raw == f64::INFINITY || !(self.ends.open_end() || column + 1 == self.reference) {
            return;
        }
        let normalised = self.pattern.normalise(raw, self.query, column + 1);
        let rank = normalised.unwrap_or(raw);
        if self.best.is_none_or(|best| rank < best.normalised.unwrap_or(best.raw)) {
            self.best = Some(Distance { raw, normalised, end: column });
        }
    }
}

/// The result of [`distances`] for one pattern.
pub(crate) enum Outcome {
    Found(Distance),
    NoPath,
    /// The caller stopped the computation.
    Stopped,
}

/// Returns the distances of a checked pair.
pub(crate) fn distances(
    set: InstructionSet,
    patterns: &[StepPattern],
    settings: Settings,
    query: Series<'_>,
    reference: Series<'_>,
    stop: Stop<'_>,
) -> Vec<Outcome> {
    let m = reference.len();
    let mut sweep = Sweep::new(set, patterns, settings, query, reference, Purpose::Distance, stop);
    for track in &mut sweep.patterns {
        track.input = entry(settings, track.halo, m);
    }
    for number in 0..sweep.strips() - 1 {
        sweep.run(number, m, |_, _| {});
    }
    let best = finish(&mut sweep, patterns).into_iter();
    if sweep.is_stopped {
        return patterns.iter().map(|_| Outcome::Stopped).collect();
    }
    best.map(|best| best.map_or(Outcome::NoPath, Outcome::Found)).collect()
}

/// Sweeps the last strip and finds the best end of each pattern.
pub(crate) fn finish(sweep: &mut Sweep<'_>, patterns: &[StepPattern]) -> Vec<Option<Distance>> {
    let n = sweep.query.len();
    let m = sweep.reference.len();
    let mut ends: Vec<_> = patterns
        .iter()
        .map(|pattern| BestEnd {
            pattern,
            ends: sweep.settings.ends,
            query: n,
            reference: m,
            best: None,
        })
        .collect();
    let last = sweep.strips() - 1;
    let (lane, row) = sweep.strip(last).place(n - 1);
    sweep.run(last, m, |time, tracks| {
        let Some(column) = time.checked_sub(lane).filter(|column| *column < m) else {
            return;
        };
        for (track, end) in tracks.iter().zip(&mut ends) {
            end.offer(column, track.cumulated[0][track.halo + row].0[lane]);
        }
    });
    ends.into_iter().map(|end| end.best).collect()
}

/// Converts an infinite distance into the error that users see.
pub(crate) fn found(
    outcome: &Outcome,
    pattern: &StepPattern,
    settings: Settings,
    query: usize,
    reference: usize,
) -> Result<Distance, NoPath> {
    match outcome {
        Outcome::Found(distance) => Ok(*distance),
        Outcome::NoPath | Outcome::Stopped => {
            Err(NoPath::new(pattern, settings.window, query, reference))
        }
    }
}
