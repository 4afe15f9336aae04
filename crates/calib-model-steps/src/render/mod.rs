//! The presentation of results: lines and tables, or JSON.

mod models;
mod representations;
mod rollouts;
