//! Translation of serde's error messages into the words of a study's user.

/// Removed keys, each with the reason and the remedy.
const REMOVED: [(&str, &str); 1] = [(
    "race_error_rate",
    "the race by certainty is gone, and its error rate with it. Leave the key out",
)];

/// Common names of other tools, each with the key of a study that it means.
const MEANT_KEYS: [(&str, &str); 8] = [
    ("horizon", "agent.gamma"),
    ("discount", "agent.gamma"),
    ("k", "model.neighbors"),
    ("n_neighbors", "model.neighbors"),
    ("neighbours", "model.neighbors"),
    ("lr", "agent.learning_rate"),
    ("alpha", "agent.learning_rate"),
    ("step_size", "agent.learning_rate"),
];

/// Common names of models, each with the value of `model.kind` that it means.
const MEANT_KINDS: [(&str, &str); 6] = [
    ("neighbors", "knn"),
    ("neighbours", "knn"),
    ("nearest_neighbors", "knn"),
    ("network", "nn"),
    ("mlp", "nn"),
    ("recurrent", "gru"),
];

/// Descriptions of the values of `model.kind`.
const KINDS: [(&str, &str); 5] = [
    ("knn", "nearest neighbours"),
    ("nn", "a network"),
    ("gru", "a recurrent network"),
    ("torchscript", "a network of your own"),
    ("none", "no model"),
];

/// The key under which the TOML library passes a date to what expects a section.
const DATE: &str = "$__toml_private_datetime";

/// Returns the key of a study for the name that other tools use: `model.neighbors` for `k`.
pub fn meant_key(name: &str) -> Option<&'static str> {
    entry(&MEANT_KEYS, name)
}

fn entry(table: &'static [(&'static str, &'static str)], name: &str) -> Option<&'static str> {
    table.iter().find(|(known, _)| known.eq_ignore_ascii_case(name)).map(|(_, meant)| *meant)
}

/// Rewrites "unknown field `x`, expected one of `a`, `b`" so that it names the nearest valid key.
pub(crate) fn friendly(message: &str) -> String {
    let Some(rest) = message.strip_prefix("unknown field `") else {
        return friendly_variant(message);
    };
    let Some((key, rest)) = rest.split_once('`') else { return message.to_owned() };
    if let Some((_, told)) = REMOVED.iter().find(|(removed, _)| *removed == key) {
        return format!("unknown key `{key}`: {told}");
    }
    let valid = quoted(rest);
    if key == DATE {
        return format!("expected a section with {}, got a date", valid.join(" or "));
    }
    if valid.is_empty() {
        return format!("unknown key `{key}`; no keys are known here");
    }
    let nearest = match meant_key(key) {
        // The last part of the key is enough within its own section.
        Some(meant) => {
            let last = meant.rsplit('.').next().unwrap_or(meant);
            Some(if valid.contains(&last) { last } else { meant })
        }
        None => nearest(key, &valid),
    };
    let nearest =
        nearest.map_or_else(String::new, |nearest| format!("; did you mean `{nearest}`?"));
    format!("unknown key `{key}`{nearest} (known keys: {})", valid.join(", "))
}

/// Describes an error in a setting that a program passed as JSON. The position is left out, because no user wrote the JSON.
pub fn setting_error(error: &serde_json::Error) -> String {
    let message = error.to_string();
    let place = format!(" at line {} column {}", error.line(), error.column());
    friendly(message.strip_suffix(&place).unwrap_or(&message))
        .replacen("unknown key", "unknown setting", 1)
        .replacen("(known keys:", "(known settings:", 1)
}

/// Describes an error in the options of a function. `text` is serde's TOML message: the
/// expectation, then a line that names the option at fault.
pub fn option_error(text: &str) -> String {
    let text = text.trim_end();
    let (message, option) = match text.rsplit_once("\nin `") {
        Some((message, option)) => (message, option.strip_suffix('`')),
        None => (text, None),
    };
    let told = friendly(message).replacen("unknown key", "unknown argument", 1).replacen(
        "(known keys:",
        "(known arguments:",
        1,
    );
    match option {
        Some(option) => format!("{option}: {told}"),
        None => told,
    }
}

fn friendly_variant(message: &str) -> String {
    if message == "duplicate key" {
        return "the key is there twice; remove one of them".to_owned();
    }
    let Some(rest) = message.strip_prefix("unknown variant `") else {
        return friendly_type(message).unwrap_or_else(|| message.to_owned());
    };
    let Some((value, rest)) = rest.split_once('`') else { return message.to_owned() };
    let valid = quoted(rest);
    let are_kinds = valid.contains(&"torchscript");
    let meant = if are_kinds { entry(&MEANT_KINDS, value) } else { None };
    let nearest = meant
        .or_else(|| nearest(value, &valid))
        .map_or_else(String::new, |nearest| format!("; did you mean \"{nearest}\"?"));
    let told = valid.iter().map(|value| match entry(&KINDS, value).filter(|_| are_kinds) {
        Some(meaning) => format!("\"{value}\", {meaning}"),
        None => format!("\"{value}\""),
    });
    let valid: Vec<String> = told.collect();
    let between = if are_kinds { "; " } else { ", " };
    format!("unknown value \"{value}\"{nearest} (known values: {})", valid.join(between))
}

/// Rewrites "invalid type: string "x", expected f64" in the words of a study's user.
fn friendly_type(message: &str) -> Option<String> {
    let rest = ["invalid type: ", "invalid value: "]
        .iter()
        .find_map(|start| message.strip_prefix(start))?;
    let (got, expected) = rest.rsplit_once(", expected ")?;
    Some(format!("expected {}, got {}", in_words(expected), value(got)))
}

/// Describes a type in the words of a study's user.
fn in_words(expected: &str) -> &str {
    match expected {
        "f32" | "f64" => "a number",
        "usize" | "u8" | "u16" | "u32" | "u64" => "a whole number from 0 up",
        "isize" | "i8" | "i16" | "i32" | "i64" => "a whole number",
        "a boolean" => "true or false",
        "a string" | "path string" => "text",
        "a sequence" => "a list",
        "a map" => "a section",
        // serde expects a name from a fixed list here, and found something that is not a string.
        "string only" => "one of the names that `calib explain` lists for the key, in quotes",
        other if other.starts_with("struct ") => "a section",
        other => other,
    }
}

/// Returns the value in a message without the name of its type.
fn value(got: &str) -> String {
    match got {
        "sequence" => "a list".to_owned(),
        "map" => "a section".to_owned(),
        "unit variant" => "another type".to_owned(),
        other => match other.strip_prefix("string ") {
            Some(text) => format!("the text {text}"),
            None => other.split('`').nth(1).unwrap_or(other).to_owned(),
        },
    }
}

/// Returns the words between backticks.
fn quoted(text: &str) -> Vec<&str> {
    text.split('`').skip(1).step_by(2).collect()
}

/// Returns the most similar word, or `None` if no word is similar enough.
pub(crate) fn nearest<'a>(word: &str, valid: &[&'a str]) -> Option<&'a str> {
    valid
        .iter()
        .copied()
        .max_by(|a, b| similarity(word, a).total_cmp(&similarity(word, b)))
        .filter(|best| similarity(word, best) > 0.7)
}

/// Returns the similarity of two words, whatever their case: 1 for equal ones.
fn similarity(word: &str, other: &str) -> f64 {
    strsim::jaro_winkler(&word.to_lowercase(), &other.to_lowercase())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the message about wrong settings in JSON.
    fn told(json: &str) -> String {
        let read = serde_json::from_str::<calib_control::AgentConfig>(json);
        setting_error(&read.expect_err("no setting"))
    }

    #[test]
    fn a_setting_in_json_is_told_without_its_place() {
        let unknown = told("{\"stepsize\": 1}");
        let start = "unknown setting `stepsize`; did you mean `step_size`? (known settings: ";
        assert!(unknown.starts_with(start) && unknown.ends_with(')'), "{unknown}");
        assert_eq!(told("{\"step_size\": \"a\"}"), "expected a number, got the text \"a\"");
    }

    #[test]
    fn options_of_a_function_are_arguments() {
        let unknown =
            option_error("unknown field `neighbours`, expected one of `members`, `neighbors`\n");
        let expected = "unknown argument `neighbours`; did you mean `neighbors`? (known arguments: members, neighbors)";
        assert_eq!(unknown, expected);
        let told = option_error("invalid type: string \"x\", expected usize\nin `members`\n");
        assert_eq!(told, "members: expected a whole number from 0 up, got the text \"x\"");
    }

    #[test]
    fn names_of_other_tools_lead_to_the_key() {
        let k = friendly("unknown field `k`, expected one of `kind`, `members`, `neighbors`");
        assert!(k.starts_with("unknown key `k`; did you mean `neighbors`? ("), "{k}");
        let horizon = friendly("unknown field `horizon`, expected `seed` or `agent`");
        assert!(horizon.contains("did you mean `agent.gamma`?"), "{horizon}");
        let kinds = "expected one of `knn`, `nn`, `gru`, `torchscript`, `none`";
        for (value, meant) in [("neighbours", "knn"), ("network", "nn")] {
            let told = friendly(&format!("unknown variant `{value}`, {kinds}"));
            assert!(told.contains(&format!("did you mean \"{meant}\"?")), "{told}");
            assert!(told.contains("\"knn\", nearest neighbours; \"nn\", a network; "), "{told}");
        }
        assert_eq!(meant_key("horizon"), Some("agent.gamma"));
        assert_eq!(meant_key("gamma"), None);
    }

    #[test]
    fn messages_are_told_in_words() {
        let far = friendly("unknown field `zzz`, expected `gamma` or `beta1`");
        assert_eq!(far, "unknown key `zzz` (known keys: gamma, beta1)");
        assert_eq!(friendly("invalid type: string"), "invalid type: string");
        let text = friendly("invalid type: string \"a, expected b\", expected f64");
        assert_eq!(text, "expected a number, got the text \"a, expected b\"");
        assert_eq!(
            friendly("invalid type: map, expected a string"),
            "expected text, got a section"
        );
    }
}
