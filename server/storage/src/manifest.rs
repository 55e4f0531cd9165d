//! Manifests: what is needed to submit an upload again, as an object beside its sources.
//!
//! If the rows are restored from a backup, the objects of later uploads are still there, and their manifests say what they
//! are. A manifest has no label of the case and nothing that changes after the upload. It is written and deleted as the
//! other objects of its case or layer; a deletion removes it before the sources, so that nothing brings back what was deleted.

use bytes::Bytes;
use case::images::Image;
use case::{CaseId, LayerId, LayerParameters, ObjectKind, Parameters};
use serde::{Deserialize, Serialize};

use super::{Framed, ObjectName, StoreError, frame};
use case::series::Uid;

/// What was uploaded.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Manifest {
    /// The case, or the one that the layer was added to.
    pub case: CaseId,
    /// The names of the source objects.
    sources: Vec<String>,
    pub upload: Manifested,
}

/// A case or a layer, but for its files.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Manifested {
    Case {
        /// Without the label.
        parameters: Parameters,
        /// The case of which it is a version.
        previous: Option<CaseId>,
        images: Vec<Image>,
    },
    Layer {
        id: LayerId,
        parameters: LayerParameters,
        /// The name that it was uploaded with.
        name: String,
        /// The series that it is made of, if that is known.
        series: Option<String>,
        images: Vec<Image>,
    },
}

impl Manifest {
    /// That of a case with these objects.
    pub(crate) fn of_case(
        case: CaseId,
        objects: impl IntoIterator<Item = ObjectName>,
        parameters: &Parameters,
        previous: Option<CaseId>,
        images: Vec<Image>,
    ) -> Self {
        let parameters = Parameters {
            name: None,
            ..parameters.clone()
        };
        let upload = Manifested::Case {
            parameters,
            previous,
            images,
        };
        Self::new(case, objects, upload)
    }

    /// That of a layer with these objects.
    pub(crate) fn of_layer(
        case: CaseId,
        id: LayerId,
        objects: impl IntoIterator<Item = ObjectName>,
        name: &str,
        parameters: &LayerParameters,
        series: Option<&Uid>,
        images: Vec<Image>,
    ) -> Self {
        let upload = Manifested::Layer {
            id,
            parameters: parameters.clone(),
            name: name.to_owned(),
            series: series.map(|series| series.as_str().to_owned()),
            images,
        };
        Self::new(case, objects, upload)
    }

    fn new(
        case: CaseId,
        objects: impl IntoIterator<Item = ObjectName>,
        upload: Manifested,
    ) -> Self {
        let sources = objects.into_iter().filter(|name| name.kind.is_source());
        let mut sources: Vec<_> = sources.map(|name| name.to_string()).collect();
        sources.sort();
        Self {
            case,
            sources,
            upload,
        }
    }

    /// The source objects; `None` if one has no name.
    pub fn sources(&self) -> Option<Vec<ObjectName>> {
        let parse = |name: &String| {
            let (kind, digest) = name.split_once('/')?;
            ObjectName::parse(kind, digest)
        };
        self.sources.iter().map(parse).collect()
    }

    /// It as an object.
    pub(crate) fn framed(&self) -> Result<Framed, StoreError> {
        let json = Bytes::from(serde_json::to_vec(self)?);
        Ok(frame(ObjectKind::Manifest, json))
    }
}
