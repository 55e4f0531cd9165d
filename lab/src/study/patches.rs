//! The patches of the views around a known place, as the channels of O2 see them.
//!
//! A patch is centred on the point of the junction nearest to the place, in the volume that is shown: with a lesion, in
//! the volume with the lesion. Places are drawn in the middle between grey and white, and a thickening turns that very
//! point grey, which would be a sign for an observer who knows the exact point. No reader does.

use std::array::from_fn;

use glam::{DVec2, DVec3};

use super::View;
use super::flat::FlatMaps;
use super::hotelling::{Outputs, Patch, WIDTH};
use super::observer::{Aided, nearest_axes};
use super::region::{FILTER_MM, Region, box_around};
use analysis::Head;
use analysis::steps::{Block, Zone, depth_at};

/// How far a point of a patch may be off its isosurface, in mm, and the number of steps towards it.
const OFF_SURFACE_MM: f32 = 0.5;
const STEPS: usize = 4;

/// How far from its place a patch may be centred, in mm.
const CENTRE_WITHIN_MM: f64 = 8.0;

/// The voxels nearest to the points of a patch; `None` outside the tissue.
type Voxels = Vec<Option<usize>>;

/// The patches around a place: slices across the axes of the volume, and isosurfaces.
struct Patches {
    planes: [Voxels; 3],
    isosurface: Voxels,
    flat: Voxels,
    mirrored: Voxels,
}

impl Patches {
    fn around(
        head: Head<'_>,
        (block, flat): (&Block, &FlatMaps),
        patch: &Patch,
        place: DVec3,
        width_mm: f64,
    ) -> Self {
        let offsets_mm = patch.offsets.iter();
        let offsets_mm = offsets_mm.map(|offset| DVec2::from_array(*offset) * width_mm);
        let on_map = flat.patch(head.depth, place, offsets_mm);
        let voxel_from_patient = block.grid.voxel_from_patient();
        let voxel = |point: DVec3| nearest(block, voxel_from_patient.transform_point3(point));
        Self {
            flat: on_map
                .into_iter()
                .map(|point| point.and_then(voxel))
                .collect(),
            planes: from_fn(|axis| in_plane(block, patch, place, (axis, width_mm))),
            isosurface: in_isosurface(head, block, patch, place, width_mm),
            mirrored: in_isosurface(head, block, patch, head.plane.reflected(place), width_mm),
        }
    }
}

/// The point of the junction nearest to a place, in patient space, with the values that are shown; the place itself if
/// there is no junction near it.
pub(crate) fn centre(head: Head<'_>, block: &Block, values: &[f32], place: DVec3) -> DVec3 {
    let voxel = block.grid.voxel_from_patient().transform_point3(place);
    let ranges = box_around(block, voxel, CENTRE_WITHIN_MM + FILTER_MM);
    let region = Region::new(head, block, values, ranges);
    let nearest = region.nearest_junction(voxel, CENTRE_WITHIN_MM);
    nearest.map_or(place, |nearest| {
        block.grid.patient_from_voxel().transform_point3(nearest)
    })
}

/// The outputs of the channels at a place in every view, in the order of [`View::ALL`].
///
/// Slices and isosurfaces show the tissue scale. Where a view shows nothing, a patch has the middle between grey and
/// white, or the mean of the map. Three stacks are seen as the mean of three slices.
pub(crate) fn outputs(
    head: Head<'_>,
    block: &Block,
    (values, flat, aided): (&[f32], &FlatMaps, &Aided),
    (place, radius_mm): (DVec3, f64),
) -> Vec<Outputs> {
    let patch = Patch::new();
    let centre = centre(head, block, values, place);
    let patches = Patches::around(head, (block, flat), &patch, centre, WIDTH * radius_mm);
    let seen = |voxels: &Voxels, shown: &dyn Fn(usize) -> f32| {
        patch.outputs(voxels.iter().map(|voxel| voxel.map_or(0.0, shown)))
    };
    let tissue = |voxel: usize| values[voxel].clamp(-0.5, 1.5) - 0.5;
    let sharpness = |voxel: usize| defined(aided.sharpness[voxel] - aided.mean_sharpness);
    let blur = |voxel: usize| defined(aided.blur[voxel]);
    let thickness = |voxel: usize| defined(aided.thickness[voxel]);
    let axes = nearest_axes(block);
    let slice = |patient: usize| seen(&patches.planes[axes[patient]], &tissue);
    let mean = |outputs: [Outputs; 3]| {
        let third = |sum: Outputs, one: &Outputs| sum.plus(*one, 1.0 / 3.0);
        outputs.iter().fold(Outputs::NONE, third)
    };
    let shown = View::ALL.map(|view| match view {
        View::Sagittal => slice(0),
        View::Coronal => slice(1),
        View::Axial => slice(2),
        View::ThreeStacks => mean([slice(0), slice(1), slice(2)]),
        View::Isosurfaces => seen(&patches.isosurface, &tissue),
        View::FlatMaps => seen(&patches.flat, &tissue),
        View::IsosurfacesMirrored => {
            seen(&patches.isosurface, &tissue).plus(seen(&patches.mirrored, &tissue), -1.0)
        }
        View::Sharpness => seen(&patches.isosurface, &sharpness),
        View::Blur => seen(&patches.isosurface, &blur),
        View::BlurList => mean(from_fn(|axis| seen(&patches.planes[axis], &blur))),
        View::Thickness => mean(from_fn(|axis| seen(&patches.planes[axis], &thickness))),
    });
    shown.to_vec()
}

fn defined(value: f32) -> f32 {
    if value.is_nan() { 0.0 } else { value }
}

fn in_plane(block: &Block, patch: &Patch, place: DVec3, (axis, width_mm): (usize, f64)) -> Voxels {
    let centre = block.grid.voxel_from_patient().transform_point3(place);
    let width = block.in_voxels(width_mm);
    let [first, second] = [[1, 2], [0, 2], [0, 1]][axis];
    let point = |&[u, v]: &[f64; 2]| {
        let mut there = centre;
        there[first] += u * width[first];
        there[second] += v * width[second];
        nearest(block, there)
    };
    patch.offsets.iter().map(point).collect()
}

/// The points of the tangent plane, moved to the isosurface at the depth of the place.
fn in_isosurface(
    head: Head<'_>,
    block: &Block,
    patch: &Patch,
    place: DVec3,
    width_mm: f64,
) -> Voxels {
    let working_from_patient = head.depth.grid().voxel_from_patient();
    let depth = |position: DVec3| {
        let there = working_from_patient.transform_point3(position).as_vec3();
        let depth_mm = depth_at(head.depth, there);
        let is_inside = depth_mm > 0.0;
        is_inside.then(|| {
            let inwards = head.depth.gradient(there).normalize_or_zero();
            (depth_mm, inwards.as_dvec3())
        })
    };
    let Some((own_mm, inwards)) = depth(place).filter(|(_, inwards)| *inwards != DVec3::ZERO)
    else {
        return vec![None; patch.offsets.len()];
    };
    let (first, second) = inwards.any_orthonormal_pair();
    let voxel_from_patient = block.grid.voxel_from_patient();
    let point = |[u, v]: &[f64; 2]| {
        let mut there = place + (first * *u + second * *v) * width_mm;
        for _ in 0..STEPS {
            let (depth_mm, inwards) = depth(there)?;
            there += inwards * f64::from(own_mm - depth_mm);
        }
        let (depth_mm, _) = depth(there)?;
        let is_on_it = (depth_mm - own_mm).abs() < OFF_SURFACE_MM;
        is_on_it
            .then(|| nearest(block, voxel_from_patient.transform_point3(there)))
            .flatten()
    };
    patch.offsets.iter().map(point).collect()
}

/// The voxel of the tissue nearest to a point.
fn nearest(block: &Block, voxel: DVec3) -> Option<usize> {
    let voxel = voxel.round().to_array();
    let is_inside = (0..3).all(|axis| (0.0..block.size[axis] as f64).contains(&voxel[axis]));
    let index = is_inside.then(|| block.grid.index(voxel.map(|along| along as usize)))?;
    (block.zones[index] != Zone::Outside).then_some(index)
}
