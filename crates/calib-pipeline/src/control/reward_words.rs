//! The reward of a study in words, and warnings about terms that reward what they should cost.

use calib_control::{Reward, SetPoint, Term};
use calib_report::listed;

/// Returns a sentence on the reward of a step.
pub(super) fn reward_told(reward: &Reward) -> String {
    match reward {
        Reward::Column(column) => format!("The reward of a step is the column {column}."),
        Reward::Terms(terms) => {
            let terms: Vec<String> = terms.iter().map(term_told).collect();
            let sum = if terms.len() == 1 { "" } else { "the sum of " };
            format!("The reward of a step is {sum}{}.", listed(&terms))
        }
    }
}

/// Returns warnings about terms with a positive weight that count a deviation: an agent gets more for a larger one.
pub(super) fn rewarded_deviations(reward: &Reward) -> Vec<String> {
    let Reward::Terms(terms) = reward else { return Vec::new() };
    let rewarded = terms.iter().enumerate().filter(|(_, term)| is_rewarded_deviation(term));
    rewarded
        .map(|(place, term)| {
            format!(
                "control.reward[{place}] has weight {} for {}, so that agents get more reward the larger that is: if it should be small, \
                 give the term a negative weight, such as weight = {}",
                term.weight,
                counted_amount(term),
                -term.weight
            )
        })
        .collect()
}

/// Whether a term probably rewards a deviation by mistake.
fn is_rewarded_deviation(term: &Term) -> bool {
    let is_deviation = match (term.low, term.high) {
        (Some(_), Some(_)) => true,
        // What is beyond one limit may be a yield, of which the study then gives the weight.
        (Some(_), None) | (None, Some(_)) => has_default_weight(term),
        (None, None) => term.change || term.set_point.is_some(),
    };
    is_deviation && term.weight > 0.0
}

/// Whether the weight is the one of a term without the key.
fn has_default_weight(term: &Term) -> bool {
    term.weight == 1.0
}

/// Formats a term as `-0.2 × the distance of level from 1.8`.
fn term_told(term: &Term) -> String {
    let amount = counted_amount(term);
    if term.weight == 1.0 { amount } else { format!("{} × {amount}", term.weight) }
}

/// Returns what a term counts of its column.
fn counted_amount(term: &Term) -> String {
    let column = &term.column;
    let amount = match (&term.set_point, term.low, term.high) {
        _ if term.change => format!("the change of {column} from row to row"),
        (Some(SetPoint::Number(set_point)), ..) => {
            format!("the distance of {column} from {set_point}")
        }
        (Some(SetPoint::Column(set_point)), ..) => {
            format!("the distance of {column} from {set_point}")
        }
        (None, Some(low), Some(high)) => format!("what {column} is below {low} or above {high}"),
        (None, Some(low), None) => format!("what {column} is below {low}"),
        (None, None, Some(high)) => format!("what {column} is above {high}"),
        (None, None, None) => column.clone(),
    };
    if term.power == 2 { format!("the square of {amount}") } else { amount }
}

#[cfg(test)]
mod tests {
    use calib_control::ControlConfig;

    use super::*;

    fn reward(terms: &str) -> Reward {
        let config: ControlConfig = toml::from_str(&format!("reward = {terms}")).expect("valid");
        config.reward
    }

    #[test]
    fn a_reward_is_told_in_words() {
        assert_eq!(reward_told(&Reward::default()), "The reward of a step is the column reward.");
        assert_eq!(
            reward_told(&reward("[{ column = 'pump', weight = -1 }]")),
            "The reward of a step is -1 × pump."
        );
        let terms = "[
            { column = 'flow' },
            { column = 'level', set_point = 1.8, weight = -0.2, power = 2 },
            { column = 'pressure', high = 0.45, weight = -5 },
        ]";
        assert_eq!(
            reward_told(&reward(terms)),
            "The reward of a step is the sum of flow, -0.2 × the square of the distance of level from 1.8 and \
             -5 × what pressure is above 0.45."
        );
    }

    #[test]
    fn a_deviation_that_is_rewarded_is_told_with_a_negative_weight() {
        let told = rewarded_deviations(&reward(
            "[{ column = 'flow' }, { column = 'level', set_point = 78.4 }]",
        ));
        assert_eq!(
            told,
            [
                "control.reward[1] has weight 1 for the distance of level from 78.4, so that agents get more reward the larger that \
              is: if it should be small, give the term a negative weight, such as weight = -1"
            ]
        );
        for (term, weight) in [
            ("{ column = 'level', set_point = 'target', weight = 0.5 }", "-0.5"),
            ("{ column = 'level', low = 1, high = 2, weight = 3 }", "-3"),
            ("{ column = 'level', high = 2 }", "-1"),
            ("{ column = 'valve', change = true }", "-1"),
        ] {
            let told = rewarded_deviations(&reward(&format!("[{term}]")));
            assert_eq!(told.len(), 1, "{term}");
            assert!(told[0].ends_with(&format!("such as weight = {weight}")), "{told:?}");
        }
    }

    #[test]
    fn costs_and_yields_are_not_told() {
        assert!(rewarded_deviations(&Reward::default()).is_empty());
        for term in [
            "{ column = 'level', set_point = 1.8, weight = -0.2 }",
            "{ column = 'level', low = 1, high = 2, weight = -1 }",
            "{ column = 'valve', change = true, weight = -0.1 }",
            "{ column = 'yield', high = 10, weight = 0.5 }",
            "{ column = 'level', set_point = 1.8, weight = 0 }",
            "{ column = 'flow' }",
        ] {
            let told = rewarded_deviations(&reward(&format!("[{term}]")));
            assert!(told.is_empty(), "{told:?}");
        }
    }
}
