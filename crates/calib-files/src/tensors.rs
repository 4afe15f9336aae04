//! Weights as safetensors: named arrays that every deep-learning framework reads.

use std::{
    collections::{BTreeMap, HashMap},
    path::Path,
};

use safetensors::{Dtype, SafeTensors, tensor::TensorView};

use crate::{FileError, Fingerprint, Fingerprinter, read_regular, write_atomically};

/// A named `f32` array in row-major order.
#[derive(Clone, Debug, PartialEq)]
pub struct Tensor {
    /// Its name, unique in the file; dots group layers (`hidden.0.weight`).
    pub name: String,
    /// Length of each dimension.
    pub shape: Vec<usize>,
    /// As many values as the shape has elements, the last dimension fastest.
    pub values: Vec<f32>,
}

impl Tensor {
    /// Returns an array of one dimension.
    pub fn flat(name: impl Into<String>, values: Vec<f32>) -> Self {
        Self { name: name.into(), shape: vec![values.len()], values }
    }
}

/// The contents of a safetensors file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Tensors {
    /// The arrays, ordered by name.
    pub tensors: Vec<Tensor>,
    /// The file's free texts by name.
    pub metadata: BTreeMap<String, String>,
}

impl Tensors {
    /// Returns the array with that name.
    pub fn get(&self, name: &str) -> Option<&Tensor> {
        self.tensors.iter().find(|tensor| tensor.name == name)
    }
}

/// Writes arrays and texts as a safetensors file, atomically.
///
/// The arrays are stored ordered by name, so that the same content gives the same bytes.
///
/// # Errors
/// If a shape does not fit its values, a name is used twice, or the file cannot be written.
pub fn write_tensors(path: &Path, content: &Tensors) -> Result<(), FileError> {
    let mut views = BTreeMap::new();
    for Tensor { name, shape, values } in &content.tensors {
        let view = TensorView::new(Dtype::F32, shape.clone(), bytemuck::cast_slice(values))
            .map_err(|error| format!("'{name}' of shape {shape:?}: {error}"))
            .map_err(|reason| FileError::tensors(path, reason))?;
        if views.insert(name.as_str(), view).is_some() {
            return Err(FileError::tensors(path, format!("the name '{name}' is used twice")));
        }
    }
    // The library keeps texts in a hash map, whose order differs between runs. A single text keeps the bytes equal.
    let mut own = content.metadata.clone();
    own.insert(SEAL.to_owned(), seal(&views, &content.metadata).to_string());
    let metadata = Some(HashMap::from([(METADATA.to_owned(), texts(&own))]));
    let bytes = safetensors::serialize(views, metadata)
        .map_err(|error| FileError::tensors(path, error.to_string()))?;
    write_atomically(path, |file| std::io::Write::write_all(file, &bytes))
}

/// Reads a safetensors file of floats. `f64` and the half-precision types are converted to `f32`.
///
/// # Errors
/// If it cannot be read, is no safetensors file, or holds an array that is not of floats; or if calib wrote it, and it
/// has changed since.
pub fn read_tensors(path: &Path) -> Result<Tensors, FileError> {
    read(path).map(|(content, _)| content)
}

/// Reads a file that [`write_tensors`] must have written.
///
/// # Errors
/// As [`read_tensors`], and if the file has no fingerprint of itself.
pub fn read_sealed_tensors(path: &Path) -> Result<Tensors, FileError> {
    let (content, seal) = read(path)?;
    let reason = "it has no fingerprint of itself: another version wrote it";
    seal.map(|_| content).ok_or_else(|| FileError::Damaged { path: path.to_owned(), reason })
}

/// Returns the content, and the verified fingerprint that the file carries, if it carries one.
fn read(path: &Path) -> Result<(Tensors, Option<String>), FileError> {
    let bytes = read_regular(path)?;
    let file = SafeTensors::deserialize(&bytes)
        .map_err(|error| FileError::tensors(path, error.to_string()))?;
    let (_, header) = SafeTensors::read_metadata(&bytes)
        .map_err(|error| FileError::tensors(path, error.to_string()))?;

    let mut tensors = Vec::with_capacity(file.len());
    for (name, view) in file.iter() {
        let values = floats(view.dtype(), view.data()).ok_or_else(|| {
            let got = view.dtype();
            let reason = format!("'{name}' is {got:?}, expected F32, F64, F16 or BF16");
            FileError::tensors(path, reason)
        })?;
        tensors.push(Tensor { name: name.to_owned(), shape: view.shape().to_vec(), values });
    }
    tensors.sort_by(|a, b| a.name.cmp(&b.name));

    let mut metadata = BTreeMap::new();
    for (name, text) in header.metadata().iter().flatten() {
        match (name == METADATA).then(|| serde_json::from_str(text)) {
            Some(Ok(own)) => metadata.extend::<BTreeMap<String, String>>(own),
            _ => drop(metadata.insert(name.clone(), text.clone())),
        }
    }
    let carried = metadata.remove(SEAL);
    if let Some(carried) = &carried
        && seal(&file.iter().collect::<BTreeMap<_, _>>(), &metadata).as_str() != carried
    {
        let reason = "its content does not have the fingerprint in its metadata";
        return Err(FileError::Damaged { path: path.to_owned(), reason });
    }
    Ok((Tensors { tensors, metadata }, carried))
}

/// The text that holds the fingerprint of all other content.
const SEAL: &str = "fingerprint";

/// Returns the fingerprint of the arrays and the texts.
fn seal(
    views: &BTreeMap<&str, TensorView<'_>>,
    metadata: &BTreeMap<String, String>,
) -> Fingerprint {
    let mut all = Fingerprinter::default();
    for (name, view) in views {
        let kind = format!("{:?} {:?}", view.dtype(), view.shape());
        all.add(name.as_bytes()).add(kind.as_bytes()).add(view.data());
    }
    all.add(texts(metadata).as_bytes());
    all.finish()
}

/// The single metadata text in which calib stores its own texts.
const METADATA: &str = "calib";

fn texts(metadata: &BTreeMap<String, String>) -> String {
    serde_json::json!(metadata).to_string()
}

fn floats(dtype: Dtype, bytes: &[u8]) -> Option<Vec<f32>> {
    Some(match dtype {
        Dtype::F32 => numbers(bytes, f32::from_le_bytes),
        Dtype::F64 => numbers(bytes, |number| f64::from_le_bytes(number) as f32),
        Dtype::BF16 => {
            numbers(bytes, |number| f32::from_bits(u32::from(u16::from_le_bytes(number)) << 16))
        }
        Dtype::F16 => numbers(bytes, |number| half(u16::from_le_bytes(number))),
        _ => return None,
    })
}

fn numbers<const N: usize>(bytes: &[u8], number: impl Fn([u8; N]) -> f32) -> Vec<f32> {
    bytes.as_chunks::<N>().0.iter().map(|&bytes| number(bytes)).collect()
}

/// Converts an IEEE half: 1 sign, 5 exponent, 10 fraction bits.
fn half(bits: u16) -> f32 {
    let sign = if bits >> 15 == 0 { 1.0 } else { -1.0 };
    let fraction = f32::from(bits & 0x3ff) / 1024.0;
    sign * match (bits >> 10) & 0x1f {
        0 => fraction * 2.0_f32.powi(-14),
        0x1f if fraction == 0.0 => f32::INFINITY,
        0x1f => f32::NAN,
        exponent => (1.0 + fraction) * 2.0_f32.powi(i32::from(exponent) - 15),
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    fn content() -> Tensors {
        Tensors {
            tensors: vec![
                tensor("hidden.0.bias", &[2], &[0.5, -0.0]),
                tensor("hidden.0.weight", &[2, 3], &[1.0, 2.0, 3.0, 4.0, f32::NAN, f32::MIN]),
            ],
            metadata: (0..20).map(|i| (format!("key {i}"), format!("text \"{i}\""))).collect(),
        }
    }

    fn tensor(name: &str, shape: &[usize], values: &[f32]) -> Tensor {
        Tensor { name: name.to_owned(), shape: shape.to_vec(), values: values.to_vec() }
    }

    /// Returns the bits of all values, array by array.
    fn bits(tensors: &[Tensor]) -> Vec<u32> {
        tensors.iter().flat_map(|tensor| &tensor.values).map(|value| value.to_bits()).collect()
    }

    #[test]
    fn come_back_bit_by_bit_and_write_the_same_bytes() {
        let directory = tempfile::tempdir().unwrap();
        let a = directory.path().join("a");
        let b = directory.path().join("b");
        let mut written = content();
        write_tensors(&a, &written).unwrap();
        let read = read_tensors(&a).unwrap();
        for (w, r) in written.tensors.iter().zip(&read.tensors) {
            assert_eq!((&w.name, &w.shape), (&r.name, &r.shape));
        }
        assert_eq!(bits(&written.tensors), bits(&read.tensors));
        assert_eq!(written.metadata, read.metadata);
        assert_eq!(read.get("hidden.0.bias").unwrap().shape, [2]);
        assert!(read.get("hidden").is_none());

        written.tensors.reverse();
        write_tensors(&b, &written).unwrap();
        assert_eq!(fs::read(&a).unwrap(), fs::read(&b).unwrap());
    }

    #[test]
    fn damage_is_found() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("weights");
        write_tensors(&path, &content()).unwrap();
        let whole = fs::read(&path).unwrap();
        let mut silent = 0;
        for place in 0..whole.len() {
            let mut other = whole.clone();
            other[place] ^= 1 << (place % 8);
            fs::write(&path, &other).unwrap();
            if let Ok(read) = read_sealed_tensors(&path) {
                // Blanks between the header's entries are not content.
                let same = read.metadata == content().metadata
                    && bits(&read.tensors) == bits(&content().tensors);
                silent += usize::from(!same);
            }
        }
        assert_eq!(silent, 0, "damages that are read with other content");
        let foreign = safetensors::serialize(
            [("a", TensorView::new(Dtype::F32, vec![1], &[0; 4]).unwrap())],
            None,
        );
        fs::write(&path, foreign.unwrap()).unwrap();
        assert!(read_tensors(&path).is_ok() && read_sealed_tensors(&path).is_err());
        assert!(refused_sealed(&path).is_of_content());
        fs::write(&path, &whole[..whole.len() - 1]).unwrap();
        assert!(refused_sealed(&path).is_of_content());
        fs::remove_file(&path).unwrap();
        assert!(!refused_sealed(&path).is_of_content(), "a missing file");
    }

    fn refused_sealed(path: &Path) -> FileError {
        read_sealed_tensors(path).expect_err("not sealed")
    }

    #[test]
    fn other_writers_types_and_texts_are_read() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("weights");
        let double = [1.5_f64, -3.0].map(f64::to_le_bytes).concat();
        let halves = [0x3c00_u16, 0xc100, 0x0001, 0x7c00].map(u16::to_le_bytes).concat();
        let brain = [0x3f80_u16, 0xc020].map(u16::to_le_bytes).concat();
        let bytes = safetensors::serialize(
            [
                ("double", TensorView::new(Dtype::F64, vec![2], &double).unwrap()),
                ("half", TensorView::new(Dtype::F16, vec![2, 2], &halves).unwrap()),
                ("brain", TensorView::new(Dtype::BF16, vec![2], &brain).unwrap()),
            ],
            Some(HashMap::from([("format".to_owned(), "pt".to_owned())])),
        );
        fs::write(&path, bytes.unwrap()).unwrap();
        let read = read_tensors(&path).unwrap();
        assert_eq!(read.get("double").unwrap().values, [1.5, -3.0]);
        assert_eq!(read.get("half").unwrap().values, [1.0, -2.5, 2.0_f32.powi(-24), f32::INFINITY]);
        assert_eq!(read.get("brain").unwrap().values, [1.0, -2.5]);
        assert_eq!(read.metadata["format"], "pt");
    }

    #[test]
    fn what_is_no_file_of_floats_is_refused_with_its_name() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("weights");

        fs::write(&path, b"not a safetensors file").unwrap();
        let refused = read_tensors(&path).unwrap_err().to_string();
        assert!(refused.contains("weights is not a usable safetensors file"), "{refused}");

        let view = TensorView::new(Dtype::I64, vec![1], &[0; 8]).unwrap();
        fs::write(&path, safetensors::serialize([("steps", view)], None).unwrap()).unwrap();
        let refused = read_tensors(&path).unwrap_err().to_string();
        assert!(refused.contains("'steps' is I64, expected F32"), "{refused}");

        let mut wrong = content();
        wrong.tensors[0].shape = vec![3];
        let refused = write_tensors(&path, &wrong).unwrap_err().to_string();
        assert!(refused.contains("'hidden.0.bias' of shape [3]"), "{refused}");
        wrong = content();
        wrong.tensors[1].name = "hidden.0.bias".into();
        let refused = write_tensors(&path, &wrong).unwrap_err().to_string();
        assert!(refused.contains("used twice"), "{refused}");
    }
}
