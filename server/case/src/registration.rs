//! The registration of two cases.

use serde::Serialize;

/// The place of another case in the patient space of a case.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct CaseRegistration {
    /// Rows of the rigid transform from the patient space of the other case to that of the case, LPS mm.
    pub case_from_other: [[f64; 4]; 4],
    /// Whether the transform can be trusted.
    pub verdict: RegistrationVerdict,
    /// Normalised mutual information where the headers place both: 1 for none, 2 for complete.
    pub nmi_before: f64,
    /// The same with the transform.
    pub nmi_after: f64,
    /// The fraction of the head that the other volume covers, 0 to 1.
    pub overlap: f64,
    /// The parts of the head are shifted to where each fits best; this is the median shift, in mm. Absent if the other
    /// volume covers too few parts.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub residual_mm: Option<f64>,
}

/// Whether the transform from one case to another can be trusted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "lowercase")]
pub enum RegistrationVerdict {
    /// Both show the same head, and fit with this transform.
    Registered,
    /// They show different heads, or do not fit: the transform aligns them only roughly.
    Rough,
}
