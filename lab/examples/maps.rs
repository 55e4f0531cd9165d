//! The maps of a head: what they cost, its candidates, and pictures of slices to look at.
//!
//! `cargo run --release -p isocortex-bench --example maps -- VOLUME.nii.gz MASK.nii.gz [FOLDER]`
//!
//! Each picture has nine axial slices as a radiologist sees them: the patient's left is on the right, the front above.

use std::error::Error;
use std::path::Path;

use analysis::{Head, MapKind, MapParameters, Maps, maps, midsagittal_plane};
use geometry::{BrainMask, DepthField, Volume, distance_map, envelope};
use glam::DVec3;
use rustix::time::{ClockId, clock_gettime};

/// Edge of a tile of a picture, in pixels.
const TILE: usize = 340;
/// Millimetres to a pixel.
const PIXEL_MM: f64 = 0.6;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [volume, mask, rest @ ..] = &arguments[..] else {
        return Err(
            "name a volume and its mask, and a folder for pictures if they are wanted".into(),
        );
    };
    let limits = imaging::Limits::default();
    let volume = imaging::nifti::read_volume(&std::fs::read(volume)?, &limits)?;
    let mask = imaging::nifti::read_mask(&std::fs::read(mask)?, &limits)?;
    let brain = BrainMask::from_mask(&mask, volume.grid())?;
    let envelope = envelope(&brain, 10.0)?;
    let depth = DepthField::new(&distance_map(&envelope));
    let plane = midsagittal_plane(&envelope, &volume);
    let head = Head {
        volume: &volume,
        depth: &depth,
        plane: &plane,
    };
    drop((mask, brain, envelope));
    let before = (cpu_secs(), memory_mb("VmRSS:"));
    let found = maps(head, &MapParameters::STANDARD)?;
    let after = (cpu_secs(), memory_mb("VmHWM:"));
    println!(
        "{:?} voxels of {:.2?} mm, maps on {:?}: {:.2} s of CPU; {:.0} MB before, at most {:.0} MB so far",
        volume.grid().size(),
        volume.grid().spacing_mm(),
        found.grid().size(),
        after.0 - before.0,
        before.1,
        after.1,
    );
    println!("{:.3?}", found.tissue);
    for (number, candidate) in found.candidates.iter().take(20).enumerate() {
        println!(
            "{:2}  {:5.2}  {:?} {:?} at {:6.1}, {} mm deep, {:.1} mm",
            number + 1,
            candidate.score,
            candidate.side,
            candidate.region,
            candidate.position_in_patient,
            candidate.depth_mm,
            candidate.size_mm,
        );
    }
    println!("{:.3?} {:?}", found.regions.numbers, found.regions.doubts);
    for elsewhere in found.elsewhere.iter().take(5) {
        println!("elsewhere: {:5.2} {:?}", elsewhere.score, elsewhere.region);
    }
    if let [folder] = rest {
        for kind in MapKind::OF_HEAD {
            let picture = draw(&volume, &found, kind);
            let path = Path::new(folder).join(format!("{}.png", kind.name()));
            write(&path, &picture)?;
        }
    }
    Ok(())
}

fn cpu_secs() -> f64 {
    let time = clock_gettime(ClockId::ProcessCPUTime);
    time.tv_sec as f64 + time.tv_nsec as f64 / 1e9
}

/// A line of the kernel's account of this process, in MB; 0 where there is none.
fn memory_mb(line: &str) -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let found = status.lines().find_map(|text| text.strip_prefix(line));
    let kilobytes =
        found.and_then(|rest| rest.trim().strip_suffix("kB")?.trim().parse::<f64>().ok());
    kilobytes.unwrap_or_default() / 1024.0
}

/// Nine axial slices, in colour where the map is beyond its threshold, with a circle around each of the twenty highest candidates.
fn draw(volume: &Volume, maps: &Maps, kind: MapKind) -> Vec<[u8; 3]> {
    let mut pixels = vec![[0; 3]; 9 * TILE * TILE];
    let grid = maps.grid();
    let corners = (0..8).map(|corner: usize| {
        let end = |axis: usize| (corner >> axis & 1) as f64 * (grid.size()[axis] - 1) as f64;
        grid.patient_from_voxel()
            .transform_point3(DVec3::new(end(0), end(1), end(2)))
    });
    let (low, high) = corners.fold(
        (DVec3::INFINITY, DVec3::NEG_INFINITY),
        |(low, high), corner| (low.min(corner), high.max(corner)),
    );
    let centre = (low + high) / 2.0;
    let (dark, bright) = (
        maps.tissue.grey * 2.0 - maps.tissue.white,
        maps.tissue.white * 1.1,
    );
    for tile in 0..9 {
        let z = low.z + (high.z - low.z) * (0.22 + 0.075 * tile as f64);
        for (row, column) in (0..TILE).flat_map(|row| (0..TILE).map(move |column| (row, column))) {
            let off = |place: usize| (place as f64 - TILE as f64 / 2.0) * PIXEL_MM;
            let position = DVec3::new(centre.x + off(column), centre.y + off(row), z);
            let grey = grey_at(volume, position, [dark, bright]);
            let mut colour = [grey; 3];
            if let Some(value) = value_at(maps, kind, position) {
                colour = coloured(kind, value, grey);
            }
            let on_ring = maps.candidates.iter().take(20).any(|candidate| {
                let apart = candidate.position_in_patient - position;
                let is_near = apart.z.abs() < 5.0;
                is_near && (apart.truncate().length() - 8.0).abs() < 0.5
            });
            if on_ring {
                colour = [80, 220, 120];
            }
            pixels[(tile / 3 * TILE + row) * 3 * TILE + tile % 3 * TILE + column] = colour;
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

fn value_at(maps: &Maps, kind: MapKind, position: DVec3) -> Option<f32> {
    let grid = maps.grid();
    let voxel = grid.voxel_from_patient().transform_point3(position).round();
    let size = DVec3::from_array(grid.size().map(|side| side as f64 - 1.0));
    let is_inside = voxel.cmpge(DVec3::ZERO).all() && voxel.cmple(size).all();
    let index = || grid.index(voxel.to_array().map(|place| place as usize));
    let value = is_inside.then(|| maps.map(kind).value(index()))?;
    (!value.is_nan()).then_some(value)
}

fn coloured(kind: MapKind, value: f32, grey: u8) -> [u8; 3] {
    let (share, colour) = match kind {
        MapKind::Sharpness => (value / 0.5, [255.0, 200.0, 40.0]),
        MapKind::Junction => (value / 0.6, [255.0, 200.0, 40.0]),
        MapKind::Blur => ((value - 2.0) / 2.5, [255.0, 90.0, 20.0]),
        _ if value > 0.0 => ((value - 2.0) / 2.5, [255.0, 160.0, 60.0]),
        _ => ((-value - 2.0) / 2.5, [60.0, 150.0, 255.0]),
    };
    let share = share.clamp(0.0, 1.0) * 0.8;
    colour.map(|colour: f32| (f32::from(grey) * (1.0 - share) + colour * share) as u8)
}

fn write(path: &Path, pixels: &[[u8; 3]]) -> Result<(), Box<dyn Error>> {
    let side = 3 * TILE as u32;
    let mut encoder = png::Encoder::new(std::fs::File::create(path)?, side, side);
    encoder.set_color(png::ColorType::Rgb);
    encoder
        .write_header()?
        .write_image_data(pixels.as_flattened())?;
    Ok(())
}
