//! Judges how well calib chooses, over several studies.

mod answer;
mod cells;
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
    artefact::{self, Below, DirectoryLock},
    bail,
    clock::Stopwatch,
    log::context::RunContext,
    options::{ValidityExtent, ValidityOptions},
    outcome::StepResult,
    output::duration,
};
use calib_study::shell_words;
use calib_validity::{Pair, judge};

use crate::run_study::RunUntil;
pub(crate) use answer::Summary;
use answer::{Drew, Judged, LeftOut, Score};
pub use answer::{JudgedStudies, SharedPlants, ValidityAnswer};
use gather::{Gathered, ReasonLeftOut, gather};
pub use plan::ValidityPlan;
use studies::{ListedStudy, Listing};
use task::Task;

/// Makes the missing results of each study, and judges all studies together.
pub(crate) fn run(
    args: &ValidityOptions,
    context: &RunContext,
) -> Result<StepResult<ValidityAnswer, ValidityPlan>, StepError> {
    let listing = studies::list(args)?;
    studies::check(&listing.studies)?;
    let directory = output(args, &listing);
    if args.extent == ValidityExtent::Plan {
        return Ok(StepResult::Planned(ValidityPlan::of(&listing, directory, context)?));
    }
    match listing.protocol {
        // Claims the folder before any plant is written into it.
        Some(_) => drop(artefact::own(&directory)?),
        None => artefact::check_own(&directory)?,
    }
    let all = all(&listing, args, context)?;
    if let Some(share) = args.share {
        let plants = (0..listing.studies.len()).filter(|place| share.has(*place)).count();
        let shared = SharedPlants { share, plants, left_out: all.left_out };
        return Ok(StepResult::Made(ValidityAnswer::Shared(shared)));
    }
    let report = directory.join("report.html");
    let judged = judged(all, &listing, args, report)?;
    let _lock = DirectoryLock::new(&directory, Below::Ours)?;
    files::write(&directory, &judged)?;
    figures::write(&directory.join("figures"), &judged)?;
    page::write(&judged.report, &judged)?;
    Ok(StepResult::Made(ValidityAnswer::Judged(Box::new(judged))))
}

/// Returns the output folder: that of the draw, or the user's, or one beside the first study.
fn output(args: &ValidityOptions, listing: &Listing) -> PathBuf {
    if let Some(protocol) = &listing.protocol {
        return protocol.directory.clone();
    }
    args.output.clone().unwrap_or_else(|| match &args.studies[0] {
        folder if folder.is_dir() => folder.join("validity-results"),
        file => file.parent().unwrap_or(Path::new("")).join("validity-results"),
    })
}

#[derive(Default)]
struct GatheredStudies {
    gathered: Vec<(String, Gathered)>,
    left_out: Vec<LeftOut>,
    /// For each model, the number of plants that lack it.
    lacking: BTreeMap<String, usize>,
}

fn all(
    listing: &Listing,
    args: &ValidityOptions,
    context: &RunContext,
) -> Result<GatheredStudies, StepError> {
    let clock = Stopwatch::start();
    let mut all = GatheredStudies::default();
    let own = (listing.studies.iter().enumerate())
        .filter(|(place, _)| args.share.is_none_or(|share| share.has(*place)));
    let own: Vec<&ListedStudy> = own.map(|(_, study)| study).collect();
    let count = own.len();
    let mut ran = 0;
    for (number, study) in own.into_iter().enumerate() {
        let task = Task::of(study.study(), study.study().sweep.steps).text();
        context.heading(&format!("plant {} of {count}, {}: {task}", number + 1, study.plant));
        let left = args.extent != ValidityExtent::Judge
            && study.out_of_reach()?.is_none()
            && study.left(context)? > 0;
        match completed(study, listing, args, &mut all.lacking, context)? {
            Ok(gathered) => all.gathered.push((study.plant.clone(), gathered)),
            Err(ReasonLeftOut(reason)) => {
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

/// Makes the missing results of one study, and collects them. Returns the reason if the study is
/// left out.
fn completed(
    study: &ListedStudy,
    listing: &Listing,
    args: &ValidityOptions,
    lacking: &mut BTreeMap<String, usize>,
    context: &RunContext,
) -> Result<Result<Gathered, ReasonLeftOut>, StepError> {
    if let Some(reason) = study.out_of_reach()? {
        return Ok(Err(ReasonLeftOut(reason)));
    }
    let protocol = listing.protocol.as_ref();
    if args.extent == ValidityExtent::Judge && protocol.is_some() && study.left(context)? > 0 {
        return Ok(Err(ReasonLeftOut("it has not been run".to_owned())));
    }
    if args.extent != ValidityExtent::Judge {
        let extent = protocol.map_or(RunUntil::Report, protocol::ProtocolFile::extent);
        if let Some(reason) = study.complete(extent, context)? {
            return Ok(Err(ReasonLeftOut(reason)));
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
    gather(study, &models, protocol.map_or(1, protocol::ProtocolFile::least_windows), context)
}

fn judged(
    all: GatheredStudies,
    listing: &Listing,
    args: &ValidityOptions,
    report: PathBuf,
) -> Result<JudgedStudies, StepError> {
    let GatheredStudies { gathered, left_out, lacking } = all;
    let Some((_, first)) = gathered.first() else {
        let told = left_out.iter().map(|plant| format!("{}: {}", plant.plant, plant.reason));
        bail!("no plant is left to judge ({})", told.collect::<Vec<_>>().join("; "));
    };
    let values = first.values.clone();
    let missing = missing(&gathered, &lacking);
    let mut networks: Vec<String> =
        gathered.iter().flat_map(|(_, studies)| studies.networks.clone()).collect();
    networks.sort();
    networks.dedup();
    let mut plants = Vec::with_capacity(gathered.len());
    let mut by_score: Vec<(Part, Vec<Pair>)> = Vec::new();
    for (plant, Gathered { task, pairs, .. }) in gathered {
        plants.push(Judged { plant, task });
        for (part, pair) in pairs {
            match by_score.iter_mut().find(|(scored, _)| *scored == part) {
                Some((_, pairs)) => pairs.push(pair),
                None => by_score.push((part, vec![pair])),
            }
        }
    }
    Ok(JudgedStudies {
        protocol: listing.protocol.as_ref().map(|protocol| Drew {
            file: protocol.file.file_name().unwrap_or_default().to_string_lossy().into_owned(),
            seed: protocol.seed(),
        }),
        plants,
        left_out,
        missing,
        scores: by_score
            .into_iter()
            .map(|(part, pairs)| {
                Ok(Score {
                    part,
                    validity: judge(values.clone(), pairs, &networks).map_err(StepError::other)?,
                })
            })
            .collect::<Result<_, StepError>>()?,
        command: command(listing, args),
        report,
    })
}

/// Returns sentences on missing models.
fn missing(gathered: &[(String, Gathered)], lacking: &BTreeMap<String, usize>) -> Vec<String> {
    let lacking = lacking.iter().map(|(model, plants)| {
        format!(
            "{model} is left out of {plants} plants: it needs libtorch, which this calib was built without, and no other one \
             has built it"
        )
    });
    let without = gathered.iter().flat_map(|(plant, studies)| {
        studies.without.iter().map(move |which| {
            format!("{which} of {plant}: every setting diverged in the model, so it has no choice")
        })
    });
    lacking.chain(without).collect()
}

/// Returns the command line.
fn command(listing: &Listing, args: &ValidityOptions) -> String {
    let mut words = vec!["calib".to_owned(), "validity".to_owned()];
    words.extend(args.studies.iter().map(|path| path.display().to_string()));
    words.extend(args.set.iter().flat_map(|text| ["--set".to_owned(), text.clone()]));
    if let Some(protocol) = &listing.protocol {
        words.extend(["--draw".to_owned(), protocol.seed().to_string()]);
    }
    shell_words(words)
}
