//! Real heads. They are not part of the project; without them, these tests report it and pass.

use super::Region;
use super::tests::{check_moved, of};
use crate::phantom::Scan;
use crate::tests::real::{data, read_mask, read_volume, vertices};

/// Vertices with less cortex, in mm, are where a surface closes a hemisphere through callosum and brain stem.
const CORTEX_FROM_MM: f64 = 1.0;

#[test]
fn the_cortex_of_each_hemisphere_lies_on_its_side_and_in_the_cerebrum() {
    let Some(data) = data() else { return };
    let folder = data.join("pycortex-s1");
    let volume = read_volume(&folder.join("t1.nii.gz"));
    let scan = Scan::new(volume, &read_mask(&folder.join("mask_dura.nii.gz")));
    let found = of(&scan);
    assert_eq!(found.doubts, []);
    let sheet = found.sheet.as_ref().expect("a sheet");
    let (mut right, mut count) = ([0u32; 2], [0u32; 2]);
    for (name, sign) in [("lh", 1.0), ("rh", -1.0)] {
        let [pial, white] =
            ["pia", "wm"].map(|kind| vertices(&folder.join(format!("{kind}_{name}.gii"))));
        for (pial, white) in pial.iter().zip(&white) {
            let is_removed = matches!(
                found.at(*pial),
                Some(Region::Cerebellum | Region::BrainStem)
            );
            let is_right = sheet.left_mm(*pial) * sign >= 0.0 && !is_removed;
            let is_cortex = pial.distance(*white) >= CORTEX_FROM_MM;
            for (group, is_in) in [true, is_cortex].into_iter().enumerate() {
                count[group] += u32::from(is_in);
                right[group] += u32::from(is_in && is_right);
            }
        }
    }
    let [all, cortex] = [0, 1].map(|group| f64::from(right[group]) / f64::from(count[group]));
    println!(
        "{all:.4} of {} vertices, {cortex:.4} of {} of cortex",
        count[0], count[1]
    );
    assert!(cortex >= 0.995 && all >= 0.99, "{cortex} {all}");
}

#[test]
fn the_parts_of_a_real_head_turn_and_mirror_with_it() {
    let Some(data) = data() else { return };
    let volume = read_volume(&data.join("csi1/t1.nii.gz"));
    let agreements = check_moved(&volume, &read_mask(&data.join("csi1/mask_dura.nii.gz")));
    // The plane is fitted again on other samples, and fluid has no border: 0.1 to 0.6 % change their part.
    assert!(
        agreements.iter().all(|same| *same >= 0.993),
        "{agreements:?}"
    );
}
