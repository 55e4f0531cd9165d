//! The values of options on the command line, each with a description for `--help`.

use case::{LayerKind, MaskKind, MaskSource};
use cases::models::PathKind;
use cases::pictures::GpuUse;
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use render::choice::Renderer;
use render::{Background, ColorMap, NamedView};

use crate::logs::LogFormat;

/// A value, its name, and its description.
type Choice<T> = (T, &'static str, &'static str);

/// Parses the name of an enum value.
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
            "From the volume if it is skull-stripped; otherwise the brain is extracted",
        ),
        (
            MaskSource::Volume,
            "volume",
            "From the volume, which must be skull-stripped: its background is exactly 0",
        ),
        (
            MaskSource::Network,
            "network",
            "Extracted by the network; its weights must be installed",
        ),
        (
            MaskSource::Pruning,
            "pruning",
            "Extracted by tree pruning; `auto` becomes this if the brain must be extracted without a network",
        ),
    ])
}

/// What a mask contains.
pub(super) fn mask_kind() -> impl TypedValueParser<Value = MaskKind> {
    one_of(&[
        (
            MaskKind::Brain,
            "brain",
            "The brain; it is closed to the envelope",
        ),
        (
            MaskKind::Envelope,
            "envelope",
            "The envelope itself; it is not closed, but its largest component is kept and its holes are filled",
        ),
    ])
}

/// Whether a graphics device may draw.
pub(super) fn gpu_use() -> impl TypedValueParser<Value = GpuUse> {
    one_of(&[
        (GpuUse::Auto, "auto", "If there is a hardware GPU"),
        (
            GpuUse::Always,
            "always",
            "Also with a software driver, which is slower than the CPU renderers",
        ),
        (GpuUse::Off, "off", "Never: no driver is loaded"),
    ])
}

/// The format of log lines.
pub(super) fn log_format() -> impl TypedValueParser<Value = LogFormat> {
    one_of(&[
        (LogFormat::Text, "text", "For people"),
        (LogFormat::Json, "json", "One JSON object per line"),
    ])
}

/// The named view.
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
            "The voxels of a thin shell, on the CPU (section 3.3 of the paper)",
        ),
        (Renderer::Mesh, "mesh", "The facets of the mesh"),
        (
            Renderer::Trace,
            "trace",
            "Sphere tracing of the distance map",
        ),
    ])
}

/// The colour map.
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
        (ColorMap::Labels, "labels", "Colours in turn, for labels"),
    ])
}

/// What a layer is.
pub(super) fn layer_kind() -> impl TypedValueParser<Value = LayerKind> {
    one_of(&[
        (LayerKind::Mr, "mr", "Intensities of an MR sequence"),
        (LayerKind::Ct, "ct", "Hounsfield units of a CT"),
        (LayerKind::Pet, "pet", "Uptake in a PET"),
        (
            LayerKind::Map,
            "map",
            "Numbers that another program computed",
        ),
        (
            LayerKind::Labels,
            "labels",
            "Whole numbers that name regions; 0 is none",
        ),
    ])
}

/// The background.
pub(super) fn background() -> impl TypedValueParser<Value = Background> {
    one_of(&[
        (Background::Black, "black", "Opaque black"),
        (Background::Transparent, "transparent", "Nothing"),
    ])
}

/// The paths of the vertices of a mesh.
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
            "The gradient of the distance map: the shortest way to a depth",
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
        for kind in LayerKind::ALL {
            assert_eq!(read(layer_kind(), kind.name()), Some(kind));
        }
        assert_eq!(read(super::view(), "above"), None);
    }
}
