//! The model directory: the files that `build-model` writes and the later commands read.

use std::path::{Path, PathBuf};

use calib_base::{
    Context as _, StepError,
    artefact::{self, Below, DirectoryLock, Facts as _},
    bail, ensure, frames,
    log::profile_file::{self, PROFILE},
    stale::StoredArtefact,
};
use calib_core::{Frames, Normaliser, States, TransitionIndex};
use calib_data::{Dataset, Profile, table::Table};
use calib_files::{Fingerprint, fingerprint_file, link_or_copy};
use calib_knn::{KnnModel, ModelConfig, SEARCH_VERSION, Shortcuts, WeightsKind};
use calib_nn::Mlp;
use calib_represent::encode;
use calib_study::{Job, Layout, StepKind, Study};

use super::kinds::{self, OpenedModel};
use crate::represent::{self, Representation};

pub use super::manifest::{MemberSummary, ModelFacts, ModelManifest, first_and_last};

/// The file of the states of a model.
const STATES: &str = "states.npy";

/// Returns the fingerprint of everything that later results depend on: the inputs, and the written weights and tables
/// to the last bit.
///
/// # Errors
/// If they cannot be written as JSON.
pub fn content(model: &ModelManifest) -> Result<String, StepError> {
    // The profile also covers the held-out range, which no result of the model depends on.
    artefact::key(&(&model.key, model.lasting_files()))
}

/// Whether the profile beside a model is as it was written.
pub fn has_profile(model: &ModelManifest, directory: &Path) -> bool {
    profile_file::is_whole(directory, model.files.get(PROFILE))
}

/// Returns the fingerprint of all inputs of a neighbour model.
pub(crate) fn model_key(
    data: &Fingerprint,
    model: &ModelConfig,
    representation: Option<&Representation>,
) -> Result<String, StepError> {
    key_of(SEARCH_VERSION, data, model, representation)
}

/// Returns the [`model_key`] of tables that version `search` of the search found. Exact tables are the same in every
/// version.
fn key_of(
    search: u32,
    data: &Fingerprint,
    model: &ModelConfig,
    representation: Option<&Representation>,
) -> Result<String, StepError> {
    // The search structure does not change the tables. Weights change what is drawn from the tables, and so also the
    // traps.
    let ModelConfig { members, neighbors, exclude_self, theiler, .. } = *model;
    let softmax = model.weights == WeightsKind::Softmax;
    let drawn = model.remove_traps.then(|| (model.weights, softmax.then_some(model.temperature)));
    let tables = (ModelFacts::FORMAT, data, members, neighbors, exclude_self, theiler, drawn);
    let exact = match representation {
        None => artefact::key(&tables)?,
        Some(representation) => artefact::key(&(tables, &representation.key))?,
    };
    let shortcuts = model.shortcuts();
    if shortcuts.is_exact() {
        return Ok(exact);
    }
    let Shortcuts { prototypes, prototype_kind, components, leaf_budget } = shortcuts;
    artefact::key(&(exact, search, prototypes, prototype_kind, components, leaf_budget))
}

/// A model that was opened from its directory.
pub struct OpenModel {
    /// Its manifest.
    pub manifest: ModelManifest,
    /// The frames that it was built from.
    pub frames: Frames,
    /// The model itself.
    pub model: OpenedModel,
    /// The encoder of the representation in which neighbours are searched, if there is one.
    encoder: Option<Mlp>,
}

impl OpenModel {
    /// Returns states from elsewhere in the metric of the model: their ψ if neighbours are searched in a
    /// representation.
    pub(crate) fn in_metric(&self, states: &States) -> Result<States, StepError> {
        match &self.encoder {
            Some(encoder) => Ok(encode(encoder, states)?),
            None if !self.manifest.study.has_representation() => Ok(states.clone()),
            None => bail!(
                "the representation was imported without an encoder, so the states nearest to others than \
                 its own cannot be found; use another rollout.start than \"nearest\", or \
                 representation.kind = \"laplacian\""
            ),
        }
    }
}

/// Writes the states, or links those in the file `prepared`.
pub(crate) fn write_states(
    directory: &Path,
    frames: &Frames,
    prepared: Option<&Path>,
) -> Result<(), StepError> {
    let path = directory.join(STATES);
    match prepared {
        Some(prepared) => Ok(link_or_copy(prepared, &path)?),
        None => frames::write_states(&path, frames),
    }
}

/// Returns the same frames over the written states.
pub(crate) fn map_states(directory: &Path, frames: &Frames) -> Result<Frames, StepError> {
    let states = frames::map_states(&directory.join(STATES))?;
    Ok(Frames::new(frames.timestamps().to_vec(), frames.segments().clone(), states)?)
}

/// Writes rows, profile and, for neighbours, the members. States must be written before, and the manifest last, by the
/// caller.
pub(crate) fn write(
    directory: &Path,
    dataset: &Dataset,
    knn: Option<&KnnModel>,
) -> Result<(), StepError> {
    let frames = &dataset.train;
    artefact::write_table(rows_table(frames, knn), &directory.join("rows.parquet"))?;
    profile_file::write(directory, &dataset.profile)?;
    Ok(knn.map_or(Ok(()), |knn| knn.write_members(directory))?)
}

/// Rewrites the manifest and the profile: the study may differ in keys that do not affect tables and weights, such as
/// the held-out range. The fingerprints of all other files are kept, so that later damage can still be detected.
pub(crate) fn rewrite(
    mut manifest: ModelManifest,
    study: &Study,
    dataset: &Dataset,
    directory: &Path,
) -> Result<ModelManifest, StepError> {
    let claim = DirectoryLock::new(directory, Below::Ours)?;
    manifest.study = study.clone();
    profile_file::write(directory, &dataset.profile)?;
    manifest.files.insert(PROFILE.to_owned(), fingerprint_file(&directory.join(PROFILE))?);
    claim.complete(&manifest)?;
    Ok(manifest)
}

/// Returns the table of rows: row → timestamp, segment and, for neighbours, block.
fn rows_table(frames: &Frames, knn: Option<&KnnModel>) -> Table {
    let table = frames::rows_table(frames);
    let Some(knn) = knn else { return table };
    let transitions = knn.transitions();
    table.with_optional(
        "block",
        (0..frames.rows())
            .map(|row: usize| {
                let row = calib_core::RowIndex::new(row);
                let transition: Option<TransitionIndex> =
                    transitions.starting_at(row).or_else(|| transitions.ending_in(row));
                transition.map(|transition| knn.blocks().block_of(transition) as u32)
            })
            .collect(),
    )
}

/// Refuses a request about the model of a study that has none.
pub(crate) fn require_model(job: &Job) -> Result<(), StepError> {
    ensure!(
        job.study().has_model(),
        "the study has no model (model.kind = \"none\"): the replayed log decides alone; go on with `{}`, or set model.kind = \"knn\" for a model",
        job.command(StepKind::Sweep)
    );
    Ok(())
}

/// Returns the fingerprint that all results of the model depend on, if the study has a model and it exists.
///
/// # Errors
/// As [`content`].
pub fn content_of(job: &Job) -> Result<Option<String>, StepError> {
    if !job.study().has_model() {
        return Ok(None);
    }
    artefact::read::<ModelManifest>(&job.layout().model()).map(|model| content(&model)).transpose()
}

/// Opens the model of a job, if its study has one.
///
/// # Errors
/// If it does not exist, is damaged, or was made from another study ([`StepError::Stale`]).
pub fn open_if_any(job: &Job) -> Result<Option<OpenModel>, StepError> {
    if job.study().has_model() { open(job).map(Some) } else { Ok(None) }
}

/// Opens the model of a job. Tables and states are mapped, and checked.
pub(crate) fn open(job: &Job) -> Result<OpenModel, StepError> {
    require_model(job)?;
    let directory = &job.layout().model();
    let build = job.command(StepKind::BuildModel);
    let manifest: ModelManifest = artefact::require(directory, &build)?;
    StoredArtefact { step: StepKind::BuildModel, study: &manifest.study, directory }.check(job)?;
    opened(directory, manifest, &build)
}

/// Opens the model in a folder, whatever its study.
pub(crate) fn open_directory(directory: &Path) -> Result<OpenModel, StepError> {
    let build = "calib build-model STUDY";
    ensure!(
        !directory.join(artefact::CONTROL_VERDICT).exists(),
        "{} has the verdict of `calib control`, which keeps no model: one with actions is made when it is asked for",
        directory.display()
    );
    let acting = Layout::new(PathBuf::new(), directory.to_owned()).control_model();
    ensure!(
        !acting.exists(),
        "{} has the results of agents that act; name {}, which is their model",
        directory.display(),
        acting.display()
    );
    opened(directory, artefact::require(directory, build)?, build)
}

/// Opens and checks the files in the folder of this manifest, which the command `build` makes again.
fn opened(directory: &Path, manifest: ModelManifest, build: &str) -> Result<OpenModel, StepError> {
    artefact::check_files(directory, &manifest.files, build)?;
    let again = format!("the model in {} is damaged; run `{build} --force`", directory.display());
    let states = frames::map_states(&directory.join(STATES)).context(&again)?;
    let frames = frames::open(&directory.join("rows.parquet"), states.clone()).context(&again)?;
    let (psi, encoder) = represent::of_model(directory, &manifest.files).context(&again)?;
    let metric = psi.unwrap_or(states);
    let model = kinds::open(directory, &manifest.study, &frames, metric, None);
    let model = model.context(&again)?;
    Ok(OpenModel { manifest, frames, model, encoder })
}

/// Checks that the model was built from `dataset`.
///
/// # Errors
/// [`StepError::Stale`] if it was built from other data.
pub fn check_data(job: &Job, manifest: &ModelManifest, dataset: &Dataset) -> Result<(), StepError> {
    if dataset.fingerprint == manifest.data {
        return Ok(());
    }
    Err(StepError::Stale(format!(
        "the model in {} was built from other data (fingerprint {}, the study's data has {}); run `{}` again",
        job.layout().model().display(),
        manifest.data.short(),
        dataset.fingerprint.short(),
        job.command(StepKind::BuildModel),
    )))
}

/// Whether the model of a job is there and need not be made again, by its manifest.
pub(super) fn is_kept(job: &Job, dataset: &Dataset) -> bool {
    if job.policy().redoes() {
        return false;
    }
    let directory = job.layout().model();
    artefact::read::<ModelManifest>(&directory).is_some_and(|found| {
        found.data == dataset.fingerprint
            && found.has_files(&directory)
            && job.study().differences(StepKind::BuildModel, &found.study).is_empty()
    })
}

/// Reads the profile of the data that the model was built from.
///
/// # Errors
/// As [`profile_file::read`].
pub fn read_profile(directory: &Path) -> Result<Profile, StepError> {
    profile_file::read(directory, "calib build-model STUDY")
}

/// Returns the sensors to predict, each with its column of the states.
///
/// # Errors
/// If a sensor is no column of the states, with the reason.
pub fn sensor_columns(
    study: &Study,
    normaliser: &Normaliser,
    profile: &Profile,
) -> Result<Vec<(String, usize)>, StepError> {
    study
        .sweep
        .sensors
        .iter()
        .map(|sensor| {
            let column = sensor_column(sensor, normaliser, profile).context("sweep.sensors")?;
            Ok((sensor.clone(), column))
        })
        .collect()
}

/// Returns the column of a sensor in the states, or the reason why it has none.
fn sensor_column(
    sensor: &str,
    normaliser: &Normaliser,
    profile: &Profile,
) -> Result<usize, StepError> {
    if let Some(column) = normaliser.position(sensor) {
        return Ok(column);
    }
    profile.require_sensor(sensor)?;
    bail!("sensor {sensor} is not a column of the states")
}

/// Returns the names of a model's files: those of every kind, the tables of its members, and `further` ones.
pub(crate) fn file_names(members: usize, further: &[&str]) -> Vec<String> {
    let own = ["states.npy", "rows.parquet", "profile.json"];
    let mut names: Vec<String> = own.iter().chain(further).map(|&name| name.to_owned()).collect();
    for member in 0..members {
        for table in ["neighbors", "distances", "left_out"] {
            names.push(format!("members/{member}/{table}.npy"));
        }
    }
    names
}

#[cfg(test)]
mod tests {
    use super::*;

    fn drawn(weights: WeightsKind, temperature: f64, remove_traps: bool) -> ModelConfig {
        ModelConfig { weights, temperature, remove_traps, ..ModelConfig::default() }
    }

    fn key(search: u32, model: &ModelConfig) -> String {
        key_of(search, &Fingerprint::of(b"states"), model, None).expect("a fingerprint")
    }

    #[test]
    fn tables_without_traps_are_those_of_the_weights() {
        let linear = key(1, &drawn(WeightsKind::Linear, 1.0, true));
        assert_eq!(linear, key(1, &drawn(WeightsKind::Linear, 2.0, true)));
        for other in [
            drawn(WeightsKind::Uniform, 1.0, true),
            drawn(WeightsKind::Softmax, 1.0, true),
            drawn(WeightsKind::Softmax, 2.0, true),
            drawn(WeightsKind::Linear, 1.0, false),
        ] {
            assert_ne!(linear, key(1, &other), "{other:?}");
        }
        assert_eq!(
            key(1, &drawn(WeightsKind::Linear, 1.0, false)),
            key(1, &drawn(WeightsKind::Softmax, 2.0, false)),
            "tables as found"
        );
        let soft = [1.0, 2.0].map(|temperature| drawn(WeightsKind::Softmax, temperature, true));
        assert_ne!(key(1, &soft[0]), key(1, &soft[1]));
    }

    #[test]
    fn approximate_tables_are_those_of_one_version_of_the_search() {
        let exact = ModelConfig::default();
        assert_eq!(key(1, &exact), key(2, &exact));
        for approximate in [
            ModelConfig { prototypes: 4, ..exact },
            ModelConfig { components: 4, ..exact },
            ModelConfig { leaf_budget: 4, ..exact },
        ] {
            assert_ne!(key(1, &approximate), key(2, &approximate), "{approximate:?}");
            assert_ne!(key(1, &approximate), key(1, &exact), "{approximate:?}");
        }
    }
}
