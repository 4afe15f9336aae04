//! A model with actions that several objects of Python share.

use std::sync::{Arc, OnceLock};

use calib_control::{Increments, NetworkModel};
use calib_pipeline::ControlModel;

use crate::lost::LostPages;

/// A mapped model with actions, and the number of lost pages when it was opened.
pub(crate) struct SharedActionModel {
    pub(crate) opened: ControlModel,
    pub(crate) lost_pages: LostPages,
    pub(crate) increments: OnceLock<Arc<Increments>>,
    pub(crate) networks: OnceLock<Arc<NetworkModel>>,
}
