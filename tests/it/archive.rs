//! A stand-in for a PACS with an archive: it holds series and answers what our client asks (QIDO-RS, WADO-RS).

use std::collections::BTreeMap;
use std::net::SocketAddr;
use std::sync::{Arc, Mutex, PoisonError};

use axum::extract::{Path, State};
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse as _, Response};
use axum::routing::get;
use axum::{Json, Router};
use serde_json::{Value, json};
use tokio::net::TcpListener;

use crate::pacs::{BOUNDARY, related};

/// The study and the series of files.
type Uids = (String, String);

type Stored = Arc<Mutex<BTreeMap<Uids, Vec<Vec<u8>>>>>;

pub(crate) struct Archive {
    stored: Stored,
    pub(crate) address: SocketAddr,
}

impl Archive {
    /// An empty one.
    pub(crate) async fn start() -> Self {
        let stored = Stored::default();
        let of_series = "/rs/studies/{study}/series/{series}";
        let routes = Router::new()
            .route("/rs/studies", get(studies))
            .route("/rs/studies/{study}/series", get(series))
            .route(of_series, get(files))
            .with_state(Arc::clone(&stored));
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let address = listener.local_addr().unwrap();
        tokio::spawn(async move { axum::serve(listener, routes).await.unwrap() });
        Self { stored, address }
    }

    /// The address of its DICOMweb root.
    pub(crate) fn root(&self) -> String {
        format!("http://{}/rs", self.address)
    }

    /// Has these files in place of those that the series had.
    pub(crate) fn hold(&self, study: &str, series: &str, files: Vec<Vec<u8>>) {
        let mut stored = self.stored.lock().unwrap_or_else(PoisonError::into_inner);
        stored.insert((study.to_owned(), series.to_owned()), files);
    }
}

/// An attribute with one value, in DICOM JSON.
fn one(vr: &str, value: impl Into<Value>) -> Value {
    let value: Value = value.into();
    json!({"vr": vr, "Value": [value]})
}

async fn studies(State(stored): State<Stored>) -> Response {
    let stored = stored.lock().unwrap_or_else(PoisonError::into_inner);
    let studies = stored
        .keys()
        .map(|(study, _)| json!({"0020000D": one("UI", study.clone())}));
    Json(studies.collect::<Vec<_>>()).into_response()
}

/// Whatever series is asked for: the client looks for its own.
async fn series(State(stored): State<Stored>, Path(study): Path<String>) -> Response {
    let stored = stored.lock().unwrap_or_else(PoisonError::into_inner);
    let of_study = stored.iter().filter(|((of, _), _)| *of == study);
    let item = |((_, series), files): (&Uids, &Vec<Vec<u8>>)| {
        let count = one("IS", files.len());
        json!({"0020000E": one("UI", series.clone()), "00201209": count})
    };
    match of_study.map(item).collect::<Vec<_>>() {
        none if none.is_empty() => StatusCode::NO_CONTENT.into_response(),
        found => Json(found).into_response(),
    }
}

async fn files(State(stored): State<Stored>, Path(uids): Path<Uids>) -> Response {
    let stored = stored.lock().unwrap_or_else(PoisonError::into_inner);
    let Some(files) = stored.get(&uids) else {
        return StatusCode::NOT_FOUND.into_response();
    };
    let kind = format!("multipart/related; type=\"application/dicom\"; boundary={BOUNDARY}");
    ([(header::CONTENT_TYPE, kind)], related(files)).into_response()
}
