//! The unit of a PET, and its standardised uptake value.

use dicom_core::Tag;
use dicom_dictionary_std::tags;
use dicom_object::InMemDicomObject;

use super::numbers::{items, real, text};

/// The header of a PET image, as far as the standardised uptake value needs it.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Pet {
    units: String,
    /// Whether attenuation and decay are corrected, the latter to the start of the scan.
    is_corrected: bool,
    weight_kg: Option<f64>,
    dose_bq: Option<f64>,
    half_life_s: Option<f64>,
    /// Seconds since a common origin.
    injected_s: Option<f64>,
    series_s: Option<f64>,
    acquired_s: Option<f64>,
}

impl Pet {
    pub(super) fn read(object: &InMemDicomObject) -> Self {
        let word = |tag| text(object, tag).unwrap_or_default().to_ascii_uppercase();
        let drug = items(object, tags::RADIOPHARMACEUTICAL_INFORMATION_SEQUENCE).first();
        let of_drug = |tag| {
            drug.and_then(|drug| real(drug, tag))
                .filter(|&number| number > 0.0)
        };
        let series_s = moment(object, [tags::SERIES_DATE, tags::SERIES_TIME]);
        let corrected = word(tags::CORRECTED_IMAGE);
        let is_corrected = ["ATTN", "DECY"]
            .iter()
            .all(|step| corrected.split('\\').any(|word| word.trim() == *step));
        Self {
            units: word(tags::UNITS),
            is_corrected: is_corrected && word(tags::DECAY_CORRECTION) == "START",
            weight_kg: real(object, tags::PATIENT_WEIGHT).filter(|&weight| weight > 0.0),
            dose_bq: of_drug(tags::RADIONUCLIDE_TOTAL_DOSE),
            half_life_s: of_drug(tags::RADIONUCLIDE_HALF_LIFE),
            injected_s: drug.and_then(|drug| injection(drug, object)),
            series_s,
            acquired_s: moment(object, [tags::ACQUISITION_DATE, tags::ACQUISITION_TIME]),
        }
    }
}

/// The unit of a PET series, and the factor that its values must be multiplied by.
///
/// Activity becomes the standardised uptake value by body weight if every header has all that it needs; otherwise it
/// keeps its unit. The activity is that of the start of the series; of a series that was computed later, that of its
/// first acquisition.
///
/// Source: QIBA, "FDG-PET/CT Profile", appendix with the vendor-neutral calculation of SUV; PS3.3 C.8.9.1.
pub(super) fn unit_of(headers: &[&Pet]) -> Option<(&'static str, f64)> {
    let first = headers.first()?;
    if headers.iter().any(|header| header.units != first.units) {
        return None;
    }
    match first.units.as_str() {
        "GML" => Some(("SUV", 1.0)),
        "BQML" => Some(suv(headers).map_or(("Bq/ml", 1.0), |factor| ("SUV", factor))),
        "CNTS" => Some(("counts", 1.0)),
        _ => None,
    }
}

/// Grams of body per becquerel at the reference time; `None` if a header lacks something.
fn suv(headers: &[&Pet]) -> Option<f64> {
    let first = headers.first()?;
    let is_same = |header: &&&Pet| {
        header.is_corrected
            && header.weight_kg == first.weight_kg
            && header.dose_bq == first.dose_bq
            && header.half_life_s == first.half_life_s
            && header.injected_s == first.injected_s
    };
    if !headers.iter().all(|header| is_same(&header)) {
        return None;
    }
    let acquired: Option<Vec<f64>> = headers.iter().map(|header| header.acquired_s).collect();
    let acquired_s = acquired?.into_iter().fold(f64::INFINITY, f64::min);
    let reference_s = first.series_s.filter(|&series_s| series_s <= acquired_s);
    let waited_s = reference_s.unwrap_or(acquired_s) - first.injected_s?;
    // Nobody waits for a day.
    if !(0.0..86_400.0).contains(&waited_s) {
        return None;
    }
    let left_bq = first.dose_bq? * (-waited_s / first.half_life_s?).exp2();
    Some(first.weight_kg? * 1000.0 / left_bq)
}

/// The time of the injection: with its date, or on the day of the series.
fn injection(drug: &InMemDicomObject, object: &InMemDicomObject) -> Option<f64> {
    let whole = text(drug, tags::RADIOPHARMACEUTICAL_START_DATE_TIME);
    if let Some(whole) = whole.filter(|whole| whole.len() >= 14) {
        let (date, time) = whole.split_at_checked(8)?;
        return seconds(date, time);
    }
    let time = text(drug, tags::RADIOPHARMACEUTICAL_START_TIME)?;
    let date = [tags::SERIES_DATE, tags::ACQUISITION_DATE]
        .into_iter()
        .find_map(|tag| text(object, tag))?;
    seconds(&date, &time)
}

fn moment(object: &InMemDicomObject, [date, time]: [Tag; 2]) -> Option<f64> {
    seconds(&text(object, date)?, &text(object, time)?)
}

/// Seconds since a common origin of a date `YYYYMMDD` and a time `HHMMSS.F` (a time zone after it is ignored).
fn seconds(date: &str, time: &str) -> Option<f64> {
    let number = |text: &str, from: usize, to: usize| text.get(from..to)?.parse::<i64>().ok();
    let [year, month, day] = [
        number(date, 0, 4)?,
        number(date, 4, 6)?,
        number(date, 6, 8)?,
    ];
    // Days of the proleptic Gregorian calendar, with years that begin in March.
    let (year, month) = if month > 2 {
        (year, month - 3)
    } else {
        (year - 1, month + 9)
    };
    let days = 365 * year + year / 4 - year / 100 + year / 400 + (153 * month + 2) / 5 + day;
    let [hour, minute] = [number(time, 0, 2)?, number(time, 2, 4)?];
    let rest = time.get(4..)?.split(['+', '-', '&']).next()?;
    let second: f64 = if rest.is_empty() {
        0.0
    } else {
        rest.parse().ok()?
    };
    let is_time = hour < 24 && minute < 60 && (0.0..61.0).contains(&second);
    is_time.then_some((86_400 * days + 3600 * hour + 60 * minute) as f64 + second)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pet() -> Pet {
        Pet {
            units: "BQML".to_owned(),
            is_corrected: true,
            weight_kg: Some(70.0),
            dose_bq: Some(370e6),
            half_life_s: Some(6588.0),
            injected_s: seconds("20240229", "235500"),
            series_s: seconds("20240301", "005500.5"),
            acquired_s: seconds("20240301", "005600"),
        }
    }

    #[test]
    fn the_uptake_value_uses_the_activity_that_is_left() {
        let pet = pet();
        let left = 370e6 * (-3600.5f64 / 6588.0).exp2();
        let factor = suv(&[&pet, &pet]).unwrap();
        assert!((factor - 70_000.0 / left).abs() < 1e-12, "{factor}");
        // A series that was computed later.
        let later = Pet {
            series_s: seconds("20240302", "120000"),
            ..pet
        };
        let left = 370e6 * (-3660.0f64 / 6588.0).exp2();
        assert!((suv(&[&later]).unwrap() - 70_000.0 / left).abs() < 1e-12);
    }

    #[test]
    fn without_everything_there_is_no_uptake_value() {
        let whole = pet();
        let lacking = [
            Pet {
                weight_kg: None,
                ..whole.clone()
            },
            Pet {
                dose_bq: None,
                ..whole.clone()
            },
            Pet {
                injected_s: None,
                ..whole.clone()
            },
            Pet {
                is_corrected: false,
                ..whole.clone()
            },
            Pet {
                injected_s: seconds("20240303", "000000"),
                ..whole.clone()
            },
        ];
        for header in lacking {
            assert_eq!(suv(&[&header]), None, "{header:?}");
        }
        let other = Pet {
            dose_bq: Some(1.0),
            ..whole.clone()
        };
        assert_eq!(suv(&[&whole, &other]), None);
    }

    #[test]
    fn times_are_read_as_the_standard_writes_them() {
        let day = seconds("20240301", "000000").unwrap() - seconds("20240229", "000000").unwrap();
        assert_eq!(day, 86_400.0);
        let year = seconds("20240101", "0000").unwrap() - seconds("20230101", "0000").unwrap();
        assert_eq!(year, 365.0 * 86_400.0);
        let moment = seconds("20240301", "010203.5+0100").unwrap();
        assert_eq!(moment - seconds("20240301", "000000").unwrap(), 3723.5);
        for (date, time) in [("2024", "000000"), ("20240301", "2460"), ("20240301", "25")] {
            assert_eq!(seconds(date, time), None, "{date} {time}");
        }
    }
}
