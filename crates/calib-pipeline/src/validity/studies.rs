//! Lists the studies, and makes their missing results.

use std::path::Path;

use calib_base::{
    Context as _, StepError,
    artefact::MANIFEST,
    bail, ensure,
    log::{
        context::RunContext,
        plant_of_study::{self, PlantOfStudy},
        simulate::PlantLogState,
    },
    options::ValidityOptions,
    torch,
};
use calib_files::read_regular;
use calib_model::ModelKind;
use calib_study::{DrawnStudy, Job, Request, Study, StudyError};
use calib_sweep::Candidate;
use calib_sweep_steps::{
    sweep::{self, candidates::candidates_of},
    verdict::evaluate,
};

use super::protocol::{ProtocolFile, files};
use crate::run_study::{self, RunUntil};

/// The studies to judge together.
pub(super) struct Listing {
    pub(super) studies: Vec<ListedStudy>,
    /// The protocol that draws them, if any.
    pub(super) protocol: Option<ProtocolFile>,
}

/// A study, which stands for a plant.
pub(super) struct ListedStudy {
    /// Name of the plant: that of the file without `.toml`.
    pub(super) plant: String,
    /// The whole study, without a chosen model or deployment.
    pub(super) job: Job,
    /// Its models; `None` for a study with one model that has no name.
    pub(super) models: Vec<Option<String>>,
    /// Its deployments; `None` for a study with one held-out range that has no name.
    pub(super) deployments: Vec<Option<String>>,
    /// The content of the file, if a protocol draws it.
    pub(super) drawn: Option<DrawnStudy>,
}

/// Lists the studies that `args` name. A folder stands for all its `*.toml` files in alphabetical order, and a protocol
/// for the studies that it draws.
pub(super) fn list(args: &ValidityOptions) -> Result<Listing, StepError> {
    if let Some(protocol) = ProtocolFile::find(args)? {
        let mut studies = Vec::new();
        for drawn in protocol.draw(&args.set)? {
            let job = drawn.job(&protocol.studies())?;
            studies.push(ListedStudy::new(drawn.plant.clone(), job, Some(drawn)));
        }
        return Ok(Listing { studies, protocol: Some(protocol) });
    }
    let mut studies: Vec<ListedStudy> = Vec::new();
    for path in &args.studies {
        for path in files(path)? {
            let plant = path.file_stem().map(|stem| stem.to_string_lossy().into_owned());
            let plant = plant.with_context(|| format!("{} has no name", path.display()))?;
            if let Some(other) = studies.iter().find(|other| other.plant == plant) {
                bail!(
                    "{} and {} are both called {plant}, and a study stands for a plant: intervals are over plants; \
                     rename one, or leave it out",
                    other.path().display(),
                    path.display()
                );
            }
            let request = Request { set: args.set.clone(), ..Request::new(path) };
            studies.push(ListedStudy::new(plant, Job::resolve(request)?, None));
        }
    }
    Ok(Listing { studies, protocol: None })
}

impl ListedStudy {
    fn new(plant: String, job: Job, drawn: Option<DrawnStudy>) -> Self {
        let models = or_the_only(job.study().compared_models());
        let deployments = or_the_only(job.study().deployment_names());
        Self { plant, job, models, deployments, drawn }
    }

    /// Returns the file.
    pub(super) fn path(&self) -> &Path {
        self.job.layout().study()
    }

    /// Returns the whole study.
    pub(super) fn study(&self) -> &Study {
        self.job.study()
    }

    /// Returns why its data is out of reach, if it is: an environment variable in its path is not set.
    pub(super) fn out_of_reach(&self) -> Result<Option<String>, StepError> {
        match plant_of_study::data_to_read(&self.job) {
            Err(StudyError::UnsetVariable { name, .. }) => Ok(Some(format!("{name} is not set"))),
            Err(error) => Err(error.into()),
            Ok(_) => Ok(None),
        }
    }

    /// Returns each of its models in each of its deployments.
    fn parts(&self) -> impl Iterator<Item = Result<Job, StudyError>> {
        self.models.iter().flat_map(|model| {
            self.deployments
                .iter()
                .map(|deployment| self.job.choose(model.as_deref(), deployment.as_deref()))
        })
    }

    /// Returns the number of models and deployments that this build of calib still has to sweep.
    pub(super) fn left(&self, context: &RunContext) -> Result<usize, StepError> {
        let is_written = self.is_written()?;
        let mut left = 0;
        for part in self.parts() {
            let part = part?;
            if !self.lacks(part.model()) {
                left += usize::from(!is_written || !evaluate::is_swept(&part, context));
            }
        }
        Ok(left)
    }

    /// Returns the total time of its sweeps, as far as it is recorded, in seconds.
    pub(super) fn swept_secs(&self) -> Result<f64, StepError> {
        let mut secs = 0.0;
        for part in self.parts() {
            secs += sweep::wall_secs(part?.layout()).unwrap_or(0.0);
        }
        Ok(secs)
    }

    /// Whether its file has the expected content.
    fn is_written(&self) -> Result<bool, StepError> {
        let Some(drawn) = &self.drawn else { return Ok(true) };
        let path = self.path();
        Ok(path.exists() && read_regular(path)? == drawn.text.as_bytes())
    }

    /// Writes the file of a drawn study, unless it has the expected content.
    fn write(&self) -> Result<(), StepError> {
        if let Some(drawn) = &self.drawn
            && !self.is_written()?
        {
            calib_files::write_atomically(self.path(), |file| {
                std::io::Write::write_all(file, drawn.text.as_bytes())
            })?;
        }
        Ok(())
    }

    /// Makes its missing results up to `extent`, as `calib run` does. Steps report as remarks. Returns the reason if
    /// the study cannot be scored.
    pub(super) fn complete(
        &self,
        extent: RunUntil,
        context: &RunContext,
    ) -> Result<Option<String>, StepError> {
        self.write()?;
        let talk = context.talking();
        // The log of an earlier draw belongs to the protocol alone, so it may be replaced.
        if self.drawn.is_some()
            && let Some(plant) = PlantOfStudy::of(&self.job)?
            && plant.found == PlantLogState::Another
        {
            plant.make(true, &talk).context("[simulate]")?;
        }
        match run_study::run(extent, &self.job, None, &talk) {
            Err(reason) if matches!(reason.root(), StepError::Unscorable(_)) => {
                Ok(Some(reason.to_string()))
            }
            ended => ended.map(|_| None),
        }
    }

    /// Whether this build cannot train a model, and no other build has trained it.
    pub(super) fn lacks(&self, model: Option<&str>) -> bool {
        let own = model.and_then(|name| self.study().models.get(name)?.get("model")?.get("kind"));
        let own = own.and_then(|kind| kind.clone().try_into::<ModelKind>().ok());
        let kind = own.unwrap_or(self.study().model.kind);
        let layout = self.job.layout().clone();
        let paths = match model {
            Some(name) => layout.of_model(name),
            None => layout,
        };
        torch::lacks(kind) && !paths.model().join(MANIFEST).exists()
    }
}

/// Checks the studies before any run: each has held-out data, and all have the same settings and score.
pub(super) fn check(studies: &[ListedStudy]) -> Result<(), StepError> {
    let mut first: Option<(&ListedStudy, Vec<String>)> = None;
    for listed in studies {
        let study = listed.study();
        let path = listed.path();
        let plant = &listed.plant;
        let data = &study.data;
        ensure!(
            study.has_model(),
            "{} has no model (model.kind = \"none\"), and validity compares the choices of models, with that of log replay beside them; set \
             model.kind = \"knn\", or leave it out",
            path.display()
        );
        ensure!(
            data.holds_out() || listed.deployments.iter().any(Option::is_some),
            "{} holds no data out, so nobody can say how well calib chooses there; set data.held_out, or leave it out",
            path.display()
        );
        ensure!(
            study.gammas() == [study.agent.gamma],
            "{} gives sensors discount factors of their own (agent.gammas), and validity compares plants by one; make a study for each \
             discount factor, or leave it out",
            path.display()
        );
        let candidates = candidates_of(study).with_context(|| path.display().to_string())?;
        let values: Vec<String> = candidates.iter().map(Candidate::label).collect();
        let Some((other, theirs)) = &first else {
            first = Some((listed, values));
            continue;
        };
        ensure!(
            *theirs == values,
            "the studies sweep different settings: {} has {}, {plant} has {}; give all the same [sweep.grid] and default, or \
             judge them apart",
            other.plant,
            theirs.join(", "),
            values.join(", ")
        );
        ensure!(
            other.study().part() == study.part(),
            "the studies score different parts of a run: {} and {plant} differ in sweep.scored or [pretrain]; judge them apart",
            other.plant
        );
    }
    Ok(())
}

fn or_the_only(names: Vec<String>) -> Vec<Option<String>> {
    if names.is_empty() { vec![None] } else { names.into_iter().map(Some).collect() }
}
