//! The published figures, from Tables 2 and 3 of the paper. Figures 5 and 6 are plots; the text states only the numbers
//! for the mesh of 1,800 triangles.

/// A row of Table 2: a mesh of 1,800 triangles, drawn by graphics hardware.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeshRow {
    /// The computer's letter in Table 1.
    pub machine: char,
    /// Setup, in seconds.
    pub setup_s: f64,
    /// Frames a second of the envelope.
    pub envelope_fps: f64,
    /// Frames a second of a deep isosurface.
    pub inner_fps: f64,
    /// Mesh derivation time, in seconds.
    pub derivation_s: f64,
}

/// A row of Table 3: voxel projection, in software.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VoxelRow {
    /// The computer's letter in Table 1.
    pub machine: char,
    /// Setup, in seconds.
    pub setup_s: f64,
    /// Frames a second of the envelope.
    pub envelope_fps: f64,
    /// Frames a second of a deep isosurface.
    pub inner_fps: f64,
}

const fn mesh(
    machine: char,
    [setup_s, envelope_fps, inner_fps, derivation_s]: [f64; 4],
) -> MeshRow {
    MeshRow {
        machine,
        setup_s,
        envelope_fps,
        inner_fps,
        derivation_s,
    }
}

const fn voxel(machine: char, [setup_s, envelope_fps, inner_fps]: [f64; 3]) -> VoxelRow {
    VoxelRow {
        machine,
        setup_s,
        envelope_fps,
        inner_fps,
    }
}

/// Table 2.
pub const TABLE_2: [MeshRow; 6] = [
    mesh('C', [13.6, 412.0, 518.0, 0.173]),
    mesh('D', [13.6, 1172.0, 1172.0, 0.173]),
    mesh('E', [12.4, 15.0, 70.0, 0.270]),
    mesh('F', [11.9, 263.0, 355.0, 0.287]),
    mesh('H', [11.5, 697.0, 709.0, 0.264]),
    mesh('I', [5.8, 424.0, 536.0, 0.110]),
];

/// Table 3.
pub const TABLE_3: [VoxelRow; 9] = [
    voxel('A', [5.02, 9.0, 98.0]),
    voxel('B', [4.86, 10.0, 104.0]),
    voxel('C', [2.35, 22.0, 280.0]),
    voxel('D', [2.35, 22.0, 280.0]),
    voxel('E', [2.26, 24.0, 339.0]),
    voxel('F', [1.92, 26.0, 308.0]),
    voxel('G', [1.96, 18.0, 329.0]),
    voxel('H', [1.74, 28.0, 397.0]),
    voxel('I', [0.99, 40.0, 422.0]),
];

/// Triangles of the mesh of Table 2.
pub const TABLE_2_TRIANGLES: usize = 1800;

/// The machine of Figure 6.
pub const FIGURE_6_MACHINE: char = 'F';

/// The range of some published figures.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Range {
    /// The worst figure for a user.
    pub worst: f64,
    /// The best figure for a user.
    pub best: f64,
}

/// The range of times; less is better.
pub fn times(figures: impl Iterator<Item = f64> + Clone) -> Range {
    Range {
        worst: figures.clone().fold(0.0, f64::max),
        best: figures.fold(f64::INFINITY, f64::min),
    }
}

/// The range of rates; more is better.
pub fn rates(figures: impl Iterator<Item = f64> + Clone) -> Range {
    let Range { worst, best } = times(figures);
    Range {
        worst: best,
        best: worst,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn less_time_and_more_frames_are_better() {
        let setup = times(TABLE_2.iter().map(|row| row.setup_s));
        assert_eq!((setup.worst, setup.best), (13.6, 5.8));
        let envelope = rates(TABLE_3.iter().map(|row| row.envelope_fps));
        assert_eq!((envelope.worst, envelope.best), (9.0, 40.0));
    }
}
