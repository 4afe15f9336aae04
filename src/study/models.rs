//! Several models in one study: `[models.NAME]` says how each differs from the rest of the file.

use anyhow::bail;
use toml::{Table, Value};

/// The sections in which models may differ. Whatever else is swept, scored or read must be the same for all, or
/// their results could not stand beside each other.
const SECTIONS: [&str; 3] = ["representation", "model", "dynamics"];

/// The key under which they lie.
const KEY: &str = "models";

/// Names of the models, in alphabetical order.
pub(super) fn names(table: &Table) -> Vec<String> {
    let models = table.get(KEY).and_then(Value::as_table);
    let mut names: Vec<String> = models.map_or_else(Vec::new, |of| of.keys().cloned().collect());
    names.sort();
    names
}

/// Leave the one model called `name` in the study; without a name they stay beside it.
pub(super) fn choose(table: &mut Table, name: Option<&str>) -> anyhow::Result<()> {
    let Some(name) = name else { return Ok(()) };
    let names = names(table);
    let models = table.remove(KEY);
    match models {
        Some(Value::Table(mut models)) if models.contains_key(name) => {
            let Some(Value::Table(own)) = models.remove(name) else {
                bail!("[{KEY}] {name} is a value, not a section")
            };
            lay_over(table, own);
            Ok(())
        }
        _ if names.is_empty() => {
            bail!("--model {name}: the study has no [{KEY}.{name}], nor any other [{KEY}] section")
        }
        _ => bail!("--model {name}: the study's models are {}", names.join(", ")),
    }
}

/// Every key of `own` replaces that of `table`; sections are laid over each other.
fn lay_over(table: &mut Table, own: Table) {
    for (key, value) in own {
        match (table.get_mut(&key), value) {
            (Some(Value::Table(below)), Value::Table(above)) => lay_over(below, above),
            (_, value) => {
                table.insert(key, value);
            }
        }
    }
}

/// Whether every name can be that of a directory, and the models differ only in what makes a model.
pub(super) fn check(table: &Table) -> anyhow::Result<()> {
    check_names(KEY, &names(table))?;
    let models = table.get(KEY).and_then(Value::as_table).into_iter().flatten();
    for (name, own) in models {
        let keys = own.as_table().into_iter().flat_map(Table::keys);
        if let Some(key) = keys.into_iter().find(|key| !SECTIONS.contains(&key.as_str())) {
            bail!(
                "[{KEY}.{name}]: {key} cannot differ from model to model, only {} can; \
                 set {key} for the whole study, or give this model a study of its own",
                SECTIONS.join(", ")
            );
        }
    }
    Ok(())
}

/// Whether every name in the section `key` can be that of a directory.
pub(super) fn check_names<'a>(
    key: &str,
    names: impl IntoIterator<Item = &'a String>,
) -> anyhow::Result<()> {
    let fine = |name: &&String| {
        !name.is_empty()
            && name.chars().all(|of| of.is_ascii_alphanumeric() || of == '-' || of == '_')
    };
    match names.into_iter().find(|name| !fine(name)) {
        Some(name) => bail!("[{key}.\"{name}\"]: names have ASCII letters, digits, - and _ only"),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table() -> Table {
        let text = "seed = 1\n[model]\nmembers = 3\nneighbors = 2\n\
             [models.b]\nmodel.neighbors = 5\n[models.a.representation]\nkind = \"laplacian\"\n";
        toml::from_str(text).expect("TOML")
    }

    #[test]
    fn a_model_is_the_study_with_its_own_keys() {
        assert_eq!(names(&table()), ["a", "b"]);
        let mut study = table();
        choose(&mut study, Some("b")).expect("exists");
        let expected = "seed = 1\n[model]\nmembers = 3\nneighbors = 5\n";
        assert_eq!(study, toml::from_str::<Table>(expected).expect("TOML"));
        let mut study = table();
        choose(&mut study, None).expect("none");
        assert_eq!(study, table(), "all models stay");
    }

    #[test]
    fn models_that_do_not_exist_are_told_from_those_that_do() {
        let error = choose(&mut table(), Some("c")).expect_err("unknown").to_string();
        assert_eq!(error, "--model c: the study's models are a, b");
        let error = choose(&mut Table::new(), Some("c")).expect_err("unknown").to_string();
        assert!(error.contains("has no [models.c]"), "{error}");
        assert!(check_names(KEY, &["a-1_B".to_owned()]).is_ok());
        assert!(check_names(KEY, &["a/b".to_owned()]).is_err());
    }

    #[test]
    fn models_differ_in_nothing_but_the_model() {
        check(&table()).expect("model and representation");
        let mut study = table();
        let model = study["models"]["a"].as_table_mut().expect("a table");
        model.insert("sweep".to_owned(), Value::Table(Table::new()));
        let error = check(&study).expect_err("sweeps must agree").to_string();
        assert!(error.starts_with("[models.a]: sweep cannot differ"), "{error}");
    }
}
