//! The colours of each brightness, for the page.

use render::ColorMap;

/// The colours of each map: 256 times red, then green, then blue, each as the difference from the one before it modulo 256,
/// in two hexadecimal digits. (Differences are small and compress well.)
pub(crate) fn colors() -> String {
    let rows = ColorMap::ALL.map(|map| {
        let table = map.table();
        let channels = (0..3).flat_map(|channel| table.map(|color| color[channel]));
        let mut before = 0_u8;
        let differences =
            channels.map(|share| share.wrapping_sub(std::mem::replace(&mut before, share)));
        let digits: String = differences.map(|share| format!("{share:02x}")).collect();
        format!("  {:?}: {digits:?}", map.name())
    });
    format!("{{\n{}\n}}\n", rows.join(",\n"))
}
