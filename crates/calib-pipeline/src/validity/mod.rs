//! How well calib chooses, over several studies.

mod claims;
mod figures;
mod files;
mod gather;
mod page;
mod plan;
mod protocol;
mod race;
mod show;
mod studies;
mod tables;
mod task;

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use calib_agent::Part;
use calib_base::{
    StepError,
    artefact::{self, Below, DirectoryLock, TOOL},
    bail,
    clock::Stopwatch,
    log::context::RunContext,
    options::{ValidityExtent, ValidityOptions},
    outcome::Outcome,
    output::{counted, duration},
};
use calib_study::{Share, shell_words};
use calib_validity::{Pair, Validity, judge};
use schemars::JsonSchema;
use serde::Serialize;

use crate::run_study::RunUntil;
use gather::{Gathered, Reason, gather};
use studies::{Listed, Listing};
use task::Task;

/// `validity.json`.
#[derive(Serialize, JsonSchema)]
pub(crate) struct Summary<'a> {
    format: u32,
    tool: &'static str,
    /// What drew plants and tasks.
    #[serde(skip_serializing_if = "Option::is_none")]
    protocol: Option<&'a Drew>,
    /// The plants that were judged.
    plants: &'a [Judged],
    /// Plants that were not, and why.
    left_out: &'a [LeftOut],
    /// Models that are missing, and why.
    missing: &'a [String],
    /// By each score, the first one that of the studies.
    scores: &'a [Score],
}

/// The protocol that drew the plants.
#[derive(Serialize, JsonSchema)]
pub(crate) struct Drew {
    /// Its file's name.
    file: String,
    seed: u64,
}

/// A plant with its task.
#[derive(Serialize, JsonSchema)]
pub(crate) struct Judged {
    plant: String,
    #[serde(flatten)]
    task: Task,
}

/// A plant that is not judged.
#[derive(Clone, Serialize, JsonSchema)]
pub(crate) struct LeftOut {
    plant: String,
    reason: String,
}

/// All pairs by the errors over one part of each run.
#[derive(Serialize, JsonSchema)]
pub(crate) struct Score {
    part: Part,
    #[serde(flatten)]
    validity: Validity,
}

/// All studies together.
struct Judgement {
    protocol: Option<Drew>,
    plants: Vec<Judged>,
    left_out: Vec<LeftOut>,
    missing: Vec<String>,
    /// At least one.
    scores: Vec<Score>,
    command: String,
}

/// Run what is missing of each study, and judge all of them together.
pub(crate) fn run(args: &ValidityOptions, context: &RunContext) -> Result<Outcome, StepError> {
    let listing = studies::list(args)?;
    studies::check(&listing.studies)?;
    let directory = output(args, &listing);
    if args.extent == ValidityExtent::Plan {
        plan::show(&listing, context)?;
        context.say(&format!("dry run: would write {}", directory.display()));
        return Ok(Outcome::Done);
    }
    match listing.protocol {
        // Before anything of a plant is written into it.
        Some(_) => drop(artefact::own(&directory)?),
        None => artefact::check_own(&directory)?,
    }
    if let Some(share) = args.share {
        return run_share(share, &listing, args, context);
    }
    let judgement = judgement(all(&listing, args, context)?, &listing, args)?;
    let _lock = DirectoryLock::new(&directory, Below::Ours)?;
    files::write(&directory, &judgement)?;
    figures::write(&directory.join("figures"), &judgement)?;
    page::write(&directory.join("report.html"), &judgement)?;
    if context.is_json() {
        context.json(&judgement.summary())?;
    } else {
        show::show(&judgement, context)?;
        context.result(&format!("report: {}", directory.join("report.html").display()))?;
    }
    Ok(Outcome::Done)
}

/// Run what is missing of the plants of a share; nothing is judged.
fn run_share(
    share: Share,
    listing: &Listing,
    args: &ValidityOptions,
    context: &RunContext,
) -> Result<Outcome, StepError> {
    let all = all(listing, args, context)?;
    let own = (0..listing.studies.len()).filter(|place| share.has(*place)).count();
    context.result(&format!(
        "share {share}: {} of {} run; when all shares are, the same command without --share judges them",
        own - all.left_out.len(),
        counted(own, "plant"),
    ))?;
    Ok(if all.left_out.is_empty() { Outcome::Done } else { Outcome::Negative })
}

impl Judgement {
    fn summary(&self) -> Summary<'_> {
        Summary {
            format: 3,
            tool: TOOL,
            protocol: self.protocol.as_ref(),
            plants: &self.plants,
            left_out: &self.left_out,
            missing: &self.missing,
            scores: &self.scores,
        }
    }

    /// By the score of the studies.
    fn first(&self) -> &Validity {
        &self.scores[0].validity
    }
}

/// In the folder of the draw, or beside the first study, unless the user says where.
fn output(args: &ValidityOptions, listing: &Listing) -> PathBuf {
    if let Some(protocol) = &listing.protocol {
        return protocol.directory.clone();
    }
    let beside = |path: &Path| match path {
        folder if folder.is_dir() => folder.join("validity-results"),
        file => file.parent().unwrap_or(Path::new("")).join("validity-results"),
    };
    args.output.clone().unwrap_or_else(|| beside(&args.studies[0]))
}

/// What all studies gave.
#[derive(Default)]
struct All {
    gathered: Vec<(String, Gathered)>,
    left_out: Vec<LeftOut>,
    /// Model → plants that lack it.
    lacking: BTreeMap<String, usize>,
}

/// Go through all studies.
fn all(listing: &Listing, args: &ValidityOptions, context: &RunContext) -> Result<All, StepError> {
    let clock = Stopwatch::start();
    let mut all = All::default();
    let is_own = |place: &usize| args.share.is_none_or(|share| share.has(*place));
    let own = listing.studies.iter().enumerate().filter(|(place, _)| is_own(place));
    let own: Vec<&Listed> = own.map(|(_, study)| study).collect();
    let count = own.len();
    let mut ran = 0;
    for (number, study) in own.into_iter().enumerate() {
        let task = Task::of(study.study(), study.study().sweep.steps).text();
        context.heading(&format!("plant {} of {count}, {}: {task}", number + 1, study.plant));
        let left = args.extent != ValidityExtent::Judge
            && study.out_of_reach()?.is_none()
            && study.left(context)? > 0;
        match take(study, listing, args, &mut all.lacking, context)? {
            Ok(gathered) => all.gathered.push((study.plant.clone(), gathered)),
            Err(Reason(reason)) => {
                context.warn(&format!("{} is left out: {reason}", study.plant));
                all.left_out.push(LeftOut { plant: study.plant.clone(), reason });
            }
        }
        ran += u32::from(left);
        let remaining = (count - number - 1) as u32;
        if left && remaining > 0 {
            let each = clock.elapsed() / ran;
            context.say(&format!(
                "{} of {count} plants done, {} each; at most {} left",
                number + 1,
                duration(each),
                duration(each * remaining)
            ));
        }
    }
    Ok(all)
}

/// One study: run what is missing, and take what it says; or why it is left out.
fn take(
    study: &Listed,
    listing: &Listing,
    args: &ValidityOptions,
    lacking: &mut BTreeMap<String, usize>,
    context: &RunContext,
) -> Result<Result<Gathered, Reason>, StepError> {
    if let Some(reason) = study.out_of_reach()? {
        return Ok(Err(Reason(reason)));
    }
    let protocol = listing.protocol.as_ref();
    if args.extent == ValidityExtent::Judge && protocol.is_some() && study.left(context)? > 0 {
        return Ok(Err(Reason("it has not been run".to_owned())));
    }
    if args.extent != ValidityExtent::Judge {
        let extent = protocol.map_or(RunUntil::Report, protocol::Named::extent);
        if let Some(reason) = study.complete(extent, context)? {
            return Ok(Err(Reason(reason)));
        }
    }
    let mut models = Vec::with_capacity(study.models.len());
    for model in &study.models {
        if study.lacks(model.as_deref()) {
            let name = model.as_deref().unwrap_or("the model").to_owned();
            *lacking.entry(name).or_default() += 1;
        } else {
            models.push(model.clone());
        }
    }
    gather(study, &models, protocol.map_or(1, protocol::Named::least_windows), context)
}

/// Judge what was gathered, by each score.
fn judgement(all: All, listing: &Listing, args: &ValidityOptions) -> Result<Judgement, StepError> {
    let All { gathered, left_out, lacking } = all;
    let Some((_, first)) = gathered.first() else {
        let told = left_out.iter().map(|of| format!("{}: {}", of.plant, of.reason));
        bail!("no plant is left to judge ({})", told.collect::<Vec<_>>().join("; "));
    };
    let values = first.values.clone();
    let missing = missing(&gathered, &lacking);
    let mut networks: Vec<String> =
        gathered.iter().flat_map(|(_, of)| of.networks.clone()).collect();
    networks.sort();
    networks.dedup();
    let mut plants = Vec::with_capacity(gathered.len());
    let mut by_score: Vec<(Part, Vec<Pair>)> = Vec::new();
    for (plant, Gathered { task, pairs, .. }) in gathered {
        plants.push(Judged { plant, task });
        for (part, pair) in pairs {
            match by_score.iter_mut().find(|(of, _)| *of == part) {
                Some((_, pairs)) => pairs.push(pair),
                None => by_score.push((part, vec![pair])),
            }
        }
    }
    let score = |(part, pairs)| {
        Ok(Score {
            part,
            validity: judge(values.clone(), pairs, &networks).map_err(StepError::other)?,
        })
    };
    Ok(Judgement {
        protocol: listing.protocol.as_ref().map(|protocol| Drew {
            file: protocol.file.file_name().unwrap_or_default().to_string_lossy().into_owned(),
            seed: protocol.seed(),
        }),
        plants,
        left_out,
        missing,
        scores: by_score.into_iter().map(score).collect::<Result<_, StepError>>()?,
        command: command(listing, args),
    })
}

/// What is not there of models, in sentences.
fn missing(gathered: &[(String, Gathered)], lacking: &BTreeMap<String, usize>) -> Vec<String> {
    let lacking = lacking.iter().map(|(model, plants)| {
        format!(
            "{model} is left out of {plants} plants: it needs libtorch, which this calib was built without, and no other one \
             has built it"
        )
    });
    let without = gathered.iter().flat_map(|(plant, of)| {
        of.without.iter().map(move |which| {
            format!("{which} of {plant}: every setting diverged in the model, so it has no choice")
        })
    });
    lacking.chain(without).collect()
}

/// What was typed.
fn command(listing: &Listing, args: &ValidityOptions) -> String {
    let paths = args.studies.iter().map(|path| path.display().to_string());
    let overrides = args.set.iter().map(|text| shell_words(["--set", text]));
    let draw = listing.protocol.as_ref().map(|protocol| format!("--draw {}", protocol.seed()));
    let words = ["calib validity".to_owned()].into_iter().chain(paths).chain(overrides);
    words.chain(draw).collect::<Vec<_>>().join(" ")
}
