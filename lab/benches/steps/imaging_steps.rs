//! Reading files.

use bench::counted::Counted;
use imaging::{Limits, nifti};

use crate::head::{head, step};

pub(crate) fn steps() -> Vec<Counted> {
    vec![
        Counted {
            name: "imaging: volume, .nii.gz",
            make: || {
                let head = head();
                step(move || nifti::read_volume(&head.volume, &Limits::default()))
            },
        },
        Counted {
            name: "imaging: mask, .nii.gz",
            make: || {
                let head = head();
                step(move || nifti::read_mask(&head.mask, &Limits::default()))
            },
        },
    ]
}
