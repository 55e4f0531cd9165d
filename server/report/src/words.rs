//! The words of a report in each language.

use std::collections::HashMap;
use std::sync::LazyLock;

use crate::pictures::Through;
use case::Closed;
use case::findings::{Certainty, FindingKind};
use case::{BrainRegion, Case, Gyrus, MapName, PatientSide, QualityState, SurfaceName, Unusual};
use render::NamedView;
use serde::{Deserialize, Serialize};

/// The words of the page, from which the report takes its sentences about masks and maps.
type PageWords = LazyLock<HashMap<String, String>>;

static ENGLISH_PAGE: PageWords = LazyLock::new(|| page(include_str!("words.en.json")));
static PORTUGUESE_PAGE: PageWords = LazyLock::new(|| page(include_str!("words.pt-BR.json")));

fn page(words: &str) -> HashMap<String, String> {
    serde_json::from_str(words).expect("a table of words, which a test reads")
}

/// A language of the report.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub enum Language {
    /// English.
    #[default]
    #[serde(rename = "en")]
    English,
    /// Brazilian Portuguese.
    #[serde(rename = "pt-BR")]
    Portuguese,
}

impl Language {
    /// The tag of the language (BCP 47).
    pub fn tag(self) -> &'static str {
        match self {
            Self::English => "en",
            Self::Portuguese => "pt-BR",
        }
    }

    pub(crate) fn words(self) -> &'static Words {
        match self {
            Self::English => &ENGLISH,
            Self::Portuguese => &PORTUGUESE,
        }
    }
}

/// The words of a report.
#[derive(Debug)]
pub(crate) struct Words {
    pub(crate) title: &'static str,
    pub(crate) notice: &'static str,
    pub(crate) made_by: &'static str,
    pub(crate) case: &'static str,
    pub(crate) patient: &'static str,
    pub(crate) not_from_dicom: &'static str,
    pub(crate) study_of: &'static str,
    pub(crate) accession_number: &'static str,
    pub(crate) acquisition: &'static str,
    pub(crate) unknown: &'static str,
    pub(crate) voxels: &'static str,
    pub(crate) mask: &'static str,
    /// The name of what the letters of directions mean.
    pub(crate) letters: &'static str,
    states: [&'static str; 3],
    /// Why the case is closed: corrected, rejected.
    closed: [&'static str; 2],
    pub(crate) finding: &'static str,
    pub(crate) no_findings: &'static str,
    pub(crate) dismissed: &'static str,
    pub(crate) overview: &'static str,
    pub(crate) overview_of_map: &'static str,
    pub(crate) no_maps: &'static str,
    pub(crate) conclusion: &'static str,
    pub(crate) appendix: &'static str,
    /// How many places of a map stand out, and how many of them are no findings.
    standing_out: &'static str,
    pub(crate) candidates: &'static str,
    pub(crate) candidates_note: &'static str,
    pub(crate) others: &'static str,
    pub(crate) elsewhere: &'static str,
    pub(crate) elsewhere_note: &'static str,
    pub(crate) rank: &'static str,
    pub(crate) side: &'static str,
    sides: [&'static str; 4],
    pub(crate) depth: &'static str,
    pub(crate) position: &'static str,
    pub(crate) score: &'static str,
    pub(crate) unusual: &'static str,
    unusuals: [&'static str; 3],
    pub(crate) size: &'static str,
    pub(crate) map_of: &'static str,
    pub(crate) region: &'static str,
    regions: [&'static str; 4],
    pub(crate) kind: &'static str,
    kinds: [&'static str; 5],
    /// The position in an atlas, and that in the axes of the commissures.
    pub(crate) atlas: &'static str,
    pub(crate) ac_pc: &'static str,
    pub(crate) length: &'static str,
    pub(crate) entry: &'static str,
    pub(crate) target: &'static str,
    pub(crate) area: &'static str,
    pub(crate) certainty: &'static str,
    certainties: [&'static str; 4],
    /// Of a finding that was taken over.
    pub(crate) unconfirmed: &'static str,
    pub(crate) label: &'static str,
    pub(crate) may_lie_elsewhere: &'static str,
    pub(crate) author: &'static str,
    pub(crate) reader: &'static str,
    pub(crate) day: &'static str,
    pub(crate) signature: &'static str,
    /// With the places of a reader, a day and a time.
    pub(crate) signed: &'static str,
    pub(crate) unsigned: &'static str,
    pub(crate) here: &'static str,
    pub(crate) other_side: &'static str,
    pub(crate) intensity: &'static str,
    pub(crate) blur: &'static str,
    pub(crate) sharpness: &'static str,
    pub(crate) anatomy: &'static str,
    /// The maps of blur, of thickness and of the FLAIR.
    maps: [&'static str; 3],
    pub(crate) as_acquired: &'static str,
    pub(crate) flipped: &'static str,
    views: [&'static str; 8],
    planes: [&'static str; 3],
    across: &'static str,
    pub(crate) unprintable: &'static str,
    /// What separates the whole part of a number from its decimals.
    decimal: char,
    page: &'static PageWords,
}

impl Words {
    pub(crate) fn state(&self, state: QualityState) -> &'static str {
        self.states[state as usize]
    }

    pub(crate) fn closed(&self, why: Closed) -> &'static str {
        self.closed[why as usize]
    }

    pub(crate) fn side(&self, side: PatientSide) -> &'static str {
        self.sides[side as usize]
    }

    pub(crate) fn kind(&self, kind: FindingKind) -> &'static str {
        self.kinds[kind as usize]
    }

    pub(crate) fn certainty(&self, certainty: Certainty) -> &'static str {
        self.certainties[certainty as usize]
    }

    pub(crate) fn view(&self, view: NamedView) -> &'static str {
        self.views[view as usize]
    }

    /// The inner side of a half; `None` of what is seen from outside.
    pub(crate) fn inner_side(&self, surface: SurfaceName) -> Option<&'static str> {
        match surface {
            SurfaceName::Left => Some(self.view(NamedView::MesialLeft)),
            SurfaceName::Right => Some(self.view(NamedView::MesialRight)),
            SurfaceName::Whole | SurfaceName::Cerebrum => None,
        }
    }

    /// What the letters of the patient's directions mean: those of DICOM, in all languages.
    pub(crate) fn legend_of_letters(&self) -> &'static str {
        self.of_page("letters.legend")
    }

    pub(crate) fn region(&self, region: BrainRegion) -> &'static str {
        self.regions[region as usize]
    }

    pub(crate) fn unusual(&self, unusual: Option<Unusual>) -> &'static str {
        unusual.map_or("–", |unusual| self.unusuals[unusual as usize])
    }

    /// A reason, in the words of the page if it knows the code.
    pub(crate) fn reason<'a>(&self, code: &str, sentence: &'a str) -> &'a str
    where
        'static: 'a,
    {
        let known = self.page.get(&format!("reason.{code}"));
        known.map_or(sentence, String::as_str)
    }

    /// A number with so many decimals.
    pub(crate) fn number(&self, number: impl Into<f64>, decimals: usize) -> String {
        let text = format!("{:.decimals$}", number.into());
        text.replace('.', &self.decimal.to_string())
    }

    /// A coordinate with its side, as the page has it: `R 35.0`.
    pub(crate) fn coordinate(&self, axis: usize, mm: f64) -> String {
        let sides = ["LR", "PA", "SI"][axis];
        let side = &sides[usize::from(mm < 0.0)..][..1];
        format!("{side} {}", self.number(mm.abs(), 1))
    }

    pub(crate) fn identity(&self, case: &Case) -> String {
        case.identity_with(|day| self.of_page("case.added").replace("{day}", day))
    }

    pub(crate) fn gyrus(&self, gyrus: Gyrus) -> &'static str {
        self.of_page(&format!("gyrus.{}", gyrus.name()))
    }

    /// The name of a field of a template.
    pub(crate) fn template_field(&self, field: &str) -> &'static str {
        self.of_page(&format!("template.{field}"))
    }

    /// What a field of a template states.
    pub(crate) fn template_word(&self, field: &str, word: &str) -> &'static str {
        let kind = match field {
            "side" | "lobe" | "gyrus" | "certainty" => field,
            _ => "sign",
        };
        self.of_page(&format!("{kind}.{word}"))
    }

    /// The head of a column of gyri.
    pub(crate) fn about_gyrus(&self) -> &'static str {
        self.of_page("gyrus.about")
    }

    /// A map; those that list places have a name for sentences.
    pub(crate) fn map(&self, map: MapName) -> &'static str {
        match map {
            MapName::Blur => self.maps[0],
            MapName::Thickness => self.maps[1],
            MapName::Flair => self.maps[2],
            other => self.of_page(&format!("map.{}", other.name())),
        }
    }

    pub(crate) fn standing_out(&self, map: MapName, [all, left]: [usize; 2]) -> String {
        let text = self.standing_out.replace("{map}", self.map(map));
        text.replace("{all}", &all.to_string())
            .replace("{left}", &left.to_string())
    }

    pub(crate) fn sides_in_doubt(&self) -> &'static str {
        self.of_page("quality.sides")
    }

    pub(crate) fn nothing_stands_out(&self) -> &'static str {
        self.of_page("candidates.nothing")
    }

    pub(crate) fn thickness(&self) -> &'static str {
        self.of_page("map.thickness")
    }

    pub(crate) fn thickness_note(&self) -> &'static str {
        self.of_page("map.thickness.about")
    }

    pub(crate) fn nothing_is_thick(&self) -> &'static str {
        self.of_page("thick.nothing")
    }

    pub(crate) fn flair(&self) -> &'static str {
        self.of_page("map.flair")
    }

    pub(crate) fn flair_note(&self) -> &'static str {
        self.of_page("map.flair.about")
    }

    pub(crate) fn no_map_of_flair(&self, reason: &str) -> String {
        self.of_page("flair.undefined").replace("{reason}", reason)
    }

    pub(crate) fn doubt_of_regions(&self, reason: &str) -> String {
        self.of_page("regions.doubt").replace("{reason}", reason)
    }

    fn of_page(&self, key: &str) -> &'static str {
        let found = self.page.get(key);
        found.expect("a word of the page, which a test reads")
    }

    pub(crate) fn through(&self, through: &Through) -> String {
        match through {
            Through::Standard(plane, mm) => {
                let at = self.coordinate(plane.axis(), *mm);
                format!("{}, {at} mm", self.planes[*plane as usize])
            }
            Through::Sulcus { angles, .. } => format!("{} ({angles})", self.across),
        }
    }
}

const ENGLISH: Words = Words {
    title: "Report of a reading",
    notice: render::RESEARCH_USE_NOTICE,
    made_by: "Made by",
    case: "Case",
    patient: "Patient",
    not_from_dicom: "The case was not created from DICOM: the patient is not known.",
    study_of: "study of",
    accession_number: "accession number",
    acquisition: "Acquisition",
    unknown: "unknown",
    voxels: "voxels",
    mask: "Brain mask",
    letters: "Letters in pictures",
    states: ["nothing unusual", "CHECK IT", "NOT A BRAIN"],
    closed: [
        "CLOSED: the archive has sent other images in place of these: another patient, another place, or other pixels",
        "CLOSED: the archive has rejected these images",
    ],
    finding: "Finding",
    no_findings: "Nothing was marked.",
    dismissed: "Looked at and dismissed",
    overview: "Overview",
    overview_of_map: "Overview with the map of blur",
    no_maps: "There are no maps of this case:",
    conclusion: "Conclusion",
    appendix: "Appendix",
    standing_out: "Places of the {map} that stand out: {all}; not among the findings: {left}.",
    candidates: "Places that were not kept",
    candidates_note: "Places where the boundary between grey and white matter is less sharp than around it and on the other side. \
                      Most are normal. The score is the mean of the map over the boundary around the point, and lower where there is little \
                      boundary; at a single point the map can be higher.",
    others: "Other places",
    elsewhere: "Elsewhere in the brain",
    elsewhere_note: "In the cerebellum, in the brain stem, or where the cerebrum has no cortex. They do not count as standing out.",
    rank: "Rank",
    side: "Side",
    sides: ["left", "right", "middle", "in doubt"],
    depth: "Depth",
    position: "Position (LPS, mm)",
    score: "Score of the place (z)",
    unusual: "Stands out",
    unusuals: ["yes", "borderline", "no"],
    size: "Size",
    map_of: "Map",
    region: "Region",
    regions: ["cerebrum", "cerebellum", "brain stem", "no cortex"],
    kind: "Form",
    kinds: ["point", "line", "polygon", "trajectory", "AC–PC"],
    atlas: "MNI 152 / Talairach, about (mm)",
    ac_pc: "From the middle of AC and PC: right, front, up (mm)",
    length: "Length, straight between its points",
    entry: "Entry (LPS, mm)",
    target: "Target (LPS, mm)",
    area: "Area, in the plane that fits best",
    certainty: "Certainty",
    certainties: ["definite", "probable", "possible", "unlikely"],
    unconfirmed: "taken over from another case, its place not confirmed",
    label: "Label",
    may_lie_elsewhere: "its place was not checked",
    author: "By",
    reader: "Reader",
    day: "Day",
    signature: "Signature",
    signed: "Signed by {reader} on {day} at {time} UTC",
    unsigned: "not signed",
    here: "Here",
    other_side: "Other side",
    intensity: "Intensity",
    blur: "Blur at this point (z)",
    sharpness: "Sharpness (per mm)",
    anatomy: "T1",
    maps: ["map of blur", "map of thickness", "map of the FLAIR"],
    as_acquired: "as acquired",
    flipped: "flipped",
    views: [
        "from the left",
        "from the right",
        "from the front",
        "from behind",
        "from above",
        "from below",
        "inner side of the left hemisphere",
        "inner side of the right hemisphere",
    ],
    planes: ["axial", "coronal", "sagittal"],
    across: "across the sulcus",
    unprintable: "A character that the font of this file lacks is shown by its number in Unicode, as ‹U+1F9E0›. The report as HTML shows it.",
    decimal: '.',
    page: &ENGLISH_PAGE,
};

const PORTUGUESE: Words = Words {
    title: "Relatório de leitura",
    notice: "Somente para pesquisa. Não se destina a diagnóstico.",
    made_by: "Feito por",
    case: "Caso",
    patient: "Paciente",
    not_from_dicom: "O caso não foi criado a partir de DICOM: o paciente não é conhecido.",
    study_of: "estudo de",
    accession_number: "número de acesso",
    acquisition: "Aquisição",
    unknown: "desconhecida",
    voxels: "voxels",
    mask: "Máscara do encéfalo",
    letters: "Letras nas imagens",
    states: ["nada incomum", "VERIFIQUE", "NÃO É UM ENCÉFALO"],
    closed: [
        "ENCERRADO: o arquivo enviou outras imagens no lugar destas: outro paciente, outra posição ou outros pixels",
        "ENCERRADO: o arquivo rejeitou estas imagens",
    ],
    finding: "Achado",
    no_findings: "Nada foi marcado.",
    dismissed: "Examinados e descartados",
    overview: "Visão geral",
    overview_of_map: "Visão geral com o mapa de borramento",
    no_maps: "Não há mapas deste caso:",
    conclusion: "Conclusão",
    appendix: "Apêndice",
    standing_out: "Locais do {map} que se destacam: {all}; fora dos achados: {left}.",
    candidates: "Locais que não foram mantidos",
    candidates_note: "Locais onde o limite entre as substâncias cinzenta e branca é menos nítido do que ao redor e do outro lado. \
                      A maioria é normal. O escore é a média do mapa no limite em torno do ponto, e menor onde o limite é \
                      curto; em um único ponto, o mapa pode ser mais alto.",
    others: "Outros locais",
    elsewhere: "Em outras partes do encéfalo",
    elsewhere_note: "No cerebelo, no tronco encefálico ou onde o cérebro não tem córtex. Não contam como locais que se destacam.",
    rank: "Posição",
    side: "Lado",
    sides: ["esquerdo", "direito", "meio", "em dúvida"],
    depth: "Profundidade",
    position: "Coordenadas (LPS, mm)",
    score: "Escore do local (z)",
    unusual: "Destaca-se",
    unusuals: ["sim", "limítrofe", "não"],
    size: "Tamanho",
    map_of: "Mapa",
    region: "Região",
    regions: ["cérebro", "cerebelo", "tronco encefálico", "sem córtex"],
    kind: "Forma",
    kinds: ["ponto", "linha", "polígono", "trajetória", "CA–CP"],
    atlas: "MNI 152 / Talairach, aproximado (mm)",
    ac_pc: "A partir do meio entre CA e CP: direita, frente, cima (mm)",
    length: "Comprimento, em linha reta entre os pontos",
    entry: "Entrada (LPS, mm)",
    target: "Alvo (LPS, mm)",
    area: "Área, no plano que melhor se ajusta",
    certainty: "Certeza",
    certainties: ["definido", "provável", "possível", "improvável"],
    unconfirmed: "trazido de outro caso, lugar não confirmado",
    label: "Rótulo",
    may_lie_elsewhere: "posição não verificada",
    author: "Por",
    reader: "Leitor",
    day: "Data",
    signature: "Assinatura",
    signed: "Assinado por {reader} em {day} às {time} UTC",
    unsigned: "sem assinatura",
    here: "Aqui",
    other_side: "Outro lado",
    intensity: "Intensidade",
    blur: "Borramento neste ponto (z)",
    sharpness: "Nitidez (por mm)",
    anatomy: "T1",
    maps: ["mapa de borramento", "mapa de espessura", "mapa do FLAIR"],
    as_acquired: "como adquirido",
    flipped: "espelhado",
    views: [
        "visto da esquerda",
        "visto da direita",
        "visto de frente",
        "visto de trás",
        "visto de cima",
        "visto de baixo",
        "face medial do hemisfério esquerdo",
        "face medial do hemisfério direito",
    ],
    planes: ["axial", "coronal", "sagital"],
    across: "através do sulco",
    unprintable: "Um caractere que falta na fonte deste arquivo é indicado pelo seu número em Unicode, como ‹U+1F9E0›. O relatório em HTML o mostra.",
    decimal: ',',
    page: &PORTUGUESE_PAGE,
};

#[cfg(test)]
mod tests {
    use super::*;
    use case::readings::Template;

    #[test]
    fn the_page_has_the_sentences_that_a_report_takes_from_it() {
        for (words, nothing, reason) in [
            (&ENGLISH, "Nothing stands out.", "No white matter"),
            (&PORTUGUESE, "Nada se destaca.", "Nenhuma substância branca"),
        ] {
            assert!(words.nothing_stands_out().starts_with(nothing));
            assert!(!words.about_gyrus().is_empty() && !words.of_page("case.added").is_empty());
            for text in [
                words.sides_in_doubt(),
                words.legend_of_letters(),
                words.thickness(),
                words.thickness_note(),
                words.nothing_is_thick(),
                words.flair(),
                words.flair_note(),
            ] {
                assert!(!text.is_empty());
            }
            for map in MapName::ALL {
                assert!(!words.map(map).is_empty());
            }
            for gyrus in Gyrus::all() {
                assert!(!words.gyrus(gyrus).is_empty());
                let lobe = gyrus.lobe().into();
                assert!(!words.template_word("lobe", lobe).is_empty());
            }
            for (field, all) in [
                ("side", ["left", "right", "both"]),
                ("blur", ["present", "absent", "undetermined"]),
                ("certainty", ["definite", "probable", "unlikely"]),
            ] {
                assert!(
                    all.iter()
                        .all(|word| !words.template_word(field, word).is_empty())
                );
            }
            for field in Template::FIELDS {
                assert!(!words.template_field(field).is_empty());
            }
            assert!(words.no_map_of_flair("<reason>").contains("<reason>"));
            let doubt = words.doubt_of_regions("<reason>");
            assert!(
                doubt.contains("<reason>") && !doubt.contains('{'),
                "{doubt}"
            );
            let known = words.reason("no-white-matter", "a sentence");
            assert!(known.starts_with(reason), "{known}");
            assert_eq!(words.reason("", "a sentence"), "a sentence");
            assert_eq!(words.reason("of-later", "a sentence"), "a sentence");
        }
    }
}
