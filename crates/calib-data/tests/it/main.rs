//! Tests the path from files to datasets through the public interface.

mod angles;
mod checksums;
mod cleaning;
mod columns;
mod cut_files;
mod foreign_exports;
mod formats;
mod inputs;
mod loggers;
mod notations;
mod ranges;
mod real;
mod shapes;
mod support;
mod tags_of_files;
