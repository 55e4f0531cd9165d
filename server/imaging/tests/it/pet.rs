//! PET series: units, a slope for each slice, and the uptake value.

use imaging::Limits;
use imaging::dicom::{Converted, DicomError, Options, Purpose, convert};

use crate::series_builder::{DataSet, Slice, Syntax, files, slices};

const PET: &str = "1.2.840.10008.5.1.4.1.1.128";

/// A PET slice with a slope of its own. What is not said of the dose is left out.
fn pet_file(slice: &Slice, weight: Option<&str>) -> Vec<u8> {
    let slice = Slice {
        sop_class: PET,
        modality: "PT",
        series_uid: "1.2.3.9".to_owned(),
        series_number: 9,
        description: "brain",
        rescale: Some([slice.instance as f64, 0.0]),
        ..slice.clone()
    };
    let mut set = slice.data_set(Syntax::Explicit);
    set.text([8, 0x21], "DA", "20240301");
    set.text([8, 0x22], "DA", "20240301");
    set.text([8, 0x31], "TM", "101000");
    set.text([8, 0x32], "TM", "101001.5");
    if let Some(weight) = weight {
        set.text([0x10, 0x1030], "DS", weight);
    }
    set.text([0x28, 0x51], "CS", "ATTN\\DECY\\SCAT");
    let mut drug = DataSet::new(Syntax::Explicit);
    drug.text([0x18, 0x1072], "TM", "091000");
    drug.text([0x18, 0x1074], "DS", "370000000");
    drug.text([0x18, 0x1075], "DS", "6586.2");
    set.head([0x54, 0x16], "SQ", drug.bytes.len() as u32 + 8);
    set.delimiter(0xE000, drug.bytes.len() as u32);
    set.bytes.extend(drug.bytes);
    set.text([0x54, 0x1001], "CS", "BQML");
    set.text([0x54, 0x1102], "CS", "START");
    let samples: Vec<u8> = slice
        .samples
        .iter()
        .flat_map(|sample| sample.to_le_bytes())
        .collect();
    set.bytes([0x7FE0, 0x10], "OW", &samples);
    set.file()
}

fn as_layer(mut files: Vec<Vec<u8>>) -> Result<Converted, DicomError> {
    let options = Options {
        purpose: Purpose::Layer,
        ..Options::default()
    };
    convert(&mut files, &options, &Limits::default())
}

fn value_of(converted: &Converted) -> f64 {
    let volume = imaging::nifti::read_values(&converted.nifti, &Limits::default()).unwrap();
    // The first sample of the third slice is 300, and its slope is 3.
    f64::from(volume.numbers[60]) / 900.0
}

#[test]
fn a_pet_is_its_activity_or_its_uptake_value() {
    let series = |weight| {
        slices(5)
            .iter()
            .map(|slice| pet_file(slice, weight))
            .collect()
    };
    let raw = as_layer(series(None)).unwrap();
    assert_eq!(raw.series.unit.as_deref(), Some("Bq/ml"));
    assert!((value_of(&raw) - 1.0).abs() < 1e-6);
    assert_eq!(
        (raw.series.name.as_str(), raw.series.modality.as_str()),
        ("PET", "PT")
    );
    let suv = as_layer(series(Some("70"))).unwrap();
    assert_eq!(suv.series.unit.as_deref(), Some("SUV"));
    let left_bq = 370e6 * (-3600.0f64 / 6586.2).exp2();
    let expected = 70_000.0 / left_bq;
    assert!((value_of(&suv) / expected - 1.0).abs() < 1e-5);
}

#[test]
fn a_pet_is_a_layer_beside_a_t1_and_never_a_case() {
    let mut both = files(&slices(5), Syntax::Explicit);
    both.extend(slices(5).iter().map(|slice| pet_file(slice, None)));
    let options = Options::default();
    let case = convert(&mut both.clone(), &options, &Limits::default()).unwrap();
    assert_eq!((case.series.name.as_str(), case.others.len()), ("T1", 1));
    assert_eq!(case.others[0].name, "PET");
    // Both could be a layer.
    let Err(DicomError::SeveralSeries { candidates }) = as_layer(both) else {
        panic!("one of two was chosen");
    };
    assert_eq!(candidates.len(), 2);
    let mut alone: Vec<_> = slices(5)
        .iter()
        .map(|slice| pet_file(slice, None))
        .collect();
    let refused = convert(&mut alone, &options, &Limits::default());
    assert!(matches!(refused, Err(DicomError::Unsupported { .. })));
}
