//! The accuracy of the meshes: Figure 7 of the paper in numbers.

mod isosurface;
mod nearest;

use geometry::{EnvelopeMesh, MeshSize, PathTable};
use glam::Vec3;
use rayon::prelude::*;
use render::FrameSize;

use self::nearest::Nearest;
use crate::agreement::{MESH_SIZES, exact_pictures, mesh_against_exact};
use crate::{BenchError, PreparedHead, Summary, Table, column};

/// The number of points of the isosurface for the distance to the mesh.
const ISOSURFACE_POINTS: usize = 20_000;

/// The points of a facet for the depth error: weights of its second and third corner.
const FACET_POINTS: [[f32; 2]; 4] = [[1.0 / 3.0, 1.0 / 3.0], [0.6, 0.2], [0.2, 0.6], [0.2, 0.2]];

/// The deviation of a mesh at a depth from the isosurface of that depth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Quality {
    /// The depth error at four points of each facet, in mm.
    pub facet_depth_mm: Summary,
    /// The distance from points of the isosurface to the nearest facet, in mm.
    pub isosurface_mm: Summary,
}

/// The accuracy of a mesh at a depth; `None` if there is no isosurface.
pub fn quality(
    case: &PreparedHead,
    (mesh, table): (&EnvelopeMesh, &PathTable),
    depth_mm: f32,
) -> Option<Quality> {
    let voxel_from_patient = case.model().field().grid().voxel_from_patient();
    let in_voxel = |position: &[f32; 3]| {
        let position = Vec3::from_array(*position).as_dvec3();
        voxel_from_patient.transform_point3(position).as_vec3()
    };
    let shrunk = table.shrink(depth_mm);
    let corners: Vec<Vec3> = shrunk.positions_in_patient.iter().map(in_voxel).collect();
    let facets = mesh.size.triangles().into_iter();
    let facets: Vec<[Vec3; 3]> = facets
        .map(|facet| facet.map(|corner| corners[corner as usize]))
        .collect();
    let off_mm = |&[a, b, c]: &[Vec3; 3]| {
        FACET_POINTS.map(|[u, v]| {
            let depth = case.model().field().depth_mm(a + (b - a) * u + (c - a) * v);
            f64::from((depth - depth_mm).abs())
        })
    };
    let facet_depth_mm = Summary::of(facets.iter().flat_map(off_mm))?;
    let points = isosurface::points(case, depth_mm, ISOSURFACE_POINTS);
    let nearest = Nearest::new(facets);
    let spacing_mm = case.model().field().spacing_mm();
    let distances: Vec<f64> = points
        .par_iter()
        .map(|&point| f64::from(nearest.distance(point) * spacing_mm))
        .collect();
    Some(Quality {
        facet_depth_mm,
        isosurface_mm: Summary::of(distances)?,
    })
}

/// The settings of the comparison.
#[derive(Debug, Clone, Copy)]
pub struct Judgement {
    /// Depth of the meshes, in mm.
    pub depth_mm: f32,
    /// Size of the compared pictures.
    pub size: FrameSize,
}

/// Figure 7 in numbers: each of the ten mesh sizes at a depth.
///
/// # Errors
/// If a mesh cannot be made or drawn.
pub fn figure_7(case: &PreparedHead, judgement: &Judgement) -> Result<Table, BenchError> {
    let columns = [
        column("contours", "N_F"),
        column("points", "N_P"),
        column("triangles", "triangles"),
        column("facet_depth_mean_mm", "depth error of facets, mm: mean"),
        column("facet_depth_p95_mm", "95 %"),
        column("facet_depth_max_mm", "max"),
        column("isosurface_mean_mm", "isosurface to mesh, mm: mean"),
        column("isosurface_p95_mm", "95 %"),
        column("isosurface_max_mm", "max"),
        column("pixels_mean_levels", "picture difference, of 255: mean"),
        column("pixels_p95_levels", "95 %"),
    ];
    let depth_mm = judgement.depth_mm;
    let title =
        format!("Figure 7 in numbers: meshes {depth_mm} mm deep, compared with the isosurface");
    let mut table = Table::new("figure_7", title, &columns);
    let exact = exact_pictures(case, depth_mm.into(), judgement.size)?;
    for [contours, points] in MESH_SIZES {
        let size = MeshSize::new(contours, points)?;
        let (mesh, paths) = case.table(size)?;
        let found = quality(case, (&mesh, &paths), depth_mm);
        let facets = found.map(|found| found.facet_depth_mm);
        let surface = found.map(|found| found.isosurface_mm);
        let pictures = mesh_against_exact(case, &paths, &exact)?;
        table.push([
            contours.into(),
            points.into(),
            size.triangle_count().into(),
            facets.map(|facets| facets.mean).into(),
            facets.map(|facets| facets.p95).into(),
            facets.map(|facets| facets.greatest).into(),
            surface.map(|surface| surface.mean).into(),
            surface.map(|surface| surface.p95).into(),
            surface.map(|surface| surface.greatest).into(),
            pictures.mean_difference().into(),
            u64::from(pictures.percentile(0.95)).into(),
        ]);
    }
    table.note("The paper shows only pictures here, no numbers.");
    table.note(
        "Picture difference: grey levels between the drawn mesh and the traced isosurface, over the pixels that both cover, from all six \
         sides.",
    );
    Ok(table)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Head;

    #[test]
    fn a_finer_mesh_is_nearer_to_the_isosurface() {
        let (case, _) = PreparedHead::prepare(&Head::phantom(3.0).unwrap(), 10.0).unwrap();
        let of = |contours, points| {
            let size = MeshSize::new(contours, points).unwrap();
            let (mesh, paths) = case.table(size).unwrap();
            quality(&case, (&mesh, &paths), 5.0).unwrap()
        };
        let (coarse, fine) = (of(8, 8), of(60, 40));
        assert!(fine.facet_depth_mm.mean < 0.5 * coarse.facet_depth_mm.mean);
        assert!(fine.isosurface_mm.mean < 0.5 * coarse.isosurface_mm.mean);
        assert!(fine.isosurface_mm.mean < 1.0, "{fine:?}");
    }
}
