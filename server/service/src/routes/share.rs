//! A case as one file: the page reduced to looking, with the answers of the server that it shows.

use std::io::{self, Write as _};

use ::report::{Language, ReportFormat, ReportQuery, ShownPatient};
use axum::Extension;
use axum::extract::State;
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::Response;
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use bytes::Bytes;
use case::findings::Finding;
use case::{CaseFacts, CaseId, SurfaceName};
use cases::{Cases, Error};
use flate2::Compression;
use flate2::write::GzEncoder;
use serde::Serialize;
use serde_json::{Value, json};

use super::bodies::Extent;
use super::cases::view_of_surface;
use super::report::ReportKeys;
use super::textures::layout;
use crate::routes::asked::CasePath;
use crate::wire::{self, Texture};
use access::audited::NamesPatient;
use access::tokens::Holder;
use http::conditional::{EntityTag, NO_STORE, REVALIDATE, Representation};
use http::negotiate::{Coding, media_type};
use http::problem::AppError;
use http::query::ApiQuery;

const HTML: &str = "text/html";

/// The most bytes of a file.
const MOST_BYTES: usize = 12_000_000;

/// An acquisition of more voxels does not fit, however well it is compressed.
const MOST_VOXELS: usize = 48 << 20;

/// The document that `make web` makes: policy, style and script; the contents of the file come at its mark.
const DOCUMENT: &str = include_str!(concat!(env!("OUT_DIR"), "/share.html"));
const MARK: &str = "<!--contents-->";

/// One file to hand on: the case to look at, without a server
///
/// An HTML file of 12 MB at most, to be opened from a disk. It runs nothing and loads nothing but what it holds: the page reduced to
/// looking, with the depth, the directions, the mirrored side, the slices, the findings and the words of the report. Its pixels are those of the
/// page. Where the acquisition is too large for the file, it has the intensities around the brain, and where those are, too, in 256
/// steps; it then states so. It names the patient, and has the label of the case, only on request; no cache may store it then.
#[utoipa::path(
    get, path = "/v1/cases/{id}/share", tag = "findings",
    params(("id" = String, Path, description = "The case"), ReportKeys),
    responses(
        (status = 200, description = "The file", content((String = "text/html"))),
        (status = 404, description = "There is no such case, or no such reading (`no-such-reading`)"),
        (status = 406, description = "HTML is not accepted"),
        (status = 409, description = "The case or its maps are not ready, or not even coarse intensities fit (`too-large-to-share`), or the reading is of somebody else and whoever asks has not signed their own (`reading-hidden`)"),
        (status = 503, description = "Too much work is waiting (`busy`), or the stored upload is missing (`source-missing`)"),
    )
)]
pub async fn get_share(
    State(cases): State<Cases>,
    CasePath(id): CasePath,
    Extension(holder): Extension<Holder>,
    ApiQuery { asked, .. }: ApiQuery<ReportKeys>,
    request: HeaderMap,
) -> Result<Response, AppError> {
    media_type(&request, &[HTML])?;
    let report = asked
        .report(&cases, &id, &holder, ReportFormat::Text)
        .await?;
    let query = report.query;
    let names_patient = query.patient;
    // It takes turns of its own.
    let (report, findings) = cases.report_and_findings(&id, report).await?;
    let words = Words {
        query,
        findings,
        report,
    };
    // What is loaded is bounded by the turns. Nothing within one takes another.
    let turn = cases.queue.turn().await?;
    let shared = Shared::gather(&cases, &id, words).await?;
    let file = turn.run(move || shared.write(MOST_BYTES)).await?;
    let body = file.ok_or_else(too_large)?;
    let mut headers = HeaderMap::new();
    let name = format!(
        "attachment; filename=\"isocortex-{}.html\"",
        &id.to_string()[..8]
    );
    headers.extend(HeaderValue::try_from(name).map(|name| (header::CONTENT_DISPOSITION, name)));
    let mut response = Representation {
        tag: EntityTag::of_bytes(&body, Coding::Identity),
        media_type: "text/html; charset=utf-8",
        coding: Coding::Identity,
        body,
        headers,
        vary: "accept",
        cache_control: if names_patient { NO_STORE } else { REVALIDATE },
    }
    .respond(&request)?;
    if names_patient {
        response.extensions_mut().insert(NamesPatient);
    }
    Ok(response)
}

fn too_large() -> AppError {
    let detail = format!(
        "the head is too large for one file of {} MB, also in 256 steps of intensity; use the report, or pictures",
        MOST_BYTES / 1_000_000
    );
    AppError::new(StatusCode::CONFLICT, "too-large-to-share", detail)
}

/// What a file says of the case.
struct Words {
    query: ReportQuery,
    findings: Vec<Finding>,
    report: Bytes,
}

/// Makes a texture, which may read all voxels: not on an async thread.
type MakeTexture = Box<dyn FnOnce() -> Texture + Send>;

/// What a file holds, before it is compressed.
struct Shared {
    id: CaseId,
    language: Language,
    /// Empty unless requested, or if the case was not created from DICOM.
    patient: String,
    /// The words of the report, as HTML.
    report: Bytes,
    case: Value,
    findings: Value,
    depths: Texture,
    /// From the best on: the first one that fits is taken.
    volumes: Vec<(VolumeForm, MakeTexture)>,
    /// The surfaces of parts of the brain, as many as fit; none if the case has only that of the whole brain.
    parts: Vec<(SurfaceName, Value, Texture)>,
}

/// Which intensities a file has, in the words of `GET …/volume`.
#[derive(Debug, Clone, Copy, Serialize)]
struct VolumeForm {
    bits: u8,
    extent: Extent,
}

impl VolumeForm {
    fn path(self) -> String {
        let extent = match self.extent {
            Extent::Envelope => "envelope",
            Extent::Whole => "whole",
        };
        format!("/volume?bits={}&extent={extent}", self.bits)
    }
}

impl Shared {
    async fn gather(cases: &Cases, id: &CaseId, words: Words) -> Result<Self, AppError> {
        let facts = cases.ready(id).await?;
        let Words {
            query,
            findings,
            report,
        } = words;
        Ok(Self {
            id: *id,
            language: query.language,
            report,
            patient: match query.patient {
                true => patient_of(cases.shown_patient(id).await?),
                false => String::new(),
            },
            case: described(cases, id, SurfaceName::Whole, query.patient).await?,
            findings: json!({ "findings": findings }),
            depths: wire::depth_texture(&cases.model(id).await?),
            volumes: volumes(cases, id, &facts).await?,
            parts: parts(cases, id, query.patient).await?,
        })
    }

    /// The file of so many bytes at most; `None` if not even the coarsest intensities fit.
    fn write(self, most_bytes: usize) -> Option<Bytes> {
        let fixed = DOCUMENT.len() + self.report.len() + self.patient.len() + ABOUT_BYTES;
        let mut room = Room(most_bytes.checked_sub(fixed)?);
        let mut answers = vec![
            room.json("", &self.case)?,
            room.json("/findings", &self.findings)?,
            room.texture("/distance", self.depths)?,
        ];
        let mut volumes = self.volumes.into_iter();
        let (volume, packed) =
            volumes.find_map(|(form, make)| Some((form, room.texture(&form.path(), make())?)))?;
        answers.push(packed);
        let parts = self.parts.into_iter().map_while(|(part, case, depths)| {
            let query = format!("?surface={}", part.name());
            let depths = room.texture(&format!("/distance{query}"), depths)?;
            Some([room.json(&query, &case)?, depths])
        });
        let mut parts: Vec<_> = parts.collect();
        // One half alone would have no other side.
        if parts.len() == 1 {
            parts.clear();
        }
        let about = json!({
            "id": self.id.to_string(),
            "language": self.language,
            "patient": self.patient,
            "volume": volume,
            "has_parts": !parts.is_empty(),
        });
        answers.extend(parts.into_iter().flatten());
        let (head, tail) = DOCUMENT.split_once(MARK)?;
        let mut file = Vec::with_capacity(most_bytes - room.0);
        file.extend_from_slice(head.as_bytes());
        file.extend_from_slice(b"<template id=\"report\">");
        file.extend_from_slice(&self.report);
        file.extend_from_slice(b"</template>");
        push_data(&mut file, "about", &in_html(&about));
        for Packed { about, base64 } in &answers {
            push_data(&mut file, "answer-about", &in_html(about));
            push_data(&mut file, "answer", base64);
        }
        file.extend_from_slice(tail.as_bytes());
        Some(file.into())
    }
}

/// Room for what a file says of itself and of its answers.
const ABOUT_BYTES: usize = 16_384;

/// An answer as a file holds it.
struct Packed {
    /// Its path below the case, its headers, and how its bytes are to be read.
    about: Value,
    base64: String,
}

/// The bytes that are left of a file.
struct Room(usize);

impl Room {
    fn json(&mut self, path: &str, value: &Value) -> Option<Packed> {
        let about = json!({ "path": path, "headers": {}, "are_differences": false });
        self.pack(about, value.to_string().as_bytes())
    }

    /// A texture; of 16 bits as differences, which are smaller.
    fn texture(&mut self, path: &str, texture: Texture) -> Option<Packed> {
        let headers = layout(&texture);
        let headers = headers.iter().map(|(name, value)| {
            let value = value.to_str().unwrap_or_default();
            (name.as_str().to_owned(), Value::from(value))
        });
        let headers: serde_json::Map<_, _> = headers.collect();
        let are_differences = texture.format != "u8";
        let bytes = texture.voxels.bytes();
        let about = json!({ "path": path, "headers": headers, "are_differences": are_differences });
        match are_differences {
            true => self.pack(about, &wire::differences(&bytes)),
            false => self.pack(about, &bytes),
        }
    }

    /// The bytes, compressed; `None` if they do not fit, and nothing of the room is taken.
    fn pack(&mut self, about: Value, bytes: &[u8]) -> Option<Packed> {
        let most = self.0 / 4 * 3;
        let mut packer = GzEncoder::new(Bounded(Vec::new(), most), Compression::default());
        packer.write_all(bytes).ok()?;
        let Bounded(packed, _) = packer.finish().ok()?;
        let base64 = STANDARD.encode(packed);
        self.0 = self.0.checked_sub(base64.len())?;
        Some(Packed { about, base64 })
    }
}

/// Bytes that may become so many and no more, so that what cannot fit is given up early.
struct Bounded(Vec<u8>, usize);

impl io::Write for Bounded {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if self.0.len() + bytes.len() > self.1 {
            return Err(io::ErrorKind::StorageFull.into());
        }
        self.0.extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Adds data that a browser neither runs nor shows.
fn push_data(file: &mut Vec<u8>, class: &str, data: &str) {
    file.extend_from_slice(format!("<script type=\"text/plain\" class=\"{class}\">").as_bytes());
    file.extend_from_slice(data.as_bytes());
    file.extend_from_slice(b"</script>\n");
}

/// A value as JSON in which no text ends the element that it is in.
fn in_html(value: &Value) -> String {
    value.to_string().replace('<', "\\u003c")
}

/// A case as `GET /v1/cases/{id}` describes it, without what leads to the server or to other cases.
async fn described(
    cases: &Cases,
    id: &CaseId,
    surface: SurfaceName,
    names_patient: bool,
) -> Result<Value, AppError> {
    let view = view_of_surface(cases, id, surface).await?;
    // By way of the text that is sent, in which numbers are as short as they are there.
    let sent = serde_json::to_vec(&view).map_err(|_| Error::Internal)?;
    let mut case: Value = serde_json::from_slice(&sent).map_err(|_| Error::Internal)?;
    if let Some(fields) = case.as_object_mut() {
        for name in ["links", "previous", "next", "expires_at"] {
            fields.remove(name);
        }
        // A label may be a name.
        if !names_patient {
            fields.insert("name".to_owned(), Value::Null);
        }
    }
    Ok(case)
}

/// The patient and the study, for people.
fn patient_of(patient: ShownPatient) -> String {
    match patient {
        ShownPatient::NotFromDicom => String::new(),
        ShownPatient::Named {
            patient, study_day, ..
        } => [Some(patient), study_day]
            .into_iter()
            .flatten()
            .collect::<Vec<_>>()
            .join(" · "),
    }
}

async fn volumes(
    cases: &Cases,
    id: &CaseId,
    facts: &CaseFacts,
) -> Result<Vec<(VolumeForm, MakeTexture)>, AppError> {
    fn of(
        bits: u8,
        extent: Extent,
        make: impl FnOnce() -> Texture + Send + 'static,
    ) -> (VolumeForm, MakeTexture) {
        (VolumeForm { bits, extent }, Box::new(make))
    }
    let model = cases.model(id).await?;
    let mut volumes = Vec::new();
    if facts.native_size.iter().product::<usize>() <= MOST_VOXELS {
        let whole = cases.whole_volume(id).await?;
        let whole = move || wire::volume_texture(whole, None);
        volumes.push(of(16, Extent::Whole, whole));
    }
    let (fine, coarse) = (model.clone(), wire::quick_range(facts));
    let fine = move || wire::volume_texture(fine, None);
    let coarse = move || wire::volume_texture(model, Some(coarse));
    volumes.push(of(16, Extent::Envelope, fine));
    volumes.push(of(8, Extent::Envelope, coarse));
    Ok(volumes)
}

async fn parts(
    cases: &Cases,
    id: &CaseId,
    names_patient: bool,
) -> Result<Vec<(SurfaceName, Value, Texture)>, AppError> {
    let mut parts = Vec::new();
    for part in [SurfaceName::Left, SurfaceName::Right, SurfaceName::Cerebrum] {
        match cases.surface(id, part).await {
            Ok(model) => parts.push((
                part,
                described(cases, id, part, names_patient).await?,
                wire::depth_texture(&model),
            )),
            Err(Error::NoSurfaces(_)) => return Ok(Vec::new()),
            Err(error) => return Err(error.into()),
        }
    }
    Ok(parts)
}

#[cfg(test)]
mod tests {
    use bytes::Bytes;

    use super::*;
    use crate::wire::Voxels;

    /// A cube of noise, which nothing makes smaller than 7.5 bits a voxel.
    fn noise(side: usize) -> Vec<u8> {
        let mut state = 1_u32;
        let next = |_| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 24) as u8
        };
        (0..side.pow(3)).map(next).collect()
    }

    fn texture(voxels: Vec<u8>, format: &'static str, side: usize) -> Texture {
        Texture {
            voxels: Voxels::Shared(Bytes::from(voxels)),
            format,
            scale: 1.0,
            offset: 0.0,
            size: [side; 3],
            patient_from_voxel: [0.0; 12],
        }
    }

    /// A case with so many voxels along each side of its acquisition and of its brain.
    fn shared(whole: usize, brain: usize) -> Shared {
        let form = |bits, extent| VolumeForm { bits, extent };
        let of = |bits, side: usize| -> MakeTexture {
            let texture = match bits {
                8 => texture(noise(side), "u8", side),
                _ => texture(
                    noise(side).into_iter().flat_map(|low| [low, 3]).collect(),
                    "u16",
                    side,
                ),
            };
            Box::new(move || texture)
        };
        Shared {
            id: CaseId::parse("0123456789abcdef0123456789abcdef").unwrap(),
            language: Language::English,
            patient: "</script><b>".into(),
            report: Bytes::from_static(b"<article></article>"),
            case: json!({}),
            findings: json!({}),
            depths: texture(vec![0; 2 * 8], "i16", 2),
            volumes: vec![
                (form(16, Extent::Whole), of(16, whole)),
                (form(16, Extent::Envelope), of(16, brain)),
                (form(8, Extent::Envelope), of(8, brain)),
            ],
            parts: [SurfaceName::Left, SurfaceName::Right]
                .map(|half| (half, json!({}), texture(vec![0; 16], "i16", 2)))
                .into(),
        }
    }

    /// The volume that a file says it has.
    fn written(shared: Shared) -> Option<String> {
        let most_bytes = DOCUMENT.len() + ABOUT_BYTES + 100_000;
        let file = shared.write(most_bytes)?;
        assert!(file.len() <= most_bytes, "{}", file.len());
        let text = std::str::from_utf8(&file).unwrap();
        assert!(text.contains("\\u003c/script>\\u003cb>") && !text.contains("</script><b>"));
        assert!(text.contains("\"has_parts\":true"));
        let (_, volume) = text.split_once("\"volume\":{").unwrap();
        Some(volume.split('}').next().unwrap().to_owned())
    }

    #[test]
    fn a_file_has_the_best_intensities_that_fit_and_says_which() {
        for ([whole, brain], expected) in [
            ([30, 20], Some("\"bits\":16,\"extent\":\"whole\"")),
            ([60, 30], Some("\"bits\":16,\"extent\":\"envelope\"")),
            // Differences of noise are larger than the noise.
            ([60, 41], Some("\"bits\":8,\"extent\":\"envelope\"")),
            ([60, 60], None),
        ] {
            let found = written(shared(whole, brain));
            assert_eq!(found.as_deref(), expected, "{whole}, {brain}");
        }
        let refusal = too_large().problem();
        assert_eq!(refusal.status, 409);
        assert!(refusal.kind.ends_with(":too-large-to-share"));
    }
}
