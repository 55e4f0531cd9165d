//! The integration tests: one program, one module for each subject.

mod agreement;
mod apart;
mod archive;
mod archives;
mod attacks;
mod audit;
mod backup;
mod bids;
mod command_line;
mod corrections;
mod dicom;
mod extraction;
mod faults;
mod findings;
mod flair;
mod flat_map;
mod fuzzed;
mod golden;
mod head;
mod heads;
mod hostile;
mod hygiene;
mod identity;
mod interface;
mod kept_store;
mod kill;
mod launch;
mod layers;
mod maps;
mod masks;
mod memory;
mod modules;
mod nifti;
mod openapi;
mod operation;
mod orthanc;
mod pacs;
mod positions;
mod proxy;
mod rendered;
mod renderers;
mod renders;
mod restart;
mod restore;
mod results;
mod retrievals;
mod scenes;
mod scopes;
mod search;
#[path = "../../server/imaging/tests/it/series_builder.rs"]
#[allow(dead_code, reason = "the tests of another crate use more of it")]
mod series_builder;
mod server;
mod several_machines;
mod short_faults;
mod sides;
mod sockets;
mod storage_nodes;
mod subjects;
mod surface_layers;
mod surfaces;
mod tls;
mod until;
mod uploads;
#[path = "../../server/extraction/tests/it/wrong_heads.rs"]
mod wrong_heads;

/// Says that a test does not run because something is missing here, which must not be in the continuous integration.
fn skipped(missing: &str) {
    assert!(std::env::var_os("CI").is_none(), "{missing}");
    eprintln!("SKIPPED: {missing}");
}
