//! The network with its published weights, on phantoms.

use std::ops::ControlFlow;

use extraction::{ExtractionError, Method, extract, predict};
use geometry::{envelope, phantom};

use crate::support::{dice, go_on, network, none_ends_as_ok};

#[test]
fn the_brain_of_a_phantom_head_is_found() {
    let Some(network) = network() else { return };
    let head = phantom::head(1.5);
    let found = extract(&head.volume, Some(network), 0.5, &go_on).unwrap();
    assert_eq!(found.method, Method::Network);
    // The network's mask follows the dura, the phantom's the sulci: their envelopes are compared.
    let truth = geometry::BrainMask::from_mask(&head.brain, head.volume.grid()).unwrap();
    let [found, truth] = [&found.brain, &truth].map(|brain| envelope(brain, 10.0).unwrap());
    let agreement = dice(found.mask(), truth.mask());
    assert!(agreement >= 0.95, "{agreement}");
}

#[test]
fn what_is_not_a_t1_head_does_not_end_as_ok() {
    let Some(network) = network() else { return };
    none_ends_as_ok(|volume| extract(volume, Some(network), 0.5, &go_on));
}

#[test]
fn an_extraction_stops_between_layers() {
    let Some(network) = network() else { return };
    let head = phantom::head(4.0).volume;
    for stop_at in [0.0, 0.05, 0.3, 0.92] {
        let stop = |done: f32| {
            if done >= stop_at {
                ControlFlow::Break(())
            } else {
                ControlFlow::Continue(())
            }
        };
        let found = predict(&head, network, 0.5, &stop);
        assert_eq!(found.map(|_| ()).unwrap_err(), ExtractionError::Cancelled);
    }
}

#[test]
fn progress_only_grows() {
    let Some(network) = network() else { return };
    let told = std::cell::RefCell::new(Vec::new());
    let observe = |done| {
        told.borrow_mut().push(done);
        ControlFlow::Continue(())
    };
    predict(&phantom::head(4.0).volume, network, 0.5, &observe).unwrap();
    let told = told.into_inner();
    assert!(told.len() > 20 && told.is_sorted(), "{told:?}");
    assert!(told[0] == 0.0 && *told.last().unwrap() <= 1.0);
}
