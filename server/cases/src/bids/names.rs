//! The files that a head can have, and how their names end.

use case::{SurfaceName, VoxelValues};

/// What is written of the voxels of a head.
pub(super) const VOXELS: [VoxelValues; 9] = [
    VoxelValues::Depth,
    VoxelValues::Sides,
    VoxelValues::Regions,
    VoxelValues::Blur,
    VoxelValues::Thickness,
    VoxelValues::Flair,
    VoxelValues::BlurPlaces,
    VoxelValues::ThicknessPlaces,
    VoxelValues::FlairPlaces,
];

/// The depths of the surfaces of each half, in mm.
pub(super) const SURFACE_DEPTHS_MM: [f32; 2] = [0.0, 8.0];

pub(super) const BRAIN: &str = "desc-brain_mask.nii.gz";
pub(super) const PLACES: [&str; 2] = ["desc-places.tsv", "desc-places.json"];
pub(super) const TRANSFORM: &str = "from-FLAIR_to-T1w_mode-image_xfm.json";
pub(super) const HEMISPHERES: [(SurfaceName, char); 2] =
    [(SurfaceName::Left, 'L'), (SurfaceName::Right, 'R')];

/// The ends of the names of all files that a head can have beside its record.
pub(super) fn ends() -> impl Iterator<Item = String> {
    let of_voxels = VOXELS.into_iter().flat_map(|values| {
        ["nii.gz", "json", "tsv"].map(|kind| format!("{}.{kind}", stem(values)))
    });
    let of_surfaces = HEMISPHERES.iter().flat_map(|(_, hemisphere)| {
        SURFACE_DEPTHS_MM.map(|depth_mm| surface_end(*hemisphere, depth_mm))
    });
    let others = [BRAIN, TRANSFORM].into_iter().chain(PLACES);
    of_voxels
        .chain(of_surfaces)
        .chain(others.map(str::to_owned))
}

/// The name of a volume after that of its head, without its kind.
pub(super) fn stem(values: VoxelValues) -> String {
    let label = values.name().replace('-', "");
    let kind = if values.are_labels() { "dseg" } else { "map" };
    format!("desc-{label}_{kind}")
}

pub(super) fn surface_end(hemisphere: char, depth_mm: f32) -> String {
    format!("hemi-{hemisphere}_desc-{depth_mm}mm_cut.surf.gii")
}
