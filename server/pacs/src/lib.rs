#![doc = include_str!("../README.md")]

mod arrivals;
mod background;
pub mod dimse;
mod error;
mod fetch;
mod hooks;
mod identity;
mod launch;
pub mod multipart;
pub mod node;
mod node_tests;
mod page;
mod parts;
mod refusal;
mod rejections;
mod rendered;
mod results;
mod retrievals;
mod send;
mod series;
pub mod settings;
mod state;
mod store;
mod stow;
mod transfer;
mod transfers;
mod values;

use access::audited::Audited;
use access::routes::{GuardedRoutes, ProtocolRoutes};
use access::scopes::Scope;
use axum::extract::DefaultBodyLimit;
use axum::http::Method;
use axum::routing::get;
use utoipa_axum::routes;

use http::sent::MAX_BODY_BYTES;

pub use self::background::start_transfers;
pub use self::node_tests::test_in_words;
pub use self::series::{ArrivalOptions, Arrivals, SeriesRule, start_series_reader};
pub use self::state::{Options, Pacs};
pub use self::store::{CopiedStep, CopyCounts, ImageStatus, PacsStore, PacsTables};

/// The routes that need a token. Each states what the token must permit, and what is recorded.
pub fn guarded_routes(pacs: &Pacs) -> ProtocolRoutes {
    let uploads = GuardedRoutes::default()
        .with(
            Scope::DicomStore,
            Audited::Store,
            routes!(stow::store_study),
        )
        .with(
            Scope::DicomStore,
            Audited::Store,
            routes!(stow::store_in_study),
        );
    let answers = GuardedRoutes::default()
        .with(
            Scope::Read,
            Audited::Query,
            routes!(arrivals::list_arrivals),
        )
        .with(Scope::Read, Audited::Query, routes!(arrivals::get_arrival))
        .with(
            Scope::Write,
            Audited::Upload,
            routes!(arrivals::take_arrival),
        )
        .with(
            Scope::Read,
            Audited::Query,
            routes!(rejections::list_rejections),
        )
        .with(
            Scope::Admin,
            Audited::Operation,
            routes!(rejections::lift_rejection),
        )
        .with(
            Scope::Write,
            Audited::Fetch,
            routes!(retrievals::create_retrieval),
        )
        .with(
            Scope::Read,
            Audited::Query,
            routes!(transfers::list_retrievals),
        )
        .with(
            Scope::Read,
            Audited::Query,
            routes!(retrievals::get_retrieval),
        )
        .with(
            Scope::Results,
            Audited::Result,
            routes!(results::create_result),
        )
        .with(
            Scope::Read,
            Audited::Query,
            routes!(transfers::list_results),
        )
        .with(Scope::Read, Audited::Query, routes!(results::get_result))
        // A notice of a PACS, which fetches a series.
        .with(
            Scope::DicomStore,
            Audited::Fetch,
            routes!(hooks::stable_series),
        )
        .with(Scope::Read, Audited::View, routes!(rendered::of_study))
        .with(Scope::Read, Audited::View, routes!(rendered::of_series))
        // The standard spells the word in two ways.
        .with_undescribed(
            Scope::Read,
            Audited::View,
            (Method::GET, "/dicomweb/studies/{study}/rendered3d"),
            get(rendered::of_study),
        )
        .with_undescribed(
            Scope::Read,
            Audited::View,
            (
                Method::GET,
                "/dicomweb/studies/{study}/series/{series}/rendered3d",
            ),
            get(rendered::of_series),
        )
        // The identifiers of a study are in its body, not in an address.
        .with(
            Scope::Read,
            Audited::Identity,
            routes!(launch::find_launched),
        )
        .with(Scope::Read, Audited::No, routes!(page::get_pacs))
        .with(
            Scope::Admin,
            Audited::Operation,
            routes!(node_tests::test_node),
        );
    let [uploads, answers] = [uploads, answers].map(|routes| {
        let routes = routes.map(|routes| routes.layer(DefaultBodyLimit::max(MAX_BODY_BYTES)));
        routes.with_state(pacs.clone())
    });
    ProtocolRoutes { uploads, answers }
}
