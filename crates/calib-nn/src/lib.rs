//! Multilayer perceptrons on a GEMM library: forward, backward, Adam, SGD.
