//! From files to datasets, through the public interface.

mod cleaning;
mod columns;
mod inputs;
mod ranges;
mod real;
mod support;
