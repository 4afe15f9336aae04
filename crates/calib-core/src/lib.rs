//! The words of the domain: timestamps, segments, transitions, states, normalisers, seeds, streams.
