use std::{collections::BTreeMap, path::Path};

use calib_core::{States, StatesError};
use calib_files::{Tensors, read_tensors, write_tensors};
use calib_nn::{Mlp, Naming, Workspace};
use rayon::prelude::*;

use crate::RepresentError;

/// Number of rows that are encoded with one product. Every product has this many rows, with padding in the
/// last. So the bytes of ψ(s) do not depend on how many states are encoded with s.
const CHUNK: usize = 256;

/// Returns ψ of every state, `[n, d]`, computed on all threads. The bytes do not depend on their number.
///
/// # Errors
/// If ψ of some state is not finite.
///
/// # Panics
/// If the states have not as many columns as the encoder has inputs.
pub fn encode(encoder: &Mlp, states: &States) -> Result<States, StatesError> {
    let (mut psi, shape) = prepare(encoder, states);
    let chunks = psi.par_chunks_mut(CHUNK * shape.1);
    let inputs = states.as_slice().par_chunks(CHUNK * shape.0);
    chunks.zip(inputs).for_each_init(
        || Buffers::new(encoder),
        |buffers, (psi, input)| buffers.encode(psi, input),
    );
    States::new(psi, states.rows(), shape.1)
}

/// Returns the same bytes as [`encode`], computed on the calling thread. It is for callers that are
/// parallel themselves.
///
/// # Errors
/// As [`encode`].
///
/// # Panics
/// As [`encode`].
pub(crate) fn encode_here(encoder: &Mlp, states: &States) -> Result<States, StatesError> {
    let (mut psi, shape) = prepare(encoder, states);
    let mut buffers = Buffers::new(encoder);
    let inputs = states.as_slice().chunks(CHUNK * shape.0);
    for (psi, input) in psi.chunks_mut(CHUNK * shape.1).zip(inputs) {
        buffers.encode(psi, input);
    }
    States::new(psi, states.rows(), shape.1)
}

/// Returns an empty buffer for ψ, and the numbers of columns of a state and of ψ.
fn prepare(encoder: &Mlp, states: &States) -> (Vec<f32>, (usize, usize)) {
    let shape = (states.columns(), encoder.outputs());
    assert_eq!(shape.0, encoder.inputs(), "an encoder is for states of its own width");
    (vec![0.0; states.rows() * shape.1], shape)
}

struct Buffers<'a> {
    encoder: &'a Mlp,
    workspace: Workspace,
    padded: Vec<f32>,
}

impl<'a> Buffers<'a> {
    fn new(encoder: &'a Mlp) -> Self {
        let workspace = Workspace::new(encoder, CHUNK);
        Self { encoder, workspace, padded: vec![0.0; CHUNK * encoder.inputs()] }
    }

    fn encode(&mut self, psi: &mut [f32], input: &[f32]) {
        self.padded[..input.len()].copy_from_slice(input);
        self.padded[input.len()..].fill(0.0);
        let outputs = self.encoder.forward(&self.padded, &mut self.workspace);
        psi.copy_from_slice(&outputs[..psi.len()]);
    }
}

/// Writes an encoder as safetensors, with the names and layout of PyTorch's
/// `Sequential(Linear, ReLU, …, Linear)`.
///
/// # Errors
/// If the file cannot be written.
pub fn write_encoder(
    path: &Path,
    encoder: &Mlp,
    metadata: BTreeMap<String, String>,
) -> Result<(), RepresentError> {
    let tensors = encoder.to_tensors(Naming::Sequential);
    Ok(write_tensors(path, &Tensors { tensors, metadata })?)
}

/// Reads a file from [`write_encoder`] or PyTorch.
///
/// # Errors
/// If the file cannot be read, or does not contain the weights of such a network.
pub fn read_encoder(path: &Path) -> Result<Mlp, RepresentError> {
    let content = read_tensors(path)?;
    Mlp::from_tensors(&content, "", Naming::Sequential).map_err(|error| RepresentError::Encoder {
        path: path.to_owned(),
        reason: error.to_string(),
    })
}

#[cfg(test)]
mod tests {
    use calib_core::Seed;

    use super::*;

    #[test]
    fn a_state_has_the_same_code_in_any_company() {
        let encoder = Mlp::new(&[5, 16, 3], Seed::new(1));
        let mut rng = Seed::new(2).rng();
        let values: Vec<f32> = (0..700 * 5).map(|_| rng.normal() as f32).collect();
        let all = States::new(values.clone(), 700, 5).expect("finite");
        let psi = encode(&encoder, &all).expect("finite");
        for (row, count) in [(0, 1), (3, 2), (255, 300), (699, 1)] {
            let few = values[row * 5..(row + count) * 5].to_vec();
            let few = States::new(few, count, 5).expect("finite");
            let alone = encode(&encoder, &few).expect("finite");
            assert_eq!(alone.as_slice(), &psi.as_slice()[row * 3..(row + count) * 3]);
        }
        assert_eq!(encode_here(&encoder, &all).expect("finite").as_slice(), psi.as_slice());
        let one = encoder.forward(all.row(5), &mut Workspace::new(&encoder, 1)).to_vec();
        assert!(one.iter().zip(psi.row(5)).all(|(a, b)| (a - b).abs() < 1e-6));
    }

    #[test]
    fn encoders_come_back() {
        let directory = tempfile::tempdir().expect("a directory");
        let path = directory.path().join("encoder.safetensors");
        let encoder = Mlp::new(&[2, 3, 4, 2], Seed::new(1));
        write_encoder(&path, &encoder, BTreeMap::new()).expect("written");
        assert_eq!(read_encoder(&path).expect("readable"), encoder);
        write_tensors(&path, &Tensors::default()).expect("written");
        let error = read_encoder(&path).expect_err("empty").to_string();
        assert!(error.contains("no `0.weight`"), "{error}");
    }
}
