//! Straight edges of known width, in 48 orientations.

use geometry::Grid;
use glam::{DAffine3, DMat3, DVec3};

use crate::block::{Block, Zone};
use crate::gradient::weighted_gradient;
use crate::phantom::{rise, white_noise};
use crate::sharpness::sharpness;
use crate::width::{JunctionWidth, WidthTable, width_table};

const SIDE: usize = 33;
const ORIENTATIONS: usize = 48;

/// A block of deep tissue, turned against the patient, with voxels of these edges.
fn block(spacing_mm: [f64; 3]) -> Block {
    let axes = DMat3::from_rotation_y(0.3) * DMat3::from_rotation_x(-0.2);
    let affine = DAffine3 {
        matrix3: axes * DMat3::from_diagonal(DVec3::from_array(spacing_mm)),
        translation: DVec3::new(12.0, -30.0, 7.0),
    };
    let grid = Grid::new([SIDE; 3], affine).unwrap();
    Block {
        first: [0; 3],
        size: [SIDE; 3],
        spacing_mm,
        zones: vec![Zone::Deep; grid.voxel_count()],
        grid,
    }
}

/// Directions that lie evenly on a half of the sphere.
fn directions() -> impl Iterator<Item = DVec3> {
    (0..ORIENTATIONS).map(|number| {
        let height = (number as f64 + 0.5) / ORIENTATIONS as f64;
        let angle = number as f64 * 2.399_963;
        let radius = (1.0 - height * height).sqrt();
        DVec3::new(radius * angle.cos(), radius * angle.sin(), height)
    })
}

/// What an edge is like.
#[derive(Clone, Copy)]
struct Edge {
    sigma_mm: f64,
    noise: f64,
}

/// The mean sharpness of the junction around the middle of a block, of an edge across a direction.
fn sharpness_of(block: &Block, edge: Edge, direction: DVec3) -> f32 {
    let middle = DVec3::splat((SIDE / 2) as f64);
    let centre = block.grid.patient_from_voxel().transform_point3(middle);
    let from_centre = |index: usize| {
        let voxel = DVec3::from_array(block.grid.voxel(index).map(|place| place as f64));
        block.grid.patient_from_voxel().transform_point3(voxel) - centre
    };
    let value = |index: usize| {
        // The edge lies a third of a millimetre off the middle, so that no direction has it on voxel centres.
        let across = from_centre(index).dot(direction) - 0.33;
        (rise(across / edge.sigma_mm) + edge.noise * white_noise(index)) as f32
    };
    let values: Vec<f32> = (0..block.voxel_count()).map(value).collect();
    let weighted = weighted_gradient(block, &values, edge.noise as f32);
    let sharpness = sharpness(block, weighted);
    let near = sharpness
        .junction
        .iter()
        .map(|&voxel| voxel as usize)
        .filter(|&voxel| from_centre(voxel).length() < 6.0);
    let (sum, count) = near.fold((0.0, 0), |(sum, count), voxel| {
        (sum + sharpness.values[voxel], count + 1)
    });
    assert!(count > 30, "{count} voxels of the junction");
    sum / count as f32
}

fn table(block: &Block) -> WidthTable {
    width_table(block.spacing_mm)
}

#[test]
fn the_width_of_an_edge_is_right_within_a_tenth_in_48_orientations() {
    for (spacing_mm, most_spread) in [([1.0; 3], 0.05), ([0.8; 3], 0.05), ([1.0, 1.0, 1.3], 0.08)] {
        let block = block(spacing_mm);
        let table = table(&block);
        for sigma_mm in [1.0, 1.5, 2.0, 3.0] {
            let edge = Edge {
                sigma_mm,
                noise: 0.0,
            };
            let seen: Vec<f32> = directions()
                .map(|direction| sharpness_of(&block, edge, direction))
                .collect();
            let mean = seen.iter().sum::<f32>() / seen.len() as f32;
            let [least, most] =
                [f32::min, f32::max].map(|pick| seen.iter().copied().reduce(pick).unwrap());
            let spread = (most - least) / mean;
            println!("{spacing_mm:?} σ {sigma_mm}: S {mean:.4}, spread {spread:.3}");
            assert!(spread < most_spread, "σ {sigma_mm}: {least} to {most}");
            for sharpness in seen {
                let off = match table.width(sharpness) {
                    Some(JunctionWidth::Mm(width)) => (f64::from(width) / sigma_mm - 1.0).abs(),
                    // At the end of the table, a hair decides.
                    Some(JunctionWidth::UnderOneMm) if sigma_mm < 1.05 => 0.0,
                    other => panic!("σ {sigma_mm}: {other:?} of {sharpness}"),
                };
                assert!(off < 0.10, "σ {sigma_mm}: {sharpness}, off by {off}");
            }
        }
    }
}

#[test]
fn an_edge_sharper_than_a_millimetre_is_only_said_to_be_that() {
    let block = block([1.0; 3]);
    let table = table(&block);
    for sigma_mm in [0.4, 0.7] {
        for direction in directions() {
            let edge = Edge {
                sigma_mm,
                noise: 0.0,
            };
            let width = table.width(sharpness_of(&block, edge, direction));
            assert_eq!(width, Some(JunctionWidth::UnderOneMm), "σ {sigma_mm}");
        }
    }
}

#[test]
fn noise_of_two_to_ten_percent_biases_the_sharpness_by_less_than_a_tenth() {
    let block = block([1.0; 3]);
    for sigma_mm in [1.0, 2.0, 3.0] {
        let mean = |noise: f64| {
            let edge = Edge { sigma_mm, noise };
            let all = directions().step_by(6);
            let seen = all.map(|direction| sharpness_of(&block, edge, direction));
            seen.sum::<f32>() / (ORIENTATIONS / 6) as f32
        };
        let without = mean(0.0);
        for noise in [0.02, 0.05, 0.10] {
            let bias = mean(noise) / without - 1.0;
            println!("σ {sigma_mm}, noise {noise}: {:+.1} %", 100.0 * bias);
            assert!(bias.abs() < 0.10, "σ {sigma_mm}, noise {noise}: {bias}");
        }
    }
}
