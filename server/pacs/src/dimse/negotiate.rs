//! The negotiation of an association (PS3.8 §7.1, §9.3).

use std::net::IpAddr;

use dicom_ul::pdu::{
    AssociationAC, AssociationRJ, AssociationRJResult,
    AssociationRJServiceProviderPresentationReason, AssociationRJServiceUserReason,
    AssociationRJSource, AssociationRQ, PresentationContextProposed, PresentationContextResult,
    PresentationContextResultReason as Reason, UserVariableItem,
};
use imaging::dicom::{IMAGE_CLASSES, TRANSFER_SYNTAXES};

use super::command::VERIFICATION;
use super::options::DimseOptions;

/// The context of all DICOM applications (PS3.7 A.2.1).
const APPLICATION_CONTEXT: &str = "1.2.840.10008.3.1.1.1";

/// Our implementation, made from a UUID (PS3.5 B.2).
const IMPLEMENTATION_CLASS: &str = "2.25.128694716284019362450871639201743650912";
const IMPLEMENTATION_VERSION: &str = concat!(
    "ISOCORTEX_",
    env!("CARGO_PKG_VERSION_MAJOR"),
    "_",
    env!("CARGO_PKG_VERSION_MINOR")
);

/// The largest PDU that we accept, without its head.
pub(super) const MAX_PDU_LENGTH: u32 = 128 << 10;

/// What a presentation context is for.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Context {
    pub(super) id: u8,
    pub(super) abstract_syntax: String,
    pub(super) transfer_syntax: String,
}

/// An association that was accepted.
#[derive(Debug, Clone)]
pub(super) struct Accepted {
    pub(super) answer: AssociationAC,
    pub(super) contexts: Vec<Context>,
}

/// Accepts a request from a listed peer.
///
/// # Errors
/// The rejection.
pub(super) fn negotiate(
    request: &AssociationRQ,
    address: IpAddr,
    options: &DimseOptions,
) -> Result<Accepted, AssociationRJ> {
    if request.protocol_version & 1 == 0 || request.application_context_name != APPLICATION_CONTEXT
    {
        return Err(rejection(
            AssociationRJServiceUserReason::ApplicationContextNameNotSupported,
        ));
    }
    if request.called_ae_title != options.aet {
        return Err(rejection(
            AssociationRJServiceUserReason::CalledAETitleNotRecognized,
        ));
    }
    if !options.knows(address, Some(&request.calling_ae_title)) {
        return Err(rejection(
            AssociationRJServiceUserReason::CallingAETitleNotRecognized,
        ));
    }
    let results: Vec<_> = request.presentation_contexts.iter().map(result).collect();
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
        user_variables: vec![
            UserVariableItem::MaxLength(MAX_PDU_LENGTH),
            UserVariableItem::ImplementationClassUID(IMPLEMENTATION_CLASS.to_owned()),
            UserVariableItem::ImplementationVersionName(IMPLEMENTATION_VERSION.to_owned()),
        ],
    };
    Ok(Accepted { answer, contexts })
}

/// The rejection of a request beyond the limit of associations, which may be sent again.
pub(super) fn congestion() -> AssociationRJ {
    let reason = AssociationRJServiceProviderPresentationReason::LocalLimitExceeded;
    AssociationRJ {
        result: AssociationRJResult::Transient,
        source: AssociationRJSource::ServiceProviderPresentation(reason),
    }
}

fn rejection(reason: AssociationRJServiceUserReason) -> AssociationRJ {
    AssociationRJ {
        result: AssociationRJResult::Permanent,
        source: AssociationRJSource::ServiceUser(reason),
    }
}

/// The first of our transfer syntaxes that is proposed for a class that we know.
fn result(proposed: &PresentationContextProposed) -> PresentationContextResult {
    let class = proposed.abstract_syntax.trim_end_matches('\0');
    let ours: &[&str] = match class {
        VERIFICATION => &TRANSFER_SYNTAXES[..2],
        class if IMAGE_CLASSES.contains(&class) => &TRANSFER_SYNTAXES,
        _ => &[],
    };
    let is_proposed = |ours: &&&str| {
        let mut proposed = proposed.transfer_syntaxes.iter();
        proposed.any(|syntax| syntax.trim_end_matches('\0') == **ours)
    };
    let (reason, syntax) = match (ours, ours.iter().find(is_proposed)) {
        ([], _) => (Reason::AbstractSyntaxNotSupported, TRANSFER_SYNTAXES[1]),
        (_, None) => (Reason::TransferSyntaxesNotSupported, TRANSFER_SYNTAXES[1]),
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
    use super::super::options::Peer;
    use super::*;

    const MR: &str = "1.2.840.10008.5.1.4.1.1.4";

    fn options() -> DimseOptions {
        DimseOptions {
            aet: "ISOCORTEX".to_owned(),
            peers: vec![Peer {
                aet: "SENDER".to_owned(),
                address: [127, 0, 0, 1].into(),
            }],
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
        let local: IpAddr = [127, 0, 0, 1].into();
        let mut contexts: Vec<(&str, &[&str])> = TRANSFER_SYNTAXES
            .iter()
            .map(|syntax| (MR, std::slice::from_ref(syntax)))
            .collect();
        contexts.push((VERIFICATION, &["1.2.840.10008.1.2"]));
        let accepted = negotiate(&request(&contexts), local, &options()).unwrap();
        assert_eq!(accepted.contexts.len(), TRANSFER_SYNTAXES.len() + 1);
        let others: [(&str, &[&str]); 3] = [
            (MR, &["1.2.840.10008.1.2.4.100", "1.2.840.10008.1.2.4.110"]),
            ("1.2.840.10008.5.1.4.1.1.88.11", &["1.2.840.10008.1.2"]),
            (MR, &["1.2.840.10008.1.2", "1.2.840.10008.1.2.1"]),
        ];
        let accepted = negotiate(&request(&others), local, &options()).unwrap();
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
    }

    #[test]
    fn strangers_are_rejected() {
        let local: IpAddr = [127, 0, 0, 1].into();
        let known = request(&[]);
        assert!(negotiate(&known, local, &options()).is_ok());
        assert!(negotiate(&known, [127, 0, 0, 2].into(), &options()).is_err());
        let mut other = known.clone();
        other.calling_ae_title = "OTHER".to_owned();
        assert!(negotiate(&other, local, &options()).is_err());
        let mut other = known.clone();
        other.called_ae_title = "OTHER".to_owned();
        assert!(negotiate(&other, local, &options()).is_err());
        let mut other = known;
        other.application_context_name = "1.2".to_owned();
        assert!(negotiate(&other, local, &options()).is_err());
    }
}
