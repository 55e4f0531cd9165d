//! The words of the interface on the command line: each with what it means, for `--help`.

use case::{MapName, MaskKind, MaskSource};
use cases::models::PathKind;
use cases::pictures::GpuUse;
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use render::choice::Renderer;
use render::{Background, ColorMap, NamedView};

use crate::logs::LogFormat;

/// A value, its word, and what it means.
type Choice<T> = (T, &'static str, &'static str);

/// Reads one of the words of an enum.
fn one_of<T: Clone + Send + Sync + 'static>(
    choices: &'static [Choice<T>],
) -> impl TypedValueParser<Value = T> {
    let words = choices
        .iter()
        .map(|(_, word, meaning)| PossibleValue::new(*word).help(*meaning));
    PossibleValuesParser::new(words).map(move |word| {
        let choice = choices.iter().find(|(_, known, _)| *known == word);
        choice.expect("clap knows the words").0.clone()
    })
}

/// Where a mask comes from.
pub(super) fn mask_source() -> impl TypedValueParser<Value = MaskSource> {
    one_of(&[
        (
            MaskSource::Auto,
            "auto",
            "From the volume where that is skull-stripped already; else the brain is extracted",
        ),
        (
            MaskSource::Volume,
            "volume",
            "From the volume, which must be skull-stripped: its background is exactly 0",
        ),
        (
            MaskSource::Network,
            "network",
            "Extracted by the network alone, which must be there",
        ),
        (
            MaskSource::Pruning,
            "pruning",
            "Extracted by tree pruning. What `auto` becomes where the brain must be extracted and there is no network",
        ),
    ])
}

/// What a mask shows.
pub(super) fn mask_kind() -> impl TypedValueParser<Value = MaskKind> {
    one_of(&[
        (
            MaskKind::Brain,
            "brain",
            "The brain, which is closed to the envelope",
        ),
        (
            MaskKind::Envelope,
            "envelope",
            "The envelope itself: it is not closed. Its largest component is kept and its holes are filled all the same",
        ),
    ])
}

/// Whether a graphics device may draw.
pub(super) fn gpu_use() -> impl TypedValueParser<Value = GpuUse> {
    one_of(&[
        (GpuUse::Auto, "auto", "Where there is one in hardware"),
        (
            GpuUse::Always,
            "always",
            "Where there is any, even if it is a program, which is slower than the processor's own renderers",
        ),
        (GpuUse::Off, "off", "Never: no driver is loaded"),
    ])
}

/// How log lines are written.
pub(super) fn log_format() -> impl TypedValueParser<Value = LogFormat> {
    one_of(&[
        (LogFormat::Text, "text", "For people"),
        (LogFormat::Json, "json", "One JSON object a line"),
    ])
}

/// From where the head is seen.
pub(super) fn view() -> impl TypedValueParser<Value = NamedView> {
    one_of(&[
        (NamedView::Left, "left", "The patient's left side"),
        (NamedView::Right, "right", "The patient's right side"),
        (NamedView::Anterior, "anterior", "Facing the patient"),
        (NamedView::Posterior, "posterior", "From behind"),
        (NamedView::Superior, "superior", "From above"),
        (NamedView::Inferior, "inferior", "From below"),
    ])
}

/// Which renderer draws.
pub(super) fn renderer() -> impl TypedValueParser<Value = Renderer> {
    one_of(&[
        (Renderer::Auto, "auto", "The exact isosurface, as `trace`"),
        (
            Renderer::Splat,
            "splat",
            "Voxels of a thin shell, in software (the paper's section 3.3)",
        ),
        (Renderer::Mesh, "mesh", "The facets of the mesh"),
        (
            Renderer::Trace,
            "trace",
            "Sphere tracing of the distance map",
        ),
    ])
}

/// How brightness becomes a colour.
pub(super) fn colormap() -> impl TypedValueParser<Value = ColorMap> {
    one_of(&[
        (ColorMap::Grey, "grey", "Black to white"),
        (ColorMap::Inverted, "inverted", "White to black"),
        (ColorMap::Hot, "hot", "Black, red, yellow, white"),
        (ColorMap::Viridis, "viridis", "Dark blue, green, yellow"),
        (ColorMap::Bone, "bone", "Grey with a tinge of blue"),
        (
            ColorMap::VermilionYellow,
            "vermilion-yellow",
            "Vermilion to yellow, for overlays of one side",
        ),
        (
            ColorMap::BlueOrange,
            "blue-orange",
            "Sky blue through grey to orange, for overlays of two signs",
        ),
    ])
}

/// A map of the junction of grey and white matter.
pub(super) fn map() -> impl TypedValueParser<Value = MapName> {
    one_of(&[
        (
            MapName::Blur,
            "blur",
            "How much less sharp it is than around it and on the other side",
        ),
        (MapName::Sharpness, "sharpness", "How sharp it is, per mm"),
        (
            MapName::Asymmetry,
            "asymmetry",
            "How much sharper it is than on the other side",
        ),
        (
            MapName::IntensityAsymmetry,
            "intensity-asymmetry",
            "How much brighter it is than on the other side",
        ),
        (
            MapName::Junction,
            "junction",
            "The density of voxels between grey and white matter",
        ),
    ])
}

/// What is behind the brain.
pub(super) fn background() -> impl TypedValueParser<Value = Background> {
    one_of(&[
        (Background::Black, "black", "Opaque black"),
        (Background::Transparent, "transparent", "Nothing"),
    ])
}

/// What the vertices of a mesh follow.
pub(super) fn paths() -> impl TypedValueParser<Value = PathKind> {
    one_of(&[
        (
            PathKind::Forest,
            "forest",
            "The optimal paths of the second transform, as in the paper",
        ),
        (
            PathKind::Flow,
            "flow",
            "Up the gradient of the distance map: the nearest way to a depth",
        ),
    ])
}

#[cfg(test)]
mod tests {
    use clap::{Arg, Command};

    use super::*;

    /// Reads a word by a parser; `None` if it is not one of its own.
    fn read<T: Clone + Send + Sync + 'static>(
        parser: impl TypedValueParser<Value = T>,
        word: &str,
    ) -> Option<T> {
        let command = Command::new("test").arg(Arg::new("word").value_parser(parser));
        let read = command.try_get_matches_from(["test", word]).ok()?;
        read.get_one::<T>("word").cloned()
    }

    #[test]
    fn the_words_of_the_command_line_are_those_of_the_interface() {
        for view in NamedView::ALL {
            assert_eq!(read(super::view(), view.name()), Some(view));
        }
        for map in ColorMap::ALL {
            assert_eq!(read(colormap(), map.name()), Some(map));
        }
        for map in MapName::ALL {
            assert_eq!(read(super::map(), map.name()), Some(map));
        }
        assert_eq!(read(super::view(), "above"), None);
    }
}
