//! The positions of voxels in the patient.

use glam::{BVec3, DAffine3, DMat3, DVec3};

use crate::GeometryError;

/// The largest number of voxels that a [`Grid`] may have: 1 Gi.
pub const MAX_VOXELS: usize = 1 << 30;

/// The largest side of a working grid, in voxels.
pub const MAX_WORKING_SIZE: usize = 512;

/// The orders of three axes, the usual one first.
pub const AXIS_ORDERS: [[usize; 3]; 6] = [
    [0, 1, 2],
    [0, 2, 1],
    [1, 0, 2],
    [1, 2, 0],
    [2, 0, 1],
    [2, 1, 0],
];

/// The greatest distance of a volume from the origin of the scanner, in mm; single precision still resolves 0.01 mm
/// there.
const MAX_OFFSET_MM: f64 = 1e5;

/// The tolerance for a working grid to be isotropic and along the patient axes.
const ALIGNMENT_TOLERANCE: f64 = 1e-4;

/// The placement of voxels in the patient: a size and an affine to LPS millimetres.
///
/// The centre of voxel `[x, y, z]` is at `patient_from_voxel * (x, y, z)`. Values on a grid are
/// stored x-fastest: the index of a voxel is `x + size[0] * (y + size[1] * z)`.
///
/// Invariants: at least one voxel along each axis, at most [`MAX_VOXELS`] in all, and a finite,
/// invertible affine.
#[derive(Debug, Clone, PartialEq)]
pub struct Grid {
    size: [usize; 3],
    patient_from_voxel: DAffine3,
    voxel_from_patient: DAffine3,
}

impl Grid {
    /// A grid of `size` voxels, placed by an affine from voxel indices to LPS millimetres.
    ///
    /// # Errors
    /// If a side is zero, if there are more than [`MAX_VOXELS`] voxels, or if the affine is not finite, not invertible,
    /// or not that of a scan: with voxels shorter than a micrometre or longer than a metre, or more than 100 m away.
    pub fn new(size: [usize; 3], patient_from_voxel: DAffine3) -> Result<Self, GeometryError> {
        if size.contains(&0) {
            return Err(GeometryError::EmptyGrid { size });
        }
        let voxels = size
            .iter()
            .try_fold(1usize, |product, &side| product.checked_mul(side));
        if voxels.is_none_or(|count| count > MAX_VOXELS) {
            return Err(GeometryError::TooManyVoxels {
                size,
                limit: MAX_VOXELS,
            });
        }
        if !patient_from_voxel.is_finite() {
            return Err(GeometryError::BadAffine { what: "not finite" });
        }
        let axes = patient_from_voxel.matrix3;
        let spacing = [
            axes.x_axis.length(),
            axes.y_axis.length(),
            axes.z_axis.length(),
        ];
        if spacing.iter().any(|edge| !(1e-3..=1e3).contains(edge)) {
            return Err(GeometryError::BadAffine {
                what: "not that of a scan: a voxel is shorter than a micrometre or longer than a metre",
            });
        }
        if patient_from_voxel.translation.abs().max_element() > MAX_OFFSET_MM {
            return Err(GeometryError::BadAffine {
                what: "not that of a scan: it lies more than 100 m from the scanner's origin",
            });
        }
        let volume_of_unit_edges = axes.determinant() / (spacing[0] * spacing[1] * spacing[2]);
        if volume_of_unit_edges.abs() < 1e-3 {
            return Err(GeometryError::BadAffine {
                what: "not invertible: its axes are coplanar",
            });
        }
        let voxel_from_patient = patient_from_voxel.inverse();
        Ok(Self {
            size,
            patient_from_voxel,
            voxel_from_patient,
        })
    }

    /// A grid along the patient axes L, P and S with voxel `[0, 0, 0]` centred at `origin` (LPS mm).
    ///
    /// # Errors
    /// As [`Grid::new`].
    pub fn aligned(
        size: [usize; 3],
        spacing_mm: [f64; 3],
        origin: DVec3,
    ) -> Result<Self, GeometryError> {
        let axes = DMat3::from_diagonal(DVec3::from_array(spacing_mm));
        Self::new(
            size,
            DAffine3 {
                matrix3: axes,
                translation: origin,
            },
        )
    }

    /// Voxels along x, y and z.
    pub fn size(&self) -> [usize; 3] {
        self.size
    }

    /// Number of voxels.
    pub fn voxel_count(&self) -> usize {
        self.size.iter().product()
    }

    /// Edge lengths of a voxel, in mm.
    pub fn spacing_mm(&self) -> [f64; 3] {
        let axes = self.patient_from_voxel.matrix3;
        [
            axes.x_axis.length(),
            axes.y_axis.length(),
            axes.z_axis.length(),
        ]
    }

    /// The affine from voxel indices to LPS mm.
    pub fn patient_from_voxel(&self) -> DAffine3 {
        self.patient_from_voxel
    }

    /// The affine from LPS mm to voxel indices.
    pub fn voxel_from_patient(&self) -> DAffine3 {
        self.voxel_from_patient
    }

    /// Index of a voxel in the x-fastest order.
    pub fn index(&self, [x, y, z]: [usize; 3]) -> usize {
        x + self.size[0] * (y + self.size[1] * z)
    }

    /// The voxel at an index: the inverse of [`Grid::index`].
    pub fn voxel(&self, index: usize) -> [usize; 3] {
        voxel_at(index, self.size)
    }

    /// The index of the voxel whose centre is nearest to a position in voxel coordinates; `None` beyond the grid, and on its
    /// outer faces.
    pub fn nearest(&self, position_in_voxel: DVec3) -> Option<usize> {
        let place = position_in_voxel.round();
        let last = as_position(self.size.map(|side| side - 1));
        let is_inside = place.cmpge(DVec3::ZERO).all() && place.cmple(last).all();
        is_inside.then(|| self.index(place.to_array().map(|along| along as usize)))
    }

    /// Whether a position in voxel coordinates lies in a voxel: within half a voxel of a centre.
    pub fn contains(&self, position_in_voxel: DVec3) -> bool {
        let inside = |position: f64, side: usize| (-0.5..=side as f64 - 0.5).contains(&position);
        (0..3).all(|axis| inside(position_in_voxel[axis], self.size[axis]))
    }

    /// The block of `size` voxels that starts at voxel `first` (which may be negative), as a separate grid.
    ///
    /// # Errors
    /// As [`Grid::new`].
    pub fn block(&self, first: [i64; 3], size: [usize; 3]) -> Result<Self, GeometryError> {
        let shift = DVec3::from_array(first.map(|voxel| voxel as f64));
        Self::new(
            size,
            self.patient_from_voxel * DAffine3::from_translation(shift),
        )
    }

    /// The voxel of this grid that is the first one of a block of it; see [`Grid::block`].
    pub fn first_of(&self, block: &Self) -> [i64; 3] {
        let own_from_block = self.voxel_from_patient * block.patient_from_voxel;
        let first = own_from_block.translation.round();
        first.to_array().map(|along| along as i64)
    }

    /// The same voxel centres in the order of the patient axes L, P, S, if the axes of the grid lie along them.
    ///
    /// Voxels need not be isotropic. An oblique grid has no such order.
    pub fn reordered_to_patient_axes(&self) -> Option<Self> {
        let axes = self.patient_from_voxel.matrix3;
        let columns = [axes.x_axis, axes.y_axis, axes.z_axis];
        let mut size = [0; 3];
        let mut spacing = [0.0; 3];
        let mut far_corner = DVec3::ZERO;
        for (column, &side) in columns.iter().zip(&self.size) {
            let along = dominant_axis(*column);
            let length = column[along];
            let off_axis = (*column - DVec3::AXES[along] * length).length();
            if off_axis > ALIGNMENT_TOLERANCE * length.abs() || size[along] != 0 {
                return None;
            }
            size[along] = side;
            spacing[along] = length.abs();
            far_corner[along] = f64::min(length * (side - 1) as f64, 0.0);
        }
        Self::aligned(
            size,
            spacing,
            self.patient_from_voxel.translation + far_corner,
        )
        .ok()
    }

    /// Whether all edges of a voxel have the same length.
    pub fn is_isotropic(&self) -> bool {
        let [x, y, z] = self.spacing_mm();
        let tolerance = ALIGNMENT_TOLERANCE * x;
        (x - y).abs() <= tolerance && (x - z).abs() <= tolerance
    }
}

/// The voxel at an index in the x-fastest order of a grid of this size.
#[inline]
pub(crate) fn voxel_at(index: usize, [nx, ny, _]: [usize; 3]) -> [usize; 3] {
    [index % nx, index / nx % ny, index / (nx * ny)]
}

/// The centre of a voxel, in voxel coordinates.
pub fn as_position(voxel: [usize; 3]) -> DVec3 {
    DVec3::from_array(voxel.map(|place| place as f64))
}

/// The bounding box of a block in another space, as its lowest and highest corner.
pub(crate) fn bounds_through(other_from_this: DAffine3, [low, high]: [DVec3; 2]) -> [DVec3; 2] {
    let corners = (0..8).map(|corner| {
        let is_high = BVec3::new(corner & 1 > 0, corner & 2 > 0, corner & 4 > 0);
        other_from_this.transform_point3(DVec3::select(is_high, high, low))
    });
    let outward = |[low, high]: [DVec3; 2], corner: DVec3| [low.min(corner), high.max(corner)];
    corners.fold([DVec3::INFINITY, DVec3::NEG_INFINITY], outward)
}

/// The axis along which a vector points most.
fn dominant_axis(vector: DVec3) -> usize {
    let lengths = vector.abs();
    if lengths.x >= lengths.y && lengths.x >= lengths.z {
        0
    } else if lengths.y >= lengths.z {
        1
    } else {
        2
    }
}

/// The values of a block of `size` voxels that starts at voxel `first` of a grid, x-fastest; the default beyond the grid.
/// `values` are those of the grid, with its size.
///
/// # Panics
/// If the number of values is not that of the voxels of the grid.
pub fn block_of<T: Copy + Default>(
    values: &[T],
    own: [usize; 3],
    (first, size): ([i64; 3], [usize; 3]),
) -> Vec<T> {
    assert_eq!(values.len(), own.iter().product(), "a value for each voxel");
    let mut block = vec![T::default(); size.iter().product()];
    // The part of a side of the block that lies in the grid.
    let within = |axis: usize| {
        let end = (own[axis] as i64 - first[axis]).clamp(0, size[axis] as i64);
        (-first[axis]).clamp(0, end) as usize..end as usize
    };
    let columns = within(0);
    if columns.is_empty() {
        return block;
    }
    let own_place = |axis: usize, place: usize| (place as i64 + first[axis]) as usize;
    for (z, y) in within(2).flat_map(|z| within(1).map(move |y| (z, y))) {
        let from =
            own_place(0, columns.start) + own[0] * (own_place(1, y) + own[1] * own_place(2, z));
        let to = columns.start + size[0] * (y + size[1] * z);
        block[to..][..columns.len()].copy_from_slice(&values[from..][..columns.len()]);
    }
    block
}

#[cfg(test)]
mod tests {
    use super::*;

    fn diagonal(x: f64, y: f64, z: f64) -> DMat3 {
        DMat3::from_diagonal(DVec3::new(x, y, z))
    }

    fn grid(matrix3: DMat3, translation: DVec3) -> Result<Grid, GeometryError> {
        Grid::new(
            [4, 5, 6],
            DAffine3 {
                matrix3,
                translation,
            },
        )
    }

    #[test]
    fn a_block_has_the_values_of_the_grid_and_the_default_beyond_it() {
        let own = [4, 3, 2];
        let values: Vec<u8> = (1..=24).collect();
        let at = |voxel: [i64; 3]| {
            let is_inside = (0..3).all(|axis| (0..own[axis] as i64).contains(&voxel[axis]));
            let [x, y, z] = voxel.map(|place| place as usize);
            if is_inside {
                values[x + 4 * (y + 3 * z)]
            } else {
                0
            }
        };
        for first in [
            [0, 0, 0],
            [-2, 1, -1],
            [1, -4, 0],
            [3, 2, 1],
            [-9, 0, 0],
            [5, 0, 0],
        ] {
            let size = [5, 4, 3];
            let block = block_of(&values, own, (first, size));
            for (index, found) in block.into_iter().enumerate() {
                let voxel = [index % 5, index / 5 % 4, index / 20];
                let voxel = [0, 1, 2].map(|axis| voxel[axis] as i64 + first[axis]);
                assert_eq!(found, at(voxel), "{first:?} {voxel:?}");
            }
        }
    }

    #[test]
    fn what_is_no_place_in_a_scanner_is_refused() {
        let (plain, origin) = (diagonal(1.0, 1.0, 1.0), DVec3::ZERO);
        assert!(grid(plain, origin).is_ok());
        for (axes, offset) in [
            (diagonal(1.0, 1.0, 0.0), origin),
            (diagonal(1.0, 1e-5, 1.0), origin),
            (diagonal(1.0, 1.0, 1e4), origin),
            (DMat3::from_cols(DVec3::X, DVec3::X, DVec3::Z), origin),
            (diagonal(f64::NAN, 1.0, 1.0), origin),
            (plain, DVec3::new(0.0, f64::INFINITY, 0.0)),
            (plain, DVec3::new(0.0, 0.0, 3.4e38)),
        ] {
            let refused = grid(axes, offset);
            assert!(
                matches!(refused, Err(GeometryError::BadAffine { .. })),
                "{axes} {offset}"
            );
        }
        assert!(matches!(
            Grid::new([4, 0, 6], DAffine3::IDENTITY),
            Err(GeometryError::EmptyGrid { .. })
        ));
        for size in [[2048; 3], [usize::MAX; 3]] {
            let refused = Grid::new(size, DAffine3::IDENTITY);
            assert!(matches!(refused, Err(GeometryError::TooManyVoxels { .. })));
        }
    }

    #[test]
    fn reordering_moves_no_voxel() {
        // Axes that run to the front, upwards and to the right.
        let axes = DMat3::from_cols(DVec3::new(0.0, -2.0, 0.0), DVec3::Z * 2.0, DVec3::X * -2.0);
        let native = grid(axes, DVec3::new(10.0, 20.0, 30.0)).unwrap();
        let ordered = native.reordered_to_patient_axes().unwrap();
        assert_eq!(ordered.size(), [6, 4, 5]);
        let native_from_ordered = native.voxel_from_patient() * ordered.patient_from_voxel();
        for index in 0..ordered.voxel_count() {
            let voxel = DVec3::from_array(ordered.voxel(index).map(|place| place as f64));
            let there = native_from_ordered.transform_point3(voxel);
            assert!(there.distance(there.round()) < 1e-9 && native.contains(there));
        }
        let tilted = DMat3::from_rotation_x(0.01);
        assert!(
            grid(tilted, DVec3::ZERO)
                .unwrap()
                .reordered_to_patient_axes()
                .is_none()
        );
    }
}
