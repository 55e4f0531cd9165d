//! What tests of the store share with those of the crates above.

mod items;
pub mod postgres;
pub mod s3;
pub mod steps;

use std::path::{Path, PathBuf};

use case::{
    CaseFacts, Failure, LayerFacts, MatrixOrigin, ObjectKind, PlacementFacts, PlacementVerdict,
    PlaneFacts, QualityState, SphereFacts, Stage, VoxelFacts, WindowFacts,
};

#[cfg(test)]
pub(crate) use self::items::{claim, job, keep, new_case, pinned, rename, waiting};
use super::upkeep::all_objects_of;
use super::{CaseQuery, Listed, ObjectName, Store};

/// The facts of a case, made up.
pub fn facts() -> CaseFacts {
    CaseFacts {
        grid_size: [1, 2, 3],
        spacing_mm: 1.0,
        patient_from_voxel: [[0.0; 4]; 4],
        native_size: [1, 2, 3],
        native_spacing_mm: [1.0; 3],
        native_patient_from_voxel: [[0.0; 4]; 4],
        voxels: Some(VoxelFacts {
            values: "0".repeat(64),
            profiles: [[0; 2]; 3],
            not_finite: 0,
            clipped: 0,
        }),
        envelope_sphere: SphereFacts {
            center_in_patient: [0.0; 3],
            radius_mm: 1.0,
        },
        max_depth_mm: 10.0,
        envelope_ml: 100.0,
        intensity_min: 0.0,
        intensity_max: 1.0,
        window: WindowFacts {
            center: 0.5,
            width: 1.0,
        },
        midsagittal: PlaneFacts {
            normal: [1.0, 0.0, 0.0],
            offset_mm: 0.0,
            correlation: 0.9,
            doubtful: false,
        },
        cuts: Vec::new(),
        pipeline: 2,
        quality: None,
        dicom: None,
        timings: vec![(Stage::Reading, 1.0)],
    }
}

/// The facts of a layer, made up.
pub fn layer_facts() -> LayerFacts {
    LayerFacts {
        size: [1, 2, 3],
        spacing_mm: [1.0; 3],
        patient_from_voxel: [[0.0; 4]; 4],
        placement: PlacementFacts {
            case_from_layer: [[0.0; 4]; 4],
            origin: MatrixOrigin::Registered,
            verdict: PlacementVerdict::Registered,
            quality: QualityState::Ok,
            reason: None,
            reason_code: None,
            fit: None,
            nmi_before: Some(1.1),
            nmi_after: Some(1.2),
            overlap: Some(1.0),
            residual_mm: Some(0.1),
        },
        range: [0.0, 1.0],
        clipped: 0,
        window: [0.0, 1.0],
        labels: Vec::new(),
        sequence: None,
    }
}

/// A failure, made up.
pub fn failure() -> Failure {
    Failure::unusable("mask-empty", "the mask is empty")
}

/// The address of an object.
pub fn name(kind: ObjectKind, contents: &str) -> ObjectName {
    ObjectName {
        kind,
        digest: blake3::hash(contents.as_bytes()),
    }
}

/// Every file below a directory, ascending.
pub fn files_below(directory: &Path) -> Vec<PathBuf> {
    let mut files = Vec::new();
    for entry in std::fs::read_dir(directory).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            files.extend(files_below(&path));
        } else {
            files.push(path);
        }
    }
    files.sort();
    files
}

/// The files of the objects in a folder, ascending, without the id of the store.
pub fn objects_below(folder: &Path) -> Vec<PathBuf> {
    let mut files = files_below(folder);
    files.retain(|file| !file.ends_with("store-id"));
    files
}

/// What must be true of a store on disk whenever nothing is under way: the objects are those that cases need, and no upload is left.
pub async fn assert_nothing_left_over(store: &Store, root: &Path) {
    assert_eq!(files_below(&root.join("uploads")), Vec::<PathBuf>::new());
    let mut needed = Vec::new();
    for Listed { case, .. } in store
        .cases(&CaseQuery::default(), None, 1000)
        .await
        .unwrap()
        .cases
    {
        for name in all_objects_of(store, &case.id).await.unwrap() {
            needed.push(root.join("objects").join(name.path().as_ref()));
        }
    }
    needed.sort();
    needed.dedup();
    assert_eq!(objects_below(&root.join("objects")), needed);
}
