//! Tree pruning, and what is taken where there is no network.

use extraction::{ExtractionError, Method, Verdict, extract, prune};
use geometry::{BrainMask, envelope, phantom};
use glam::{DMat3, DVec3};

use crate::support::{dice, go_on, melon, noise, with_axes, with_values};

#[test]
fn the_brain_of_a_folded_phantom_head_is_found_without_weights() {
    let head = phantom::head(1.5);
    let found = extract(&head.volume, None, 0.5, &go_on).unwrap();
    assert_eq!(found.method, Method::TreePruning);
    let truth = BrainMask::from_mask(&head.brain, head.volume.grid()).unwrap();
    let [found, truth] = [&found.brain, &truth].map(|brain| envelope(brain, 10.0).unwrap());
    let agreement = dice(found.mask(), truth.mask());
    assert!(agreement >= 0.95, "{agreement}");
}

#[test]
fn what_is_not_a_t1_head_does_not_end_as_ok_without_weights_either() {
    let head = phantom::head(2.0).volume;
    let brightest = f64::from(*head.voxels().iter().max().unwrap());
    let swapped = DMat3::from_cols(DVec3::Y, DVec3::X, DVec3::Z);
    let lies = [
        ("zeros", with_values(&head, |_, _| 0.0)),
        (
            "noise",
            with_values(&head, |_, voxel| 500.0 + 400.0 * noise(voxel)),
        ),
        (
            "inverted",
            with_values(&head, |stored, _| brightest - f64::from(stored)),
        ),
        ("left taken for the front", with_axes(&head, swapped)),
        ("a melon", melon()),
    ];
    for (name, volume) in lies {
        match prune(&volume, &go_on) {
            Ok(found) => {
                println!(
                    "{name}: {:?} {:?}",
                    found.quality.verdict, found.quality.reasons
                );
                assert!(found.quality.verdict > Verdict::Ok, "{name}");
            }
            Err(error) => assert!(
                matches!(error, ExtractionError::NoBrain { .. }),
                "{name}: {error}"
            ),
        }
    }
}
