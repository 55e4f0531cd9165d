/// The UIDs of the transfer syntaxes that can be read, the plainest first.
pub const TRANSFER_SYNTAXES: [&str; 12] = [
    "1.2.840.10008.1.2.1",
    "1.2.840.10008.1.2",
    "1.2.840.10008.1.2.2",
    "1.2.840.10008.1.2.1.99",
    "1.2.840.10008.1.2.5",
    "1.2.840.10008.1.2.4.70",
    "1.2.840.10008.1.2.4.57",
    "1.2.840.10008.1.2.4.80",
    "1.2.840.10008.1.2.4.90",
    "1.2.840.10008.1.2.4.81",
    "1.2.840.10008.1.2.4.91",
    "1.2.840.10008.1.2.4.50",
];

/// How the elements of a data set are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Encoding {
    ImplicitLittle,
    ExplicitLittle,
    ExplicitBig,
}

/// How pixels are compressed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) enum Packing {
    Native,
    Rle,
    /// Baseline (8 bits, lossy) or lossless; its header states which.
    Jpeg,
    JpegLs,
    Jpeg2000,
    /// Not supported; the text names it in the error.
    Unsupported(&'static str),
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Syntax {
    pub(crate) encoding: Encoding,
    pub(crate) deflated: bool,
    pub(crate) packing: Packing,
}

impl Syntax {
    pub(crate) fn native(encoding: Encoding) -> Self {
        Self {
            encoding,
            deflated: false,
            packing: Packing::Native,
        }
    }

    fn packed(packing: Packing) -> Self {
        Self {
            packing,
            ..Self::native(Encoding::ExplicitLittle)
        }
    }

    /// The transfer syntax with a UID (PS3.6 table A-1), which may be padded.
    pub(crate) fn from_uid(uid: &[u8]) -> Self {
        let text = std::str::from_utf8(uid).unwrap_or_default();
        let text = text.trim_end_matches(['\0', ' ']);
        let Some(rest) = text.strip_prefix("1.2.840.10008.1.2") else {
            return Self::packed(Packing::Unsupported("a private transfer syntax"));
        };
        match rest {
            "" => Self::native(Encoding::ImplicitLittle),
            ".1" => Self::native(Encoding::ExplicitLittle),
            ".1.99" => Self {
                deflated: true,
                ..Self::native(Encoding::ExplicitLittle)
            },
            ".2" => Self::native(Encoding::ExplicitBig),
            ".5" => Self::packed(Packing::Rle),
            ".4.50" | ".4.57" | ".4.70" => Self::packed(Packing::Jpeg),
            ".4.51" => Self::packed(Packing::Unsupported("lossy JPEG of 12 bits")),
            ".4.80" | ".4.81" => Self::packed(Packing::JpegLs),
            ".4.90" | ".4.91" => Self::packed(Packing::Jpeg2000),
            ".4.110" | ".4.111" | ".4.112" => Self::packed(Packing::Unsupported("JPEG XL")),
            ".4.201" | ".4.202" | ".4.203" => {
                Self::packed(Packing::Unsupported("High-Throughput JPEG 2000"))
            }
            _ if rest.starts_with(".4.10") => Self::packed(Packing::Unsupported("a video")),
            _ => Self::packed(Packing::Unsupported("this transfer syntax")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_listed_syntax_is_read() {
        for uid in TRANSFER_SYNTAXES {
            let syntax = Syntax::from_uid(uid.as_bytes());
            assert!(!matches!(syntax.packing, Packing::Unsupported(_)), "{uid}");
        }
    }
}
