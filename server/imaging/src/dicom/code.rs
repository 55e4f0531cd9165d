//! The codes of what this program writes and reads.

/// A coded concept of these.
pub(super) type Code = crate::dicom::write::Code<'static>;

/// The scheme of the codes that no standard has.
pub(super) const SCHEME: &str = "99ISOCORTEX";

/// The value of [`STATE`] of a finding that was found to be normal.
pub(super) const DISMISSED: &str = "dismissed";

macro_rules! codes {
    ($($name:ident $scheme:literal $value:literal $meaning:literal)*) => { $(
        pub(super) const $name: Code = Code { value: $value, scheme: $scheme, meaning: $meaning };
    )* };
}

codes! {
    IMAGING_MEASUREMENT_REPORT "DCM" "126000" "Imaging Measurement Report"
    IMAGING_MEASUREMENTS "DCM" "126010" "Imaging Measurements"
    MEASUREMENT_GROUP "DCM" "125007" "Measurement Group"
    LANGUAGE "DCM" "121049" "Language of Content Item and Descendants"
    ENGLISH "RFC5646" "en-US" "English (United States)"
    OBSERVER_TYPE "DCM" "121005" "Observer Type"
    DEVICE "DCM" "121007" "Device"
    PERSON "DCM" "121006" "Person"
    PERSON_OBSERVER_NAME "DCM" "121008" "Person Observer Name"
    QUALITATIVE_EVALUATIONS "UMLS" "C0034375" "Qualitative Evaluations"
    CONCLUSION "DCM" "121077" "Conclusion"
    DEVICE_OBSERVER_UID "DCM" "121012" "Device Observer UID"
    PROCEDURE_REPORTED "DCM" "121058" "Procedure reported"
    MR "LN" "25056-3" "MRI unspecified body region"
    TRACKING_IDENTIFIER "DCM" "112039" "Tracking Identifier"
    TRACKING_UID "DCM" "112040" "Tracking Unique Identifier"
    FINDING_SITE "SCT" "363698007" "Finding Site"
    BRAIN "SCT" "12738006" "Brain"
    LATERALITY "SCT" "272741003" "Laterality"
    LEFT "SCT" "7771000" "Left"
    RIGHT "SCT" "24028007" "Right"
    BILATERAL "SCT" "51440002" "Bilateral"
    FRONTAL_LOBE "SCT" "83251001" "Frontal lobe"
    PARIETAL_LOBE "SCT" "16630005" "Parietal lobe"
    TEMPORAL_LOBE "SCT" "78277001" "Temporal lobe"
    OCCIPITAL_LOBE "SCT" "31065004" "Occipital lobe"
    INSULA "SCT" "36169008" "Insula"
    CEREBELLUM "SCT" "113305005" "Cerebellum"
    PRESENT "SCT" "52101004" "Present"
    ABSENT "SCT" "272519000" "Absent"
    UNDETERMINED "SCT" "373068000" "Undetermined"
    IMAGE_REGION "DCM" "111030" "Image Region"
    COMMENT "DCM" "121106" "Comment"
    MILLIMETRES "UCUM" "mm" "mm"
    SQUARE_MILLIMETRES "UCUM" "mm2" "mm2"
    LENGTH "SCT" "410668003" "Length"
    AREA "SCT" "42798000" "Area"
    DEPTH "99ISOCORTEX" "depth" "Depth below the envelope of the brain"
    KIND "99ISOCORTEX" "form" "Form of a finding"
    LABEL "99ISOCORTEX" "label" "Label"
    COLOUR "99ISOCORTEX" "colour" "Colour"
    GYRUS "99ISOCORTEX" "gyrus" "Gyrus, about, from an atlas"
    MNI152 "99ISOCORTEX" "mni152" "Position in MNI 152, about: right, anterior, superior, mm"
    TALAIRACH "99ISOCORTEX" "talairach" "Position in Talairach space, about: right, anterior, superior, mm"
    AC_PC "99ISOCORTEX" "ac-pc" "Position from the middle of AC and PC: right, anterior, superior, mm"
    MAP "99ISOCORTEX" "map" "Map in whose list it was found"
    AUTHOR "99ISOCORTEX" "author" "Author, as stated by the client"
    CASE "99ISOCORTEX" "case" "Case in whose images it was marked"
    CERTAINTY "99ISOCORTEX" "certainty" "Certainty that it is abnormal"
    STATE "99ISOCORTEX" "state" "State"
    CINGULATE_GYRUS "99ISOCORTEX" "cingulate" "Cingulate gyrus"
    DEEP_NUCLEI "99ISOCORTEX" "deep" "Deep nuclei"
    GYRUS_OF_READER "99ISOCORTEX" "gyrus-of-reader" "Gyrus, as the reader states it"
    BLUR "99ISOCORTEX" "blur" "Blurred boundary between grey and white matter"
    THICKENING "99ISOCORTEX" "thickening" "Thick cortex"
    TRANSMANTLE "99ISOCORTEX" "transmantle" "Transmantle sign"
    FLAIR "99ISOCORTEX" "flair" "Bright in FLAIR"
    SULCAL_BOTTOM "99ISOCORTEX" "sulcal_bottom" "At the bottom of a sulcus"
    SIGNED_AT "99ISOCORTEX" "signed-at" "Time of the signature in Isocortex"
    SEGMENTATION "DCM" "113076" "Segmentation"
    ANATOMICAL_STRUCTURE "SCT" "123037004" "Anatomical Structure"
    SPATIAL_CONCEPT "SCT" "309825002" "Spatial and Relational Concept"
    SELECTED_REGION "DCM" "111099" "Selected region"
    SURFACE_RENDERING "DCM" "113075" "Surface rendering"
    CURVED_REFORMATTING "DCM" "113073" "Curved multiplanar reformatting"
    SOURCE_OF_PROCESSING "DCM" "121322" "Source image for image processing operation"
    KEY_OBJECT_DESCRIPTION "DCM" "113012" "Key Object Description"
    REJECTED_FOR_QUALITY "DCM" "113001" "Rejected for Quality Reasons"
    REJECTED_FOR_SAFETY "DCM" "113037" "Rejected for Patient Safety Reasons"
    INCORRECT_WORKLIST_ENTRY "DCM" "113038" "Incorrect Modality Worklist Entry"
    RETENTION_EXPIRED "DCM" "113039" "Data Retention Policy Expired"
}
