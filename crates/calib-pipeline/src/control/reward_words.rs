//! The reward of a study in words.

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
}
