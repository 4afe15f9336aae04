//! The log that a study reads, where `[simulate]` says how it is made.

use std::path::PathBuf;

use anyhow::{Context as _, bail, ensure};
use calib_data::DataConfig;
use calib_plant::PlantOptions;

use super::simulate::{self, Found, Simulated};
use crate::{
    cli::{PlantArgs, SimulateArgs},
    memory,
    output::Printer,
    study::{Chosen, Study, StudyPaths},
};

/// The plant of a study, where its log goes, and what there is of it.
pub(super) struct PlantOfStudy {
    pub(super) directory: PathBuf,
    pub(super) options: PlantOptions,
    pub(super) found: Found,
}

impl PlantOfStudy {
    /// What `[simulate]` describes; nothing if the study has no such section.
    pub(super) fn of(study: &Study, paths: &StudyPaths) -> anyhow::Result<Option<Self>> {
        let Some(config) = &study.simulate else { return Ok(None) };
        let options = config.plant().context("[simulate]")?;
        let folder = study.data_to_read(paths)?.path.0.into_iter().next();
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
pub(super) fn data(study: &Study, paths: &StudyPaths) -> anyhow::Result<DataConfig> {
    if let Some(PlantOfStudy { directory, found, .. }) = PlantOfStudy::of(study, paths)? {
        let (directory, command) = (directory.display(), paths.command("simulate"));
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
    let data = study.data_to_read(paths)?;
    memory::check_log(&data)?;
    Ok(data)
}

/// What `calib simulate STUDY` is to write, and where; and what to do next.
pub(super) fn described(args: &SimulateArgs) -> anyhow::Result<(PathBuf, PlantOptions, String)> {
    let shown = args.target.display();
    ensure!(
        args.plant == PlantArgs::default(),
        "{shown} describes its plant in [simulate]: change it there, or for once with --set, such as --set simulate.days=2"
    );
    let chosen = Chosen { profile: args.profile.as_deref(), ..Chosen::default() };
    let (study, paths) = Study::load(&args.target, &args.set, chosen)?;
    let Some(PlantOfStudy { directory, options, .. }) = PlantOfStudy::of(&study, &paths)? else {
        let unused =
            if args.set.is_empty() { "" } else { " (one is not used where --set names the data)" };
        bail!("{shown} has no [simulate] section{unused}; add one, or simulate into a folder")
    };
    Ok((directory, options, paths.command("run")))
}
