//! The same study at other sizes: `[profiles.NAME]` replaces keys of the whole file.

use toml::{Table, Value};

use crate::{
    error::{Problem, refuse, require},
    overlay::{check_names, lay_over, names, take},
};

/// Key of the section that holds the profiles.
pub(crate) const KEY: &str = "profiles";

/// Key with which a profile names the profile that it extends.
pub(crate) const BASE: &str = "base";

/// Names that a profile cannot have, because the study has folders of these names in its results.
const TAKEN: [&str; 12] = [
    "control",
    "control-model",
    "control-representation",
    "control-units",
    "deployments",
    "evaluate",
    "model",
    "models",
    "pretrain",
    "representation",
    "rollout",
    "sweep",
];

/// Place of the results of a profile.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Results {
    /// The folder of the study's results, or the one that the profile gives.
    AsWritten,
    /// A folder with the name of the profile, inside the folder of the study's results.
    InOwnFolder,
}

/// Applies the profile called `name` to the study, if one is given, and removes all profiles.
pub(crate) fn choose(table: &mut Table, name: Option<&str>) -> Result<ChosenProfile, Problem> {
    let Some(name) = name else {
        table.remove(KEY);
        return Ok(ChosenProfile { results: Results::AsWritten, laid_over: Table::new() });
    };
    let own = take(&mut table.clone(), KEY, "--profile", name)?;
    let results =
        if own.contains_key("output") { Results::AsWritten } else { Results::InOwnFolder };
    let laid_over = with_base(table, own, &mut vec![name.to_owned()])?;
    table.remove(KEY);
    lay_over(table, laid_over.clone());
    Ok(ChosenProfile { results, laid_over })
}

/// The profile that was applied to a study. It is empty if no profile was chosen.
#[derive(Clone, Debug)]
pub(crate) struct ChosenProfile {
    pub(crate) results: Results,
    /// Keys of the profile, merged with those of the profiles that it extends.
    pub(crate) laid_over: Table,
}

/// Merges a profile with the profiles that it extends. `above` lists the profiles that led here, this one last.
fn with_base(table: &Table, mut own: Table, above: &mut Vec<String>) -> Result<Table, Problem> {
    let name = above.last().cloned().unwrap_or_default();
    let base = match own.remove(BASE) {
        None => return Ok(own),
        Some(Value::String(base)) => base,
        Some(other) => {
            refuse!("[{KEY}.{name}] {BASE} must be the name of another profile, got {other}")
        }
    };
    require!(
        !above.contains(&base),
        "[{KEY}.{base}] is based on itself: {}, {base}; remove one {BASE}",
        above.join(", ")
    );
    let below = take(&mut table.clone(), KEY, &format!("[{KEY}.{name}] {BASE} ="), &base)?;
    above.push(base);
    let mut whole = with_base(table, below, above)?;
    lay_over(&mut whole, own);
    Ok(whole)
}

/// Checks that the study is valid with each of its profiles, as far as `is_study` can check.
pub(crate) fn check(
    table: &Table,
    is_study: impl Fn(Table) -> Result<(), Problem>,
) -> Result<(), Problem> {
    let names = names(table, KEY);
    check_names(KEY, &names)?;
    for name in &names {
        require!(
            !TAKEN.contains(&name.as_str()),
            "[{KEY}.{name}]: the study has a folder of that name in its results; choose another name"
        );
        let own = table.get(KEY).and_then(|profiles| profiles.get(name)).and_then(Value::as_table);
        if own.is_some_and(|own| own.contains_key(KEY)) {
            refuse!("[{KEY}.{name}] has [{KEY}] of its own, and one is chosen at a time");
        }
        let mut study = table.clone();
        choose(&mut study, Some(name))?;
        is_study(study).map_err(|problem| problem.within(&format!("{KEY}.{name}")))?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table() -> Table {
        let text = "seed = 1\n[sweep]\nsteps = 30\nonline_runs = 9\n\
             [profiles.tiny]\nseed = 2\nsweep.steps = 3\n[profiles.other]\noutput = \"there\"\n";
        toml::from_str(text).expect("TOML")
    }

    fn results(chosen: Result<ChosenProfile, Problem>) -> Results {
        chosen.expect("exists").results
    }

    #[test]
    fn a_profile_is_the_study_with_other_keys() {
        let mut study = table();
        assert_eq!(results(choose(&mut study, Some("tiny"))), Results::InOwnFolder);
        let expected = "seed = 2\n[sweep]\nsteps = 3\nonline_runs = 9\n";
        assert_eq!(study, toml::from_str::<Table>(expected).expect("TOML"));
        let mut study = table();
        assert_eq!(results(choose(&mut study, Some("other"))), Results::AsWritten);
        let mut study = table();
        assert_eq!(results(choose(&mut study, None)), Results::AsWritten);
        assert!(!study.contains_key(KEY) && study["seed"].as_integer() == Some(1));
        let error = choose(&mut table(), Some("large")).expect_err("unknown").to_string();
        assert_eq!(error, "--profile large: the study's profiles are other, tiny");
    }

    /// Returns a study with a profile that extends another one, followed by `tail`.
    fn based(tail: &str) -> Table {
        let text = format!(
            "seed = 1\n[profiles.tiny]\noutput = \"there\"\nseed = 2\nsweep = {{ steps = 3 }}\n\
             [profiles.tiny-change]\nbase = \"tiny\"\nsweep.online_runs = 5\n{tail}"
        );
        toml::from_str(&text).expect("TOML")
    }

    fn refused(tail: &str, name: &str) -> String {
        choose(&mut based(tail), Some(name)).expect_err("refused").to_string()
    }

    #[test]
    fn a_profile_may_be_based_on_another() {
        let mut study = based("");
        let chosen = choose(&mut study, Some("tiny-change")).expect("exists");
        assert_eq!(chosen.results, Results::InOwnFolder, "the folder of its base is not its own");
        let online_runs = chosen.laid_over["sweep"]["online_runs"].as_integer();
        assert_eq!((online_runs, chosen.laid_over["seed"].as_integer()), (Some(5), Some(2)));
        let expected = "output = \"there\"\nseed = 2\n[sweep]\nsteps = 3\nonline_runs = 5\n";
        assert_eq!(study, toml::from_str::<Table>(expected).expect("TOML"));
        assert_eq!(
            refused("[profiles.more]\nbase = \"tny\"\n", "more"),
            "[profiles.more] base = tny: the study's profiles are more, tiny, tiny-change"
        );
        assert_eq!(
            refused("[profiles.a]\nbase = \"b\"\n[profiles.b]\nbase = \"a\"\n", "a"),
            "[profiles.a] is based on itself: a, b, a; remove one base"
        );
        let number = refused("[profiles.a]\nbase = 3\n", "a");
        assert_eq!(number, "[profiles.a] base must be the name of another profile, got 3");
    }

    #[test]
    fn every_profile_is_checked() {
        check(&table(), |_| Ok(())).expect("valid");
        let error = check(&table(), |study| {
            require!(study["seed"].as_integer() == Some(1), "another seed");
            Ok(())
        });
        assert_eq!(format!("{:#}", error.expect_err("refused")), "[profiles.tiny]: another seed");
        let taken = toml::from_str("[profiles.sweep]\nseed = 1\n").expect("TOML");
        let error = check(&taken, |_| Ok(())).expect_err("taken").to_string();
        assert!(error.contains("choose another name"), "{error}");
    }
}
