//! Results as whoever asked for them reads them: lines and tables, or JSON.

mod models;
mod representations;
mod rollouts;
