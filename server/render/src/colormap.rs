mod viridis;

use strum::IntoStaticStr;

/// The mapping from brightness, 0 to 255, to a colour.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, IntoStaticStr)]
#[strum(serialize_all = "kebab-case")]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "kebab-case"))]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[cfg_attr(feature = "openapi", schema(as = Colors))]
pub enum ColorMap {
    /// Black to white.
    #[default]
    Grey,
    /// White to black.
    Inverted,
    /// Black, red, yellow, white.
    Hot,
    /// Dark blue, green, yellow: evenly stepped for the eye and for the colour-blind.
    Viridis,
    /// Grey with a tinge of blue, like an X-ray film.
    Bone,
    /// Vermilion to yellow, for overlays with one sign: it stands out on grey for all kinds of colour vision.
    VermilionYellow,
    /// Sky blue through grey to orange, for overlays with two signs: all kinds of colour vision can distinguish the
    /// ends.
    BlueOrange,
    /// Seven colours in turn, then the same mixed with white and with black: for labels.
    Labels,
}

impl ColorMap {
    /// All of them.
    pub const ALL: [Self; 8] = [
        Self::Grey,
        Self::Inverted,
        Self::Hot,
        Self::Viridis,
        Self::Bone,
        Self::VermilionYellow,
        Self::BlueOrange,
        Self::Labels,
    ];

    /// The name in the interfaces: `grey`, `inverted`, `hot`, `viridis`, `bone`, `vermilion-yellow`, `blue-orange`,
    /// `labels`.
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// Whether the map diverges from a neutral middle: an overlay is then transparent in the middle.
    pub fn is_diverging(self) -> bool {
        matches!(self, Self::BlueOrange)
    }

    /// Whether all its colours are grey, so that one byte per pixel is enough.
    pub fn is_grey(self) -> bool {
        matches!(self, Self::Grey | Self::Inverted)
    }

    /// The 256 colours from black to white brightness, as red, green, blue.
    ///
    /// `hot` and `bone` are MATLAB's, in closed form: hot rises in red, then green, then blue over 3/8, 3/8 and 2/8 of
    /// the range; bone is 7 parts grey and 1 part hot with red and blue exchanged. `viridis` is by N. J. Smith, S. van
    /// der Walt and E. Firing, given to the public domain (CC0), <https://bids.github.io/colormap/>. The ends of
    /// `vermilion-yellow` and `blue-orange` come from the palette for all kinds of colour vision by M. Okabe and K.
    /// Ito, "Color Universal Design", 2002; between them, the colours are linear. `labels` is the same palette without
    /// black.
    pub fn table(self) -> [[u8; 3]; 256] {
        match self {
            Self::Grey => table_of(|level| [level; 3]),
            Self::Inverted => table_of(|level| [1.0 - level; 3]),
            Self::Hot => table_of(hot),
            Self::Viridis => viridis::TABLE,
            Self::Bone => table_of(bone),
            Self::VermilionYellow => table_of(|level| mixed(VERMILION, YELLOW, level)),
            Self::BlueOrange => table_of(blue_orange),
            Self::Labels => std::array::from_fn(label_color),
        }
    }
}

/// The table of a function from levels, 0 to 1, to fractions of red, green and blue.
fn table_of(color: impl Fn(f64) -> [f64; 3]) -> [[u8; 3]; 256] {
    std::array::from_fn(|index| {
        color(index as f64 / 255.0).map(|share| (255.0 * share + 0.5).floor() as u8)
    })
}

fn hot(level: f64) -> [f64; 3] {
    [
        8.0 * level / 3.0,
        (8.0 * level - 3.0) / 3.0,
        (8.0 * level - 6.0) / 2.0,
    ]
    .map(|share| share.clamp(0.0, 1.0))
}

fn bone(level: f64) -> [f64; 3] {
    let [red, green, blue] = hot(level);
    [blue, green, red].map(|tinge| (7.0 * level + tinge) / 8.0)
}

/// Four colours of Okabe and Ito, and the grey between two of them.
const VERMILION: [f64; 3] = [213.0, 94.0, 0.0];
const YELLOW: [f64; 3] = [240.0, 228.0, 66.0];
const SKY_BLUE: [f64; 3] = [86.0, 180.0, 233.0];
const ORANGE: [f64; 3] = [230.0, 159.0, 0.0];
const MIDDLE_GREY: [f64; 3] = [160.0; 3];

/// The linear mix of two colours of 0 to 255, as fractions.
fn mixed(from: [f64; 3], to: [f64; 3], part: f64) -> [f64; 3] {
    std::array::from_fn(|channel| (from[channel] + part * (to[channel] - from[channel])) / 255.0)
}

fn blue_orange(level: f64) -> [f64; 3] {
    if level < 0.5 {
        mixed(SKY_BLUE, MIDDLE_GREY, 2.0 * level)
    } else {
        mixed(MIDDLE_GREY, ORANGE, 2.0 * level - 1.0)
    }
}

/// The colours of labels: those of Okabe and Ito without black, those easy to tell apart first.
const OF_LABELS: [[f64; 3]; 7] = [
    VERMILION,
    SKY_BLUE,
    YELLOW,
    [0.0, 158.0, 115.0],
    [204.0, 121.0, 167.0],
    ORANGE,
    [0.0, 114.0, 178.0],
];

/// The colour of a label, from 1; 0 is none.
pub fn label_color(number: usize) -> [u8; 3] {
    let Some(number) = number.checked_sub(1) else {
        return [0; 3];
    };
    let own = OF_LABELS[number % OF_LABELS.len()];
    let (with, part) = match number / OF_LABELS.len() % 3 {
        0 => (own, 0.0),
        1 => ([255.0; 3], 0.5),
        _ => ([0.0; 3], 0.4),
    };
    mixed(own, with, part).map(|share| (255.0 * share + 0.5) as u8)
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;

    use super::*;

    #[test]
    fn every_map_but_the_inverted_and_the_diverging_gets_brighter_all_the_way() {
        let luma = |[red, green, blue]: [u8; 3]| {
            2126 * u32::from(red) + 7152 * u32::from(green) + 722 * u32::from(blue)
        };
        let rises = |map: &ColorMap| !map.is_diverging() && *map != ColorMap::Labels;
        for map in ColorMap::ALL.into_iter().filter(rises) {
            let mut table = map.table();
            if map == ColorMap::Inverted {
                table.reverse();
            }
            assert!(
                // Rounded to 8 bits, neighbours may stand in the wrong order.
                table.windows(5).all(|pair| luma(pair[0]) < luma(pair[4])),
                "{map:?}"
            );
        }
    }

    #[test]
    fn tables_agree_with_their_sources() {
        assert_eq!(ColorMap::Grey.table()[77], [77; 3]);
        assert_eq!(ColorMap::Inverted.table()[77], [178; 3]);
        let hot = ColorMap::Hot.table();
        assert_eq!(
            [hot[0], hot[51], hot[255]],
            [[0, 0, 0], [136, 0, 0], [255; 3]]
        );
        // Viridis at its ends and middle: 0.267004, 0.004874, 0.329415; 0.127568, 0.566949, 0.550556; 0.993248,
        // 0.906157, 0.143936.
        let viridis = ColorMap::Viridis.table();
        assert_eq!(
            [viridis[0], viridis[128], viridis[255]],
            [[68, 1, 84], [33, 145, 140], [253, 231, 37]]
        );
        // Bone is grey times 7/8 with the last eighth in blue first.
        let bone = ColorMap::Bone.table();
        assert_eq!(
            [bone[0], bone[51], bone[255]],
            [[0, 0, 0], [45, 45, 62], [255; 3]]
        );
    }

    /// What dichromats see of linear red, green and blue: F. Viénot, H. Brettel and J. D. Mollon, "Digital Video
    /// Colourmaps for Checking the Legibility of Displays by Dichromats", Color Research and Application 24, 1999; for
    /// protanopes and deuteranopes.
    const DICHROMATS: [[[f64; 3]; 3]; 2] = [
        [
            [0.11238, 0.88762, 0.0],
            [0.11238, 0.88762, 0.0],
            [0.00401, -0.00401, 1.0],
        ],
        [
            [0.29275, 0.70725, 0.0],
            [0.29275, 0.70725, 0.0],
            [-0.02234, 0.02234, 1.0],
        ],
    ];

    fn seen(by: [[f64; 3]; 3], color: [u8; 3]) -> [f64; 3] {
        let linear = color.map(|share| (f64::from(share) / 255.0).powf(2.2));
        by.map(|row| {
            let sum: f64 = (0..3).map(|channel| row[channel] * linear[channel]).sum();
            255.0 * sum.max(0.0).powf(1.0 / 2.2)
        })
    }

    #[test]
    fn dichromats_tell_the_overlays_from_grey_and_their_ends_from_one_another() {
        let distance = |a: [f64; 3], b: [f64; 3]| {
            (0..3)
                .map(|channel| (a[channel] - b[channel]).abs())
                .sum::<f64>()
        };
        for by in DICHROMATS {
            for color in ColorMap::VermilionYellow.table() {
                let color = seen(by, color);
                let grey = [color.iter().sum::<f64>() / 3.0; 3];
                assert!(distance(color, grey) > 90.0, "{color:?}");
            }
            let table = ColorMap::BlueOrange.table();
            let [blue, orange] = [table[0], table[255]].map(|color| seen(by, color));
            assert!(distance(blue, orange) > 200.0, "{blue:?} {orange:?}");
        }
    }

    #[test]
    fn twenty_one_labels_have_colours_of_their_own() {
        let table = ColorMap::Labels.table();
        assert_eq!(table[1], [213, 94, 0]);
        for number in 1..=21 {
            assert!(!table[1..number].contains(&table[number]), "{number}");
        }
        assert_eq!(table[22], table[1]);
    }

    #[test]
    fn maps_have_different_names() {
        let names: HashSet<&str> = ColorMap::ALL.into_iter().map(ColorMap::name).collect();
        assert_eq!(names.len(), ColorMap::ALL.len());
    }
}
