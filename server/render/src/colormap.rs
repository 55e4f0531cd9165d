//! Colours for brightness.

mod viridis;

use std::str::FromStr;

use crate::RenderError;

/// How brightness, 0 to 255, becomes a colour.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "lowercase"))]
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
}

impl ColorMap {
    /// All of them.
    pub const ALL: [Self; 5] = [
        Self::Grey,
        Self::Inverted,
        Self::Hot,
        Self::Viridis,
        Self::Bone,
    ];

    /// The name in the interfaces: `grey`, `inverted`, `hot`, `viridis`, `bone`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Grey => "grey",
            Self::Inverted => "inverted",
            Self::Hot => "hot",
            Self::Viridis => "viridis",
            Self::Bone => "bone",
        }
    }

    /// Whether red, green and blue are the same throughout, so that one byte a pixel is enough.
    pub fn is_grey(self) -> bool {
        matches!(self, Self::Grey | Self::Inverted)
    }

    /// The 256 colours from black to white brightness, as red, green, blue.
    ///
    /// `hot` and `bone` are MATLAB's, in closed form: hot rises in red, then green, then blue over 3/8, 3/8 and 2/8 of the
    /// range; bone is 7 parts grey and 1 part hot with red and blue exchanged. `viridis` is by N. J. Smith, S. van der Walt and E. Firing,
    /// given to the public domain (CC0), <https://bids.github.io/colormap/>.
    pub fn table(self) -> [[u8; 3]; 256] {
        match self {
            Self::Grey => table_of(|level| [level; 3]),
            Self::Inverted => table_of(|level| [1.0 - level; 3]),
            Self::Hot => table_of(hot),
            Self::Viridis => viridis::TABLE,
            Self::Bone => table_of(bone),
        }
    }
}

impl FromStr for ColorMap {
    type Err = RenderError;

    fn from_str(name: &str) -> Result<Self, RenderError> {
        Self::ALL
            .into_iter()
            .find(|map| map.name() == name)
            .ok_or(RenderError::UnknownName {
                name: "colormap",
                known: "grey, inverted, hot, viridis, bone",
            })
    }
}

/// A table of colours given as shares of red, green and blue for levels of 0 to 1.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_map_but_the_inverted_gets_brighter_all_the_way() {
        let luma = |[red, green, blue]: [u8; 3]| {
            2126 * u32::from(red) + 7152 * u32::from(green) + 722 * u32::from(blue)
        };
        for map in ColorMap::ALL {
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
        // Viridis at its ends and middle: 0.267004, 0.004874, 0.329415; 0.127568, 0.566949, 0.550556; 0.993248, 0.906157, 0.143936.
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

    #[test]
    fn maps_are_known_by_name() {
        for map in ColorMap::ALL {
            assert_eq!(map.name().parse(), Ok(map));
        }
        assert!("jet".parse::<ColorMap>().is_err());
    }
}
