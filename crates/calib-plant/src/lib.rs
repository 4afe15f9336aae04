//! A simulated membrane-filtration pilot plant.
