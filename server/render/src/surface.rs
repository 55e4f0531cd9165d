//! The surface that the pixels of a picture show, for every renderer.

use std::ops::Range;

use rayon::prelude::*;

use crate::known::Known;
use crate::points::PointRow;
use crate::rays::{Rays, View};
use crate::shade::Shade;
use crate::silhouette::Silhouette;
use crate::{Frame, FrameSize, Hits, RenderRequest, Scene};

/// Rows per piece of work of a thread.
pub(crate) const BAND: usize = 16;

/// Bands that a picture has in the pool at once, for each thread. A pool ends what it has begun before it takes what others wait for: a
/// large picture that asked for all its bands at once would keep every other waiting until it is drawn.
const BANDS_IN_TURN: usize = 8;

/// Finds the point of an isosurface that each pixel shows.
pub(crate) trait Surface: Sync {
    /// Writes what each pixel of some rows shows, from row `first` on; `rows` hold nothing before.
    fn find_rows(&self, first: usize, rows: &mut [PointRow]);

    /// The edges of its picture; `None` if [`Surface::find_rows`] says how much of each pixel is covered.
    fn silhouette(&self) -> Option<Silhouette<'_>>;
}

/// Whether a picture is still wanted. Called repeatedly while it is drawn, from any thread.
pub type Wanted<'a> = dyn Fn() -> bool + Sync + 'a;

/// The picture of a surface; `None` soon after it is no longer wanted.
pub(crate) fn draw(
    surface: &dyn Surface,
    scene: &Scene<'_>,
    request: &RenderRequest,
    view: impl Into<View>,
    is_wanted: &Wanted<'_>,
) -> Option<Frame> {
    let surface = &WhileWanted { surface, is_wanted };
    let view = view.into();
    let shade = Shade::new(scene, view, request, voxel_mm(scene));
    let size = view.size();
    let row_bytes = size.width() as usize * shade.format().bytes_per_pixel();
    let mut bytes = vec![0; row_bytes * size.height() as usize];
    let with_inward = shade.asks_for_inward();
    let known = Known::new(scene.field, request.parameters().depth_mm);
    let rays = working_rays(scene, view);
    let finish = |row: usize, points: &mut PointRow, pixels: &mut [u8]| {
        known.leave_bare(&rays, row, points);
        shade.row(row, points, pixels);
    };
    match surface.silhouette() {
        Some(silhouette) => {
            let picture = Softened {
                surface,
                silhouette,
                size,
                with_inward,
            };
            picture.for_each_row(&mut bytes, finish);
        }
        None => for_each_row(surface, view.size(), with_inward, &mut bytes, finish),
    }
    is_wanted().then(|| Frame::new(size, shade.format(), bytes))
}

/// Draws a surface band by band, with soft edges.
struct Softened<'a> {
    surface: &'a dyn Surface,
    silhouette: Silhouette<'a>,
    size: FrameSize,
    with_inward: bool,
}

impl Softened<'_> {
    /// Calls `finish` with each row's number, points and pixels, on all threads.
    ///
    /// Where the edge lies in a row is known from the rows above and below: the last row of a band and the first of the next
    /// one are finished when all bands have been found.
    fn for_each_row(
        &self,
        pixels: &mut [u8],
        finish: impl Fn(usize, &mut PointRow, &mut [u8]) + Sync,
    ) {
        let height = self.size.height() as usize;
        let per_row = pixels.len() / height;
        let finish_rows =
            |first: usize, rows: &mut [PointRow], inner: Range<usize>, pixels: &mut [u8]| {
                self.silhouette.soften(first, rows, inner.clone());
                for (row, pixels) in inner.zip(pixels.chunks_exact_mut(per_row)) {
                    finish(first + row, &mut rows[row], pixels);
                }
            };
        let bands = pixels.chunks_mut(per_row * BAND).enumerate();
        let mut ends: Vec<[Vec<PointRow>; 2]> = in_turns(bands, |(band, pixels)| {
            let first = band * BAND;
            let mut rows = vec![
                PointRow::new(self.size.width() as usize, self.with_inward);
                pixels.len() / per_row
            ];
            self.surface.find_rows(first, &mut rows);
            let count = rows.len();
            let ends = [
                rows[..count.min(2)].to_vec(),
                rows[count.saturating_sub(2)..].to_vec(),
            ];
            let from = usize::from(first > 0);
            let to = count - usize::from(first + count < height);
            if from < to {
                finish_rows(first, &mut rows, from..to, &mut pixels[from * per_row..]);
            }
            ends
        });
        let beside: Vec<Vec<PointRow>> = (1..ends.len())
            .map(|band| {
                let [_, above] = &mut ends[band - 1];
                let mut rows = std::mem::take(above);
                rows.append(&mut ends[band][0]);
                rows
            })
            .collect();
        let Some(pixels) = pixels.get_mut((BAND - 1) * per_row..) else {
            return;
        };
        let seams = pixels.chunks_mut(per_row * BAND).zip(beside).enumerate();
        in_turns(seams, |(band, (pixels, mut rows))| {
            finish_rows((band + 1) * BAND - 2, &mut rows, 1..3, pixels);
        });
    }
}

/// What `draw` returns for each piece of a picture, in order. All threads draw, and after some pieces those of other pictures come.
fn in_turns<I: Send, R: Send>(
    pieces: impl Iterator<Item = I>,
    draw: impl Fn(I) -> R + Sync + Send,
) -> Vec<R> {
    let in_turn = BANDS_IN_TURN * rayon::current_num_threads();
    let mut pieces = pieces.fuse();
    let mut drawn = Vec::with_capacity(pieces.size_hint().0);
    loop {
        let turn: Vec<I> = pieces.by_ref().take(in_turn).collect();
        if turn.is_empty() {
            return drawn;
        }
        drawn.par_extend(turn.into_par_iter().map(&draw));
    }
}

/// A surface that shows nothing after it is no longer wanted.
struct WhileWanted<'a> {
    surface: &'a dyn Surface,
    is_wanted: &'a Wanted<'a>,
}

impl Surface for WhileWanted<'_> {
    fn find_rows(&self, first: usize, rows: &mut [PointRow]) {
        if (self.is_wanted)() {
            self.surface.find_rows(first, rows);
        }
    }

    fn silhouette(&self) -> Option<Silhouette<'_>> {
        self.surface.silhouette()
    }
}

/// What each pixel of a surface's picture shows.
pub(crate) fn hits(
    surface: &dyn Surface,
    scene: &Scene<'_>,
    request: &RenderRequest,
    view: impl Into<View>,
) -> Hits {
    let view = view.into();
    let known = Known::new(scene.field, request.parameters().depth_mm);
    let rays = working_rays(scene, view);
    let voxel_mm = voxel_mm(scene) as f32;
    let mut heights_mm = vec![f32::NEG_INFINITY; view.size().pixel_count()];
    for_each_row(
        surface,
        view.size(),
        false,
        &mut heights_mm,
        |row, points, heights_mm| {
            known.leave_bare(&rays, row, points);
            for (height_mm, height) in heights_mm.iter_mut().zip(&points.heights) {
                *height_mm = height * voxel_mm;
            }
        },
    );
    Hits::new(view, heights_mm)
}

/// The lines of sight of a picture through the working grid; heights are in working voxels.
pub(crate) fn working_rays(scene: &Scene<'_>, view: impl Into<View>) -> Rays {
    Rays::new(view, scene.field.grid(), voxel_mm(scene))
}

/// A height below everything that `scene` holds, in working voxels.
pub(crate) fn bottom(scene: &Scene<'_>) -> f32 {
    -(scene.bounds.radius_mm / voxel_mm(scene)) as f32 - 2.0
}

/// Edge of a working voxel, in mm.
pub(crate) fn voxel_mm(scene: &Scene<'_>) -> f64 {
    scene.field.grid().spacing_mm()[0]
}

/// Calls `take` with each row's number, points and share of `out`, on all threads.
fn for_each_row<T: Send>(
    surface: &dyn Surface,
    size: FrameSize,
    with_inward: bool,
    out: &mut [T],
    take: impl Fn(usize, &mut PointRow, &mut [T]) + Sync,
) {
    let per_row = out.len() / size.height() as usize;
    in_turns(out.chunks_mut(per_row * BAND).enumerate(), |(band, out)| {
        let first = band * BAND;
        let mut rows = vec![PointRow::new(size.width() as usize, with_inward); out.len() / per_row];
        surface.find_rows(first, &mut rows);
        for (row, out) in out.chunks_exact_mut(per_row).enumerate() {
            take(first + row, &mut rows[row], out);
        }
    });
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc;
    use std::thread;
    use std::time::Duration;

    use super::*;

    #[test]
    fn a_picture_lets_others_pass_after_some_of_its_bands() {
        let (begin, begun) = mpsc::channel();
        let (pass, passed) = mpsc::channel();
        let next_turn = BANDS_IN_TURN * rayon::current_num_threads();
        thread::scope(|scope| {
            scope.spawn(move || {
                begun.recv().expect("the large picture begins");
                assert_eq!(in_turns(0..3, |band| 2 * band), [0, 2, 4]);
                pass.send(()).expect("the large picture waits");
            });
            let bands = (0..2 * next_turn + 1).inspect(|&band| {
                if band == next_turn {
                    passed
                        .recv_timeout(Duration::from_secs(30))
                        .expect("the other picture is drawn between two turns");
                }
            });
            let drawn = in_turns(bands, |band| {
                if band == 0 {
                    begin.send(()).expect("the other picture waits");
                }
                band
            });
            assert!(drawn.into_iter().eq(0..2 * next_turn + 1));
        });
    }
}
