use case::{
    FailureKind, LayerKind, LayerParameters, MatrixOrigin, PlacementVerdict, QualityState,
    Transform,
};
use geometry::Grid;
use geometry::phantom::{PhantomHead, head};
use glam::{DAffine3, DVec3};

use super::*;
use crate::testing::upload;
use crate::{Pipeline, Prepared};

/// A head of 3 mm, prepared.
fn prepared() -> (PhantomHead, Prepared) {
    let head = head(3.0);
    let source = upload(&head);
    let never = std::sync::atomic::AtomicBool::new(false);
    let prepared = Pipeline::default().prepare(
        &source,
        &case::Parameters::default(),
        &Limits::default(),
        &|_| {},
        &never,
    );
    (head, prepared.unwrap())
}

fn numbers(grid: &Grid, numbers: &[f32]) -> LayerSource {
    LayerSource {
        volume: nifti::write_numbers(grid, numbers).unwrap().into(),
        dicom: None,
    }
}

fn of_kind(kind: LayerKind) -> LayerParameters {
    LayerParameters {
        kind,
        ..LayerParameters::default()
    }
}

fn prepare(
    (head, prepared): &(PhantomHead, Prepared),
    source: &LayerSource,
    parameters: &LayerParameters,
    kept: Option<&PlacementFacts>,
) -> Result<PreparedLayer, Failure> {
    let volume = crate::testing::nifti(&head.volume);
    let case = LayerCase {
        facts: &prepared.facts,
        envelope: prepared.envelope(),
        volume: prepared.built.model.volume(),
        source: &volume,
        dicom: None,
    };
    prepare_layer(source, parameters, &Limits::default(), &case, kept)
}

/// The head's intensities, inverted, as another program would write them: moved by a shift of its header.
fn moved(head: &PhantomHead, shift_mm: f64) -> LayerSource {
    let volume = &head.volume;
    let affine = DAffine3::from_translation(DVec3::new(shift_mm, 0.0, 0.0))
        * volume.grid().patient_from_voxel();
    let grid = Grid::new(volume.grid().size(), affine).unwrap();
    let inverted = volume
        .voxels()
        .iter()
        .map(|&stored| 500.0 - volume.intensity(stored.into()));
    numbers(&grid, &inverted.collect::<Vec<_>>())
}

#[test]
fn a_moved_volume_is_registered_and_keeps_its_place() {
    let case = prepared();
    let source = moved(&case.0, 12.0);
    let first = prepare(&case, &source, &of_kind(LayerKind::Mr), None).unwrap();
    let placement = &first.facts.placement;
    assert_eq!(placement.origin, MatrixOrigin::Registered);
    assert_eq!(placement.verdict, PlacementVerdict::Registered);
    assert_eq!(placement.quality, QualityState::Ok);
    let [row, ..] = placement.case_from_layer;
    assert!((row[3] + 12.0).abs() < 1.0, "{row:?}");
    assert!(placement.nmi_after > placement.nmi_before);

    let voxels = decode_layer(&first.payload).unwrap();
    assert!(voxels.grid().voxel_count() <= case.0.volume.grid().voxel_count());
    let kept = PlacementFacts {
        reason: Some("of an earlier preparation".to_owned()),
        reason_code: None,
        fit: None,
        ..placement.clone()
    };
    let again = prepare(&case, &source, &of_kind(LayerKind::Mr), Some(&kept)).unwrap();
    assert_eq!(again.facts.placement, kept);
    assert_eq!(again.payload, first.payload);
}

#[test]
fn the_same_volume_stays_where_its_header_places_it() {
    let case = prepared();
    let same = prepare(&case, &moved(&case.0, 0.0), &of_kind(LayerKind::Mr), None).unwrap();
    let placement = &same.facts.placement;
    assert_eq!(placement.origin, MatrixOrigin::Header);
    assert_eq!(placement.verdict, PlacementVerdict::Unchanged);
    assert_eq!(placement.quality, QualityState::Ok);
}

#[test]
fn what_is_no_image_of_the_head_is_refused_and_can_be_placed_by_hand() {
    let case = prepared();
    let grid = case.0.volume.grid();
    let noise = |index: usize| (index.wrapping_mul(2_654_435_761) % 997) as f32;
    let source = numbers(
        grid,
        &(0..grid.voxel_count()).map(noise).collect::<Vec<_>>(),
    );
    let refused = prepare(&case, &source, &of_kind(LayerKind::Mr), None).unwrap_err();
    assert_eq!(refused.name, "layer-not-registered");
    assert_eq!(refused.kind, FailureKind::Unusable);
    let rows = [
        [1.0, 0.0, 0.0, 3.0],
        [0.0, 1.0, 0.0, 0.0],
        [0.0, 0.0, 1.0, 0.0],
        [0.0, 0.0, 0.0, 1.0],
    ];
    for (transform, origin, quality) in [
        (Transform::None, MatrixOrigin::Header, QualityState::Review),
        (
            Transform::Matrix(rows),
            MatrixOrigin::ByHand,
            QualityState::Ok,
        ),
    ] {
        let parameters = LayerParameters {
            transform,
            ..LayerParameters::default()
        };
        let placed = prepare(&case, &source, &parameters, None)
            .unwrap()
            .facts
            .placement;
        assert_eq!((placed.origin, placed.quality), (origin, quality));
        assert_eq!(placed.reason.is_some(), quality == QualityState::Review);
        assert_eq!(placed.reason_code.is_some(), placed.reason.is_some());
    }
}

#[test]
fn windows_are_those_of_the_kind() {
    let case = prepared();
    let grid = case.0.volume.grid();
    let count = grid.voxel_count();
    let window = |kind, unit: &str, value: &dyn Fn(usize) -> f32| {
        let source = numbers(grid, &(0..count).map(value).collect::<Vec<_>>());
        let parameters = LayerParameters {
            unit: unit.to_owned(),
            transform: Transform::None,
            ..of_kind(kind)
        };
        prepare(&case, &source, &parameters, None).map(|layer| layer.facts.window)
    };
    let ramp = |index: usize| (index % 1000) as f32 / 100.0 - 2.0;
    let [low, high] = window(LayerKind::Pet, "SUV", &ramp).unwrap();
    assert!(low == 0.0 && (7.8..8.0).contains(&high), "{low} {high}");
    assert_eq!(window(LayerKind::Ct, "HU", &ramp), Ok([0.0, 80.0]));
    let [low, high] = window(LayerKind::Mr, "", &ramp).unwrap();
    assert!(
        (-1.9..-1.7).contains(&low) && (7.7..7.9).contains(&high),
        "{low} {high}"
    );
    let [low, high] = window(LayerKind::Map, "z", &ramp).unwrap();
    assert!(low == -high && (7.8..8.0).contains(&high), "{low} {high}");
    let one_sided = |index: usize| (index % 1000) as f32 / 1000.0;
    let [low, high] = window(LayerKind::Map, "p", &one_sided).unwrap();
    assert!(low == 0.0 && (0.98..1.0).contains(&high), "{low} {high}");
    // Something in the corner of the volume alone is outside of the head.
    let corner = |index: usize| if index < 5 { 1.0 } else { 0.0 };
    for kind in [LayerKind::Map, LayerKind::Labels] {
        let refused = window(kind, "", &corner).unwrap_err();
        assert_eq!(refused.name, "layer-outside-head", "{kind:?}");
    }
}

#[test]
fn maps_and_labels_lie_where_their_header_says_and_doubt_is_told() {
    let case = prepared();
    let same = case.0.volume.grid();
    let blob = |grid: &Grid| {
        let centre = DVec3::from_array(case.1.facts.envelope_sphere.center_in_patient);
        let value = |index: usize| {
            let voxel = DVec3::from_array(grid.voxel(index).map(|place| place as f64));
            let place = grid.patient_from_voxel().transform_point3(voxel);
            f32::from(u8::from(place.distance(centre) < 30.0))
        };
        numbers(
            grid,
            &(0..grid.voxel_count()).map(value).collect::<Vec<_>>(),
        )
    };
    let placed = prepare(&case, &blob(same), &of_kind(LayerKind::Labels), None).unwrap();
    assert_eq!(placed.facts.placement.origin, MatrixOrigin::Header);
    assert_eq!(placed.facts.placement.quality, QualityState::Ok);
    assert_eq!(placed.facts.labels.len(), 1);

    // As many programs write: another grid, and not the space of the scanner.
    let other = Grid::new(
        same.size(),
        DAffine3::from_translation(DVec3::splat(4.0)) * same.patient_from_voxel(),
    );
    let mut file = gunzipped(&blob(&other.unwrap()).volume);
    for code in [252, 254] {
        file[code] = 2;
    }
    let source = LayerSource {
        volume: file.into(),
        dicom: None,
    };
    let placed = prepare(&case, &source, &of_kind(LayerKind::Map), None).unwrap();
    assert_eq!(placed.facts.placement.quality, QualityState::Review);
    assert!(placed.facts.placement.reason.is_some());
    assert_eq!(
        placed.facts.placement.reason_code.as_deref(),
        Some("space-not-stated")
    );
}

#[test]
fn a_file_that_states_no_axes_is_doubted() {
    let case = prepared();
    // MGH with `goodRASflag` 0: a ball of 20 mm.
    const SIDE: i32 = 60;
    let mut file: Vec<u8> = [1, SIDE, SIDE, SIDE, 1, 0, 0]
        .into_iter()
        .flat_map(i32::to_be_bytes)
        .collect();
    file.resize(284, 0);
    let is_within = |index: i32| {
        let voxel = [index, index / SIDE, index / SIDE / SIDE].map(|along| along % SIDE - SIDE / 2);
        voxel.map(|along| along * along).iter().sum::<i32>() < 400
    };
    file.extend((0..SIDE.pow(3)).map(|index| u8::from(is_within(index))));
    let source = LayerSource {
        volume: file.clone().into(),
        dicom: None,
    };
    for kind in [LayerKind::Map, LayerKind::Labels] {
        let placed = prepare(&case, &source, &of_kind(kind), None).unwrap();
        let placement = placed.facts.placement;
        assert_eq!(placement.quality, QualityState::Review);
        assert_eq!(placement.reason_code.as_deref(), Some("axes-assumed"));
    }
    // So is a case whose mask is such a file.
    let mut of_case = upload(&case.0);
    let are_assumed =
        |source: &crate::Source| crate::source::are_axes_assumed(source, &Limits::default());
    assert!(!are_assumed(&of_case).unwrap());
    of_case.mask = Some(file.into());
    assert!(are_assumed(&of_case).unwrap());
}

fn gunzipped(bytes: &[u8]) -> Vec<u8> {
    let mut plain = Vec::new();
    std::io::Read::read_to_end(&mut flate2::read::GzDecoder::new(bytes), &mut plain).unwrap();
    plain
}

#[test]
fn values_keep_their_sign_and_what_is_not_a_number_is_undefined() {
    let case = prepared();
    let grid = case.0.volume.grid();
    let value = |index: usize| match index % 5 {
        0 => f32::NAN,
        rest => (rest as f32 - 3.0) * 0.37,
    };
    let values: Vec<f32> = (0..grid.voxel_count()).map(value).collect();
    let source = numbers(grid, &values);
    let layer = prepare(&case, &source, &of_kind(LayerKind::Map), None).unwrap();
    assert!((layer.facts.range[0] + 0.74).abs() < 1e-6);
    let voxels = decode_layer(&layer.payload).unwrap();
    let back = numbers_of(&voxels, &layer.facts, LayerKind::Map);
    let whole_from_block = grid.voxel_from_patient() * voxels.grid().patient_from_voxel();
    for (index, &number) in back.iter().enumerate() {
        let voxel = DVec3::from_array(voxels.grid().voxel(index).map(|place| place as f64));
        let voxel = whole_from_block.transform_point3(voxel).round().to_array();
        let known = values[grid.index(voxel.map(|place| place as usize))];
        assert_eq!(known.is_nan(), number.is_nan());
        if !known.is_nan() {
            assert!((known - number).abs() < 1.2e-5, "{known} {number}");
            assert_eq!(known == 0.0, number == 0.0);
        }
    }
}

#[test]
fn one_odd_voxel_takes_no_steps_from_the_others() {
    let case = prepared();
    let grid = case.0.volume.grid();
    let value = |index: usize| (index % 1123) as f32 / 100.0 - 5.6;
    let mut values: Vec<f32> = (0..grid.voxel_count()).map(value).collect();
    values[grid.index(grid.size().map(|side| side / 2))] = 1e5;
    let layer = prepare(
        &case,
        &numbers(grid, &values),
        &of_kind(LayerKind::Map),
        None,
    );
    let facts = layer.unwrap().facts;
    assert_eq!(facts.clipped, 1);
    // A step is about a hundredth, as between the values.
    assert!(facts.range[1] < 1000.0, "{:?}", facts.range);
}

#[test]
fn labels_are_named_and_those_of_meld_by_themselves() {
    let case = prepared();
    let grid = case.0.volume.grid();
    let labels = |values: [f32; 4], names: &[(u32, &str)]| {
        let value = |index: usize| values[index % 4];
        let source = numbers(
            grid,
            &(0..grid.voxel_count()).map(value).collect::<Vec<_>>(),
        );
        let names = names
            .iter()
            .map(|(value, name)| (*value, (*name).to_owned()));
        let parameters = LayerParameters {
            labels: names.collect(),
            ..of_kind(LayerKind::Labels)
        };
        let layer = prepare(&case, &source, &parameters, None)?;
        let voxels = decode_layer(&layer.payload).unwrap();
        let back = numbers_of(&voxels, &layer.facts, LayerKind::Labels);
        assert!(back.iter().all(|number| values.contains(number)));
        let names = layer
            .facts
            .labels
            .into_iter()
            .map(|label| (label.value, label.name));
        Ok::<_, Failure>(names.collect::<Vec<_>>())
    };
    let named = |names: &[(u32, &str)]| -> Vec<(u32, String)> {
        names
            .iter()
            .map(|(value, name)| (*value, (*name).to_owned()))
            .collect()
    };
    assert_eq!(
        labels([0.0, 1.0, 100.0, 2.0], &[]).unwrap(),
        named(&[
            (1, "cluster 1"),
            (2, "cluster 2"),
            (100, "cluster 1, salient")
        ])
    );
    assert_eq!(
        labels([0.0, 1.0, 300.0, 2.0], &[(2, "two")]).unwrap(),
        named(&[(1, "1"), (2, "two"), (300, "300")])
    );
    assert_eq!(
        labels([0.0, 0.5, 1.0, 2.0], &[]).unwrap_err().name,
        "labels-not-whole"
    );
    assert_eq!(
        labels([0.0, -1.0, 1.0, 2.0], &[]).unwrap_err().name,
        "labels-not-whole"
    );
    assert_eq!(labels([0.0; 4], &[]).unwrap_err().name, "layer-empty");
}

#[test]
fn what_cannot_be_shown_is_refused_by_name() {
    let case = prepared();
    let grid = case.0.volume.grid();
    let all = |value: f32| numbers(grid, &vec![value; grid.voxel_count()]);
    for (source, name) in [
        (all(f32::NAN), "layer-empty"),
        (all(3.0), "layer-empty"),
        (LayerSource::default(), "not-nifti"),
    ] {
        let refused = check_layer(&source, &of_kind(LayerKind::Mr), &Limits::default());
        assert_eq!(refused.unwrap_err().name, name);
    }
    let mut huge = vec![0.0; grid.voxel_count()];
    huge[7] = 2e9;
    let refused = check_layer(
        &numbers(grid, &huge),
        &of_kind(LayerKind::Map),
        &Limits::default(),
    );
    assert_eq!(refused.unwrap_err().name, "intensity-range");
    let few = Limits {
        max_voxels: grid.voxel_count() - 1,
        ..Limits::default()
    };
    let refused = check_layer(&all(1.0), &of_kind(LayerKind::Mr), &few).unwrap_err();
    assert_eq!(refused.kind, FailureKind::TooLarge);
}
