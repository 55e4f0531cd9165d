//! Reads the weights of the network from the wheel that its authors published.
//!
//! A wheel is a zip archive. The models in it are zip archives too; their members `data/0` to `data/37` are the tensors
//! in the order of the definition of the layers, in raw little-endian single precision. Nothing else is read.

use std::io::{Cursor, Read as _};

use zip::ZipArchive;

use crate::ExtractionError;

/// Values in each tensor, in the order of the file.
const LENGTHS: [usize; 38] = [
    16 * 343,
    16 * 16 * 27,
    16 * 16 * 27,
    16 * 16 * 27,
    16 * 16 * 27,
    16 * 32 * 27,
    32 * 32 * 27,
    16 * 32,
    32 * 32 * 27,
    32 * 32 * 27,
    32 * 64 * 27,
    64 * 64 * 27,
    32 * 64,
    64 * 64 * 27,
    64 * 64 * 27,
    64 * 128 * 27,
    128 * 128 * 27,
    64 * 128,
    128 * 128 * 27,
    128 * 128 * 27,
    128 * 32,
    32 * 32 * 27,
    32 * 64,
    64 * 16,
    16 * 16 * 27,
    16 * 32,
    32 * 8,
    8 * 8 * 27,
    8 * 16,
    16 * 4,
    4 * 4 * 27,
    4 * 16,
    16 * 8 * 27,
    8,
    8 * 8 * 27,
    8,
    8 * 2 * 8,
    2,
];

/// The size limit of an unpacked model; the published ones have 8.7 MB.
const MAX_MODEL_BYTES: u64 = 1 << 25;

/// The tensors of one model.
#[derive(Debug, Clone)]
pub(crate) struct Weights(Vec<Vec<f32>>);

/// The weights of one layer.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Parameters<'a> {
    pub(crate) weights: &'a [f32],
    /// The bias of each output; empty for none.
    pub(crate) bias: &'a [f32],
}

impl Weights {
    /// The tensors of the model at `path` of a wheel.
    pub(crate) fn from_wheel(wheel: &[u8], path: &str) -> Result<Self, ExtractionError> {
        let mut wheel = open(wheel)?;
        let member = wheel.by_name(path).map_err(not_the_wheel)?;
        let mut model = Vec::new();
        member
            .take(MAX_MODEL_BYTES)
            .read_to_end(&mut model)
            .map_err(not_the_wheel)?;
        let mut model = open(&model)?;
        let folder = model
            .file_names()
            .flatten()
            .find_map(|name| name.strip_suffix("/data/0").map(str::to_owned))
            .ok_or_else(|| not_the_wheel("a model has no tensors"))?;
        let tensors = LENGTHS.iter().enumerate();
        tensors
            .map(|(number, &length)| {
                read_tensor(&mut model, &format!("{folder}/data/{number}"), length)
            })
            .collect::<Result<_, _>>()
            .map(Self)
    }

    /// A tensor by its number, for a layer without bias.
    pub(crate) fn tensor(&self, number: usize) -> Parameters<'_> {
        Parameters {
            weights: &self.0[number],
            bias: &[],
        }
    }

    /// A tensor by its number, with the next one as the bias.
    pub(crate) fn with_bias(&self, number: usize) -> Parameters<'_> {
        Parameters {
            weights: &self.0[number],
            bias: &self.0[number + 1],
        }
    }

    #[cfg(test)]
    /// Pseudo-random weights, the same at each call.
    pub(crate) fn random(seed: u32) -> Self {
        let mut state = seed;
        let tensors = LENGTHS.map(|length| {
            (0..length)
                .map(|_| super::testing::random(&mut state) * 0.2)
                .collect()
        });
        Self(tensors.to_vec())
    }
}

fn open(bytes: &[u8]) -> Result<ZipArchive<Cursor<&[u8]>>, ExtractionError> {
    ZipArchive::new(Cursor::new(bytes)).map_err(not_the_wheel)
}

fn read_tensor(
    model: &mut ZipArchive<Cursor<&[u8]>>,
    name: &str,
    length: usize,
) -> Result<Vec<f32>, ExtractionError> {
    let mut member = model.by_name(name).map_err(not_the_wheel)?;
    if member.size() != 4 * length as u64 {
        return Err(not_the_wheel("a tensor has the wrong length"));
    }
    let mut bytes = vec![0; 4 * length];
    member.read_exact(&mut bytes).map_err(not_the_wheel)?;
    // Reading to the end verifies the checksum.
    member.read_to_end(&mut Vec::new()).map_err(not_the_wheel)?;
    let values: Vec<f32> = bytes
        .as_chunks()
        .0
        .iter()
        .map(|&bytes| f32::from_le_bytes(bytes))
        .collect();
    if values.iter().all(|value| value.is_finite()) {
        Ok(values)
    } else {
        Err(not_the_wheel("a weight is not a number"))
    }
}

fn not_the_wheel(what: impl std::fmt::Display) -> ExtractionError {
    ExtractionError::Weights {
        what: what.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_not_the_wheel_is_refused_in_words() {
        for bytes in [&b""[..], b"PK\x05\x06", &[0; 4096]] {
            let refused = Weights::from_wheel(bytes, "data/models/model.pt");
            let message = refused.unwrap_err().to_string();
            assert!(
                message.starts_with("this is not the wheel of deepbet 1.0.2"),
                "{message}"
            );
        }
    }
}
