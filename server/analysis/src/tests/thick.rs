//! Slices that were interpolated from thicker ones, or repeated.

use geometry::{BrainMask, DepthField, Volume, distance_map, envelope};

use super::real::{data, read_mask, read_volume};
use crate::block::Block;
use crate::candidates::HeadDoubts;
use crate::maps_and_division;
use crate::phantom::{Phantom, Scan, plain_grid};
use crate::slices::{LEAST_SHARE, USUAL_SHARE, least_detail};
use crate::tissue::tissue_of;

/// A volume as slices of so many voxels along an axis, averaged and interpolated linearly to what they were.
fn interpolated(volume: &Volume, axis: usize, thickness: usize) -> Volume {
    let grid = volume.grid();
    let count = grid.size()[axis] / thickness;
    let stride = [1, grid.size()[0], grid.size()[0] * grid.size()[1]][axis];
    let value = |index: usize| {
        let place = grid.voxel(index)[axis];
        let start = index - place * stride;
        let mean = |slice: usize| {
            let first = slice.min(count - 1) * thickness;
            let values = (first..first + thickness).map(|k| volume.voxels()[start + k * stride]);
            values.map(f64::from).sum::<f64>() / thickness as f64
        };
        let position = (place as f64 - (thickness - 1) as f64 / 2.0) / thickness as f64;
        let position = position.clamp(0.0, (count - 1) as f64);
        let (below, part) = (position.floor() as usize, position.fract());
        (mean(below) * (1.0 - part) + mean(below + 1) * part).round() as u16
    };
    let voxels = (0..grid.voxel_count()).map(value).collect();
    Volume::new(grid.clone(), voxels, volume.rescale()).expect("the same grid")
}

/// A volume in which every so many slices along an axis are the same.
fn repeated(volume: &Volume, axis: usize, times: usize) -> Volume {
    let grid = volume.grid();
    let value = |index: usize| {
        let mut voxel = grid.voxel(index);
        voxel[axis] -= voxel[axis] % times;
        volume.voxels()[grid.index(voxel)]
    };
    let voxels = (0..grid.voxel_count()).map(value).collect();
    Volume::new(grid.clone(), voxels, volume.rescale()).expect("the same grid")
}

#[test]
fn a_head_whose_slices_were_interpolated_or_repeated_has_no_maps() {
    let noisy = Phantom {
        noise: 70.0,
        ..Phantom::PLAIN
    };
    let mut scan = noisy.scan(&plain_grid());
    let sound = scan.volume.clone();
    let refusal = |scan: &Scan| {
        let (block, _, tissue) = tissue_of(scan.head()).expect("tissue");
        HeadDoubts::of(scan.head(), &block, &tissue).err()
    };
    assert_eq!(refusal(&scan), None);
    for volume in [interpolated(&sound, 2, 5), repeated(&sound, 2, 5)] {
        scan.volume = volume;
        let reason = refusal(&scan).expect("a refusal");
        assert_eq!(reason.code(), "interpolated-slices", "{reason}");
        assert_eq!(scan.maps(), Err(reason));
        let both = maps_and_division(scan.head(), None);
        assert_eq!(both.err(), Some(reason));
    }
}

#[test]
fn interpolated_slices_show_less_detail_across_than_within() {
    let Some(data) = data() else { return };
    // `colin27` is the mean of 27 scans: its own detail is blurred, and what interpolation leaves counts for more.
    for (folder, is_mean, volume) in [("colin27", true, "ch2"), ("csi1", false, "t1")] {
        let folder = data.join(folder);
        let volume = read_volume(&folder.join(format!("{volume}.nii.gz")));
        let mask = read_mask(&folder.join("mask_dura.nii.gz"));
        let brain = BrainMask::from_mask(&mask, volume.grid()).expect("a brain");
        let envelope = envelope(&brain, 10.0).expect("an envelope");
        let depth = DepthField::new(&distance_map(&envelope));
        let share = |volume: &Volume| {
            let block = Block::new(volume, &depth).expect("a block");
            least_detail(volume, &block).expect("detail")
        };
        let sound = share(&volume);
        println!("{}: {sound:.3}", folder.display());
        assert!(sound > USUAL_SHARE, "{sound}");
        for axis in 0..3 {
            let share_of_repeated = share(&repeated(&volume, axis, 5));
            println!("  5 times along {axis}: {share_of_repeated:.3}");
            assert!(
                share_of_repeated < LEAST_SHARE,
                "{axis}: {share_of_repeated}"
            );
            for thickness in [5, 3] {
                let share = share(&interpolated(&volume, axis, thickness));
                println!("  {thickness} mm along {axis}: {share:.3}");
                // Of slices of 3 mm some keep as much as a resampled head, and have a caveat.
                let most = match (is_mean, thickness) {
                    (true, _) => 1.0,
                    (false, 5) => LEAST_SHARE,
                    (false, _) => USUAL_SHARE,
                };
                assert!(share < most, "{axis} {thickness}: {share}");
            }
        }
    }
}
