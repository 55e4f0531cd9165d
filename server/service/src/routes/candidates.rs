//! The most blurred places of a case, and the profile through a point.

use axum::extract::State;
use std::fmt::Write as _;

use axum::http::HeaderMap;
use axum::response::Response;
use bytes::Bytes;
use glam::DVec3;
use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};

use crate::routes::asked::{CasePath, Question};
use case::{CandidateFacts, Gyrus, MapName, RegionFacts, StandardPosition, SurfaceName, Unusual};
use cases::gyri::PlaceNames;
use cases::library::{LoadedMaps, MapsState};
use cases::pictures::{MAPS_OFF, Numbers, check_count, ready, surface_version};
use cases::profile::{PointProfile, Profile, profile};
use cases::{Cases, Error};
use http::conditional::Format;
use http::negotiate::media_type;
use http::problem::AppError;
use http::query::{ApiQuery, Asked};
use pipeline::ac_pc::AcPc;
use pipeline::maps::{Judgement, MAP_FORMAT, ScoreCaveat};

const JSON: &str = "application/json";
const CSV: &str = "text/csv";

/// The most candidates in one answer.
const MAX_CANDIDATES: usize = 60;

/// The query for candidates.
#[derive(Debug, Clone, Copy, Serialize, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct CandidatesQuery {
    /// The greatest number of candidates in the answer; the highest are returned.
    #[serde(default = "default_limit")]
    #[param(minimum = 1, maximum = 60, default = 20)]
    limit: usize,
    /// Where the places are: in the cerebrum, or in all regions of the brain.
    #[serde(default)]
    #[param(inline)]
    region: RegionAsked,
    /// The map that lists the places: where the junction is blurred, where the cortex is thick, or where the newest FLAIR is
    /// bright.
    #[serde(default)]
    #[param(inline)]
    map: MapAsked,
}

/// A map that lists places.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
enum MapAsked {
    /// The junction is less sharp than around the place and on the other side.
    #[default]
    Blur,
    /// The cortex is thicker than on the other side.
    Thickness,
    /// The newest FLAIR among the layers is brighter than around the place and on the other side.
    Flair,
}

impl MapAsked {
    fn name(self) -> MapName {
        match self {
            Self::Blur => MapName::Blur,
            Self::Thickness => MapName::Thickness,
            Self::Flair => MapName::Flair,
        }
    }
}

/// The regions of the brain that are asked about.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
enum RegionAsked {
    /// The cerebrum.
    #[default]
    Cerebrum,
    /// The cerebellum, the brain stem and what is no cortex as well.
    All,
}

fn default_limit() -> usize {
    20
}

impl Asked for CandidatesQuery {
    type Values = ();

    fn checked(&self) -> Result<(), AppError> {
        Ok(check_count("limit", self.limit, 1, MAX_CANDIDATES)?)
    }
}

/// The candidates of a case.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub struct CandidateList {
    /// Highest first.
    candidates: Vec<CandidateFacts>,
    /// Whether no place of the cerebrum stands out, which means that it is `unusual`: `yes`. This does not exclude a lesion. Absent if
    /// no limit is known for the map.
    #[serde(skip_serializing_if = "Option::is_none")]
    nothing_stands_out: Option<bool>,
    /// The limits of unusual scores of this map; absent if none is known, as for `flair`, and for `thickness` with voxels above
    /// 1 mm.
    #[serde(skip_serializing_if = "Option::is_none")]
    limits: Option<LimitsView>,
    /// Why no limit is known, or why more heads without a lesion than usual exceed the limits; absent if there is nothing to say.
    #[serde(skip_serializing_if = "Option::is_none")]
    caveat: Option<CaveatView>,
    /// The regions of the brain. If they are in doubt, nothing is left out.
    regions: RegionFacts,
}

/// The limits of unusual scores, which belong to the format of the maps. Borderline places do not stand out.
#[derive(Debug, Clone, Copy, Serialize, ToSchema)]
#[schema(as = ScoreLimits)]
pub struct LimitsView {
    /// Scores above this are unusual.
    unusual_above: f32,
    /// Scores from this on are borderline.
    borderline_from: f32,
}

/// What is to be known about the scores of a map before one is believed to be unusual.
#[derive(Debug, Clone, Serialize, ToSchema)]
#[schema(as = ScoreCaveat)]
pub struct CaveatView {
    /// The sentence, in English.
    reason: String,
    /// Its stable code: `untested-flair`, `thickness-coarse-voxels`, `blur-coarse-voxels`, `interpolated` or `scores-low-contrast`.
    reason_code: &'static str,
}

impl From<ScoreCaveat> for CaveatView {
    fn from(caveat: ScoreCaveat) -> Self {
        Self {
            reason: caveat.to_string(),
            reason_code: caveat.code(),
        }
    }
}

/// Places where the junction is less sharp than in its surroundings and on the other side, the cortex thicker, or a FLAIR brighter
///
/// Most are normal: they are places to look at, and nothing is detected. Each states whether its score is higher than those
/// of heads without a lesion (unless no limit is known, which `caveat` explains), and about which gyrus it is in if an atlas is installed and the head surely fits it: a coarse name,
/// not a measurement. With that atlas it states about where it is in MNI 152 and Talairach space, and how far that may be off; and once a
/// reader has set both commissures (a finding of the kind `acpc`), where it is in their axes. The list has the cerebrum alone unless `region=all`. As JSON, or with `Accept: text/csv` as CSV.
#[utoipa::path(
    get, path = "/v1/cases/{id}/candidates", tag = "layers",
    params(("id" = String, Path, description = "The case"), CandidatesQuery),
    responses(
        (status = 200, description = "The places, highest first", content((CandidateList = "application/json"), (String = "text/csv"))),
        (status = 406, description = "Neither JSON nor CSV is accepted"),
        (status = 409, description = "The case or its maps are not ready, or the maps are undefined"),
    )
)]
pub async fn get_candidates(
    State(cases): State<Cases>,
    CasePath(id): CasePath,
    ApiQuery { asked: query, .. }: ApiQuery<CandidatesQuery>,
    request: HeaderMap,
) -> Result<Response, AppError> {
    let kind = media_type(&request, &[JSON, CSV])?;
    let question = Question::new(id, "candidates", &query, &request);
    let map = cases.map(&id, query.map.name()).await?;
    let facts = cases.ready(&id).await?;
    let findings = cases.findings(&id).await?;
    let ac_pc = AcPc::of(&findings.list, &facts.midsagittal);
    let names = (map.version(), cases.atlas_tag(), ac_pc);
    let format = Format::of(kind)
        .variant(format!("{kind} {names:?}"))
        .revalidated();
    let work = async |_| {
        let maps = map.maps(&cases.library, &id).await?;
        let gyri = cases.gyri(&id).await?;
        let names = PlaceNames {
            gyri: gyri.as_deref(),
            ac_pc,
        };
        let list = CandidateList::of(&maps, &names, &query);
        let body = match kind {
            CSV => list.csv().into_bytes(),
            _ => json(&list)?,
        };
        Ok(Bytes::from(body).into())
    };
    question.answer(&cases, format, work).await
}

fn json(value: &impl Serialize) -> Result<Vec<u8>, AppError> {
    serde_json::to_vec(value).map_err(|_| Error::Internal.into())
}

impl CandidateList {
    fn of(maps: &LoadedMaps, names: &PlaceNames<'_>, query: &CandidatesQuery) -> Self {
        let [in_cerebrum, elsewhere] = match query.map {
            MapAsked::Blur | MapAsked::Flair => [&maps.candidates, &maps.elsewhere],
            MapAsked::Thickness => maps.thick.each_ref(),
        };
        let Judgement { limits, caveat } = maps.judgement(query.map.name());
        let mut candidates = in_cerebrum.clone();
        if query.region == RegionAsked::All {
            candidates.extend(elsewhere);
            // Stable: of equal ones, those of the cerebrum come first.
            candidates.sort_by(|a, b| b.score.total_cmp(&a.score));
        }
        candidates.truncate(query.limit);
        Self {
            candidates: names.of_places(&candidates),
            nothing_stands_out: limits.map(|_| !in_cerebrum.iter().any(CandidateFacts::stands_out)),
            limits: limits.map(|limits| LimitsView {
                unusual_above: limits.unusual_above,
                borderline_from: limits.borderline_from,
            }),
            caveat: caveat.map(CaveatView::from),
            regions: maps.regions.clone(),
        }
    }

    fn csv(&self) -> String {
        let mut text =
            "rank,left_mm,posterior_mm,superior_mm,depth_mm,side,score,size_mm,region,unusual,gyrus,caveat,mni152,talairach,ac_pc\r\n"
                .to_owned();
        let caveat = self.caveat.as_ref().map_or("", |caveat| caveat.reason_code);
        for (rank, candidate) in (1..).zip(&self.candidates) {
            let [x, y, z] = candidate.position_in_patient;
            let [side, region, unusual, gyrus] = [
                candidate.side.name(),
                candidate.region.name(),
                candidate.unusual.map_or("", Unusual::name),
                candidate.gyrus.map_or("", Gyrus::name),
            ];
            let CandidateFacts {
                depth_mm,
                score,
                size_mm,
                ..
            } = candidate;
            let [mni152, talairach, ac_pc] = standard_fields(candidate.standard);
            let depth_mm = depth_mm.map_or(String::new(), |depth_mm| depth_mm.to_string());
            let row = format!(
                "{rank},{x},{y},{z},{depth_mm},{side},{score},{size_mm},{region},{unusual},{gyrus},{caveat},{mni152},{talairach},{ac_pc}\r\n"
            );
            text.push_str(&row);
        }
        text
    }
}

/// The fields of a CSV for a position in other heads: three numbers each, or nothing.
pub(super) fn standard_fields(standard: Option<StandardPosition>) -> [String; 3] {
    fn field(position: Option<[i32; 3]>) -> String {
        position.map_or(String::new(), |[x, y, z]| format!("{x} {y} {z}"))
    }
    let StandardPosition { atlas, ac_pc } = standard.unwrap_or_default();
    [
        field(atlas.map(|atlas| atlas.mni152)),
        field(atlas.map(|atlas| atlas.talairach)),
        field(ac_pc),
    ]
}

/// The point that a profile goes through.
#[derive(Debug, Clone, Copy, Serialize, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct ProfileQuery {
    /// LPS coordinates of a point below the envelope, in mm: `x,y,z`.
    #[param(value_type = String, example = "-38,-42,30")]
    position: Numbers<3>,
    /// The surface from which the profile begins: of the whole brain, or of a part, as for pictures. The mirrored profile of a half
    /// is that of the other half.
    #[serde(default, skip_serializing_if = "SurfaceName::is_whole")]
    #[param(inline)]
    surface: SurfaceName,
}

impl Asked for ProfileQuery {
    type Values = ();

    fn checked(&self) -> Result<(), AppError> {
        if self.position.0.iter().any(|along| along.abs() > 1e4) {
            let detail = "must be within -10000 to 10000 mm along each axis";
            return Err(AppError::out_of_range("position", detail));
        }
        Ok(())
    }
}

/// The profile through a point, and through its mirrored point
///
/// From the envelope inwards along the gradient of the depth: intensities, maps, and the width of the junction of grey
/// and white matter at the point; and about which gyrus the point is in if an atlas is installed. As JSON, or with `Accept: text/csv` the samples as CSV.
#[utoipa::path(
    get, path = "/v1/cases/{id}/profile", tag = "layers",
    params(("id" = String, Path, description = "The case"), ProfileQuery),
    responses(
        (status = 200, description = "The profiles; without maps, the values of maps are null", content((Profile = "application/json"), (String = "text/csv"))),
        (status = 400, description = "A key or value of the query is invalid, or the point is outside the envelope"),
        (status = 406, description = "Neither JSON nor CSV is accepted"),
        (status = 409, description = "The case or its maps are not ready, or it has only the surface of the whole brain: `no-surfaces`"),
        (status = 503, description = "Too much work is waiting (`busy`), or the stored upload is missing (`source-missing`)"),
    )
)]
pub async fn get_profile(
    State(cases): State<Cases>,
    CasePath(id): CasePath,
    ApiQuery { asked: query, .. }: ApiQuery<ProfileQuery>,
    request: HeaderMap,
) -> Result<Response, AppError> {
    let kind = media_type(&request, &[JSON, CSV])?;
    cases.ready(&id).await?;
    let maps = match cases.library.maps(&id).await? {
        MapsState::Ready(maps) => Ok(maps),
        MapsState::Undefined(reason) => Err(reason),
        MapsState::Off => Err(MAPS_OFF),
        MapsState::Making => return Err(Error::LayerNotReady.into()),
    };
    let question = Question::new(id, "profile", &query, &request);
    let has_maps = maps.is_ok();
    let layers = cases.layers(&id).await?;
    let ready: Vec<_> = layers.iter().filter(|layer| ready(layer).is_ok()).collect();
    let versions: Vec<_> = ready
        .iter()
        .map(|layer| format!("{} {}", layer.id, layer.name))
        .collect();
    let format = Format::of(kind)
        .variant(format!(
            "{kind} {MAP_FORMAT} {has_maps} {versions:?} {}{}",
            cases.atlas_tag(),
            surface_version(query.surface).unwrap_or_default()
        ))
        .revalidated();
    let work = async |_| {
        let models = [
            cases.surface(&id, query.surface).await?,
            cases.surface(&id, query.surface.mirrored()).await?,
        ];
        let gyri = cases.gyri(&id).await?;
        let position = DVec3::from_array(query.position.0);
        let mut layers = Vec::with_capacity(ready.len());
        for layer in ready {
            layers.push(cases.library.sampled(layer).await?);
        }
        let find = move || {
            let maps = maps.as_ref().map(|maps| &**maps).map_err(Clone::clone);
            let [own, opposite] = &models;
            profile([own, opposite], maps, &layers, gyri.as_deref(), position)
        };
        let found = cases.queue.run(find).await??;
        let body = match kind {
            CSV => csv(&found).into_bytes(),
            _ => json(&found)?,
        };
        Ok(Bytes::from(body).into())
    };
    question.answer(&cases, format, work).await
}

/// A text as a field of CSV (RFC 4180). One that a spreadsheet would compute is written with an apostrophe before it.
pub(super) fn quoted(text: &str) -> String {
    let is_computed = text.starts_with(['=', '+', '-', '@', '\t', '\r', '＝', '＋', '－', '＠']);
    let guard = if is_computed { "'" } else { "" };
    format!("\"{guard}{}\"", text.replace('"', "\"\""))
}

/// A row for each sample; undefined values are empty.
fn csv(profile: &Profile) -> String {
    let mut text = "point,distance_mm,left_mm,posterior_mm,superior_mm,depth_mm,intensity,blur,thickness,sharpness,asymmetry,\
                    intensity_asymmetry,junction"
        .to_owned();
    for layer in &profile.layers {
        let _ = write!(text, ",{}", quoted(&layer.name));
    }
    text.push_str("\r\n");
    let points = [
        ("own", Some(&profile.own)),
        ("mirrored", profile.mirrored.as_ref()),
    ];
    for (name, PointProfile { samples, .. }) in points
        .into_iter()
        .filter_map(|(name, point)| Some((name, point?)))
    {
        for sample in samples {
            let [x, y, z] = sample.position_in_patient;
            let _ = write!(text, "{name},{},{x},{y},{z}", sample.distance_mm);
            let own = [
                sample.depth_mm,
                sample.intensity,
                sample.blur,
                sample.thickness,
                sample.sharpness,
                sample.asymmetry,
                sample.intensity_asymmetry,
                sample.junction,
            ];
            for value in own.into_iter().chain(sample.layers.iter().copied()) {
                text.push(',');
                if let Some(value) = value {
                    let _ = write!(text, "{value}");
                }
            }
            text.push_str("\r\n");
        }
    }
    text
}
