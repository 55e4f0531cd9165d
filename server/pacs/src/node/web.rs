//! A node by DICOMweb (PS3.18 §10.4 WADO-RS, §10.5 STOW-RS, §10.6 QIDO-RS). Redirections are not followed.

use std::fmt;
use std::time::Duration;

use axum::http::{HeaderValue, Request, Response, StatusCode, Uri, header};
use base64::Engine as _;
use base64::prelude::BASE64_STANDARD;
use bytes::Bytes;
use case::series::{SeriesUids, Uid};
use http_body_util::{BodyExt as _, Full, Limited};
use hyper::body::Incoming;
use serde_json::Value;

use super::error::{BadNode, NodeError};
use crate::multipart::boundary_of;
use http::client::{HttpClient, http_client};
use http::negotiate::MediaType;

/// How long to wait for the head of an answer: an archive may fetch a series from a tape first.
const ANSWER: Duration = Duration::from_secs(120);

/// How long to wait for the answer to a test.
const TEST: Duration = Duration::from_secs(20);

/// The largest answer to a query.
const MAX_QUERY_BYTES: usize = 4 << 20;

/// How long to wait until an object is stored.
const SEND: Duration = Duration::from_secs(600);

const DICOM: &str = "application/dicom";

const DICOM_JSON: &str = "application/dicom+json";

/// Credentials for a node; hidden in `Debug`.
#[derive(Clone, PartialEq, Eq)]
pub enum Credentials {
    /// Not at all.
    None,
    /// By name and password.
    Basic(String, String),
    /// By a token.
    Bearer(String),
}

impl fmt::Debug for Credentials {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("Credentials(…)")
    }
}

/// A DICOMweb server. Cheap to clone.
#[derive(Clone)]
pub struct WebNode {
    /// Without a slash at its end.
    base: String,
    authorization: Option<HeaderValue>,
    client: HttpClient,
}

impl fmt::Debug for WebNode {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("WebNode(…)")
    }
}

impl WebNode {
    /// A server with the address of its DICOMweb root.
    ///
    /// # Errors
    /// [`BadNode`].
    pub fn new(address: &str, credentials: &Credentials) -> Result<Self, BadNode> {
        check_address(address)?;
        Ok(Self {
            base: address.trim_end_matches('/').to_owned(),
            authorization: authorization(credentials)?,
            client: http_client().map_err(|_| BadNode::Roots)?,
        })
    }

    /// Searches for one study.
    pub(crate) async fn test(&self) -> Result<(), NodeError> {
        let searched = tokio::time::timeout(TEST, self.get("/studies?limit=1", DICOM_JSON)).await;
        match searched.map_err(|_elapsed| NodeError::Silent)? {
            Ok(answer) if answer.status() == StatusCode::NO_CONTENT => Ok(()),
            Ok(answer) => {
                let kind = answer.headers().get(header::CONTENT_TYPE);
                let kind = kind.and_then(|kind| MediaType::parse(kind.to_str().ok()?));
                let is_json = |kind: MediaType| kind.essence.ends_with("json");
                match kind.is_some_and(is_json) {
                    true => Ok(()),
                    false => Err(NodeError::NoDicomWeb),
                }
            }
            Err(NodeError::NotFound | NodeError::Status(405)) => Err(NodeError::NoDicomWeb),
            Err(error) => Err(error),
        }
    }

    /// How many images a series has, if the node states it.
    pub(crate) async fn count(&self, uids: &SeriesUids) -> Result<Option<usize>, NodeError> {
        let (study, series) = (uids.study.as_str(), uids.series.as_str());
        let path =
            format!("/studies/{study}/series?SeriesInstanceUID={series}&includefield=00201209");
        let answer = match self.get(&path, DICOM_JSON).await {
            Ok(answer) => answer,
            // A node that cannot search may have the series nevertheless.
            Err(NodeError::Status(400..=499)) => return Ok(None),
            Err(error) => return Err(error),
        };
        if answer.status() == StatusCode::NO_CONTENT {
            return Err(NodeError::NotFound);
        }
        let body = Limited::new(answer.into_body(), MAX_QUERY_BYTES).collect();
        let body = tokio::time::timeout(ANSWER, body).await;
        let body = body.map_err(|_elapsed| NodeError::Silent)?;
        let body = body.map_err(|_| NodeError::Unreadable)?.to_bytes();
        let found: Vec<Value> = serde_json::from_slice(&body).map_err(|_| NodeError::Unreadable)?;
        let is_wanted = |item: &&Value| value(item, "0020000E").as_deref() == Some(series);
        let item = found.iter().find(is_wanted).ok_or(NodeError::NotFound)?;
        Ok(value(item, "00201209").and_then(|count| count.parse().ok()))
    }

    /// All images of a series: the boundary of the parts, and the body.
    pub(crate) async fn series(&self, uids: &SeriesUids) -> Result<(String, Incoming), NodeError> {
        let (study, series) = (uids.study.as_str(), uids.series.as_str());
        let path = format!("/studies/{study}/series/{series}");
        let accept = "multipart/related; type=\"application/dicom\"; transfer-syntax=*";
        let answer = self.get(&path, accept).await?;
        let kind = answer.headers().get(header::CONTENT_TYPE);
        let kind = kind.and_then(|kind| MediaType::parse(kind.to_str().ok()?));
        let boundary = kind.as_ref().and_then(|kind| boundary_of(kind, DICOM));
        let boundary = boundary.ok_or(NodeError::Unreadable)?.to_owned();
        Ok((boundary, answer.into_body()))
    }

    /// Stores an object (STOW-RS). Afterwards the node has it.
    pub(crate) async fn store(&self, instance: &Uid, file: &[u8]) -> Result<(), NodeError> {
        let boundary = format!("isocortex-{}", instance.as_str());
        let head = format!("--{boundary}\r\nContent-Type: {DICOM}\r\n\r\n");
        let tail = format!("\r\n--{boundary}--\r\n");
        let body = Bytes::from([head.as_bytes(), file, tail.as_bytes()].concat());
        let kind = format!("multipart/related; type=\"{DICOM}\"; boundary=\"{boundary}\"");
        let request = Request::post(format!("{}/studies", self.base))
            .header(header::ACCEPT, DICOM_JSON)
            .header(header::CONTENT_TYPE, kind)
            .body(Full::new(body));
        let answer = self.ask(request, SEND).await?;
        let status = answer.status();
        if matches!(status.as_u16(), 404 | 405 | 410) {
            return Err(NodeError::NoStow);
        }
        if matches!(status.as_u16(), 401 | 403) {
            return Err(refusal(status));
        }
        let body = Limited::new(answer.into_body(), MAX_QUERY_BYTES).collect();
        let body = tokio::time::timeout(ANSWER, body).await;
        let body = body.map_err(|_elapsed| NodeError::Silent)?;
        let body = body.map_or_else(|_| Bytes::new(), http_body_util::Collected::to_bytes);
        stored(status, &body, instance)
    }

    async fn get(&self, path: &str, accept: &str) -> Result<Response<Incoming>, NodeError> {
        let request = Request::get(format!("{}{path}", self.base))
            .header(header::ACCEPT, accept)
            .body(Full::default());
        let answer = self.ask(request, ANSWER).await?;
        match answer.status() {
            status if status.is_success() => Ok(answer),
            status => Err(refusal(status)),
        }
    }

    async fn ask(
        &self,
        request: Result<Request<Full<Bytes>>, axum::http::Error>,
        patience: Duration,
    ) -> Result<Response<Incoming>, NodeError> {
        let mut request = request.map_err(|_| NodeError::Unreachable)?;
        if let Some(authorization) = &self.authorization {
            let headers = request.headers_mut();
            headers.insert(header::AUTHORIZATION, authorization.clone());
        }
        let answer = tokio::time::timeout(patience, self.client.request(request)).await;
        let answer = answer.map_err(|_elapsed| NodeError::Silent)?;
        answer.map_err(|_| NodeError::Unreachable)
    }
}

fn refusal(status: StatusCode) -> NodeError {
    match status {
        StatusCode::UNAUTHORIZED | StatusCode::FORBIDDEN => NodeError::Refused,
        StatusCode::NOT_FOUND | StatusCode::GONE => NodeError::NotFound,
        status => NodeError::Status(status.as_u16()),
    }
}

/// Whether a node has stored an object, by its status and its report (PS3.18 §10.5.3), in JSON or XML. Without a report
/// that names the object, the answer is none of STOW-RS: a proxy's page for one.
fn stored(status: StatusCode, body: &[u8], instance: &Uid) -> Result<(), NodeError> {
    let report: Option<Value> = serde_json::from_slice(body).ok();
    let report = report.as_ref();
    let item_of = |sequence: &str| {
        let items = report.and_then(|report| report[sequence]["Value"].as_array());
        let is_ours = |item: &&Value| value(item, "00081155").as_deref() == Some(instance.as_str());
        items.and_then(|items| items.iter().find(is_ours))
    };
    if let Some(item) = item_of("00081198") {
        let reason = value(item, "00081197").and_then(|reason| reason.parse().ok());
        return Err(reason.map_or(NodeError::NotStoredAtAll, NodeError::NotStored));
    }
    match status {
        StatusCode::OK | StatusCode::ACCEPTED if item_of("00081199").is_some() => Ok(()),
        StatusCode::OK if report.is_none() && xml_names(body, instance) => Ok(()),
        StatusCode::OK => Err(NodeError::Unreadable),
        StatusCode::ACCEPTED | StatusCode::CONFLICT => Err(NodeError::NotStoredAtAll),
        status => Err(NodeError::Status(status.as_u16())),
    }
}

/// Whether a report in XML (PS3.19) lists an object as stored, and none as failed.
fn xml_names(body: &[u8], instance: &Uid) -> bool {
    let text = String::from_utf8_lossy(body);
    let value = format!(">{}<", instance.as_str());
    text.contains("00081199") && text.contains(&value) && !text.contains("00081198")
}

fn check_address(address: &str) -> Result<(), BadNode> {
    let uri: Uri = address.parse().map_err(|_| BadNode::Address)?;
    let authority = uri.authority().ok_or(BadNode::Address)?;
    let is_web = matches!(uri.scheme_str(), Some("http" | "https"));
    let is_plain = !authority.as_str().contains('@') && uri.query().is_none();
    (is_web && is_plain).then_some(()).ok_or(BadNode::Address)
}

fn authorization(credentials: &Credentials) -> Result<Option<HeaderValue>, BadNode> {
    let text = match credentials {
        Credentials::None => return Ok(None),
        Credentials::Basic(name, password) => {
            let both = BASE64_STANDARD.encode(format!("{name}:{password}"));
            format!("Basic {both}")
        }
        Credentials::Bearer(token) => format!("Bearer {token}"),
    };
    let mut value = HeaderValue::from_str(&text).map_err(|_| BadNode::Credentials)?;
    value.set_sensitive(true);
    Ok(Some(value))
}

/// The first value of an attribute in DICOM JSON, a text or a number.
fn value(item: &Value, tag: &str) -> Option<String> {
    match &item[tag]["Value"][0] {
        Value::String(text) => Some(text.clone()),
        Value::Number(number) => Some(number.to_string()),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_address_of_a_node_is_plain() {
        let none = Credentials::None;
        for address in [
            "http://orthanc:8042/dicom-web",
            "https://pacs.example/dcm4chee-arc/aets/DCM4CHEE/rs/",
        ] {
            let node = WebNode::new(address, &none).unwrap();
            assert!(!node.base.ends_with('/'));
        }
        for address in [
            "",
            "orthanc",
            "ftp://orthanc/",
            "http://a:b@orthanc/",
            "http://orthanc/?x=1",
        ] {
            let refused = WebNode::new(address, &none).err();
            assert_eq!(refused, Some(BadNode::Address), "{address}");
        }
    }

    #[test]
    fn credentials_are_never_shown() {
        let credentials = Credentials::Basic("alice".to_owned(), "CANARY".to_owned());
        let node = WebNode::new("http://orthanc/", &credentials).unwrap();
        let header = node.authorization.clone().unwrap();
        assert_eq!(header, "Basic YWxpY2U6Q0FOQVJZ");
        let shown = format!("{node:?} {credentials:?} {header:?}");
        assert!(
            !shown.contains("CANARY") && !shown.contains("YWxp"),
            "{shown}"
        );
        let bad = Credentials::Bearer("a\nb".to_owned());
        let refused = WebNode::new("http://orthanc/", &bad).err();
        assert_eq!(refused, Some(BadNode::Credentials));
    }

    #[test]
    fn an_object_is_stored_if_the_node_reports_so() {
        let uid = Uid::parse("2.25.7").unwrap();
        let item = |reason: u16| serde_json::json!({"00081155": {"vr": "UI", "Value": ["2.25.7"]}, "00081197": {"vr": "US", "Value": [reason]}});
        let report =
            |tag: &str, reason| serde_json::json!({tag: {"vr": "SQ", "Value": [item(reason)]}});
        let there = report("00081199", 0);
        let refused = report("00081198", 0xA900);
        let full = report("00081198", 0xA700);
        let ask = |status, report: Option<&Value>| {
            let body = report.map(Value::to_string).unwrap_or_default();
            stored(StatusCode::from_u16(status).unwrap(), body.as_bytes(), &uid)
        };
        assert_eq!(ask(200, Some(&there)), Ok(()));
        assert_eq!(ask(200, None), Err(NodeError::Unreadable));
        let nothing = serde_json::json!({});
        assert_eq!(ask(200, Some(&nothing)), Err(NodeError::Unreadable));
        let ok = |body: &str| stored(StatusCode::OK, body.as_bytes(), &uid);
        let xml = |tag: &str, uid: &str| {
            format!(
                "<NativeDicomModel><DicomAttribute tag=\"{tag}\"><Item number=\"1\"><DicomAttribute tag=\"00081155\"><Value number=\"1\">{uid}</Value></DicomAttribute></Item></DicomAttribute></NativeDicomModel>"
            )
        };
        assert_eq!(ok(&xml("00081199", "2.25.7")), Ok(()));
        for page in [
            &xml("00081199", "2.25.70"),
            &xml("00081198", "2.25.7"),
            "<html>Please log in</html>",
            "",
        ] {
            assert_eq!(ok(page), Err(NodeError::Unreadable), "{page}");
        }
        assert_eq!(ask(202, Some(&there)), Ok(()), "with a warning");
        assert_eq!(ask(200, Some(&refused)), Err(NodeError::NotStored(0xA900)));
        assert_eq!(ask(409, Some(&refused)), Err(NodeError::NotStored(0xA900)));
        assert_eq!(ask(202, None), Err(NodeError::NotStoredAtAll));
        assert_eq!(ask(409, Some(&there)), Err(NodeError::NotStoredAtAll));
        assert_eq!(ask(503, None), Err(NodeError::Status(503)));
        let passes = |answer: Result<(), NodeError>| answer.unwrap_err().may_pass();
        assert!(passes(ask(409, Some(&full))) && passes(ask(503, None)));
        assert!(!passes(ask(409, Some(&refused))) && !passes(ask(400, None)));
    }

    #[test]
    fn numbers_come_as_numbers_and_as_texts() {
        let item = serde_json::json!({"a": {"vr": "IS", "Value": [181]}, "b": {"vr": "IS", "Value": ["181"]}, "c": {"vr": "IS"}});
        assert_eq!(value(&item, "a"), value(&item, "b"));
        assert_eq!(value(&item, "c"), None);
    }
}
