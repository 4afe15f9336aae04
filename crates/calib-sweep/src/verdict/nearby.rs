use super::Share;
use crate::Candidate;

/// Returns the share of the resamples that choose `chosen` or a neighbour. `None` without resamples, and if `chosen`
/// has no neighbour.
pub(super) fn share_nearby(
    stability: &[Share],
    candidates: &[Candidate],
    chosen: usize,
) -> Option<f64> {
    let nearby = neighbours(candidates, chosen);
    let counted = stability
        .iter()
        .filter(|share| share.candidate == chosen || nearby.contains(&share.candidate));
    let share = counted.map(|share| share.share).sum();
    (!stability.is_empty() && !nearby.is_empty()).then_some(share)
}

/// Returns the settings that differ from `chosen` in only one number, by one place among the numbers of the sweep.
fn neighbours(candidates: &[Candidate], chosen: usize) -> Vec<usize> {
    let own = &candidates[chosen].values;
    let mut nearby = Vec::new();
    for field in 0..own.len() {
        let line = candidates.iter().filter(|candidate| {
            let mut pairs = candidate.values.iter().zip(own).enumerate();
            pairs.all(|(place, (other, own))| place == field || other == own)
        });
        let mut line: Vec<(f64, usize)> = line
            .filter_map(|candidate| Some((candidate.values[field].1.as_f64()?, candidate.index)))
            .collect();
        line.sort_by(|a, b| a.0.total_cmp(&b.0));
        if let Some(place) = line.iter().position(|candidate| candidate.1 == chosen) {
            let beside = [place.checked_sub(1), Some(place + 1)].into_iter().flatten();
            nearby.extend(beside.filter_map(|place| line.get(place)).map(|candidate| candidate.1));
        }
    }
    nearby
}

#[cfg(test)]
mod tests {
    use calib_agent::AgentConfig;
    use serde_json::{Value, json};

    use super::*;

    fn candidates(values: &[&[Value]]) -> Vec<Candidate> {
        values
            .iter()
            .enumerate()
            .map(|(index, values)| Candidate {
                index,
                is_default: index == 0,
                values: values.iter().cloned().map(|value| ("field".to_owned(), value)).collect(),
                agent: AgentConfig::default(),
            })
            .collect()
    }

    #[test]
    fn neighbours_differ_in_one_number_by_one_place() {
        // In any order, because the default may come last.
        let line = candidates(&[&[json!(1e-4)], &[json!(1e-2)], &[json!(1e-3)]]);
        assert_eq!(neighbours(&line, 2), [0, 1]);
        assert_eq!(neighbours(&line, 1), [2]);
        let grid = candidates(&[
            &[json!(0.1), json!(16)],
            &[json!(0.1), json!(32)],
            &[json!(0.2), json!(16)],
            &[json!(0.2), json!(32)],
            &[json!(0.3), json!(32)],
        ]);
        assert_eq!(neighbours(&grid, 3), [1, 4, 2]);
        let words = candidates(&[&[json!("adam")], &[json!("sgd")]]);
        assert!(neighbours(&words, 0).is_empty(), "words have no order");
        let drawn = candidates(&[&[json!(0.1), json!(16)], &[json!(0.2), json!(32)]]);
        assert!(neighbours(&drawn, 0).is_empty(), "drawn at random");
    }

    fn share(candidate: usize, share: f64) -> Share {
        Share { candidate, share }
    }

    #[test]
    fn neighbours_count_as_the_same() {
        let line = candidates(&[&[json!(1e-4)], &[json!(1e-3)], &[json!(1e-2)], &[json!(0.1)]]);
        let stability = [share(1, 0.5), share(2, 0.25), share(3, 0.25)];
        assert_eq!(share_nearby(&stability, &line, 1), Some(0.75));
        assert_eq!(share_nearby(&stability, &line, 2), Some(1.0));
        assert_eq!(share_nearby(&[], &line, 1), None);
        let words = candidates(&[&[json!("adam")], &[json!("sgd")]]);
        assert_eq!(share_nearby(&[share(0, 1.0)], &words, 0), None);
    }
}
