//! Several models in one study: `[models.NAME]` says how each model differs from the rest of the file.

use toml::{Table, Value};

use crate::{
    Study,
    error::{Problem, refuse, require},
    overlay::{self, check_names, lay_over, take},
};

/// Sections in which models may differ. Everything else that is swept, scored or read must be the same for all
/// models. Otherwise their results could not be compared.
pub(crate) const SECTIONS: [&str; 4] = ["representation", "model", "dynamics", "rollout"];

/// Key of the section that holds the models.
pub(crate) const KEY: &str = "models";

/// Key that lists the models to compare.
const COMPARED: &str = "compare";

/// Upper limit for models times deployments of a study. Each part is resolved before any work begins.
const MOST_PARTS: usize = 1_000;

/// Returns the names of the compared models in alphabetical order.
pub(crate) fn names(table: &Table) -> Vec<String> {
    let all = overlay::names(table, KEY);
    match compared(table) {
        Some(compared) => {
            all.into_iter().filter(|name| compared.contains(&name.as_str())).collect()
        }
        None => all,
    }
}

impl Study {
    /// Returns the names of the compared models in alphabetical order; empty if a model was chosen.
    pub fn compared_models(&self) -> Vec<String> {
        self.models
            .keys()
            .filter(|name| self.compare.as_ref().is_none_or(|compared| compared.contains(name)))
            .cloned()
            .collect()
    }
}

/// Returns the list in `compare`, if the key is given.
fn compared(table: &Table) -> Option<Vec<&str>> {
    Some(table.get(COMPARED)?.as_array()?.iter().filter_map(Value::as_str).collect())
}

/// Applies the model called `name` to the study, and removes all models. Without a name, all models stay.
pub(crate) fn choose(table: &mut Table, name: Option<&str>) -> Result<(), Problem> {
    let Some(name) = name else { return Ok(()) };
    let own = take(table, KEY, "--model", name)?;
    table.remove(COMPARED);
    lay_over(table, own);
    Ok(())
}

/// Checks that each name can be the name of a directory, and that models differ only in the allowed sections.
pub(crate) fn check(table: &Table) -> Result<(), Problem> {
    let all = overlay::names(table, KEY);
    check_names(KEY, &all)?;
    if let Some(compared) = compared(table) {
        require!(!compared.is_empty(), "{COMPARED} lists no model; name some, or leave it out");
        if let Some(unknown) = compared.into_iter().find(|name| !all.iter().any(|own| own == name))
        {
            refuse!("{COMPARED} lists {unknown}, and the study's models are {}", all.join(", "));
        }
    }
    let models = names(table).len();
    let deployments = overlay::names(table, "deployments").len();
    let parts = models.max(1).saturating_mul(deployments.max(1));
    require!(
        parts <= MOST_PARTS,
        "{KEY}: the study has {models} models and {deployments} deployments, {parts} sweeps, and a study has at most \
         {MOST_PARTS}; list fewer models in {COMPARED}, or divide it into several studies"
    );
    let shares_pretraining = is_pretrained_before_the_model(table);
    let models = table.get(KEY).and_then(Value::as_table).into_iter().flatten();
    for (name, own) in models {
        require!(
            !shares_pretraining || value(own.as_table(), "model", "period").is_none(),
            "[{KEY}.{name}] has a model.period of its own, and what precedes it would be for pre-training, which all \
             models share; give pretrain.period"
        );
        let keys = own.as_table().into_iter().flat_map(Table::keys);
        if let Some(key) = keys.into_iter().find(|key| !SECTIONS.contains(&key.as_str())) {
            refuse!(
                "[{KEY}.{name}]: {key} cannot differ from model to model, only {} can; \
                 set {key} for the whole study, or give this model a study of its own",
                SECTIONS.join(", ")
            );
        }
    }
    Ok(())
}

/// Whether agents learn from all training rows before `model.period`.
fn is_pretrained_before_the_model(table: &Table) -> bool {
    let [epochs, checkpoint, period] =
        ["epochs", "checkpoint", "period"].map(|key| value(Some(table), "pretrain", key));
    let trained = epochs.and_then(Value::as_integer).is_some_and(|epochs| epochs > 0);
    (trained || checkpoint.is_some()) && period.is_none()
}

fn value<'a>(table: Option<&'a Table>, section: &str, key: &str) -> Option<&'a Value> {
    table?.get(section)?.as_table()?.get(key)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn models_share_what_agents_learnt_from() {
        let text =
            "[pretrain]\nepochs = 3\n[models.a]\n[models.b.model.period]\nstart = 2022-03-01\n";
        let table: Table = toml::from_str(text).expect("TOML");
        let refused = check(&table).expect_err("refused").to_string();
        assert!(refused.contains("[models.b]") && refused.contains("pretrain.period"), "{refused}");
        let period = "epochs = 3\nperiod = { end = 2022-03-01 }";
        check(&toml::from_str(&text.replace("epochs = 3", period)).expect("TOML")).expect("given");
        check(&toml::from_str(&text.replace("= 3", "= 0")).expect("TOML")).expect("off");
    }

    fn study_of(models: usize, deployments: usize) -> Table {
        let models = (0..models).map(|number| format!("[models.m{number}]\n"));
        let deployments = (0..deployments).map(|number| format!("[deployments.d{number}]\n"));
        toml::from_str(&models.chain(deployments).collect::<String>()).expect("TOML")
    }

    #[test]
    fn too_many_are_refused_before_any_is_looked_at() {
        for (models, deployments) in [(0, 0), (MOST_PARTS, 1), (10, 100)] {
            check(&study_of(models, deployments)).expect("not too many");
        }
        for (models, deployments) in [(100_000, 0), (0, MOST_PARTS + 1), (11, 100)] {
            let refused = check(&study_of(models, deployments)).expect_err("too many").to_string();
            assert!(refused.contains("at most 1000; list fewer models"), "{refused}");
        }
        let mut chosen = study_of(2_000, 0);
        chosen.insert(COMPARED.to_owned(), vec!["m1", "m7"].into());
        check(&chosen).expect("two of them");
    }

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
        assert!(check_names(KEY, &["a-1_B".to_owned()]).is_ok());
        assert!(check_names(KEY, &["a/b".to_owned()]).is_err());
    }

    #[test]
    fn some_of_the_models_can_be_compared() {
        let mut study = table();
        study.insert("compare".to_owned(), Value::Array(vec!["b".into()]));
        check(&study).expect("valid");
        assert_eq!(names(&study), ["b"]);
        choose(&mut study, Some("a")).expect("the other one can still be chosen");
        assert!(!study.contains_key("compare"));
        let mut study = table();
        study.insert("compare".to_owned(), Value::Array(vec!["b".into(), "c".into()]));
        let error = check(&study).expect_err("unknown").to_string();
        assert_eq!(error, "compare lists c, and the study's models are a, b");
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
