//! The regions of a brain: what they cost, how large they are, whether they are believed, and pictures to look at.
//!
//! `cargo run --release -p isocortex-bench --example regions -- VOLUME.nii.gz MASK.nii.gz [PICTURE.png]`
//!
//! The picture has sagittal, coronal and axial slices as a radiologist sees them, with the border of each region in its
//! colour: left red, right blue, cerebellum green, brain stem yellow.

use std::error::Error;
use std::path::Path;

use analysis::steps::{regions, tissue_of};
use analysis::{Head, Regions, midsagittal_plane};
use geometry::{BrainMask, DepthField, Volume, distance_map, envelope};
use glam::DVec3;
use rustix::time::{ClockId, clock_gettime};

/// Edge of a tile of the picture, in pixels.
const TILE: usize = 300;
/// Millimetres to a pixel.
const PIXEL_MM: f64 = 0.65;
/// Where the slices are, as shares of the brain from right, back and bottom.
const SHARES: [[f64; 5]; 3] = [
    [0.5, 0.44, 0.36, 0.25, 0.75],
    [0.12, 0.22, 0.32, 0.42, 0.55],
    [0.12, 0.22, 0.32, 0.42, 0.6],
];
/// The colours of the regions, by their codes.
const COLOURS: [[u8; 3]; 9] = [
    [0, 0, 0],
    [255, 90, 90],
    [90, 140, 255],
    [60, 220, 60],
    [255, 220, 0],
    [255, 150, 255],
    [150, 255, 255],
    [255, 150, 60],
    [150, 90, 255],
];

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [volume, mask, rest @ ..] = &arguments[..] else {
        return Err("name a volume and its mask, and a picture if it is wanted".into());
    };
    let limits = imaging::Limits::default();
    let volume = imaging::nifti::read_volume(&std::fs::read(volume)?, &limits)?;
    let mask = imaging::nifti::read_mask(&std::fs::read(mask)?, &limits)?;
    let brain = BrainMask::from_mask(&mask, volume.grid())?;
    let envelope = envelope(&brain, 10.0)?;
    let head = Head {
        volume: &volume,
        depth: &DepthField::new(&distance_map(&envelope)),
        plane: &midsagittal_plane(&envelope, &volume),
    };
    let (block, values, tissue) = tissue_of(head)?;
    let before = cpu_secs();
    let found = regions(head, &block, &values, None);
    println!(
        "{:?} voxels of {:.2?} mm, a block of {:?}: {:.3} s of CPU",
        volume.grid().size(),
        volume.grid().spacing_mm(),
        block.size,
        cpu_secs() - before,
    );
    println!("{:.3?}", found.numbers);
    for doubt in &found.doubts {
        println!("review: {doubt} ({})", doubt.code());
    }
    if let [picture] = rest {
        let contrast = tissue.white - tissue.grey;
        let window = [tissue.grey - 1.2 * contrast, tissue.white + 0.2 * contrast];
        write(Path::new(picture), &draw(&volume, &found, window))?;
    }
    Ok(())
}

fn cpu_secs() -> f64 {
    let time = clock_gettime(ClockId::ProcessCPUTime);
    time.tv_sec as f64 + time.tv_nsec as f64 / 1e9
}

/// A row of slices for each plane.
fn draw(volume: &Volume, found: &Regions, window: [f32; 2]) -> Vec<[u8; 3]> {
    let grid = found.grid();
    let corners = (0..8).map(|corner: usize| {
        let end = |axis: usize| (corner >> axis & 1) as f64 * (grid.size()[axis] - 1) as f64;
        let voxel = DVec3::new(end(0), end(1), end(2));
        grid.patient_from_voxel().transform_point3(voxel)
    });
    let (low, high) = corners.fold(
        (DVec3::INFINITY, DVec3::NEG_INFINITY),
        |(low, high), corner| (low.min(corner), high.max(corner)),
    );
    let centre = (low + high) / 2.0;
    let across = TILE * SHARES[0].len();
    let mut pixels = vec![[0; 3]; across * 3 * TILE];
    for (plane, shares) in SHARES.iter().enumerate() {
        for (tile, share) in shares.iter().enumerate() {
            for (row, column) in
                (0..TILE).flat_map(|row| (0..TILE).map(move |column| (row, column)))
            {
                let off = |place: usize| (place as f64 - TILE as f64 / 2.0) * PIXEL_MM;
                let [right, down] = [off(column), off(row)];
                // LPS: the patient's left is on the right of the picture, the front above or on the left.
                let (position, steps) = match plane {
                    0 => (
                        DVec3::new(
                            high.x - share * (high.x - low.x),
                            centre.y + right,
                            centre.z - down,
                        ),
                        [DVec3::Y, DVec3::Z],
                    ),
                    1 => (
                        DVec3::new(
                            centre.x + right,
                            high.y - share * (high.y - low.y),
                            centre.z - down,
                        ),
                        [DVec3::X, DVec3::Z],
                    ),
                    _ => (
                        DVec3::new(
                            centre.x + right,
                            centre.y + down,
                            low.z + share * (high.z - low.z),
                        ),
                        [DVec3::X, DVec3::Y],
                    ),
                };
                let code = |position| found.at(position).map_or(0, |region| region as u8);
                let here = code(position);
                let is_border = steps
                    .into_iter()
                    .any(|step| code(position + step * PIXEL_MM) != here);
                let grey = grey_at(volume, position, window);
                let share = if is_border { 0.8 } else { 0.18 };
                let colour = COLOURS[usize::from(here)];
                let mixed = |place: usize| {
                    let share = if here > 0 { share } else { 0.0 };
                    (f32::from(grey) * (1.0 - share) + f32::from(colour[place]) * share) as u8
                };
                pixels[(plane * TILE + row) * across + tile * TILE + column] =
                    [mixed(0), mixed(1), mixed(2)];
            }
        }
    }
    pixels
}

fn grey_at(volume: &Volume, position: DVec3, [dark, bright]: [f32; 2]) -> u8 {
    let voxel = volume
        .grid()
        .voxel_from_patient()
        .transform_point3(position);
    let stored = volume.sample(voxel.as_vec3());
    let intensity = stored.map_or(dark, |stored| volume.intensity(stored));
    (255.0 * ((intensity - dark) / (bright - dark)).clamp(0.0, 1.0)) as u8
}

fn write(path: &Path, pixels: &[[u8; 3]]) -> Result<(), Box<dyn Error>> {
    let [width, height] = [SHARES[0].len(), 3].map(|tiles| (tiles * TILE) as u32);
    let mut encoder = png::Encoder::new(std::fs::File::create(path)?, width, height);
    encoder.set_color(png::ColorType::Rgb);
    encoder
        .write_header()?
        .write_image_data(pixels.as_flattened())?;
    Ok(())
}
