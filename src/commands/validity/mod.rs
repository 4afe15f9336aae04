//! How well calib chooses, over several studies.

mod figures;
mod files;
mod gather;
mod page;
mod show;
mod studies;

use std::path::{Path, PathBuf};

use calib_core::Seed;
use calib_validity::{Options, Pair, Validity, judge};
use serde::Serialize;

use super::artefact::{Below, Claim, TOOL};
use crate::{cli::ValidityArgs, exit::ExitStatus, output::Printer};
use gather::Gathered;

/// `validity.json`.
#[derive(Serialize)]
struct Summary<'a> {
    format: u32,
    tool: &'static str,
    seed: u64,
    /// Models that are missing, and why.
    missing: &'a [String],
    #[serde(flatten)]
    validity: &'a Validity,
}

/// All studies together.
struct Judgement {
    pairs: Vec<Pair>,
    validity: Validity,
    missing: Vec<String>,
    seed: u64,
    command: String,
}

/// Run what is missing of each study, and judge all of them together.
pub(super) fn run(args: &ValidityArgs, printer: &Printer) -> anyhow::Result<ExitStatus> {
    let studies = studies::list(args)?;
    studies::check(&studies, args)?;
    let directory = output(args);
    if args.dry_run {
        studies::announce(&studies, args, printer)?;
        printer.say(&format!("dry run: would write {}", directory.display()));
        return Ok(ExitStatus::Done);
    }
    let mut gathered = Vec::with_capacity(studies.len());
    let mut missing = Vec::new();
    for study in &studies {
        printer.heading(&format!("study {}", study.plant));
        if !args.judge_only {
            studies::complete(study, args, printer)?;
        }
        let mut models = Vec::with_capacity(study.models.len());
        for model in &study.models {
            match studies::missing(study, model.as_deref(), args)? {
                None => models.push(model.clone()),
                Some(reason) => {
                    printer.warn(&reason);
                    missing.push(reason);
                }
            }
        }
        gathered.push(gather::gather(study, &models, args, printer)?);
    }
    let judgement = judgement(gathered, missing, args)?;
    let _claim = Claim::new(&directory, Below::Ours)?;
    files::write(&directory, &judgement)?;
    figures::write(&directory.join("figures"), &judgement)?;
    page::write(&directory.join("report.html"), &judgement)?;
    if args.json {
        printer.json(&judgement.summary())?;
    } else {
        show::show(&judgement, printer)?;
        printer.result(&format!("report: {}", directory.join("report.html").display()))?;
    }
    Ok(ExitStatus::Done)
}

impl Judgement {
    fn summary(&self) -> Summary<'_> {
        let Self { validity, missing, seed, .. } = self;
        Summary { format: 1, tool: TOOL, seed: *seed, missing, validity }
    }
}

/// Beside the first study, unless the user says where.
fn output(args: &ValidityArgs) -> PathBuf {
    let beside = |path: &Path| match path {
        folder if folder.is_dir() => folder.join("validity-results"),
        file => file.parent().unwrap_or(Path::new("")).join("validity-results"),
    };
    args.output.clone().unwrap_or_else(|| beside(&args.studies[0]))
}

/// Judge what was gathered.
fn judgement(
    gathered: Vec<Gathered>,
    missing: Vec<String>,
    args: &ValidityArgs,
) -> anyhow::Result<Judgement> {
    let values = gathered.first().map_or_else(Vec::new, |first| first.values.clone());
    let pairs: Vec<Pair> = gathered.into_iter().flat_map(|of| of.pairs).collect();
    let options = Options { resamples: args.resamples, seed: Seed::new(args.seed) };
    let validity = judge(values, pairs.clone(), &options)?;
    // Those that were left out have no number in the results.
    let judged =
        |pair: &Pair| !validity.left_out.contains(&format!("{} of {}", pair.sensor, pair.plant));
    let pairs = pairs.into_iter().filter(judged).collect();
    let paths = args.studies.iter().map(|path| path.display().to_string());
    let overrides = args.set.iter().map(|text| format!("--set '{text}'"));
    let draws = format!("--resamples {} --seed {}", args.resamples, args.seed);
    let words = ["calib validity".to_owned()].into_iter().chain(paths).chain(overrides);
    let command = words.chain([draws]).collect::<Vec<_>>().join(" ");
    Ok(Judgement { pairs, validity, missing, seed: args.seed, command })
}
