//! Tree pruning, and what is taken where there is no network.

use extraction::{Method, Rating, extract, prune};
use geometry::{BrainMask, envelope, phantom};

use crate::support::{dice, go_on, none_ends_as_ok};

#[test]
fn the_brain_of_a_folded_phantom_head_is_found_without_weights() {
    let head = phantom::head(1.5);
    let found = extract(&head.volume, None, 0.5, &go_on).unwrap();
    assert_eq!(found.method, Method::TreePruning);
    let missing = "the network's weights are missing";
    let reasons = &found.quality.reasons;
    assert!(
        reasons
            .iter()
            .any(|reason| reason.sentence.contains(missing)),
        "{reasons:?}"
    );
    assert_eq!(found.quality.rating, Rating::Review);
    let asked = prune(&head.volume, &go_on).unwrap();
    assert!(
        !asked
            .quality
            .reasons
            .iter()
            .any(|reason| reason.sentence.contains(missing))
    );
    let truth = BrainMask::from_mask(&head.brain, head.volume.grid()).unwrap();
    let [found, truth] = [&found.brain, &truth].map(|brain| envelope(brain, 10.0).unwrap());
    let agreement = dice(found.mask(), truth.mask());
    assert!(agreement >= 0.95, "{agreement}");
}

#[test]
fn what_is_not_a_t1_head_does_not_end_as_ok_without_weights_either() {
    none_ends_as_ok(|volume| extract(volume, None, 0.5, &go_on));
}
