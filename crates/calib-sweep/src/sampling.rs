use std::cmp::Ordering;

use calib_core::Seed;
use itertools::Itertools as _;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::{
    SweepError,
    points::Points,
    sobol::{DIMENSIONS, Sobol},
};

/// How settings are chosen among the combinations of the swept values.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Sampling {
    /// All combinations.
    #[default]
    Grid,
    /// `samples` combinations. Each value is drawn independently and uniformly: from a list, from the numbers
    /// of a linear range, or from the logarithms of a logarithmic one.
    Random,
    /// `samples` combinations, spread evenly: Sobol's sequence with a digital shift from the study's seed.
    Sobol,
}

/// Limit on the settings of a sweep, larger than any practical sweep.
const MANY_CANDIDATES: usize = 10_000;

/// Draws per requested sample before calib concludes that there are no more different ones.
const PATIENCE: usize = 100;

/// Returns combinations of values of the swept fields, one list per setting.
pub(crate) fn combinations(
    axes: &[(String, Points)],
    sampling: Sampling,
    samples: usize,
    seed: Seed,
) -> Result<Vec<Vec<Value>>, SweepError> {
    match sampling {
        Sampling::Grid => grid(axes),
        Sampling::Random => {
            let seed = seed.child("random");
            sample(axes, samples, |index: usize| {
                let mut rng = seed.number(index as u64).rng();
                axes.iter().map(|_| rng.unit()).collect()
            })
        }
        Sampling::Sobol => {
            if axes.len() > DIMENSIONS {
                return Err(SweepError::TooManyFields { got: axes.len(), most: DIMENSIONS });
            }
            let sobol = Sobol::new(axes.len(), seed.child("sobol"));
            sample(axes, samples, |index| sobol.point(index as u32))
        }
    }
}

/// Returns the Cartesian product, with the first field varying slowest.
fn grid(axes: &[(String, Points)]) -> Result<Vec<Vec<Value>>, SweepError> {
    let lists = axes
        .iter()
        .map(|(field, points)| match points {
            Points::Discrete(values) => Ok(values),
            Points::Continuous(_) => Err(SweepError::Range {
                field: field.clone(),
                reason:
                    "a grid cannot list every number in it; give per_decade, count or step, or set \
                     sweep.sampling to \"random\" or \"sobol\""
                        .to_owned(),
            }),
        })
        .collect::<Result<Vec<_>, _>>()?;
    let count = lists.iter().fold(1_usize, |count, list| count.saturating_mul(list.len()));
    if count > MANY_CANDIDATES {
        return Err(SweepError::TooManyCandidates { got: count, most: MANY_CANDIDATES });
    }
    Ok(lists.into_iter().map(|list| list.iter().cloned()).multi_cartesian_product().collect())
}

/// Returns the first `samples` distinct points, in grid order. A larger sample contains every smaller one.
fn sample(
    axes: &[(String, Points)],
    samples: usize,
    point: impl Fn(usize) -> Vec<f64>,
) -> Result<Vec<Vec<Value>>, SweepError> {
    if !(1..=MANY_CANDIDATES).contains(&samples) {
        return Err(SweepError::Samples { got: samples, most: MANY_CANDIDATES });
    }
    let mut chosen: Vec<(Vec<f64>, Vec<Value>)> = Vec::with_capacity(samples);
    for index in 0..samples * PATIENCE {
        let drawn = axes.iter().zip(point(index)).map(|((_, points), unit)| points.draw(unit));
        let (places, values): (Vec<f64>, Vec<Value>) = drawn.unzip();
        if let Err(place) = chosen.binary_search_by(|(other, _)| compare(other, &places)) {
            chosen.insert(place, (places, values));
        }
        if chosen.len() == samples {
            return Ok(chosen.into_iter().map(|(_, values)| values).collect());
        }
    }
    Err(SweepError::TooFewPoints { got: samples, there: chosen.len() })
}

fn compare(a: &[f64], b: &[f64]) -> Ordering {
    a.iter().zip(b).fold(Ordering::Equal, |order, (a, b)| order.then(a.total_cmp(b)))
}

#[cfg(test)]
mod tests {
    use calib_agent::AgentConfig;
    use proptest::prelude::*;

    use super::*;
    use crate::Axis;

    fn axes(fields: &[(&str, &str)]) -> Vec<(String, Points)> {
        let points = fields.iter().map(|&(field, text)| {
            let axis: Axis = serde_json::from_str(text).expect("an axis");
            let points = axis.points(field, &AgentConfig::default()).expect("valid");
            (field.to_owned(), points)
        });
        points.collect()
    }

    fn three() -> Vec<(String, Points)> {
        axes(&[
            ("hidden_units", r#"{"from": 16, "to": 512, "scale": "log"}"#),
            ("learning_rate", r#"{"from": 1e-6, "to": 1e-1, "scale": "log"}"#),
            ("optimiser", r#"["adam", "sgd"]"#),
        ])
    }

    fn drawn_of_three(sampling: Sampling, samples: usize, seed: u64) -> Vec<Vec<Value>> {
        combinations(&three(), sampling, samples, Seed::new(seed)).expect("drawn")
    }

    proptest! {
        #[test]
        fn samples_are_different_in_range_ordered_and_nested(
            seed: u64,
            samples in 1_usize..80,
            sobol: bool,
        ) {
            let sampling = if sobol { Sampling::Sobol } else { Sampling::Random };
            let drawn = drawn_of_three(sampling, samples, seed);
            let again = drawn_of_three(sampling, samples, seed);
            prop_assert_eq!(&drawn, &again, "a seed draws the same");
            prop_assert_eq!(drawn.len(), samples);
            let more = drawn_of_three(sampling, samples + 20, seed);
            prop_assert!(drawn.iter().all(|values| more.contains(values)));
            for values in &drawn {
                prop_assert_eq!(drawn.iter().filter(|other| *other == values).count(), 1);
                prop_assert!((16..=512).contains(&values[0].as_u64().expect("whole")));
                prop_assert!((1e-6..=1e-1).contains(&values[1].as_f64().expect("a number")));
            }
            prop_assert!(drawn.is_sorted_by_key(|values| values[0].as_u64()));
        }
    }

    #[test]
    fn sobol_is_more_even_than_chance() {
        let rates = axes(&[("learning_rate", r#"{"from": 1e-8, "to": 1, "scale": "log"}"#)]);
        let [sobol, random] = [Sampling::Sobol, Sampling::Random].map(|sampling| {
            let drawn = combinations(&rates, sampling, 64, Seed::new(3)).expect("drawn");
            let logs: Vec<f64> =
                drawn.iter().map(|values| values[0].as_f64().expect("a number").log10()).collect();
            logs.windows(2).map(|pair| pair[1] - pair[0]).fold(0.0, f64::max)
        });
        // 64 points in 8 decades: one in each eighth of a decade. So no two neighbours are 2/8 apart.
        assert!(sobol < 0.26, "{sobol}");
        assert!(random > 0.3, "{random}");
    }

    fn refusal(axes: &[(String, Points)], sampling: Sampling, samples: usize) -> String {
        combinations(axes, sampling, samples, Seed::new(1)).expect_err("refused").to_string()
    }

    #[test]
    fn what_cannot_be_drawn_is_refused() {
        assert!(refusal(&three(), Sampling::Grid, 5).contains("give per_decade, count or step"));
        assert!(
            refusal(&three(), Sampling::Sobol, 0).contains("sweep.samples must be from 1 to 10000")
        );
        let few = axes(&[("optimiser", r#"["adam", "sgd"]"#)]);
        let text = refusal(&few, Sampling::Sobol, 3);
        assert!(text.contains("3 different") && text.contains("only 2"), "{text}");
        let wide: Vec<(String, Points)> =
            (0..30).map(|field| (field.to_string(), few[0].1.clone())).collect();
        assert!(refusal(&wide, Sampling::Sobol, 3).contains("30 fields"));
        assert!(refusal(&wide, Sampling::Grid, 3).contains("settings, more than"));
    }
}
