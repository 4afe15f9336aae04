//! The same study at another size: `[profiles.NAME]` is laid over the whole file.

use anyhow::{Context as _, bail, ensure};
use toml::{Table, Value};

use super::overlay::{check_names, lay_over, names, take};

/// The key under which they lie.
const KEY: &str = "profiles";

/// Names that the results of a profile cannot have, because those of the study have them.
const TAKEN: [&str; 8] = [
    "deployments",
    "evaluate",
    "model",
    "models",
    "pretrain",
    "representation",
    "rollout",
    "sweep",
];

/// Where the results of a profile go.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Results {
    /// Where those of the study go, or where the profile itself says.
    AsWritten,
    /// To a folder called as the profile, in that of the study.
    InOwnFolder,
}

/// Lay the profile called `name` over the study, without which it stays as it is; profiles themselves are removed.
pub(super) fn choose(table: &mut Table, name: Option<&str>) -> anyhow::Result<Results> {
    let Some(name) = name else {
        table.remove(KEY);
        return Ok(Results::AsWritten);
    };
    let own = take(table, KEY, "--profile", name)?;
    let results =
        if own.contains_key("output") { Results::AsWritten } else { Results::InOwnFolder };
    lay_over(table, own);
    Ok(results)
}

/// Whether the study is one with each of its profiles, as far as `is_study` can tell.
pub(super) fn check(
    table: &Table,
    is_study: impl Fn(Table) -> anyhow::Result<()>,
) -> anyhow::Result<()> {
    let names = names(table, KEY);
    check_names(KEY, &names)?;
    for name in &names {
        ensure!(
            !TAKEN.contains(&name.as_str()),
            "[{KEY}.{name}]: the study has a folder of that name in its results; choose another name"
        );
        let own = table.get(KEY).and_then(|of| of.get(name)).and_then(Value::as_table);
        if own.is_some_and(|own| own.contains_key(KEY)) {
            bail!("[{KEY}.{name}] has [{KEY}] of its own, and one is chosen at a time");
        }
        let mut study = table.clone();
        choose(&mut study, Some(name))?;
        is_study(study).with_context(|| format!("[{KEY}.{name}]"))?;
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

    #[test]
    fn a_profile_is_the_study_with_other_keys() {
        let mut study = table();
        assert_eq!(choose(&mut study, Some("tiny")).expect("exists"), Results::InOwnFolder);
        let expected = "seed = 2\n[sweep]\nsteps = 3\nonline_runs = 9\n";
        assert_eq!(study, toml::from_str::<Table>(expected).expect("TOML"));
        let mut study = table();
        assert_eq!(choose(&mut study, Some("other")).expect("exists"), Results::AsWritten);
        let mut study = table();
        assert_eq!(choose(&mut study, None).expect("none"), Results::AsWritten);
        assert!(!study.contains_key(KEY) && study["seed"].as_integer() == Some(1));
        let error = choose(&mut table(), Some("large")).expect_err("unknown").to_string();
        assert_eq!(error, "--profile large: the study's profiles are other, tiny");
    }

    #[test]
    fn every_profile_is_checked() {
        check(&table(), |_| Ok(())).expect("valid");
        let error = check(&table(), |study| {
            ensure!(study["seed"].as_integer() == Some(1), "another seed");
            Ok(())
        });
        assert_eq!(format!("{:#}", error.expect_err("refused")), "[profiles.tiny]: another seed");
        let taken = toml::from_str("[profiles.sweep]\nseed = 1\n").expect("TOML");
        let error = check(&taken, |_| Ok(())).expect_err("taken").to_string();
        assert!(error.contains("choose another name"), "{error}");
    }
}
