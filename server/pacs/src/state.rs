//! What the requests share.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

use access::audit::Audit;
use axum::extract::Request;
use axum::http::StatusCode;
use cases::Cases;
use jiff::tz::TimeZone;

use crate::node::Node;
use crate::series::Arrivals;
use crate::store::PacsStore;
use http::client_limit::{ClientLimit, ClientPermit};
use http::listen::client_of;
use http::problem::AppError;
use http::uploads::UploadLimits;

/// The options of the PACS interface.
#[derive(Debug)]
pub struct Options {
    /// What requests with images may take.
    pub uploads: UploadLimits,
    /// The nodes from which series are fetched and to which results are sent.
    pub nodes: Vec<Node>,
    /// Whether the page shows the patient.
    pub shows_patient: bool,
    /// The zone of the scanners' dates and times, if it is known.
    pub time_zone: Option<TimeZone>,
    /// The record of who does what.
    pub audit: Audit,
}

/// What the requests share. Cheap to clone.
#[derive(Debug, Clone)]
pub struct Pacs {
    arrivals: Arrivals,
    inner: Arc<Inner>,
}

#[derive(Debug)]
struct Inner {
    options: Options,
    room: ClientLimit,
    /// Whether each node answered when it was last asked. Held for moments.
    reached: Mutex<BTreeMap<String, bool>>,
}

impl Pacs {
    /// The PACS interface of an application.
    pub fn new(cases: Cases, options: Options) -> Self {
        let room = ClientLimit::new(options.uploads.at_a_time);
        Self {
            arrivals: Arrivals::new(cases),
            inner: Arc::new(Inner {
                options,
                room,
                reached: Mutex::default(),
            }),
        }
    }

    pub fn cases(&self) -> &Cases {
        &self.arrivals.cases
    }

    /// What comes from a PACS.
    pub fn arrivals(&self) -> &Arrivals {
        &self.arrivals
    }

    /// The store with the rows of the PACS.
    pub fn store(&self) -> &PacsStore {
        self.arrivals.store()
    }

    pub(crate) fn options(&self) -> &Options {
        &self.inner.options
    }

    /// Refuses what needs the identity of a patient, if none is kept.
    pub(crate) fn needs_identity(&self) -> Result<(), AppError> {
        match self.cases().deidentifies() {
            false => Ok(()),
            true => Err(AppError::new(
                StatusCode::UNPROCESSABLE_ENTITY,
                "deidentified",
                "this server keeps no identity of patients (`deidentify` in `[pacs]`), so it fetches nothing by UIDs and makes no results for a PACS",
            )),
        }
    }

    /// Notes whether a node answered, with whatever words.
    pub(crate) fn note(&self, node: &str, is_reached: bool) {
        let reached = self.inner.reached.lock();
        let mut reached = reached.unwrap_or_else(PoisonError::into_inner);
        reached.insert(node.to_owned(), is_reached);
    }

    /// Whether each node answered when it was last asked; none that was never asked.
    pub fn reached(&self) -> Vec<(String, bool)> {
        let reached = self.inner.reached.lock();
        let reached = reached.unwrap_or_else(PoisonError::into_inner);
        reached
            .iter()
            .map(|(node, is)| (node.clone(), *is))
            .collect()
    }

    pub(crate) fn node(&self, name: &str) -> Option<&Node> {
        self.inner
            .options
            .nodes
            .iter()
            .find(|node| node.name() == name)
    }

    /// The node that a request names. The name is not repeated, because it may be anything.
    pub(crate) fn named_node(&self, name: &str) -> Result<&Node, AppError> {
        self.node(name).ok_or_else(|| {
            AppError::not_found(
                "no-such-node",
                "no node of the configuration has this name; add it to `pacs.nodes`",
            )
        })
    }

    /// Room for one more request with images, until it is dropped. One client may take a quarter of it.
    pub(crate) fn room(&self, request: &Request) -> Result<ClientPermit, AppError> {
        let permit = (self.inner.room).try_acquire(client_of(request.extensions()));
        permit.ok_or_else(|| cases::Error::Busy.into())
    }
}
