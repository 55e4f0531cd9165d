//! The integration tests: one program, one module for each subject.

mod agreement;
mod apart;
mod archives;
mod attacks;
mod audit;
mod backup;
mod command_line;
mod corrections;
mod dicom;
mod dicomweb;
mod extraction;
mod faults;
mod findings;
mod flair;
mod golden;
mod head;
mod heads;
mod hostile;
mod hygiene;
mod interface;
mod kill;
mod launch;
mod layers;
mod maps;
mod masks;
mod memory;
mod nifti;
mod openapi;
mod operation;
mod orthanc;
mod pacs;
mod positions;
mod rendered;
mod renderers;
mod renders;
mod restart;
mod results;
mod retrievals;
mod scenes;
mod scopes;
#[path = "../../server/imaging/tests/it/series_builder.rs"]
#[allow(dead_code, reason = "the tests of another crate use more of it")]
mod series_builder;
mod server;
mod several_machines;
mod short_faults;
mod sides;
mod sockets;
mod storage_nodes;
mod surfaces;
mod tls;
mod until;
mod uploads;
#[path = "../../server/extraction/tests/it/wrong_heads.rs"]
mod wrong_heads;
