//! Leave-one-block-out k-nearest-neighbour calibration models: blocks, exact search, tables.
