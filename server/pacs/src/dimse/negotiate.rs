//! The negotiation of an association (PS3.8 §7.1, §9.3).

use crate::dimse::options::DimseOptions;
use dicom_ul::pdu::{
    AssociationAC, AssociationRJ, AssociationRJResult,
    AssociationRJServiceProviderPresentationReason, AssociationRJServiceUserReason,
    AssociationRJSource, AssociationRQ, PresentationContextProposed, PresentationContextResult,
    PresentationContextResultReason as Reason, UserVariableItem,
};
use imaging::dicom::write::{IMPLEMENTATION_CLASS_UID, IMPLEMENTATION_VERSION_NAME};
use imaging::dicom::{IMAGE_CLASSES, TRANSFER_SYNTAXES};

use crate::dimse::command::VERIFICATION;
use crate::dimse::counts::Rejection;
use crate::dimse::peers::Peer;
use crate::dimse::wire::MAX_PDU_LENGTH;

/// The context of all DICOM applications (PS3.7 A.2.1).
const APPLICATION_CONTEXT: &str = "1.2.840.10008.3.1.1.1";

/// Explicit VR Little Endian, in which we write.
pub(crate) const EXPLICIT: &str = TRANSFER_SYNTAXES[0];

/// Implicit VR Little Endian, which every node accepts (PS3.5 §10.1).
pub(crate) const IMPLICIT: &str = TRANSFER_SYNTAXES[1];

/// What a presentation context is for.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Context {
    pub(crate) id: u8,
    pub(crate) abstract_syntax: String,
    pub(crate) transfer_syntax: String,
}

/// An association that was accepted.
#[derive(Debug, Clone)]
pub(crate) struct Accepted {
    pub(crate) answer: AssociationAC,
    pub(crate) contexts: Vec<Context>,
}

/// Accepts a request with the title of one of these peers, if it asks for ours.
///
/// # Errors
/// Why it is rejected.
pub(crate) fn negotiate(
    request: &AssociationRQ,
    peers: &[Peer],
    options: &DimseOptions,
) -> Result<Accepted, Rejection> {
    if request.protocol_version & 1 == 0 || request.application_context_name != APPLICATION_CONTEXT
    {
        return Err(Rejection::Context);
    }
    if request.called_ae_title != options.aet {
        return Err(Rejection::CalledTitle);
    }
    if !peers
        .iter()
        .any(|peer| peer.aet == request.calling_ae_title)
    {
        return Err(Rejection::CallingTitle);
    }
    let proposed = request.presentation_contexts.iter();
    let results: Vec<_> = proposed.map(result).collect();
    let accepted = request.presentation_contexts.iter().zip(&results);
    let contexts = accepted
        .filter(|(_, result)| result.reason == Reason::Acceptance)
        .map(|(proposed, result)| Context {
            id: proposed.id,
            abstract_syntax: proposed.abstract_syntax.clone(),
            transfer_syntax: result.transfer_syntax.clone(),
        })
        .collect();
    let answer = AssociationAC {
        protocol_version: 1,
        calling_ae_title: request.calling_ae_title.clone(),
        called_ae_title: request.called_ae_title.clone(),
        application_context_name: APPLICATION_CONTEXT.to_owned(),
        presentation_contexts: results,
        user_variables: user_variables(),
    };
    Ok(Accepted { answer, contexts })
}

/// What we state about ourselves.
fn user_variables() -> Vec<UserVariableItem> {
    vec![
        UserVariableItem::MaxLength(MAX_PDU_LENGTH),
        UserVariableItem::ImplementationClassUID(IMPLEMENTATION_CLASS_UID.to_owned()),
        UserVariableItem::ImplementationVersionName(IMPLEMENTATION_VERSION_NAME.to_owned()),
    ]
}

/// A request for an association to store an object of a class.
pub(crate) fn request_to_store(
    context: u8,
    class: &str,
    calling: &str,
    called: &str,
) -> AssociationRQ {
    AssociationRQ {
        protocol_version: 1,
        calling_ae_title: calling.to_owned(),
        called_ae_title: called.to_owned(),
        application_context_name: APPLICATION_CONTEXT.to_owned(),
        presentation_contexts: vec![PresentationContextProposed {
            id: context,
            abstract_syntax: class.to_owned(),
            transfer_syntaxes: [EXPLICIT, IMPLICIT].map(str::to_owned).into(),
        }],
        user_variables: user_variables(),
    }
}

/// The answer to a request that is rejected. One beyond the limit of associations may be sent again.
pub(crate) fn rejection(why: Rejection) -> AssociationRJ {
    use AssociationRJServiceUserReason as Reason;
    let reason = match why {
        Rejection::Limit => {
            let reason = AssociationRJServiceProviderPresentationReason::LocalLimitExceeded;
            return AssociationRJ {
                result: AssociationRJResult::Transient,
                source: AssociationRJSource::ServiceProviderPresentation(reason),
            };
        }
        Rejection::Context => Reason::ApplicationContextNameNotSupported,
        Rejection::CalledTitle => Reason::CalledAETitleNotRecognized,
        Rejection::CallingTitle | Rejection::Address => Reason::CallingAETitleNotRecognized,
    };
    AssociationRJ {
        result: AssociationRJResult::Permanent,
        source: AssociationRJSource::ServiceUser(reason),
    }
}

/// Whether a class may be one of objects that are stored: of the standard (PS3.4 B.5), or of a manufacturer.
fn is_storage(class: &str) -> bool {
    let standard = class.strip_prefix("1.2.840.10008.");
    standard.is_none_or(|rest| rest.starts_with("5.1.4.1.1."))
}

/// The first of our transfer syntaxes that is proposed for a class that we know; any syntax of an object that is not kept.
fn result(proposed: &PresentationContextProposed) -> PresentationContextResult {
    let class = proposed.abstract_syntax.trim_end_matches('\0');
    let ours: &[&str] = match class {
        VERIFICATION => &TRANSFER_SYNTAXES[..2],
        class if IMAGE_CLASSES.contains(&class) => &TRANSFER_SYNTAXES,
        _ => &[],
    };
    if ours.is_empty()
        && is_storage(class)
        && let Some(syntax) = proposed.transfer_syntaxes.first()
    {
        return PresentationContextResult {
            id: proposed.id,
            reason: Reason::Acceptance,
            transfer_syntax: syntax.clone(),
        };
    }
    let is_proposed = |ours: &&&str| {
        let mut proposed = proposed.transfer_syntaxes.iter();
        proposed.any(|syntax| syntax.trim_end_matches('\0') == **ours)
    };
    let (reason, syntax) = match (ours, ours.iter().find(is_proposed)) {
        ([], _) => (Reason::AbstractSyntaxNotSupported, IMPLICIT),
        (_, None) => (Reason::TransferSyntaxesNotSupported, IMPLICIT),
        (_, Some(syntax)) => (Reason::Acceptance, *syntax),
    };
    PresentationContextResult {
        id: proposed.id,
        reason,
        transfer_syntax: syntax.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MR: &str = "1.2.840.10008.5.1.4.1.1.4";

    fn negotiated(request: &AssociationRQ) -> Result<Accepted, Rejection> {
        negotiate(request, &[peer("SENDER")], &options())
    }

    fn peer(aet: &str) -> Peer {
        Peer {
            aet: aet.to_owned(),
            address: [127, 0, 0, 1].into(),
            may_reject: false,
        }
    }

    fn options() -> DimseOptions {
        DimseOptions {
            aet: "ISOCORTEX".to_owned(),
            ..DimseOptions::default()
        }
    }

    fn request(contexts: &[(&str, &[&str])]) -> AssociationRQ {
        let context =
            |(number, (class, syntaxes)): (usize, &(&str, &[&str]))| PresentationContextProposed {
                id: 2 * number as u8 + 1,
                abstract_syntax: (*class).to_owned(),
                transfer_syntaxes: syntaxes.iter().map(|&syntax| syntax.to_owned()).collect(),
            };
        AssociationRQ {
            protocol_version: 1,
            calling_ae_title: "SENDER".to_owned(),
            called_ae_title: "ISOCORTEX".to_owned(),
            application_context_name: APPLICATION_CONTEXT.to_owned(),
            presentation_contexts: contexts.iter().enumerate().map(context).collect(),
            user_variables: Vec::new(),
        }
    }

    #[test]
    fn images_are_accepted_in_every_syntax_that_is_read() {
        let mut contexts: Vec<(&str, &[&str])> = TRANSFER_SYNTAXES
            .iter()
            .map(|syntax| (MR, std::slice::from_ref(syntax)))
            .collect();
        contexts.push((VERIFICATION, &["1.2.840.10008.1.2"]));
        let accepted = negotiated(&request(&contexts)).unwrap();
        assert_eq!(accepted.contexts.len(), TRANSFER_SYNTAXES.len() + 1);
        let others: [(&str, &[&str]); 3] = [
            (MR, &["1.2.840.10008.1.2.4.100", "1.2.840.10008.1.2.4.110"]),
            ("1.2.840.10008.5.1.4.1.2.2.1", &["1.2.840.10008.1.2"]),
            (MR, &["1.2.840.10008.1.2", "1.2.840.10008.1.2.1"]),
        ];
        let accepted = negotiated(&request(&others)).unwrap();
        let reasons = accepted.answer.presentation_contexts.iter();
        let reasons: Vec<_> = reasons.map(|result| result.reason.clone()).collect();
        assert_eq!(
            reasons,
            [
                Reason::TransferSyntaxesNotSupported,
                Reason::AbstractSyntaxNotSupported,
                Reason::Acceptance
            ]
        );
        assert_eq!(accepted.contexts[0].transfer_syntax, "1.2.840.10008.1.2.1");
        assert_eq!(accepted.contexts[0].id, 5);
        // Objects that are not kept may come in any syntax.
        let others: [(&str, &[&str]); 2] = [
            (
                "1.2.840.10008.5.1.4.1.1.104.1",
                &["1.2.840.10008.1.2.4.100"],
            ),
            ("1.3.12.2.1107.5.9.1", &["1.2.840.10008.1.2"]),
        ];
        let accepted = negotiated(&request(&others)).unwrap();
        let ids: Vec<_> = accepted.contexts.iter().map(|context| context.id).collect();
        assert_eq!(ids, [1, 3]);
    }

    #[test]
    fn strangers_are_rejected() {
        let known = request(&[]);
        assert!(negotiated(&known).is_ok());
        let refused = negotiate(&known, &[peer("OTHER")], &options());
        assert_eq!(refused.err(), Some(Rejection::CallingTitle));
        let mut other = known.clone();
        other.called_ae_title = "OTHER".to_owned();
        assert_eq!(negotiated(&other).err(), Some(Rejection::CalledTitle));
        let mut other = known;
        other.application_context_name = "1.2".to_owned();
        assert_eq!(negotiated(&other).err(), Some(Rejection::Context));
    }
}
