use crate::Scores;

/// A representation is chosen only if its uniqueness is above this value (paper).
pub const LEAST_UNIQUENESS: f64 = 0.95;

/// Returns the position of the representation to use. Among those with a uniqueness above 0.95, it has the
/// highest dynamics awareness (paper); of equal ones it is the first. Returns `None` if none qualifies.
/// Diverged representations have no scores.
pub fn select(candidates: &[Option<Scores>]) -> Option<usize> {
    let mut best: Option<(usize, f64)> = None;
    for (position, scores) in candidates.iter().enumerate() {
        let Some(scores) = scores.filter(|scores| scores.uniqueness > LEAST_UNIQUENESS) else {
            continue;
        };
        if best.is_none_or(|(_, awareness)| scores.dynamics_awareness > awareness) {
            best = Some((position, scores.dynamics_awareness));
        }
    }
    best.map(|(position, _)| position)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scores(dynamics_awareness: f64, uniqueness: f64) -> Scores {
        Scores {
            dynamics_awareness,
            uniqueness,
            live_dimensions: 1,
            successive_distance: 1.0,
            random_distance: 2.0,
        }
    }

    #[test]
    fn uniqueness_qualifies_and_awareness_decides() {
        let all = [
            Some(scores(0.9, 0.95)),
            None,
            Some(scores(0.5, 0.96)),
            Some(scores(0.6, 0.99)),
            Some(scores(0.6, 1.0)),
        ];
        assert_eq!(select(&all), Some(3));
        assert_eq!(select(&all[..2]), None);
        assert_eq!(select(&[Some(scores(0.0, 1.0))]), Some(0));
    }
}
