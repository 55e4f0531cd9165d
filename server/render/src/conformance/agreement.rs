//! How far two pictures of one request are apart, pixel by pixel.

use std::ops::AddAssign;

use crate::{Frame, PixelFormat};

/// The differences between pictures, pixel by pixel; several pairs of pictures add up.
///
/// The difference of a pixel is that of its most different channel, in levels of 255. A pixel counts as covered if at least
/// half of it is: the colour of a smaller part is coarse where it was mixed with nothing.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Agreement {
    /// Pixels that both pictures cover, by their difference in levels.
    differences: [u64; 256],
    /// Pixels that only one picture covers.
    one_sided: u64,
    /// Those of them without an edge of the second silhouette within a pixel.
    beyond_edge: u64,
    /// Pixels that neither covers.
    neither: u64,
}

impl Default for Agreement {
    /// An empty comparison.
    fn default() -> Self {
        Self {
            differences: [0; 256],
            one_sided: 0,
            beyond_edge: 0,
            neither: 0,
        }
    }
}

impl AddAssign<&Self> for Agreement {
    fn add_assign(&mut self, other: &Self) {
        for (sum, count) in self.differences.iter_mut().zip(other.differences) {
            *sum += count;
        }
        self.one_sided += other.one_sided;
        self.beyond_edge += other.beyond_edge;
        self.neither += other.neither;
    }
}

impl Agreement {
    /// Compares a picture with a reference.
    ///
    /// # Panics
    /// If they differ in size or format, or have no alpha, which distinguishes black from background.
    pub fn of(found: &Frame, judge: &Frame) -> Self {
        assert_eq!(
            (found.size(), found.format()),
            (judge.size(), judge.format()),
            "pictures of one request"
        );
        let length = found.format().bytes_per_pixel();
        assert!(
            matches!(found.format(), PixelFormat::GreyAlpha8 | PixelFormat::Rgba8),
            "pictures with alpha"
        );
        let mut agreement = Self::default();
        let pairs = found.bytes().chunks_exact(length);
        for (index, (found, other)) in pairs.zip(judge.bytes().chunks_exact(length)).enumerate() {
            let colors = found.iter().zip(other).take(length - 1);
            match (is_covered(found), is_covered(other)) {
                (true, true) => {
                    let most = colors.map(|(a, b)| a.abs_diff(*b)).max().unwrap_or(0);
                    agreement.differences[usize::from(most)] += 1;
                }
                (false, false) => agreement.neither += 1,
                _ => {
                    agreement.one_sided += 1;
                    agreement.beyond_edge += u64::from(!is_at_edge(judge, index));
                }
            }
        }
        agreement
    }

    /// Number of pixels that both cover.
    pub fn covered_pixels(&self) -> u64 {
        self.differences.iter().sum()
    }

    /// The mean difference over the pixels that both cover, in levels of 255; 0 if there are none.
    pub fn mean_difference(&self) -> f64 {
        let levels = self.differences.iter().zip(0_u64..);
        let sum: u64 = levels.map(|(count, level)| count * level).sum();
        sum as f64 / self.covered_pixels().max(1) as f64
    }

    /// The quantile `share` (0 to 1) of the differences over the pixels that both cover, in levels.
    pub fn percentile(&self, share: f64) -> u8 {
        let wanted = share * self.covered_pixels() as f64;
        let mut counted = 0;
        let enough = self.differences.iter().position(|count| {
            counted += count;
            counted as f64 >= wanted
        });
        enough.unwrap_or(255) as u8
    }

    /// The fraction of the pixels covered by either picture that both cover with a difference of at most `levels`; 1 if
    /// there are none.
    pub fn share_within(&self, levels: u8) -> f64 {
        let within: u64 = self.differences[..=usize::from(levels)].iter().sum();
        let either = self.covered_pixels() + self.one_sided;
        if either == 0 {
            1.0
        } else {
            within as f64 / either as f64
        }
    }

    /// Number of pixels that only one picture covers, more than a pixel from the silhouette of the reference.
    pub fn beyond_edge(&self) -> u64 {
        self.beyond_edge
    }
}

/// Whether at least half of a pixel with alpha is covered.
fn is_covered(pixel: &[u8]) -> bool {
    pixel.last().is_some_and(|&alpha| alpha >= 128)
}

/// Whether some of the nine pixels around a pixel are covered and some are not; pixels outside the picture are not
/// covered.
fn is_at_edge(frame: &Frame, index: usize) -> bool {
    let width = frame.size().width();
    let [x, y] = [index as u32 % width, index as u32 / width];
    let covered = |x: u32, y: u32| frame.pixel(x, y).is_some_and(is_covered);
    let mut around = (0..9).map(|step| {
        covered(
            (x + step % 3).wrapping_sub(1),
            (y + step / 3).wrapping_sub(1),
        )
    });
    let first = around.next();
    around.any(|other| Some(other) != first)
}

/// A picture of the differences between two pictures: black for none, white from 32 levels on.
///
/// # Panics
/// If they differ in size or format.
pub fn difference_picture(found: &Frame, expected: &Frame) -> Frame {
    assert_eq!(
        (found.size(), found.format()),
        (expected.size(), expected.format()),
        "pictures of one request"
    );
    let length = found.format().bytes_per_pixel();
    let pairs = found.bytes().chunks_exact(length);
    let levels = pairs
        .zip(expected.bytes().chunks_exact(length))
        .map(|(found, expected)| {
            let differences = found.iter().zip(expected).map(|(a, b)| a.abs_diff(*b));
            differences.max().unwrap_or(0).saturating_mul(8)
        })
        .collect();
    Frame::new(found.size(), PixelFormat::Grey8, levels)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::FrameSize;

    fn frame(width: u32, pixels: &[[u8; 2]]) -> Frame {
        let size = FrameSize::new(width, pixels.len() as u32 / width).unwrap();
        Frame::new(
            size,
            PixelFormat::GreyAlpha8,
            pixels.as_flattened().to_vec(),
        )
    }

    #[test]
    fn levels_are_counted_over_what_both_cover() {
        let found = frame(4, &[[10, 255], [20, 255], [0, 0], [90, 255]]);
        let judge = frame(4, &[[10, 255], [26, 128], [0, 0], [0, 0]]);
        let agreement = Agreement::of(&found, &judge);
        assert_eq!(agreement.covered_pixels(), 2);
        assert_eq!(agreement.mean_difference(), 3.0);
        assert_eq!([0.5, 1.0].map(|share| agreement.percentile(share)), [0, 6]);
        assert_eq!(agreement.share_within(2), 1.0 / 3.0);
        assert_eq!(agreement.share_within(6), 2.0 / 3.0);
        let mut twice = agreement.clone();
        twice += &agreement;
        assert_eq!(twice.covered_pixels(), 4);
        assert_eq!(twice.mean_difference(), 3.0);
    }

    #[test]
    fn a_silhouette_may_be_a_pixel_off_and_no_more() {
        let covered = [50, 255];
        let mut judge = vec![[0, 0]; 25];
        judge[12] = covered;
        let beyond = |index: usize| {
            let mut found = judge.clone();
            found[index] = covered;
            Agreement::of(&frame(5, &found), &frame(5, &judge)).beyond_edge()
        };
        assert_eq!([12, 6, 13, 18].map(beyond), [0; 4]);
        assert_eq!([0, 10, 24].map(beyond), [1; 3]);
    }

    #[test]
    fn what_differs_is_bright() {
        let difference = difference_picture(
            &frame(2, &[[10, 255], [0, 255]]),
            &frame(2, &[[13, 255], [200, 255]]),
        );
        assert_eq!(difference.bytes(), [24, 255]);
    }
}
