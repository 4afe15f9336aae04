//! The log that a study reads, where `[simulate]` says how it is made.

use std::path::PathBuf;

use anyhow::{Context as _, bail, ensure};
use calib_data::DataConfig;
use calib_plant::PlantOptions;
use calib_study::{Job, Request, StudyError};

use super::simulate::{self, Found, Simulated};
use crate::{
    cli::{PlantArgs, SimulateArgs},
    memory,
    output::Printer,
};

/// The plant of a study, where its log goes, and what there is of it.
pub(super) struct PlantOfStudy {
    pub(super) directory: PathBuf,
    pub(super) options: PlantOptions,
    pub(super) found: Found,
}

impl PlantOfStudy {
    /// What `[simulate]` describes; nothing if the study has no such section.
    pub(super) fn of(job: &Job) -> anyhow::Result<Option<Self>> {
        let Some(config) = &job.study().simulate else { return Ok(None) };
        let options = config.plant().context("[simulate]")?;
        let folder = data_to_read(job)?.path.0.into_iter().next();
        let directory = PathBuf::from(folder.context("data.path is empty")?);
        let found = simulate::find(&directory, &options)?;
        Ok(Some(Self { directory, options, found }))
    }

    /// Write what is missing of the log; `force` begins anew.
    pub(super) fn make(self, force: bool, printer: &Printer) -> anyhow::Result<Simulated> {
        simulate::simulate(&self.directory, self.options, force, printer)
    }
}

/// The `[data]` section to read with, once the log is there.
pub(super) fn data(job: &Job) -> anyhow::Result<DataConfig> {
    if let Some(PlantOfStudy { directory, found, .. }) = PlantOfStudy::of(job)? {
        let (directory, command) = (directory.display(), job.command("simulate"));
        match found {
            // Somebody's own logs are read as they are.
            Found::Whole | Found::NotSimulated => {}
            Found::Unfinished => {
                bail!(
                    "the log of the plant that [simulate] describes is not in {directory}; run `{command}` first"
                )
            }
            Found::Another => bail!(
                "{directory} holds another simulation than [simulate] describes; run `{command} --force` to replace it"
            ),
        }
    }
    Ok(data_to_read(job)?)
}

/// The `[data]` section with the variables of the environment.
pub(super) fn data_to_read(job: &Job) -> Result<DataConfig, StudyError> {
    let data = job.data_to_read(|name| std::env::var(name).ok())?;
    Ok(DataConfig { scratch: memory::working_files(), ..data })
}

/// What `calib simulate STUDY` is to write, and where; and what to do next.
pub(super) fn described(args: &SimulateArgs) -> anyhow::Result<(PathBuf, PlantOptions, String)> {
    let shown = args.target.display();
    ensure!(
        args.plant == PlantArgs::default(),
        "{shown} describes its plant in [simulate]: change it there, or for once with --set, such as --set simulate.days=2"
    );
    let job = Job::resolve(Request {
        set: args.set.clone(),
        profile: args.profile.clone(),
        ..Request::new(&args.target)
    })?;
    let Some(PlantOfStudy { directory, options, .. }) = PlantOfStudy::of(&job)? else {
        let unused =
            if args.set.is_empty() { "" } else { " (one is not used where --set names the data)" };
        bail!("{shown} has no [simulate] section{unused}; add one, or simulate into a folder")
    };
    Ok((directory, options, job.command("run")))
}
