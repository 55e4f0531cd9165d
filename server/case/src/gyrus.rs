//! The coarse names of places of the brain.

use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use strum::IntoStaticStr;

use crate::PatientSide;

/// A lobe, or another large part, of the brain.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, IntoStaticStr,
)]
#[strum(serialize_all = "kebab-case")]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "kebab-case")]
pub enum Lobe {
    /// The frontal lobe.
    Frontal,
    /// The parietal lobe.
    Parietal,
    /// The temporal lobe.
    Temporal,
    /// The occipital lobe.
    Occipital,
    /// The insula.
    Insula,
    /// The cingulate gyrus.
    Cingulate,
    /// Nuclei below the cortex.
    Deep,
    /// The cerebellum.
    Cerebellum,
}

/// A gyrus, or another structure, of either side. Its form in JSON and CSV is a stable word such as `heschl-gyrus`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Gyrus(u8);

/// Each with its word, its lobe, and how AAL begins the names of its labels.
const GYRI: [(&str, Lobe, &str); 47] = [
    ("precentral-gyrus", Lobe::Frontal, "Precentral"),
    ("superior-frontal-gyrus", Lobe::Frontal, "Frontal_Sup"),
    (
        "superior-frontal-gyrus-orbital",
        Lobe::Frontal,
        "Frontal_Sup_Orb",
    ),
    (
        "superior-frontal-gyrus-medial",
        Lobe::Frontal,
        "Frontal_Sup_Medial",
    ),
    ("medial-orbital-gyrus", Lobe::Frontal, "Frontal_Med_Orb"),
    ("middle-frontal-gyrus", Lobe::Frontal, "Frontal_Mid"),
    (
        "middle-frontal-gyrus-orbital",
        Lobe::Frontal,
        "Frontal_Mid_Orb",
    ),
    (
        "inferior-frontal-gyrus-opercular",
        Lobe::Frontal,
        "Frontal_Inf_Oper",
    ),
    (
        "inferior-frontal-gyrus-triangular",
        Lobe::Frontal,
        "Frontal_Inf_Tri",
    ),
    (
        "inferior-frontal-gyrus-orbital",
        Lobe::Frontal,
        "Frontal_Inf_Orb",
    ),
    ("rolandic-operculum", Lobe::Frontal, "Rolandic_Oper"),
    ("supplementary-motor-area", Lobe::Frontal, "Supp_Motor_Area"),
    ("olfactory-cortex", Lobe::Frontal, "Olfactory"),
    ("gyrus-rectus", Lobe::Frontal, "Rectus"),
    ("paracentral-lobule", Lobe::Frontal, "Paracentral_Lobule"),
    ("postcentral-gyrus", Lobe::Parietal, "Postcentral"),
    ("superior-parietal-gyrus", Lobe::Parietal, "Parietal_Sup"),
    ("inferior-parietal-gyrus", Lobe::Parietal, "Parietal_Inf"),
    ("supramarginal-gyrus", Lobe::Parietal, "SupraMarginal"),
    ("angular-gyrus", Lobe::Parietal, "Angular"),
    ("precuneus", Lobe::Parietal, "Precuneus"),
    ("heschl-gyrus", Lobe::Temporal, "Heschl"),
    ("superior-temporal-gyrus", Lobe::Temporal, "Temporal_Sup"),
    ("middle-temporal-gyrus", Lobe::Temporal, "Temporal_Mid"),
    ("inferior-temporal-gyrus", Lobe::Temporal, "Temporal_Inf"),
    (
        "superior-temporal-pole",
        Lobe::Temporal,
        "Temporal_Pole_Sup",
    ),
    ("middle-temporal-pole", Lobe::Temporal, "Temporal_Pole_Mid"),
    ("fusiform-gyrus", Lobe::Temporal, "Fusiform"),
    ("parahippocampal-gyrus", Lobe::Temporal, "ParaHippocampal"),
    ("hippocampus", Lobe::Temporal, "Hippocampus"),
    ("amygdala", Lobe::Temporal, "Amygdala"),
    ("calcarine-cortex", Lobe::Occipital, "Calcarine"),
    ("cuneus", Lobe::Occipital, "Cuneus"),
    ("lingual-gyrus", Lobe::Occipital, "Lingual"),
    ("superior-occipital-gyrus", Lobe::Occipital, "Occipital_Sup"),
    ("middle-occipital-gyrus", Lobe::Occipital, "Occipital_Mid"),
    ("inferior-occipital-gyrus", Lobe::Occipital, "Occipital_Inf"),
    ("insula", Lobe::Insula, "Insula"),
    ("anterior-cingulate-gyrus", Lobe::Cingulate, "Cingulum_Ant"),
    ("middle-cingulate-gyrus", Lobe::Cingulate, "Cingulum_Mid"),
    (
        "posterior-cingulate-gyrus",
        Lobe::Cingulate,
        "Cingulum_Post",
    ),
    ("caudate-nucleus", Lobe::Deep, "Caudate"),
    ("putamen", Lobe::Deep, "Putamen"),
    ("pallidum", Lobe::Deep, "Pallidum"),
    ("thalamus", Lobe::Deep, "Thalamus"),
    ("cerebellum", Lobe::Cerebellum, "Cerebelum"),
    ("cerebellar-vermis", Lobe::Cerebellum, "Vermis"),
];

impl Gyrus {
    /// All of them, lobe by lobe.
    pub fn all() -> impl Iterator<Item = Self> {
        (0..GYRI.len() as u8).map(Self)
    }

    /// The word in JSON and CSV.
    pub fn name(self) -> &'static str {
        GYRI[usize::from(self.0)].0
    }

    /// The gyrus of a word.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::all().find(|gyrus| gyrus.name() == name)
    }

    /// The lobe that it belongs to.
    pub fn lobe(self) -> Lobe {
        GYRI[usize::from(self.0)].1
    }

    /// The gyrus and the side of a name of AAL, such as `Heschl_L`. The vermis lies in the middle.
    ///
    /// Source: Tzourio-Mazoyer et al., "Automated anatomical labeling of activations in SPM using a macroscopic anatomical
    /// parcellation of the MNI MRI single-subject brain", NeuroImage 15, 2002.
    pub fn from_aal(name: &str) -> Option<(Self, PatientSide)> {
        let (name, side) = match name.rsplit_once('_') {
            Some((name, "L")) => (name, PatientSide::Left),
            Some((name, "R")) => (name, PatientSide::Right),
            _ => (name, PatientSide::Middle),
        };
        let is_middle = side == PatientSide::Middle;
        let found = Self::all().find(|gyrus| match GYRI[usize::from(gyrus.0)].2 {
            // Their lobules have labels of their own.
            part @ "Vermis" => is_middle && name.starts_with(part),
            part @ "Cerebelum" => !is_middle && name.starts_with(part),
            whole => !is_middle && name == whole,
        });
        Some((found?, side))
    }
}

impl Serialize for Gyrus {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.name())
    }
}

impl<'de> Deserialize<'de> for Gyrus {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let name = String::deserialize(deserializer)?;
        Self::from_name(&name).ok_or_else(|| D::Error::custom("is not the name of a gyrus"))
    }
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;

    use super::*;

    #[test]
    fn every_word_is_its_own_and_leads_back() {
        let words: HashSet<_> = Gyrus::all().map(Gyrus::name).collect();
        assert_eq!(words.len(), GYRI.len());
        for gyrus in Gyrus::all() {
            let json = serde_json::to_string(&gyrus).unwrap();
            assert_eq!(serde_json::from_str::<Gyrus>(&json).unwrap(), gyrus);
        }
        assert!(serde_json::from_str::<Gyrus>("\"nose\"").is_err());
    }

    #[test]
    fn names_of_aal_are_understood_and_no_others() {
        let of = |name| Gyrus::from_aal(name).map(|(gyrus, side)| (gyrus.name(), side));
        let (left, right, middle) = (PatientSide::Left, PatientSide::Right, PatientSide::Middle);
        assert_eq!(of("Heschl_L"), Some(("heschl-gyrus", left)));
        assert_eq!(
            of("Frontal_Sup_Orb_R"),
            Some(("superior-frontal-gyrus-orbital", right))
        );
        assert_eq!(of("Cerebelum_Crus1_L"), Some(("cerebellum", left)));
        assert_eq!(of("Cerebelum_4_5_R"), Some(("cerebellum", right)));
        assert_eq!(of("Vermis_4_5"), Some(("cerebellar-vermis", middle)));
        for foreign in [
            "Heschl",
            "Frontal_Sup_2_L",
            "G_and_S_frontomargin_L",
            "",
            "_L",
        ] {
            assert_eq!(of(foreign), None, "{foreign}");
        }
        assert_eq!(
            Gyrus::from_name("heschl-gyrus").unwrap().lobe(),
            Lobe::Temporal
        );
    }
}
