//! Finds channels whose names are similar to a misspelt one.

/// Returns `; did you mean A or B?`, or an empty string.
pub fn hint<'a>(name: &str, channels: impl Iterator<Item = &'a str>) -> String {
    let similar = by_likeness(name, channels).into_iter().filter(|&(likeness, _)| likeness > 0.8);
    let names: Vec<&str> = similar.take(3).map(|(_, name)| name).collect();
    if names.is_empty() { String::new() } else { format!("; did you mean {}?", names.join(" or ")) }
}

/// Returns all channels, those with names most similar to `name` first.
pub fn nearest_names<'a>(name: &str, channels: impl Iterator<Item = &'a str>) -> Vec<&'a str> {
    by_likeness(name, channels).into_iter().map(|(_, channel)| channel).collect()
}

/// Returns each channel with the similarity of its name to `name`, the most similar first.
fn by_likeness<'a>(name: &str, channels: impl Iterator<Item = &'a str>) -> Vec<(f64, &'a str)> {
    let wanted = name.to_lowercase();
    let mut all: Vec<(f64, &str)> = channels
        .map(|channel| {
            let candidate = channel.to_lowercase();
            let contains = candidate.contains(&wanted) || wanted.contains(&candidate);
            let likeness = strsim::jaro_winkler(&wanted, &candidate);
            (if contains { likeness + 1.0 } else { likeness }, channel)
        })
        .collect();
    all.sort_by(|left, right| right.0.total_cmp(&left.0).then(left.1.cmp(right.1)));
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn misspelt_names_get_a_hint() {
        let channels = ["ZW_PIT300.DATA", "ZW_PIT301.DATA", "ZW_TIT101.DATA"];
        assert_eq!(hint("pit300", channels.into_iter()), "; did you mean ZW_PIT300.DATA?");
        assert_eq!(hint("qqq", channels.into_iter()), "");
        assert_eq!(
            nearest_names("tit101", channels.into_iter()),
            ["ZW_TIT101.DATA", "ZW_PIT301.DATA", "ZW_PIT300.DATA"]
        );
    }
}
