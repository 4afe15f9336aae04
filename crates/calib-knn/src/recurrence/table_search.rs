use calib_core::Monitor;
use calib_files::ScratchPlace;

use crate::{
    Exclusion, Weights,
    index::{Planned, Sources},
};

/// The search that found the tables of a model, and its settings.
#[derive(Clone, Copy)]
pub(crate) struct TableSearch<'a> {
    pub(crate) planned: &'a Planned<'a>,
    pub(crate) sources: &'a Sources<'a>,
    pub(crate) k: usize,
    pub(crate) exclusion: Exclusion,
    pub(crate) weights: Weights,
    pub(crate) place: &'a ScratchPlace,
    pub(crate) monitor: &'a dyn Monitor,
}
