use std::fmt::Display;

/// Lists the first `most` of these values, at least one, and shows whether there are more: "a, b, c, …".
pub fn abridged_list(values: impl IntoIterator<Item = impl Display>, most: usize) -> String {
    let mut values = values.into_iter();
    let mut shown: Vec<String> =
        values.by_ref().take(most).map(|value| value.to_string()).collect();
    if values.next().is_some() {
        shown.push("…".to_owned());
    }
    shown.join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_list_shows_that_more_values_are_left_out() {
        let names = ["a", "b", "c", "d"];
        assert_eq!(abridged_list(&names[..0], 3), "");
        assert_eq!(abridged_list(&names[..3], 3), "a, b, c");
        assert_eq!(abridged_list(names, 3), "a, b, c, …");
        assert_eq!(abridged_list([1.5, 2.0], 1), "1.5, …");
    }
}
