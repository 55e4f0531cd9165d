//! "Only about 15% of the voxels are inside the envelope"; "a 2-voxel shell is enough to prevent holes" (section 3.3).

use super::DEPTHS_MM;
use crate::{PreparedHead, Table, column};

/// The thickness of the projected shell, in voxels.
const SHELL_VOXELS: f32 = 2.0;

/// The voxels of the shells, as shares of the envelope.
pub(super) fn table(head: &PreparedHead) -> Table {
    let columns = [
        column("depth_mm", "depth, mm"),
        column("voxels", "voxels of the shell"),
        column("share", "share of the envelope"),
        column("shallower_share", "shallower than its end"),
    ];
    let spacing_mm = head.model().field().spacing_mm();
    let thickness_mm = SHELL_VOXELS * spacing_mm;
    let title = format!("Voxels projected at a depth: a shell of 2 voxels, {thickness_mm} mm");
    let mut table = Table::new("shells", title, &columns);
    let shells = head.model().shell();
    let all = shells.voxels().len();
    for depth_mm in DEPTHS_MM {
        let voxels = shells.shell(depth_mm, thickness_mm).len();
        let shallower = shells.shell(0.0, depth_mm + thickness_mm).len();
        table.push([
            f64::from(depth_mm).into(),
            voxels.into(),
            (voxels as f64 / all as f64).into(),
            (shallower as f64 / all as f64).into(),
        ]);
    }
    let native_mm = head.model().volume().grid().spacing_mm();
    let native_mm3 = native_mm.iter().product::<f64>() * head.volume_voxels as f64;
    let inside_mm3 = f64::from(spacing_mm).powi(3) * all as f64;
    table.note(format!(
        "{:.1} % of the volume lie inside the envelope; about 15 % in the paper.",
        100.0 * inside_mm3 / native_mm3
    ));
    table
}
