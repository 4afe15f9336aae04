//! Tests rollouts, their starts and the removal of traps through the public interface.

mod closed_classes;
mod rollouts;
