//! Model observers: their scores at each point of the junction, and their marks in a whole head.

use std::ops::RangeInclusive;

use geometry::DepthField;
use glam::DVec3;

use super::flat::FlatMaps;
use super::region::{Cuts, FILTER_MM, NEAR_MIDDLE, Region, box_around};
use super::search::Mark;
use analysis::steps::{Block, Measures, Scores, compare, depth_at, regions};
use analysis::{Head, MapParameters, TissueScale};

/// The depths of the search on slices, on isosurfaces, and in the lists of the program if the regions are in doubt, in mm.
const SLICE_DEPTHS_MM: RangeInclusive<f32> = 3.0..=28.0;
const SURFACE_DEPTHS_MM: RangeInclusive<f32> = 3.0..=24.0;
const DOUBTFUL_DEPTHS_MM: RangeInclusive<f32> = 3.0..=30.0;
/// The least distance between two marks, in mm, and the greatest number of marks per head.
const APART_MM: f64 = 10.0;
const MARKS: usize = 60;

/// The view of an observer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum View {
    /// V1 to V3: slices across one axis of the volume, named by the nearest patient axis.
    Sagittal,
    /// Slices from front to back.
    Coronal,
    /// Slices from bottom to top.
    Axial,
    /// V4: all three stacks, the sharpest of the three at each point.
    ThreeStacks,
    /// V5: isosurfaces.
    Isosurfaces,
    /// V6: flat maps of isosurfaces.
    FlatMaps,
    /// V7: isosurfaces compared with their mirror image.
    IsosurfacesMirrored,
    /// V8: sharpness on isosurfaces.
    Sharpness,
    /// V9: `blur` on isosurfaces.
    Blur,
    /// V10: the list of `blur`, as the program makes it.
    BlurList,
    /// V11: the list of `thickness`, as the program makes it.
    Thickness,
}

impl View {
    /// All views, in the order of the table.
    pub const ALL: [Self; 11] = [
        Self::Axial,
        Self::Coronal,
        Self::Sagittal,
        Self::ThreeStacks,
        Self::Isosurfaces,
        Self::FlatMaps,
        Self::IsosurfacesMirrored,
        Self::Sharpness,
        Self::Blur,
        Self::BlurList,
        Self::Thickness,
    ];
    /// The lists of the program.
    pub const LISTS: [Self; 2] = [Self::BlurList, Self::Thickness];
    /// The views that show a map. Alone, they take a third of the time.
    pub const OF_MAPS: [Self; 4] = [Self::Sharpness, Self::Blur, Self::BlurList, Self::Thickness];

    /// Its number and name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Axial => "V1 axial",
            Self::Coronal => "V2 coronal",
            Self::Sagittal => "V3 sagittal",
            Self::ThreeStacks => "V4 three stacks",
            Self::Isosurfaces => "V5 isosurfaces",
            Self::FlatMaps => "V6 flat maps",
            Self::IsosurfacesMirrored => "V7 isosurfaces, mirrored",
            Self::Sharpness => "V8 sharpness on isosurfaces",
            Self::Blur => "V9 blur on isosurfaces",
            Self::BlurList => "V10 list of blur",
            Self::Thickness => "V11 list of thickness",
        }
    }

    /// Whether it shows a map instead of intensities.
    pub(crate) fn is_aided(self) -> bool {
        Self::OF_MAPS.contains(&self)
    }

    fn depths_mm(self) -> RangeInclusive<f32> {
        match self {
            Self::Axial | Self::Coronal | Self::Sagittal | Self::ThreeStacks => SLICE_DEPTHS_MM,
            Self::BlurList | Self::Thickness => DOUBTFUL_DEPTHS_MM,
            _ => SURFACE_DEPTHS_MM,
        }
    }
}

/// A point of the junction with its scores.
#[derive(Debug, Clone, Copy)]
struct Point {
    position: DVec3,
    depth_mm: f32,
    cuts: Cuts,
    /// The score in the isosurface at the mirrored point; NaN if there is none.
    mirrored: f32,
}

/// The scores of the observers of cuts in a head.
pub(crate) struct Seen {
    points: Vec<Point>,
    /// The flat maps of its isosurfaces.
    pub(crate) flat: FlatMaps,
    /// The axes of the volume nearest to the patient's left, back and top.
    axes: [usize; 3],
}

/// The scores of the observers of maps in a head.
pub(crate) struct Aided {
    points: Vec<AidedPoint>,
    /// The maps of the block; NaN where they are undefined.
    pub(crate) sharpness: Vec<f32>,
    pub(crate) blur: Vec<f32>,
    pub(crate) thickness: Vec<f32>,
    /// The mean sharpness of the junction.
    pub(crate) mean_sharpness: f32,
    /// Whether the lists count the cerebrum alone, at any depth.
    are_regions_known: bool,
}

/// A voxel of the junction with its maps.
#[derive(Debug, Clone, Copy)]
struct AidedPoint {
    position: DVec3,
    depth_mm: f32,
    /// Sharpness, per mm.
    sharpness: f32,
    /// `blur` and the score for a thick cortex, smoothed as for candidates.
    blur: f32,
    thickness: f32,
}

/// The axes of the volume nearest to the patient's left, back and top.
pub(crate) fn nearest_axes(block: &Block) -> [usize; 3] {
    let columns = block.grid.patient_from_voxel().matrix3;
    [0, 1, 2].map(|patient: usize| {
        let along = |axis: usize| columns.col(axis).normalize()[patient].abs();
        (0..3)
            .max_by(|&a, &b| along(a).total_cmp(&along(b)))
            .expect("three axes")
    })
}

impl Seen {
    /// The whole head.
    pub(crate) fn of(head: Head<'_>, block: &Block, values: &[f32]) -> Self {
        let all = block.size.map(|side| 0..=side - 1);
        let region = Region::new(head, block, values, all);
        let mut points = points(block, &region);
        for point in &mut points {
            let there = head.plane.reflected(point.position);
            let there = block
                .grid
                .voxel_from_patient()
                .transform_point3(there)
                .round();
            if there.cmpge(DVec3::ZERO).all() {
                let voxel = there.to_array().map(|along| along as usize);
                if region.has_room(voxel) {
                    point.mirrored = region.cuts(voxel).isosurface;
                }
            }
        }
        Self {
            points,
            flat: FlatMaps::of(head, block, &region),
            axes: nearest_axes(block),
        }
    }

    /// The head with a lesion; the opposite side is unchanged.
    pub(crate) fn with(
        &self,
        head: Head<'_>,
        block: &Block,
        values: &[f32],
        changed: Changed,
    ) -> Self {
        let place = block
            .grid
            .voxel_from_patient()
            .transform_point3(changed.centre);
        // A template reaches 9 mm from its centre, and the gradient needs some more.
        let seen_from_mm = changed.reach_mm + 9.0;
        let ranges = box_around(block, place, seen_from_mm + 9.0 + FILTER_MM);
        let region = Region::new(head, block, values, ranges);
        let is_changed = |point: &Point| point.position.distance(changed.centre) <= seen_from_mm;
        let (before, untouched): (Vec<Point>, Vec<Point>) =
            self.points.iter().partition(|point| is_changed(point));
        let mut points = self::points(block, &region);
        points.retain(is_changed);
        for point in &mut points {
            let nearest = before.iter().min_by(|a, b| {
                let [a, b] = [a, b].map(|other| other.position.distance_squared(point.position));
                a.total_cmp(&b)
            });
            point.mirrored = nearest.map_or(f32::NAN, |nearest| nearest.mirrored);
        }
        points.extend(untouched);
        let resampled = (place, changed.reach_mm + FILTER_MM);
        Self {
            points,
            flat: self.flat.with(block, &region, resampled),
            axes: self.axes,
        }
    }

    fn score(&self, view: View, point: &Point) -> f32 {
        let plane = |patient: usize| point.cuts.planes[self.axes[patient]];
        match view {
            View::Sagittal => -plane(0),
            View::Coronal => -plane(1),
            View::Axial => -plane(2),
            View::ThreeStacks => -plane(0).max(plane(1)).max(plane(2)),
            View::Isosurfaces => -point.cuts.isosurface,
            View::IsosurfacesMirrored => point.mirrored - point.cuts.isosurface,
            View::FlatMaps | View::Sharpness | View::Blur | View::BlurList | View::Thickness => {
                f32::NAN
            }
        }
    }

    pub(crate) fn marks(&self, view: View) -> Vec<Mark> {
        let depths = view.depths_mm();
        if view == View::FlatMaps {
            let points = self.flat.points();
            let visible = points.filter(|point| depths.contains(&point.depth_mm));
            return greedy(visible.map(|point| Mark {
                position_in_patient: point.position,
                score: -point.sharpness,
            }));
        }
        let visible = self
            .points
            .iter()
            .filter(|point| depths.contains(&point.depth_mm));
        greedy(visible.map(|point| Mark {
            position_in_patient: point.position,
            score: self.score(view, point),
        }))
    }

    /// The score at the point nearest to a position; the lowest if the flat maps do not show it.
    pub(crate) fn at(&self, view: View, depth: &DepthField, place: DVec3) -> f32 {
        if view == View::FlatMaps {
            let sharpness = self.flat.at(depth, place);
            return sharpness.map_or(f32::NEG_INFINITY, |sharpness| -sharpness);
        }
        let nearest = self.points.iter().min_by(|a, b| {
            let [a, b] = [a, b].map(|point| point.position.distance_squared(place));
            a.total_cmp(&b)
        });
        nearest.map_or(f32::NAN, |point| self.score(view, point))
    }
}

/// The points that a lesion changes.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Changed {
    pub(crate) centre: DVec3,
    pub(crate) reach_mm: f64,
}

/// Every second voxel of the junction along each axis, with its scores.
fn points(block: &Block, region: &Region) -> Vec<Point> {
    let is_point = |index: &usize| {
        let index = *index;
        let voxel = region.in_block(index);
        voxel.iter().all(|along| along % 2 == 0)
            && SLICE_DEPTHS_MM.contains(&region.depths_mm[index])
            && (region.smooth[index] - 0.5).abs() < NEAR_MIDDLE
            && region.has_room(voxel)
    };
    let point = |index: usize| {
        let voxel = region.in_block(index);
        let place = DVec3::from_array(voxel.map(|along| along as f64));
        Point {
            position: block.grid.patient_from_voxel().transform_point3(place),
            depth_mm: region.depths_mm[index],
            cuts: region.cuts(voxel),
            mirrored: f32::NAN,
        }
    };
    (0..region.voxel_count())
        .filter(is_point)
        .map(point)
        .collect()
}

impl Aided {
    /// The whole head, computed from its own volume.
    pub(crate) fn of(
        head: Head<'_>,
        block: &Block,
        (values, tissue): (&[f32], &TissueScale),
        parameters: &MapParameters,
    ) -> Self {
        let mut sharpness = parameters.sharpness(block, values, tissue);
        let regions = regions(head, block, values, parameters.doubt);
        let whole_junction = sharpness.count_only(&regions);
        let thick = (&sharpness, tissue);
        let mut thickness = parameters.thickening(block, values, thick, head.plane);
        let measures = Measures {
            sharpness: &sharpness,
            detail: parameters.detail(block, values, &sharpness, tissue),
        };
        let mut comparison = compare(block, measures, head.plane, parameters);
        let map = &mut comparison.blur;
        let smoothed_mm = parameters.candidate_mm;
        let blur = Scores::smoothed(block, &whole_junction, map, smoothed_mm);
        let thick = Scores::smoothed(block, &whole_junction, &mut thickness, smoothed_mm);
        let working_from_block =
            head.depth.grid().voxel_from_patient() * block.grid.patient_from_voxel();
        let scores = blur.scores.iter().zip(&thick.scores);
        let scored = whole_junction.iter().zip(scores);
        let is_counted = |voxel: &u32| sharpness.junction.binary_search(voxel).is_ok();
        let counted = scored.filter(|(voxel, _)| is_counted(voxel));
        let points = counted.map(|(&voxel, (&blur, &thickness))| {
            let place = block.grid.voxel(voxel as usize).map(|along| along as f64);
            let place = DVec3::from_array(place);
            let in_working = working_from_block.transform_point3(place).as_vec3();
            AidedPoint {
                position: block.grid.patient_from_voxel().transform_point3(place),
                depth_mm: depth_at(head.depth, in_working),
                sharpness: sharpness.values[voxel as usize],
                blur,
                thickness,
            }
        });
        let points: Vec<AidedPoint> = points.collect();
        let sum: f32 = points.iter().map(|point| point.sharpness).sum();
        Self {
            mean_sharpness: sum / points.len().max(1) as f32,
            points,
            blur: comparison.blur,
            thickness,
            sharpness: sharpness.values,
            are_regions_known: regions.doubts.is_empty(),
        }
    }

    fn score(view: View, point: &AidedPoint) -> f32 {
        match view {
            View::Sharpness => -point.sharpness,
            View::Thickness => point.thickness,
            _ => point.blur,
        }
    }

    pub(crate) fn marks(&self, view: View) -> Vec<Mark> {
        let depths = view.depths_mm();
        let is_any_depth = self.are_regions_known && View::LISTS.contains(&view);
        let is_visible = |point: &&AidedPoint| is_any_depth || depths.contains(&point.depth_mm);
        let visible = self.points.iter().filter(is_visible);
        greedy(visible.map(|point| Mark {
            position_in_patient: point.position,
            score: Self::score(view, point),
        }))
    }

    /// The score at the voxel of the junction nearest to a position.
    pub(crate) fn at(&self, view: View, place: DVec3) -> f32 {
        let nearest = self.points.iter().min_by(|a, b| {
            let [a, b] = [a, b].map(|point| point.position.distance_squared(place));
            a.total_cmp(&b)
        });
        nearest.map_or(f32::NAN, |point| Self::score(view, point))
    }
}

/// Marks, highest first, each at least 10 mm from every higher one.
pub(crate) fn greedy(points: impl Iterator<Item = Mark>) -> Vec<Mark> {
    let mut points: Vec<Mark> = points.filter(|mark| !mark.score.is_nan()).collect();
    points.sort_by(|a, b| b.score.total_cmp(&a.score));
    let mut marks: Vec<Mark> = Vec::new();
    for point in points {
        let is_apart = marks.iter().all(|mark| {
            mark.position_in_patient
                .distance_squared(point.position_in_patient)
                >= APART_MM * APART_MM
        });
        if is_apart {
            marks.push(point);
        }
        if marks.len() == MARKS {
            break;
        }
    }
    marks
}
