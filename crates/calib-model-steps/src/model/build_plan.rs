//! Estimates the memory and disk space of building a model, and checks that they are available.

use std::{ops::Range, path::Path};

use calib_base::{
    StepError, bail,
    cost::StepCost,
    disk_room,
    log::prepared::Known,
    memory,
    options::{BuildOptions, Spill},
    output::{bytes, count, counted},
};
use calib_core::{Segment, Segments, Timestamp, Transitions};
use calib_data::Dataset;
use calib_knn::{IndexKind, KnnModel, MemoryNeed, ModelConfig};
use calib_model::ModelFamily;
use calib_study::Job;
use schemars::JsonSchema;
use serde::Serialize;

use crate::represent::{self, Width};

/// The training states of a log, as far as a plan needs them.
pub(crate) struct Training {
    pub(crate) timestamps: Vec<Timestamp>,
    segments: Segments,
    pub(crate) columns: usize,
    /// Memory for making the states, in bytes.
    making_bytes: u64,
}

impl Training {
    pub(crate) fn of(known: &Known) -> Self {
        match known {
            Known::Prepared(prepared) => {
                let train = &prepared.dataset.train;
                Self {
                    timestamps: train.timestamps().to_vec(),
                    segments: train.segments().clone(),
                    columns: train.states().columns(),
                    making_bytes: 0,
                }
            }
            Known::Surveyed(surveyed, making_bytes) => Self {
                timestamps: surveyed.timestamps(),
                segments: surveyed.segment_rows().clone(),
                columns: surveyed.columns(),
                making_bytes: *making_bytes,
            },
        }
    }
}

/// The data that are memory-mapped from files while a model is built. The system can take their memory back.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Spilled {
    Nothing,
    States,
    /// States, images and tables.
    Everything,
}

impl Spilled {
    /// Returns the memory of a build whose other arrays need this much, in bytes.
    fn peak(self, need: &MemoryNeed) -> u64 {
        match self {
            Self::Nothing => need.peak(),
            // A share of the states should stay in memory. Otherwise each is read from the disk again and again.
            Self::States => need.working.saturating_add(need.states / 3),
            Self::Everything => need.least,
        }
    }

    /// Returns the arrays to map for this option: with [`Spill::Auto`] as few as `fits` permits, or otherwise
    /// everything.
    fn chosen(asked: Spill, fits: impl Fn(Self) -> bool) -> Self {
        match asked {
            Spill::Auto if fits(Self::Nothing) => Self::Nothing,
            Spill::Auto if fits(Self::States) => Self::States,
            Spill::Never => Self::Nothing,
            Spill::Auto | Spill::Always => Self::Everything,
        }
    }
}

/// The plan of building a model, with the resources that it needs.
#[derive(Clone, Debug, Serialize, JsonSchema)]
pub struct BuildPlan {
    rows: usize,
    columns: usize,
    segments: usize,
    members: usize,
    neighbors: usize,
    /// The requested search structure.
    index: IndexKind,
    /// The data that are memory-mapped from files.
    pub(crate) spill: Spilled,
    /// Predicted peak of the memory that cannot be given back, in bytes.
    memory_bytes: u64,
    /// Available memory in bytes, or the value of `--memory`.
    available_bytes: Option<u64>,
    /// Bytes on disk: the model, and the temporary files of the build.
    disk_bytes: u64,
}

impl BuildPlan {
    /// Returns the plan for a model that is built from `part` of the training states. `width` is that of the searched
    /// states.
    ///
    /// # Errors
    /// If a model with so many columns and these segments cannot be built, or there is too little memory.
    pub(crate) fn new(
        data: &Training,
        part: Range<usize>,
        model: &ModelConfig,
        width: Width,
        options: &BuildOptions,
    ) -> Result<Self, StepError> {
        let rows = part.len();
        let columns = data.columns;
        // Before any state is read, and before an older model is given up.
        let segments = segments_of(&data.segments, &part);
        let transitions = Transitions::new(Segments::from_lengths(segments.iter().copied())?);
        let (known, psi) = match width {
            Width::OfStates => (Some(columns), None),
            Width::Exactly(coordinates) => (Some(coordinates), Some(coordinates)),
            Width::Perhaps(coordinates) => (None, Some(coordinates)),
        };
        KnnModel::check(known, &transitions, model)?;
        drop(transitions);
        // If there is a ψ, it is searched. It is mapped from its file, so that only its copy takes further disk space.
        let threads = rayon::current_num_threads();
        let mut need = MemoryNeed::predict(rows, psi.unwrap_or(columns), model, threads);
        need.states = 4 * (rows * columns) as u64;
        let available = options.memory.or_else(memory::available);
        let spill = Spilled::chosen(options.spill, |spilled| {
            let taken = data.making_bytes.max(spilled.peak(&need));
            available.is_none_or(|available| taken <= available)
        });
        let memory_bytes = data.making_bytes.max(spill.peak(&need));
        if let Some(available) = available.filter(|available| memory_bytes > *available) {
            // The number of table entries per row is the number of neighbours in all members.
            let tables = model.neighbors.saturating_mul(model.members) > columns;
            bail!(
                "building this model of {} states of {} columns takes {} of memory, and {} is there; \
                 {}raise `preprocess.subsample`, shorten `data.train`, leave channels out with `data.exclude`{}, \
                 or say with --memory SIZE that there is more",
                count(rows),
                columns,
                bytes(memory_bytes),
                bytes(available),
                if tables { "lower `model.neighbors` or `model.members`, " } else { "" },
                if options.spill == Spill::Never {
                    ", let it work on disk with --spill auto"
                } else {
                    ""
                },
            );
        }
        let working = if spill == Spilled::Everything { need.working } else { 0 };
        let on_disk = [need.states, beside_states(rows, psi.unwrap_or(0), model), working];
        Ok(Self {
            rows,
            columns,
            segments: segments.len(),
            members: model.members,
            neighbors: model.neighbors,
            index: model.index,
            spill,
            memory_bytes,
            available_bytes: available,
            disk_bytes: on_disk.into_iter().fold(0, u64::saturating_add),
        })
    }

    /// Refuses a model that does not fit on the disk. States that have a file already are linked.
    ///
    /// # Errors
    /// If there is clearly less space.
    pub(crate) fn require_room(
        &self,
        states: Option<&Path>,
        directory: &Path,
    ) -> Result<(), StepError> {
        let linked = states.map_or(0, |_| 4 * (self.rows * self.columns) as u64);
        disk_room::require(
            disk_room::left(self.disk_bytes.saturating_sub(linked), directory),
            "the model",
            directory,
            "choose a folder on another disk with --output, or lower model.neighbors or model.members",
        )
    }

    /// Returns the cost of a build that takes `processor_secs`.
    pub(super) fn cost(&self, processor_secs: f64) -> StepCost {
        StepCost { processor_secs, memory: self.memory_bytes, disk: self.disk_bytes }
    }

    /// Returns the plan in a sentence.
    pub(crate) fn sentence(&self) -> String {
        let available = self
            .available_bytes
            .map_or_else(String::new, |available| format!(" of {} there", bytes(available)));
        let spill = match self.spill {
            Spilled::Nothing => "",
            Spilled::States => ", with states mapped from their file",
            Spilled::Everything => ", with states, images and tables mapped from files",
        };
        format!(
            "{} rows x {} columns in {}; {}, k = {}; expecting {} of memory{available} and up to {} on disk{spill}",
            count(self.rows),
            self.columns,
            counted(self.segments, "segment"),
            counted(self.members, "ensemble member"),
            self.neighbors,
            bytes(self.memory_bytes),
            bytes(self.disk_bytes),
        )
    }
}

/// Returns the bytes that building the model of a study still takes on the disk, without the states, which have a file
/// already. A network takes little.
pub fn disk_left(job: &Job, dataset: &Dataset) -> u64 {
    if !takes_disk(job) {
        return 0;
    }
    let study = job.study();
    let states = dataset.train.states();
    let coordinates = match represent::width(study, job.layout(), states.columns()) {
        Width::OfStates => 0,
        Width::Exactly(coordinates) | Width::Perhaps(coordinates) => coordinates,
    };
    let needed = beside_states(states.rows(), coordinates, &study.model);
    disk_room::left(needed, &job.layout().model())
}

/// Whether a model has tables of neighbours. Others take hardly any disk.
pub fn takes_disk(job: &Job) -> bool {
    job.study().model.kind.family() == ModelFamily::Neighbors
}

/// Returns the disk space of ψ with so many coordinates and of the tables, and of the parts of tables until these are
/// written.
fn beside_states(rows: usize, coordinates: usize, model: &ModelConfig) -> u64 {
    let psi = 4 * (rows * coordinates) as u64;
    let tables = bytes_of_tables(rows, model);
    psi.saturating_add(tables).saturating_add(tables)
}

/// Returns the bytes of the tables of all members, limited to the largest `u64`.
fn bytes_of_tables(rows: usize, model: &ModelConfig) -> u64 {
    // The check permits nearly as many neighbours as rows, in half as many members as rows.
    let factors = [rows, model.neighbors, model.members];
    factors.into_iter().fold(8, |bytes, factor| bytes.saturating_mul(factor as u64))
}

/// Returns the number of rows of each segment that are in `part`.
fn segments_of(segments: &Segments, part: &Range<usize>) -> Vec<usize> {
    let rows = segments.iter().map(Segment::rows);
    let inside = rows.map(|rows| rows.start.max(part.start)..rows.end.min(part.end));
    inside.filter(|rows| !rows.is_empty()).map(|rows| rows.len()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table_bytes(rows: usize, neighbors: usize, members: usize) -> u64 {
        bytes_of_tables(rows, &ModelConfig { neighbors, members, ..ModelConfig::default() })
    }

    #[test]
    fn tables_beyond_all_numbers_are_not_small() {
        assert_eq!(table_bytes(1000, 3, 5), 120_000);
        // 3.2e19, which exceeds the largest `u64` by 1.4e19.
        assert_eq!(table_bytes(4_000_000, 1_000_000, 1_000_000), u64::MAX);
    }

    #[test]
    fn tables_are_there_twice_while_they_are_written() {
        let model = ModelConfig { neighbors: 3, members: 5, ..ModelConfig::default() };
        assert_eq!(beside_states(1000, 0, &model), 2 * 120_000);
        assert_eq!(beside_states(1000, 6, &model), 2 * 120_000 + 24_000);
    }

    /// Returns the mapped arrays of a model that takes 100 bytes, 60 without its states, and 20 at least.
    fn chosen(asked: Spill, available: u64) -> Spilled {
        Spilled::chosen(asked, |spilled| {
            let taken = match spilled {
                Spilled::Nothing => 100,
                Spilled::States => 60,
                Spilled::Everything => 20,
            };
            taken <= available
        })
    }

    #[test]
    fn plans_spill_states_before_images() {
        assert_eq!(chosen(Spill::Auto, 100), Spilled::Nothing);
        assert_eq!(chosen(Spill::Auto, 99), Spilled::States);
        assert_eq!(chosen(Spill::Auto, 59), Spilled::Everything);
        // The plan refuses a model that does not fit even so.
        assert_eq!(chosen(Spill::Auto, 19), Spilled::Everything);
        assert_eq!(chosen(Spill::Never, 0), Spilled::Nothing);
        assert_eq!(chosen(Spill::Always, 1000), Spilled::Everything);
    }
}
