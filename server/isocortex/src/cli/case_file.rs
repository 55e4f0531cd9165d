//! A prepared case in one file, which `prepare --output` writes and `render` reads.
//!
//! Little-endian: the magic word `ISOCASE\n`, a version (u32), the facts as JSON and then the derived objects as the
//! store has them, unpacked; each of these parts as its BLAKE3 digest (32 bytes), its packed and its plain length
//! (u64), and its bytes, packed with zstd.

use std::sync::Arc;

use bytes::Bytes;
use case::{CaseFacts, ObjectKind};
use cases::Error;
use cases::library::LoadedMaps;
use cases::models::PathKind;
use geometry::{
    BuiltModel, DeformableModel, DepthMaps, DistanceMap, Forest, GeometryError, MeshSize, Paths,
    ShrunkMesh, distance_map,
};
use pipeline::codec::{decode_forest, decode_paths, decode_volume};
use pipeline::maps::compute_maps;
use pipeline::{Derived, Prepared, envelope_of};
use render::gpu::{CaseKey, KeyedModel};

use super::status::{CliError, ExitStatus};

/// The magic word of a file.
pub(super) const MAGIC: &[u8; 8] = b"ISOCASE\n";

const VERSION: u32 = 1;
const ZSTD_LEVEL: i32 = 3;

/// No part of a case is larger than the voxels of the largest volume, at two bytes each, and some.
const MAX_PLAIN_LENGTH: u64 = (2 * geometry::MAX_VOXELS as u64) + (1 << 20);

/// The objects in a file, in their order.
const KINDS: [ObjectKind; 4] = [
    ObjectKind::Envelope,
    ObjectKind::Volume,
    ObjectKind::Forest,
    ObjectKind::Paths,
];

/// The one case of this process, and the maps for meshes of any size.
pub(super) struct LocalCase {
    model: Arc<DeformableModel>,
    distance: DistanceMap,
    forest: Forest,
    pub(super) facts: CaseFacts,
}

impl LocalCase {
    /// A case that was prepared in this process.
    pub(super) fn of(prepared: Prepared) -> Self {
        let BuiltModel {
            model,
            distance,
            forest,
        } = prepared.built;
        Self {
            model: Arc::new(model),
            distance,
            forest,
            facts: prepared.facts,
        }
    }

    /// Its model, for a renderer.
    pub(super) fn keyed(&self) -> KeyedModel {
        KeyedModel {
            key: CaseKey(0),
            model: Arc::clone(&self.model),
        }
    }

    /// Its maps, computed now.
    ///
    /// # Errors
    /// If they are undefined.
    pub(super) fn maps(&self) -> Result<LoadedMaps, Error> {
        let envelope = self.distance.envelope();
        let maps = compute_maps(&self.facts, envelope, self.model.volume());
        maps.map(|maps| LoadedMaps::new(0, maps))
            .map_err(Error::MapsUndefined)
    }

    /// The mesh at a depth.
    ///
    /// # Errors
    /// If the mesh cannot be made.
    pub(super) fn shrink(
        &self,
        size: MeshSize,
        kind: PathKind,
        depth_mm: f32,
    ) -> Result<ShrunkMesh, GeometryError> {
        let paths = match kind {
            PathKind::Forest => Paths::Forest(&self.forest),
            PathKind::Flow => Paths::Flow,
        };
        self.model
            .shrink_once(size, &self.distance, paths, depth_mm)
    }
}

/// The bytes of a file.
pub(super) fn write(prepared: Prepared) -> Result<Vec<u8>, CliError> {
    let Derived { objects, facts } = Derived::of(prepared);
    let unwritable = |error: &dyn std::fmt::Display| CliError::new(ExitStatus::Internal, error);
    let mut file = MAGIC.to_vec();
    file.extend_from_slice(&VERSION.to_le_bytes());
    let facts = serde_json::to_vec(&facts).map_err(|error| unwritable(&error))?;
    let object = |kind| objects.iter().find(|(other, _)| *other == kind);
    let objects = KINDS
        .into_iter()
        .filter_map(object)
        .map(|(_, bytes)| &bytes[..]);
    for part in std::iter::once(&facts[..]).chain(objects) {
        let packed = zstd::bulk::compress(part, ZSTD_LEVEL).map_err(|error| unwritable(&error))?;
        file.extend_from_slice(blake3::hash(part).as_bytes());
        file.extend_from_slice(&(packed.len() as u64).to_le_bytes());
        file.extend_from_slice(&(part.len() as u64).to_le_bytes());
        file.extend_from_slice(&packed);
    }
    Ok(file)
}

/// Reads a file back. Every part is checked against its digest.
pub(super) fn read(file: &Bytes) -> Result<LocalCase, CliError> {
    decode(file).ok_or_else(|| {
        let message = "the prepared file is damaged, or of another version; prepare it again";
        CliError::new(ExitStatus::BadInput, message)
    })
}

fn decode(file: &[u8]) -> Option<LocalCase> {
    let rest = file.strip_prefix(MAGIC)?;
    let mut rest = rest.strip_prefix(&VERSION.to_le_bytes())?;
    let facts = serde_json::from_slice(&part(&mut rest)?).ok()?;
    let envelope = envelope_of(&facts, &part(&mut rest)?)?;
    let volume = decode_volume(&part(&mut rest)?)?;
    let forest = decode_forest(&part(&mut rest)?, &envelope)?;
    let paths = decode_paths(&part(&mut rest)?)?;
    let distance = distance_map(&envelope);
    let model = DeformableModel::new(volume, DepthMaps::new(&distance), paths);
    Some(LocalCase {
        model: Arc::new(model),
        distance,
        forest,
        facts,
    })
}

/// The next part of a file.
fn part(rest: &mut &[u8]) -> Option<Vec<u8>> {
    let (digest, after) = rest.split_at_checked(32)?;
    let (packed_length, after) = length(after)?;
    let (plain_length, after) = length(after)?;
    let (packed, after) = after.split_at_checked(usize::try_from(packed_length).ok()?)?;
    if plain_length > MAX_PLAIN_LENGTH {
        return None;
    }
    let plain = zstd::bulk::decompress(packed, usize::try_from(plain_length).ok()?).ok()?;
    *rest = after;
    (blake3::hash(&plain).as_bytes() == digest).then_some(plain)
}

fn length(bytes: &[u8]) -> Option<(u64, &[u8])> {
    let (length, rest) = bytes.split_first_chunk()?;
    Some((u64::from_le_bytes(*length), rest))
}
