//! The values of options on the command line, each with a description for `--help`.

use case::{Contrast, LayerKind, MaskKind, MaskSource, VoxelValues};
use cases::dicom::Form;
use cases::settings::GpuUse;
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};

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

/// A form of a NIfTI header.
pub(super) fn form() -> impl TypedValueParser<Value = Form> {
    one_of(&[
        (
            Form::Sform,
            "sform",
            "The affine of srow_x, srow_y and srow_z",
        ),
        (Form::Qform, "qform", "The quaternion and pixdim"),
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

/// What voxels have values of.
pub(super) fn voxel_values() -> impl TypedValueParser<Value = VoxelValues> {
    let words = PossibleValuesParser::new(VoxelValues::ALL.map(VoxelValues::name));
    words.map(|word| {
        let mut all = VoxelValues::ALL.into_iter();
        all.find(|values| values.name() == word)
            .expect("clap knows the words")
    })
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

/// The contrast of a layer, if it has one.
pub(super) fn contrast() -> impl TypedValueParser<Value = Option<Contrast>> {
    one_of(&[
        (Some(Contrast::T1), "t1", "White matter is bright"),
        (Some(Contrast::T2), "t2", "Fluid is bright"),
        (
            Some(Contrast::Flair),
            "flair",
            "As T2, but fluid is dark; the newest one gets a map",
        ),
        (Some(Contrast::Other), "other", "Another contrast"),
        (None, "none", "Not known, or not MR"),
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
        for kind in LayerKind::ALL {
            assert_eq!(read(layer_kind(), kind.name()), Some(kind));
        }
        assert_eq!(read(layer_kind(), "above"), None);
        for known in Contrast::ALL {
            assert_eq!(read(contrast(), known.name()), Some(Some(known)));
        }
        assert_eq!(read(contrast(), "none"), Some(None));
    }
}
