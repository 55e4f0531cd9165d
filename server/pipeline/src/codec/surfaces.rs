//! The closed parts of a brain, or the reason why there are none.

use geometry::Envelope;
use serde::{Deserialize, Serialize};

use super::bytes::{Reader, put_leb128};
use super::{decode_envelope, encode_envelope};
use crate::Undefined;
use crate::surfaces::{SURFACES_FORMAT, Surfaces, SurfacesOrReason};

/// The longest accepted head.
const MAX_HEAD_BYTES: u32 = 1 << 16;

/// The head of the object, before the surfaces.
#[derive(Debug, Serialize, Deserialize)]
struct ObjectHead {
    format: u32,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    undefined: Option<Undefined>,
}

/// The payload of surfaces, or of the reason for none.
pub fn encode_surfaces(surfaces: &SurfacesOrReason) -> Vec<u8> {
    let head = ObjectHead {
        format: SURFACES_FORMAT,
        undefined: surfaces.as_ref().err().cloned(),
    };
    let head = serde_json::to_vec(&head).expect("a number and texts");
    let mut bytes = Vec::new();
    let mut part = |part: &[u8]| {
        bytes.extend_from_slice(&(part.len() as u32).to_le_bytes());
        bytes.extend_from_slice(part);
    };
    part(&head);
    for envelope in surfaces.iter().flat_map(|surfaces| &surfaces.envelopes) {
        part(&encode_envelope(envelope));
        part(&fence_bytes(envelope.fence()));
    }
    bytes
}

/// The surfaces from a payload, without the cuts of the volume; `None` if it is damaged or has another format, so that they must be
/// computed again.
pub fn decode_surfaces(payload: &[u8]) -> Option<SurfacesOrReason> {
    let mut reader = Reader(payload);
    let length = reader.u32().filter(|&length| length <= MAX_HEAD_BYTES)?;
    let head: ObjectHead = serde_json::from_slice(reader.take(length as usize)?).ok()?;
    if head.format != SURFACES_FORMAT {
        return None;
    }
    if let Some(reason) = head.undefined {
        return Some(Err(reason));
    }
    let mut part = || {
        let length = reader.u32()?;
        reader.take(length as usize)
    };
    let mut envelope = || {
        let envelope = decode_envelope(part()?)?;
        let fence = fence_from(part()?, &envelope)?;
        Some(envelope.with_fence(fence))
    };
    let envelopes = [envelope()?, envelope()?, envelope()?];
    Some(Ok(Surfaces { envelopes }))
}

/// The differences of ascending numbers as LEB128.
fn fence_bytes(fence: &[u32]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut before = 0;
    for &index in fence {
        put_leb128(&mut bytes, index - before);
        before = index;
    }
    bytes
}

/// `None` if a number is not that of a voxel inside.
fn fence_from(bytes: &[u8], envelope: &Envelope) -> Option<Vec<u32>> {
    let mut reader = Reader(bytes);
    let inside = envelope.mask().voxels();
    let mut fence = Vec::new();
    let mut index = 0u32;
    while !reader.0.is_empty() {
        index = index.checked_add(reader.leb128()?)?;
        inside.get(index as usize).filter(|is_inside| **is_inside)?;
        fence.push(index);
    }
    Some(fence)
}

#[cfg(test)]
mod tests {
    use geometry::phantom;

    use super::*;

    fn surfaces() -> Surfaces {
        let ball = |radius: f64| {
            let envelope = geometry::envelope(&phantom::ball(radius), 0.0).unwrap();
            let inside = envelope.mask().voxels().iter().enumerate();
            let inside = inside.filter(|(_, is_inside)| **is_inside);
            let fence = inside.map(|(index, _)| index as u32).step_by(7).collect();
            envelope.with_fence(fence)
        };
        Surfaces {
            envelopes: [ball(9.0), ball(8.0), ball(12.0).with_fence(Vec::new())],
        }
    }

    #[test]
    fn surfaces_and_the_reason_for_none_come_back_and_another_format_does_not() {
        let none = Undefined {
            code: "no-fissure".into(),
            sentence: "there is no fissure".into(),
        };
        for found in [Ok(surfaces()), Err(none)] {
            let payload = encode_surfaces(&found);
            assert_eq!(decode_surfaces(&payload), Some(found));
            for length in [0, 3, 4, 10, payload.len() - 1] {
                assert_eq!(decode_surfaces(&payload[..length]), None, "{length}");
            }
            let mut other = payload;
            let format = format!("{{\"format\":{SURFACES_FORMAT}").len();
            other[4 + format - 1] = b'0';
            assert_eq!(decode_surfaces(&other), None);
        }
    }

    #[test]
    fn a_fence_outside_its_envelope_is_refused() {
        let envelope = &surfaces().envelopes[0];
        assert_eq!(fence_from(&fence_bytes(&[0]), envelope), None);
        assert_eq!(fence_from(&[0xff, 0xff, 0xff, 0xff, 0x0f], envelope), None);
        let fence = envelope.fence().to_vec();
        assert_eq!(fence_from(&fence_bytes(&fence), envelope), Some(fence));
    }
}
