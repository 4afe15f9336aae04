//! Studies without a model (`model.kind = "none"`): their defaults, and the keys that would have no effect.

use toml::{Table, Value};

use crate::{
    error::{Problem, refuse, require},
    models,
};

/// The key and value of a study without a model.
const NONE: &str = "model.kind = \"none\"";

/// Remedy in messages, which turns it into a study with a model.
const REMEDY: &str = "remove it, or set model.kind = \"knn\"";

/// Sections with keys that only apply to models.
const SECTIONS: [&str; 5] = ["model", "sweep", "representation", "dynamics", "rollout"];

/// Keys of `[sweep]` that only apply to models.
const SWEEP_KEYS: [&str; 3] = ["member_runs", "network_runs", "start"];

/// Keys of `[model]` that also apply without a model.
const MODEL_KEYS: [&str; 2] = ["kind", "period"];

/// Whether a table says that there is no model; `None` if it does not give a kind.
fn says_none(table: &Table) -> Option<bool> {
    Some(table.get("model")?.get("kind")?.as_str() == Some("none"))
}

/// Whether the table describes a study without a model.
fn is_without(table: &Table) -> bool {
    says_none(table) == Some(true)
}

/// Makes log replay the selection method of a study without a model, unless the study names a rule.
pub(crate) fn set_rule(table: &mut Table) {
    if !is_without(table) {
        return;
    }
    let evaluate = table.entry("evaluate").or_insert_with(|| Value::Table(Table::new()));
    if let Value::Table(evaluate) = evaluate
        && !evaluate.contains_key("rule")
    {
        evaluate.insert("rule".to_owned(), "log_replay".into());
    }
}

/// Refuses keys that have no effect without a model. `table` is the study. `layers` are its parts, lowest first: the file,
/// a profile, `--set`. Layers below the one that removes the model may keep such keys: they describe the model that the
/// study has without that layer.
pub(crate) fn check(table: &Table, layers: &[Table]) -> Result<(), Problem> {
    check_models(table)?;
    if !is_without(table) {
        return Ok(());
    }
    let from = layers.iter().rposition(|layer| says_none(layer).is_some()).unwrap_or(0);
    // Acting agents have their own model, which may search in a representation.
    let acts = table.contains_key("control");
    layers[from..].iter().try_for_each(|layer| check_layer(layer, acts))
}

/// Checks that every compared model is a model.
fn check_models(table: &Table) -> Result<(), Problem> {
    let Some(models) = table.get(models::KEY).and_then(Value::as_table) else { return Ok(()) };
    let own = models.iter().find(|(_, own)| own.as_table().is_some_and(is_without));
    let told = "beside models there is no study without one, and each model's report compares its choice with that of log replay";
    if let Some((name, _)) = own {
        refuse!("[models.{name}]: {NONE} names no model; {told}; remove [models.{name}]");
    }
    require!(
        models.is_empty() || !is_without(table),
        "{NONE}, and the study has [models]: {told}; remove [models], or set model.kind = \"knn\""
    );
    Ok(())
}

fn check_layer(layer: &Table, acts: bool) -> Result<(), Problem> {
    for section in SECTIONS {
        let keys = layer.get(section).and_then(Value::as_table).into_iter().flat_map(Table::keys);
        let unused = keys.into_iter().find(|key| match section {
            "model" => !MODEL_KEYS.contains(&key.as_str()),
            "sweep" => SWEEP_KEYS.contains(&key.as_str()),
            "representation" => !acts,
            _ => true,
        });
        if let Some(key) = unused {
            refuse!(
                "{section}.{key} has no effect, because {NONE} is a study without a model; {REMEDY}"
            );
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use calib_sweep::Rule;

    use crate::{Job, Request, Study, StudyError};

    const NONE: &str = "[model]\nkind = \"none\"\n";

    fn resolved(text: &str, profile: Option<&str>, set: &[&str]) -> Result<Study, StudyError> {
        let set = set.iter().map(|&text| text.to_owned()).collect();
        let profile = profile.map(str::to_owned);
        let request = Request { set, profile, ..Request::new("s.toml") };
        Ok(Job::of_text(request, text.to_owned())?.study().clone())
    }

    fn refused(text: &str, set: &[&str]) -> String {
        resolved(text, None, set).expect_err("refused").to_string()
    }

    fn rule(text: &str, set: &[&str]) -> Rule {
        resolved(text, None, set).expect("valid").evaluate.rule
    }

    #[test]
    fn the_replayed_log_decides_unless_a_rule_is_named() {
        assert_eq!(rule("", &[]), Rule::Pooled);
        assert_eq!(rule(NONE, &[]), Rule::LogReplay);
        assert_eq!(rule("[evaluate]\ntop_k = 1\n", &["model.kind=none"]), Rule::LogReplay);
        let one = "evaluate.rule=one_standard_error";
        assert_eq!(rule(NONE, &[one]), Rule::OneStandardError);
        let study = resolved(NONE, None, &[]).expect("valid");
        assert!(!study.has_model() && study.members() * study.member_runs() == 0);
        let data = of_log(&["model.kind=none"]).expect("valid");
        assert_eq!(data.evaluate.rule, Rule::LogReplay);
    }

    fn of_log(set: &[&str]) -> Result<Study, StudyError> {
        let set: Vec<String> = set.iter().map(|&text| text.to_owned()).collect();
        crate::of_data(std::path::Path::new("log.csv"), &set)
    }

    #[test]
    fn keys_of_a_model_are_refused_with_their_place() {
        for (text, told) in [
            ("members = 3\n", "s.toml:3:1: model.members has no effect"),
            ("[rollout]\nsteps = 9\n", "s.toml:4:1: rollout.steps has no effect"),
            ("[dynamics]\nepochs = 9\n", "s.toml:4:1: dynamics.epochs has no effect"),
            ("[representation]\nkind = \"laplacian\"\n", "s.toml:4:1: representation.kind"),
            ("[sweep]\nmember_runs = 3\n", "s.toml:4:1: sweep.member_runs has no effect"),
            ("[sweep]\nnetwork_runs = 3\n", "s.toml:4:1: sweep.network_runs"),
            ("[sweep]\nstart = \"recent\"\n", "s.toml:4:1: sweep.start has no effect"),
        ] {
            let error = refused(&format!("{NONE}{text}"), &[]);
            assert!(error.starts_with(told), "{error}");
            assert!(error.contains("remove it, or set model.kind = \"knn\""), "{error}");
        }
        let period = "period = { start = 2022-01-01 }\n";
        resolved(&format!("{NONE}{period}"), None, &[]).expect("of the training range");
        let given = refused(NONE, &["model.members=3"]);
        assert!(given.starts_with("s.toml with --set model.members=3: model.members"), "{given}");
        let data = of_log(&["model.kind=none", "rollout.steps=9"]);
        assert!(data.expect_err("refused").to_string().contains("rollout.steps has no effect"));
    }

    #[test]
    fn a_model_can_be_taken_away_from_a_study_that_describes_one() {
        let text = "[model]\nmembers = 3\n[rollout]\nsteps = 9\n[sweep]\nmember_runs = 2\n\
            [profiles.fast]\nmodel.kind = \"none\"\n[profiles.slow]\nmodel.kind = \"none\"\nrollout.steps = 7\n\
            [profiles.back]\nbase = \"fast\"\nmodel.kind = \"knn\"\nrollout.steps = 5\n";
        assert!(!resolved(text, None, &["model.kind=none"]).expect("by --set").has_model());
        assert!(!resolved(text, Some("fast"), &[]).expect("by a profile").has_model());
        assert!(resolved(text, Some("back"), &[]).expect("and back").has_model());
        let slow = resolved(text, Some("slow"), &[]).expect_err("a key of its own").to_string();
        assert!(slow.contains("rollout.steps has no effect"), "{slow}");
        let both = refused(text, &["model.kind=none", "sweep.member_runs=1"]);
        assert!(both.contains("sweep.member_runs has no effect"), "{both}");
        let back =
            resolved(NONE, None, &["model.kind=nn", "dynamics.epochs=3"]).expect("a network");
        assert!(back.has_model() && back.evaluate.rule == Rule::Pooled);
    }

    #[test]
    fn rules_that_count_runs_in_a_model_are_refused() {
        for rule in ["worst_rank", "mean_rank", "mean_error", "mean_log_error", "pooled"] {
            let error = refused(&format!("{NONE}[evaluate]\nrule = \"{rule}\"\n"), &[]);
            assert!(
                error.starts_with(&format!(
                    "s.toml:4:1: evaluate.rule = \"{rule}\" counts runs in a model"
                )),
                "{error}"
            );
        }
        let nothing = refused(&format!("{NONE}[sweep]\nlog_replay_runs = 0\n"), &[]);
        assert!(nothing.contains("nothing would decide"), "{nothing}");
    }

    #[test]
    fn models_stand_beside_models_alone() {
        let one = refused("[models.a]\n[models.b]\nmodel.kind = \"none\"\n", &[]);
        assert!(one.contains("[models.b]: model.kind = \"none\" names no model"), "{one}");
        let all = refused("[models.a]\n[models.b]\nmodel.kind = \"nn\"\n", &["model.kind=none"]);
        assert!(all.contains("remove [models], or set model.kind"), "{all}");
    }

    #[test]
    fn the_representation_of_agents_that_act_has_an_effect() {
        let control = "[control]\nactions = [\"A\"]\nreward = [{ sensor = \"B\" }]\n";
        let text = format!("{NONE}[representation]\nkind = \"laplacian\"\n");
        assert!(refused(&text, &[]).contains("representation.kind has no effect"));
        let table: toml::Table = toml::from_str(&format!("{text}{control}")).expect("TOML");
        super::check(&table, std::slice::from_ref(&table)).expect("for [control]");
    }
}
