//! Growth with the pixels.

use geometry::MeshSize;
use render::encode_png;

use super::{Growth, note_exponents};
use crate::{Cell, Costs, MeasureError, Painter, Spin, Table, column};

/// Sides of the pictures.
const SIDES: [u32; 4] = [256, 512, 1024, 2048];

/// Times of a picture by its pixels, for each painter.
pub(super) fn table(growth: &Growth<'_>) -> Result<Table, MeasureError> {
    let columns = [
        column("painter", "drawn by"),
        column("side", "side"),
        column("pixels", "pixels"),
        column("frame_ms", "frame, wall ms"),
        column("frame_cpu_ms", "CPU, ms"),
        column("png_ms", "PNG, CPU ms"),
    ];
    let title = format!("Growth with the pixels, {} mm deep", growth.depth_mm);
    let mut table = Table::new("growth_pixels", title, &columns);
    for painter in growth.painters {
        let mut rows = Table::new("growth_pixels", "", &columns);
        for side in SIDES {
            if side <= growth.extent.picture_side {
                rows.push(row(growth, painter, side)?);
            }
        }
        note_exponents(&mut rows, "pixels", &["frame_cpu_ms", "png_ms"]);
        for note in rows.notes {
            table.note(format!("{}: {note}", painter.name()));
        }
        table.rows.extend(rows.rows);
    }
    Ok(table)
}

fn row(growth: &Growth<'_>, painter: &Painter, side: u32) -> Result<Vec<Cell>, MeasureError> {
    let name = painter.name();
    growth
        .tell
        .tell(&format!("growth with the pixels: {name}, {side}²"));
    let size = MeshSize::STANDARD;
    let mesh = if painter.draws_mesh() {
        let (_, paths) = growth.case.table(size)?;
        Some((size, paths.shrink(growth.depth_mm)))
    } else {
        None
    };
    let spin = Spin {
        frames: 36,
        seconds: 2.0,
        size: growth.frame(side)?,
        depth_mm: growth.depth_mm,
    };
    let rate = spin.rate(growth.case, painter, mesh.as_ref())?;
    let frame = painter.draw(growth.case, spin.request(growth.case, 0)?, mesh.as_ref())?;
    let png = Costs::of(growth.extent.repeat, || encode_png(&frame, &[]));
    Ok(vec![
        name.into(),
        u64::from(side).into(),
        frame.size().pixel_count().into(),
        (rate.wall_s.median * 1e3).into(),
        rate.cpu_s.map(|cpu_s| cpu_s * 1e3).into(),
        (png.least_s() * 1e3).into(),
    ])
}
