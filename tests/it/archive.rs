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

type Held = Arc<Mutex<BTreeMap<Uids, Vec<Vec<u8>>>>>;

pub(crate) struct Archive {
    held: Held,
    pub(crate) address: SocketAddr,
}

impl Archive {
    /// An empty one.
    pub(crate) async fn start() -> Self {
        let held = Held::default();
        let of_series = "/rs/studies/{study}/series/{series}";
        let routes = Router::new()
            .route("/rs/studies", get(studies))
            .route("/rs/studies/{study}/series", get(series))
            .route(of_series, get(files))
            .with_state(Arc::clone(&held));
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let address = listener.local_addr().unwrap();
        tokio::spawn(async move { axum::serve(listener, routes).await.unwrap() });
        Self { held, address }
    }

    /// The address of its DICOMweb root.
    pub(crate) fn root(&self) -> String {
        format!("http://{}/rs", self.address)
    }

    /// Has these files in place of those that the series had.
    pub(crate) fn hold(&self, study: &str, series: &str, files: Vec<Vec<u8>>) {
        let mut held = self.held.lock().unwrap_or_else(PoisonError::into_inner);
        held.insert((study.to_owned(), series.to_owned()), files);
    }
}

/// An attribute with one value, in DICOM JSON.
fn one(vr: &str, value: impl Into<Value>) -> Value {
    let value: Value = value.into();
    json!({"vr": vr, "Value": [value]})
}

async fn studies(State(held): State<Held>) -> Response {
    let held = held.lock().unwrap_or_else(PoisonError::into_inner);
    let studies = held
        .keys()
        .map(|(study, _)| json!({"0020000D": one("UI", study.clone())}));
    Json(studies.collect::<Vec<_>>()).into_response()
}

/// Whatever series is asked for: the client looks for its own.
async fn series(State(held): State<Held>, Path(study): Path<String>) -> Response {
    let held = held.lock().unwrap_or_else(PoisonError::into_inner);
    let of_study = held.iter().filter(|((of, _), _)| *of == study);
    let item = |((_, series), files): (&Uids, &Vec<Vec<u8>>)| {
        let count = one("IS", files.len());
        json!({"0020000E": one("UI", series.clone()), "00201209": count})
    };
    match of_study.map(item).collect::<Vec<_>>() {
        none if none.is_empty() => StatusCode::NO_CONTENT.into_response(),
        found => Json(found).into_response(),
    }
}

async fn files(State(held): State<Held>, Path(uids): Path<Uids>) -> Response {
    let held = held.lock().unwrap_or_else(PoisonError::into_inner);
    let Some(files) = held.get(&uids) else {
        return StatusCode::NOT_FOUND.into_response();
    };
    let kind = format!("multipart/related; type=\"application/dicom\"; boundary={BOUNDARY}");
    ([(header::CONTENT_TYPE, kind)], related(files)).into_response()
}
