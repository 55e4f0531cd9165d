//! FreeSurfer's binary triangle surfaces, and values of their vertices (`curv`).

use geometry::Grid;
use glam::{DMat3, DVec3};
use render::SHORT_NOTICE;

use super::Mesh;

const TRIANGLES_MAGIC: [u8; 3] = [0xff, 0xff, 0xfe];
const VALUES_MAGIC: [u8; 3] = [0xff; 3];

/// What FreeSurfer's axes point to, in RAS: left, inferior, anterior.
const AXES: [DVec3; 3] = [DVec3::NEG_X, DVec3::NEG_Z, DVec3::Y];

const ORDERS: [[usize; 3]; 6] = [
    [0, 1, 2],
    [0, 2, 1],
    [1, 0, 2],
    [1, 2, 0],
    [2, 0, 1],
    [2, 1, 0],
];

/// The volume that a surface belongs to, with its voxels in FreeSurfer's order: to the left, downwards, forwards. In any other order
/// `tkregister` coordinates would be turned, or mirrored.
#[derive(Debug, Clone, PartialEq)]
pub struct VolumeGeometry {
    size: [usize; 3],
    spacing_mm: [f64; 3],
    /// The directions of the axes in scanner RAS.
    directions: DMat3,
    /// `c_ras`: the centre of the volume in scanner RAS mm.
    centre: DVec3,
}

impl VolumeGeometry {
    /// That of a volume, its axes put in order.
    pub fn of(grid: &Grid) -> Self {
        let ras = |lps: DVec3| DVec3::new(-lps.x, -lps.y, lps.z);
        let affine = grid.patient_from_voxel();
        let own = [0, 1, 2].map(|axis| ras(affine.matrix3.col(axis)).normalize());
        let fit = |order: &[usize; 3]| -> f64 {
            (AXES.iter().zip(order))
                .map(|(along, &axis)| along.dot(own[axis]).abs())
                .sum()
        };
        let order = ORDERS
            .into_iter()
            .max_by(|one, other| fit(one).total_cmp(&fit(other)))
            .unwrap_or_default();
        let mut centre = DVec3::ZERO;
        let mut directions = DMat3::IDENTITY;
        for (place, axis) in order.into_iter().enumerate() {
            let is_reversed = AXES[place].dot(own[axis]) < 0.0;
            // FreeSurfer's centre is the voxel with half the number of voxels.
            let half = grid.size()[axis] as f64 / 2.0;
            centre[axis] = if is_reversed { half - 1.0 } else { half };
            let sign = if is_reversed { -1.0 } else { 1.0 };
            *directions.col_mut(place) = own[axis] * sign;
        }
        Self {
            size: order.map(|axis| grid.size()[axis]),
            spacing_mm: order.map(|axis| grid.spacing_mm()[axis]),
            directions,
            centre: ras(affine.transform_point3(centre)),
        }
    }

    /// The footer that states where `tkregister` coordinates are.
    fn footer(&self) -> Vec<u8> {
        // The sum of -0 and 0 is 0.
        let numbers = |numbers: [f64; 3]| {
            numbers
                .map(|number| format!("{:.15e}", number + 0.0))
                .join(" ")
        };
        let [x, y, z] = [0, 1, 2].map(|axis| numbers(self.directions.col(axis).to_array()));
        let text = format!(
            "valid = 1  # volume info valid\nfilename = T1\nvolume = {}\nvoxelsize = {}\nxras   = {x}\nyras   = {y}\nzras   = {z}\n\
             cras   = {}\n",
            self.size.map(|side| side.to_string()).join(" "),
            numbers(self.spacing_mm),
            numbers(self.centre.to_array()),
        );
        let head = [2_i32, 0, 20].map(i32::to_be_bytes);
        [head.as_flattened(), text.as_bytes()].concat()
    }
}

/// A mesh in `tkregister` RAS mm of a volume, with the footer that leads to scanner RAS.
pub fn freesurfer(mesh: Mesh<'_>, volume: &VolumeGeometry) -> Vec<u8> {
    let along_axes = volume.directions.inverse();
    let corner = |&[x, y, z]: &[f32; 3]| {
        let scanner = DVec3::new(-f64::from(x), -f64::from(y), f64::from(z));
        let [left, down, front] = (along_axes * (scanner - volume.centre)).to_array();
        [-left, front, -down].map(|along| along as f32)
    };
    let mut file = TRIANGLES_MAGIC.to_vec();
    let title = format!(
        "Isocortex, depth {:.3} mm. {SHORT_NOTICE}\n\n",
        mesh.depth_mm
    );
    file.extend_from_slice(title.as_bytes());
    let counts = [mesh.positions_in_patient.len(), mesh.triangles.len()];
    file.extend(
        counts
            .iter()
            .flat_map(|&count| (count as i32).to_be_bytes()),
    );
    let corners = mesh.positions_in_patient.iter().flat_map(corner);
    file.extend(corners.flat_map(f32::to_be_bytes));
    let numbers = mesh.triangles.as_flattened().iter();
    file.extend(numbers.flat_map(|&number| number.to_be_bytes()));
    file.extend(volume.footer());
    file
}

/// Values of the vertices of a mesh, as a `curv` file of the new kind.
pub fn freesurfer_values(mesh: Mesh<'_>, values: &[f32]) -> Vec<u8> {
    let mut file = VALUES_MAGIC.to_vec();
    let counts = [values.len(), mesh.triangles.len(), 1];
    file.extend(
        counts
            .iter()
            .flat_map(|&count| (count as i32).to_be_bytes()),
    );
    file.extend(values.iter().flat_map(|value| value.to_be_bytes()));
    file
}

#[cfg(test)]
mod tests {
    use super::super::fixture::{mesh_of, tetrahedron};
    use super::*;
    use glam::DAffine3;

    /// A grid of any order of the axes, oblique and away from the origin.
    fn grid(order: [usize; 3], signs: [f64; 3]) -> Grid {
        let mut axes = DMat3::ZERO;
        for (axis, along) in order.into_iter().enumerate() {
            axes.col_mut(axis)[along] = signs[axis] * [0.8, 1.0, 1.25][axis];
        }
        let turned = DMat3::from_rotation_x(0.2) * DMat3::from_rotation_z(-0.1) * axes;
        let place = DVec3::new(11.0, -7.0, 23.0);
        Grid::new([31, 40, 52], DAffine3::from_mat3_translation(turned, place)).unwrap()
    }

    #[test]
    fn scanner_coordinates_follow_from_the_footer_and_left_is_left_in_any_order_of_axes() {
        let (positions, triangles) = tetrahedron();
        for order in ORDERS {
            for signs in [[1.0, 1.0, 1.0], [-1.0, 1.0, 1.0], [1.0, -1.0, -1.0]] {
                let grid = grid(order, signs);
                let volume = VolumeGeometry::of(&grid);
                // Right-handed coordinates stay right-handed.
                assert!(volume.directions.determinant() < 0.0);
                let file = freesurfer(mesh_of(&positions, &triangles), &volume);
                let start = file.windows(2).position(|two| two == b"\n\n").unwrap() + 2;
                assert_eq!(file[start..start + 8], [0, 0, 0, 4, 0, 0, 0, 4]);
                let number = |at: usize| {
                    let at = start + 8 + 4 * at;
                    f64::from(f32::from_be_bytes(file[at..at + 4].try_into().unwrap()))
                };
                for (vertex, position) in positions.iter().enumerate() {
                    let [x, y, z] = [0, 1, 2].map(|axis| number(3 * vertex + axis));
                    let [along_x, along_y, along_z] =
                        [0, 1, 2].map(|axis| volume.directions.col(axis));
                    let scanner = volume.centre - along_x * x - along_y * z + along_z * y;
                    let patient = DVec3::new(-scanner.x, -scanner.y, scanner.z);
                    let expected = DVec3::from_array(position.map(f64::from));
                    assert!(patient.distance(expected) < 1e-4, "{patient} {expected}");
                }
                // The second vertex lies 30 mm to the left of the first one.
                assert!(number(3) < number(0) - 25.0);
                // The centre is a place of the volume itself.
                let centre = volume.centre * DVec3::new(-1.0, -1.0, 1.0);
                let voxel = grid.voxel_from_patient().transform_point3(centre);
                let middle = DVec3::new(15.5, 20.0, 26.0);
                assert!(
                    (middle - voxel).max_element() < 1.01 && (middle - voxel).min_element() > -0.01
                );
            }
        }
    }

    #[test]
    fn a_conformed_volume_is_its_own_geometry() {
        let affine = DMat3::from_cols(DVec3::X, DVec3::NEG_Z, DVec3::NEG_Y);
        let place = DVec3::new(-128.0, 128.0, 128.0);
        let grid = Grid::new([256; 3], DAffine3::from_mat3_translation(affine, place)).unwrap();
        let volume = VolumeGeometry::of(&grid);
        assert_eq!(volume.centre, DVec3::ZERO);
        assert_eq!(
            volume.directions,
            DMat3::from_cols_array_2d(&AXES.map(|axis| axis.to_array()))
        );
        let text = String::from_utf8_lossy(&volume.footer()).into_owned();
        assert!(text.contains("volume = 256 256 256\n"), "{text}");
        assert!(
            text.contains("\nxras   = -1.000000000000000e0 0.0"),
            "{text}"
        );
    }
}
