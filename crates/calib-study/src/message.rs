//! serde's messages, told as a person would.

/// Keys that are gone, each with what became of it and what to do.
const REMOVED: [(&str, &str); 1] = [(
    "race_error_rate",
    "the race by certainty is gone, and its error rate with it. Leave the key out",
)];

/// Rewrite "unknown field `x`, expected one of `a`, `b`" so that it names the nearest valid key.
pub(crate) fn friendly(message: &str) -> String {
    let Some(rest) = message.strip_prefix("unknown field `") else {
        return friendly_variant(message);
    };
    let Some((key, rest)) = rest.split_once('`') else { return message.to_owned() };
    if let Some((_, told)) = REMOVED.iter().find(|(removed, _)| *removed == key) {
        return format!("unknown key `{key}`: {told}");
    }
    let valid = quoted(rest);
    if valid.is_empty() {
        return format!("unknown key `{key}`; no keys are known here");
    }
    let nearest = nearest(key, &valid)
        .map_or_else(String::new, |nearest| format!("; did you mean `{nearest}`?"));
    format!("unknown key `{key}`{nearest} (known keys: {})", valid.join(", "))
}

/// What is wrong with a setting that a program passed on as JSON. The place in the JSON is left out, because nobody wrote it.
pub fn setting_error(error: &serde_json::Error) -> String {
    let message = error.to_string();
    let place = format!(" at line {} column {}", error.line(), error.column());
    friendly(message.strip_suffix(&place).unwrap_or(&message))
        .replacen("unknown key", "unknown setting", 1)
        .replacen("(known keys:", "(known settings:", 1)
}

/// What is wrong with options of a function, as serde's TOML tells it: what it expected, and in a further line which option has another value.
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
    let nearest = nearest(value, &valid)
        .map_or_else(String::new, |nearest| format!("; did you mean \"{nearest}\"?"));
    let valid: Vec<String> = valid.iter().map(|value| format!("\"{value}\"")).collect();
    format!("unknown value \"{value}\"{nearest} (known values: {})", valid.join(", "))
}

/// Rewrite "invalid type: string "x", expected f64" in the words of whoever writes a study.
fn friendly_type(message: &str) -> Option<String> {
    let rest = ["invalid type: ", "invalid value: "]
        .iter()
        .find_map(|start| message.strip_prefix(start))?;
    let (got, expected) = rest.rsplit_once(", expected ")?;
    Some(format!("expected {}, got {}", in_words(expected), value(got)))
}

/// What a type is for whoever writes a study.
fn in_words(expected: &str) -> &str {
    match expected {
        "f32" | "f64" => "a number",
        "usize" | "u8" | "u16" | "u32" | "u64" => "a whole number from 0 up",
        "isize" | "i8" | "i16" | "i32" | "i64" => "a whole number",
        "a boolean" => "true or false",
        "a string" | "path string" => "text",
        "a sequence" => "a list",
        "a map" => "a section",
        // Where one of a few names belongs, and there is no name at all.
        "string only" => "one of the names that `calib explain` lists for the key, in quotes",
        other if other.starts_with("struct ") => "a section",
        other => other,
    }
}

/// What stands there, without the name of its type.
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

/// The words between backticks.
fn quoted(text: &str) -> Vec<&str> {
    text.split('`').skip(1).step_by(2).collect()
}

/// The most similar word, if it is similar at all.
pub(crate) fn nearest<'a>(word: &str, valid: &[&'a str]) -> Option<&'a str> {
    let similarity =
        |candidate: &str| strsim::jaro_winkler(&word.to_lowercase(), &candidate.to_lowercase());
    valid
        .iter()
        .copied()
        .max_by(|a, b| similarity(a).total_cmp(&similarity(b)))
        .filter(|best| similarity(best) > 0.7)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_setting_in_json_is_told_without_its_place() {
        let told = |json: &str| {
            let read = serde_json::from_str::<calib_control::AgentConfig>(json);
            setting_error(&read.expect_err("no setting"))
        };
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
