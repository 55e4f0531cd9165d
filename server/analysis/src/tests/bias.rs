//! A strong bias of the coil, and specks of junction.

use geometry::{Grid, Volume};
use glam::DAffine3;

use crate::block::{Block, Zone};
use crate::candidates::Scores;
use crate::phantom::{Phantom, Scan, plain_grid};
use crate::tissue::{Bias, tissue_scale};

/// The fraction of deep white matter that a bias field makes look like junction or grey matter.
fn misjudged(scan: &Scan, darkened: &Volume, bias: &Bias) -> f64 {
    let head = scan.head();
    let block = Block::new(head.volume, head.depth).unwrap();
    let (plain, _) = tissue_scale(head.volume, &block, &Bias::STANDARD).unwrap();
    let (found, _) = tissue_scale(darkened, &block, bias).unwrap();
    let white: Vec<f32> = (plain.iter().zip(&found).zip(&block.zones))
        .filter(|((plain, _), zone)| **plain > 0.95 && **zone == Zone::Deep)
        .map(|((_, found), _)| *found)
        .collect();
    assert!(white.len() > 10_000);
    white.iter().filter(|&&found| found < 0.75).count() as f64 / white.len() as f64
}

#[test]
fn white_matter_stays_white_in_a_strong_bias() {
    let scan = Phantom::PLAIN.scan(&plain_grid());
    let grid = scan.volume.grid();
    let side = grid.size()[1] as f64;
    let voxels = (0..grid.voxel_count()).map(|index| {
        // From 0.7 in front to 1.3 behind.
        let bias = 0.7 + 0.6 * grid.voxel(index)[1] as f64 / side;
        (f64::from(scan.volume.voxels()[index]) * bias) as u16
    });
    let darkened = Volume::new(grid.clone(), voxels.collect(), scan.volume.rescale()).unwrap();
    let one_pass = Bias {
        passes: &[(20.0, 0.5)],
    };
    let [before, now] = [&one_pass, &Bias::STANDARD].map(|bias| misjudged(&scan, &darkened, bias));
    println!("one pass {before:.4}, all passes {now:.4}");
    assert!(now < 0.002 && now < before / 4.0, "{before} {now}");
}

#[test]
fn a_speck_scores_lower_than_a_junction() {
    let grid = Grid::new([40; 3], DAffine3::IDENTITY).unwrap();
    let block = Block {
        first: [0; 3],
        size: [40; 3],
        spacing_mm: [1.0; 3],
        zones: vec![Zone::Deep; grid.voxel_count()],
        grid,
    };
    let speck = block.grid.index([30, 20, 20]);
    let voxels = 0..block.voxel_count();
    let junction: Vec<u32> = voxels
        .filter(|&index| block.grid.voxel(index)[0] == 10 || index == speck)
        .map(|index| index as u32)
        .collect();
    let mut map = vec![3.0; block.voxel_count()];
    map[speck] = 6.0;
    let scores = Scores::smoothed(&block, &junction, &mut map);
    let score = |voxel: usize| {
        let place = junction.binary_search(&(voxel as u32)).unwrap();
        scores.scores[place]
    };
    let of_speck = score(speck);
    let of_junction = score(block.grid.index([10, 20, 20]));
    assert!(
        of_speck < 1.5 && of_junction > 2.0,
        "{of_speck} {of_junction}"
    );
    assert_eq!(map[speck], 6.0, "the map itself keeps its values");
}
