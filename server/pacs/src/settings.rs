//! `[pacs]`: images from a PACS.

use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::time::Duration;

use http::files::{UnreadableFile, read_file};
use jiff::tz::{Offset, TimeZone};
use serde::Deserialize;

use crate::dimse::{
    self, BadTls, DimseOptions, ListeningTls, PeerAddress, ReloadedTls, StorageNode, TlsAuthority,
    TlsIdentity, connecting_tls, is_aet, listening_tls,
};
use crate::node::{self, Credentials, WebNode};
use crate::series::{ArrivalOptions, SeriesRule};

/// Why a setting of the PACS is invalid.
#[derive(Debug, thiserror::Error)]
pub enum BadSettings {
    #[error(transparent)]
    Unreadable(#[from] UnreadableFile),
    /// An unknown time zone.
    #[error(
        "`pacs.time_zone` is `{zone}`; it must be an offset such as `-03:00`, from `-12:00` to `+14:00`, or the name of a zone that this machine knows, such as `Europe/Berlin` (is `tzdata` installed?)"
    )]
    TimeZone { zone: String },
    /// A node of the PACS is invalid.
    #[error("the node `{name}` in `pacs.nodes` is invalid: {source}")]
    Node { name: String, source: node::BadNode },
    /// The credentials of a node are incomplete, or of two kinds.
    #[error(
        "the node `{name}` needs `user` and `password_file`, or `token_file`, or none of them, and they need `url`"
    )]
    NodeCredentials { name: String },
    /// Two nodes have one name.
    #[error("two nodes in `pacs.nodes` have the same name")]
    SameNode,
    /// An application entity title is invalid.
    #[error(
        "`pacs.dimse`: an `aet` must be 1 to 16 printable characters without backslashes, and without spaces at its ends"
    )]
    Aet,
    /// The address of a peer is none.
    #[error(
        "the `address` of the peer `{aet}` in `pacs.dimse.peers` must be an address, a network such as 10.0.0.0/8, or the name of a host"
    )]
    PeerAddress { aet: String },
    /// TLS of DIMSE is configured incompletely.
    #[error(
        "`pacs.dimse` needs both `tls_certificate` and `tls_key`, or no key that begins with `tls_`"
    )]
    DimseTls,
    /// A file for TLS of DIMSE is invalid.
    #[error("TLS of DIMSE: {0}")]
    BadTls(#[from] BadTls),
}

const SECONDS_PER_DAY: u64 = 24 * 3600;

/// `[pacs]`: images from a PACS.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Settings {
    /// A series is read when nothing has come for it for this time, in seconds.
    pub stable_seconds: u64,
    /// How long series and their images are kept for late images, in days.
    pub keep_days: u64,
    /// Whether no identity of a patient is kept, of images and of uploads.
    pub deidentify: bool,
    /// Which series become cases.
    pub series: SeriesRule,
    /// The zone of the dates and times of sources that do not state it: an offset such as `-03:00`, or a name such as
    /// `America/Sao_Paulo`.
    pub time_zone: Option<String>,
    pub dimse: Dimse,
    /// Nodes from which series are fetched and to which results are sent.
    pub nodes: Vec<Node>,
}

impl Default for Settings {
    fn default() -> Self {
        let arrivals = ArrivalOptions::default();
        Self {
            stable_seconds: arrivals.stable.as_secs(),
            keep_days: arrivals.keep.as_secs() / SECONDS_PER_DAY,
            deidentify: false,
            series: SeriesRule::default(),
            time_zone: None,
            dimse: Dimse::default(),
            nodes: Vec::new(),
        }
    }
}

/// `[pacs.dimse]`: images by C-STORE.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Dimse {
    /// The address to listen on; without one, there is no listener.
    pub listen: Option<SocketAddr>,
    /// Our application entity title, also to nodes.
    pub aet: String,
    /// Who may store images. Nobody else may connect.
    pub peers: Vec<Peer>,
    /// A file with our certificate, for TLS.
    pub tls_certificate: Option<PathBuf>,
    /// A file with its key.
    pub tls_key: Option<PathBuf>,
    /// A file with the certificates that those of peers are issued by.
    pub tls_authority: Option<PathBuf>,
}

impl Default for Dimse {
    fn default() -> Self {
        Self {
            listen: None,
            aet: DimseOptions::default().aet,
            peers: Vec::new(),
            tls_certificate: None,
            tls_key: None,
            tls_authority: None,
        }
    }
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Peer {
    /// Its application entity title.
    pub aet: String,
    /// Where it connects from: an address, a network such as `10.0.0.0/8`, or the name of a host.
    pub address: String,
    /// Whether its rejection notes count.
    #[serde(default)]
    pub may_reject: bool,
}

/// A node. It has a DICOMweb root, an address for C-STORE, or both.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Node {
    /// Its name in requests.
    pub name: String,
    /// The address of its DICOMweb root.
    pub url: Option<String>,
    /// The user, if it requires a password.
    pub user: Option<String>,
    /// A file with the password.
    pub password_file: Option<PathBuf>,
    /// A file with a bearer token, instead of user and password.
    pub token_file: Option<PathBuf>,
    /// Its application entity title, if results are sent by C-STORE.
    pub aet: Option<String>,
    /// Its host and port for C-STORE.
    pub address: Option<String>,
    /// A file with the certificates that that of the node is issued by, if it is sent results by TLS.
    pub tls_authority: Option<PathBuf>,
}

impl Dimse {
    /// Our certificate and its key, if there are any.
    fn identity(&self) -> Result<Option<TlsIdentity>, BadSettings> {
        match (&self.tls_certificate, &self.tls_key) {
            (None, None) => Ok(None),
            (Some(certificate), Some(key)) => {
                let certificate = read_file(certificate, "the certificate for TLS")?;
                let key = read_file(key, "the file of the key for TLS")?;
                let identity = TlsIdentity::read(certificate.as_bytes(), key.as_bytes());
                Ok(Some(identity?))
            }
            _ => Err(BadSettings::DimseTls),
        }
    }

    /// TLS of the listener.
    ///
    /// # Errors
    /// If a file cannot be read or is invalid.
    pub fn tls(&self) -> Result<Option<ListeningTls>, BadSettings> {
        let Some(identity) = self.identity()? else {
            return match self.tls_authority {
                Some(_) => Err(BadSettings::DimseTls),
                None => Ok(None),
            };
        };
        let authority = self.tls_authority.as_deref().map(authority).transpose()?;
        Ok(Some(listening_tls(&identity, authority.as_ref())?))
    }
}

/// An offset from UTC, such as `-03:00`, as a DICOM object may state it (0008,0201).
fn offset_of(text: &str) -> Option<Offset> {
    let sign = match text.get(..1)? {
        "+" => 1,
        "-" => -1,
        _ => return None,
    };
    let (hours, minutes) = text[1..].split_once(':')?;
    let number = |part: &str| -> Option<i32> {
        let is_plain = part.len() == 2 && part.bytes().all(|byte| byte.is_ascii_digit());
        is_plain.then(|| part.parse().ok())?
    };
    let minutes = number(minutes).filter(|minutes| *minutes < 60)?;
    let minutes = sign * (60 * number(hours)? + minutes);
    let is_possible = (-12 * 60..=14 * 60).contains(&minutes);
    is_possible.then(|| Offset::from_seconds(60 * minutes).ok())?
}

fn authority(path: &Path) -> Result<TlsAuthority, BadSettings> {
    Ok(TlsAuthority::read(
        read_file(path, "the certificates of an authority")?.as_bytes(),
    )?)
}

impl Settings {
    /// How series become cases.
    pub fn arrivals(&self) -> ArrivalOptions {
        ArrivalOptions {
            stable: Duration::from_secs(self.stable_seconds),
            keep: Duration::from_secs(self.keep_days.saturating_mul(SECONDS_PER_DAY)),
            series: self.series,
        }
    }

    /// The zone of the scanners' dates and times, if it is configured.
    ///
    /// # Errors
    /// If it is neither an offset nor the name of a zone that this machine knows.
    pub fn time_zone(&self) -> Result<Option<TimeZone>, BadSettings> {
        let zone = |text: &String| {
            let offset = offset_of(text).map(TimeZone::fixed);
            let zone = offset.or_else(|| TimeZone::get(text).ok());
            zone.ok_or_else(|| BadSettings::TimeZone { zone: text.clone() })
        };
        self.time_zone.as_ref().map(zone).transpose()
    }

    /// The nodes.
    ///
    /// # Errors
    /// If one cannot be used, or its credentials cannot be read.
    pub fn nodes(&self) -> Result<Vec<node::Node>, BadSettings> {
        let nodes: Vec<_> = self
            .nodes
            .iter()
            .map(|node| node.open(&self.dimse))
            .collect::<Result<_, _>>()?;
        for (number, node) in self.nodes.iter().enumerate() {
            if self.nodes[..number]
                .iter()
                .any(|other| other.name == node.name)
            {
                return Err(BadSettings::SameNode);
            }
        }
        Ok(nodes)
    }

    /// The address and the options of the listener for C-STORE, if there is one.
    ///
    /// # Errors
    /// If an application entity title is not one.
    pub fn dimse(&self) -> Result<Option<(SocketAddr, DimseOptions)>, BadSettings> {
        // The files for TLS are of use to nodes, too.
        let tls = self.dimse.tls()?;
        let Some(listen) = self.dimse.listen else {
            return Ok(None);
        };
        let titles = self.dimse.peers.iter().map(|peer| &peer.aet);
        if !titles.chain([&self.dimse.aet]).all(|aet| is_aet(aet)) {
            return Err(BadSettings::Aet);
        }
        let peer = |peer: &Peer| {
            let address = PeerAddress::parse(&peer.address);
            let aet = peer.aet.clone();
            match address {
                Some(address) => Ok(dimse::Peer {
                    aet,
                    address,
                    may_reject: peer.may_reject,
                }),
                None => Err(BadSettings::PeerAddress { aet }),
            }
        };
        let peers: Result<_, _> = self.dimse.peers.iter().map(peer).collect();
        let options = DimseOptions {
            aet: self.dimse.aet.clone(),
            peers: peers?,
            tls: tls.map(ReloadedTls::new),
            ..DimseOptions::default()
        };
        Ok(Some((listen, options)))
    }

    /// The numbers that must be at least 1.
    pub fn counts(&self) -> [(&'static str, u64); 2] {
        [
            ("pacs.stable_seconds", self.stable_seconds),
            ("pacs.keep_days", self.keep_days),
        ]
    }
}

impl Node {
    fn open(&self, dimse: &Dimse) -> Result<node::Node, BadSettings> {
        let invalid = |source| BadSettings::Node {
            name: self.name.clone(),
            source,
        };
        let credentials = self.credentials()?;
        let web = match &self.url {
            Some(url) => Some(WebNode::new(url, &credentials).map_err(invalid)?),
            None if credentials == Credentials::None => None,
            None => {
                return Err(BadSettings::NodeCredentials {
                    name: self.name.clone(),
                });
            }
        };
        let storage = match (&self.aet, &self.address) {
            (None, None) if self.tls_authority.is_none() => None,
            (Some(aet), Some(address)) => {
                let node = StorageNode::new(address, aet, &dimse.aet);
                let node = node.map_err(invalid)?;
                Some(match &self.tls_authority {
                    None => node,
                    Some(file) => {
                        let identity = dimse.identity()?;
                        let tls = connecting_tls(&authority(file)?, identity.as_ref())?;
                        let node = node.with_tls(tls);
                        node.map_err(invalid)?
                    }
                })
            }
            _ => return Err(invalid(node::BadNode::NoService)),
        };
        node::Node::new(&self.name, web, storage).map_err(invalid)
    }

    fn credentials(&self) -> Result<Credentials, BadSettings> {
        Ok(match (&self.user, &self.password_file, &self.token_file) {
            (None, None, None) => Credentials::None,
            (Some(user), Some(file), None) => {
                let password = read_file(file, "the file of the password of a node")?;
                Credentials::Basic(user.clone(), password.trim_end().to_owned())
            }
            (None, None, Some(file)) => {
                let token = read_file(file, "the file of the token of a node")?;
                Credentials::Bearer(token.trim().to_owned())
            }
            _ => {
                return Err(BadSettings::NodeCredentials {
                    name: self.name.clone(),
                });
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::node::BadNode;

    fn parsed(text: &str) -> Settings {
        toml::from_str(text).unwrap()
    }

    #[test]
    fn nothing_listens_and_nobody_is_known_unless_it_is_configured() {
        let pacs = parsed("");
        assert_eq!(pacs.dimse().unwrap().map(|(listen, _)| listen), None);
        let pacs = parsed(
            "[dimse]\nlisten = \"127.0.0.1:11112\"\n[[dimse.peers]]\naet = \"ORTHANC\"\naddress = \"192.0.2.7\"",
        );
        let (_, options) = pacs.dimse().unwrap().unwrap();
        assert_eq!(
            (options.aet.as_str(), options.peers.len()),
            ("ISOCORTEX", 1)
        );
        assert!(!options.peers[0].may_reject);
        let pacs = parsed(
            "[dimse]\nlisten = \"127.0.0.1:1\"\n[[dimse.peers]]\naet = \"A\"\naddress = \"192.0.2.7\"\nmay_reject = true",
        );
        let (_, options) = pacs.dimse().unwrap().unwrap();
        assert!(options.peers[0].may_reject);
        for (address, is_right) in [("10.0.0.0/8", true), ("orthanc", true), ("10.0.0", false)] {
            let pacs = parsed(&format!(
                "[dimse]\nlisten = \"127.0.0.1:1\"\n[[dimse.peers]]\naet = \"A\"\naddress = \"{address}\""
            ));
            let refused = matches!(pacs.dimse(), Err(BadSettings::PeerAddress { .. }));
            assert_ne!(refused, is_right, "{address}");
        }
        for (aet, is_right) in [
            ("CT 1", true),
            ("", false),
            (" ", false),
            (" CT1", false),
            ("CT1 ", false),
            ("SEVENTEEN-LETTERS", false),
            ("A\\\\B", false),
        ] {
            let pacs = parsed(&format!(
                "[dimse]\nlisten = \"127.0.0.1:1\"\naet = \"{aet}\""
            ));
            let refused = matches!(pacs.dimse(), Err(BadSettings::Aet));
            assert_ne!(refused, is_right, "{aet}");
        }
    }

    #[test]
    fn a_time_zone_is_an_offset_or_a_known_name() {
        let zone = |text| parsed(&format!("time_zone = \"{text}\"")).time_zone();
        assert_eq!(parsed("").time_zone().unwrap(), None);
        for offset in ["-03:00", "+05:30", "-12:00", "+14:00"] {
            assert!(
                zone(offset).unwrap().unwrap().to_fixed_offset().is_ok(),
                "{offset}"
            );
        }
        for wrong in [
            "Nowhere/City",
            "-03:99",
            "+25:00",
            "-12:01",
            "+14:30",
            "-03",
        ] {
            let refused = matches!(zone(wrong), Err(BadSettings::TimeZone { .. }));
            assert!(refused, "{wrong}");
        }
    }

    #[test]
    fn credentials_of_a_node_come_from_files_and_are_never_shown() {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), "CANARY\n").unwrap();
        let node = |rest: &str| {
            parsed(&format!(
                "[[nodes]]\nname = \"orthanc\"\nurl = \"http://orthanc:8042/dicom-web\"\n{rest}"
            ))
        };
        let path = file.path().display();
        for rest in [
            String::new(),
            format!("user = \"alice\"\npassword_file = \"{path}\""),
            format!("token_file = \"{path}\""),
        ] {
            let nodes = node(&rest).nodes().unwrap();
            assert!(!format!("{nodes:?}").contains("CANARY"));
        }
        let half = node("user = \"alice\"").nodes();
        assert!(matches!(half, Err(BadSettings::NodeCredentials { .. })));
        let for_nothing = format!("[[nodes]]\nname = \"a\"\ntoken_file = \"{path}\"");
        let for_nothing = parsed(&for_nothing).nodes();
        assert!(matches!(
            for_nothing,
            Err(BadSettings::NodeCredentials { .. })
        ));
        let twice = format!(
            "{0}{0}",
            "[[nodes]]\nname = \"a\"\nurl = \"http://orthanc/\"\n"
        );
        assert!(matches!(parsed(&twice).nodes(), Err(BadSettings::SameNode)));
    }

    #[test]
    fn a_node_for_c_store_has_a_title_and_an_address() {
        let opened = |keys: &str| {
            let nodes = parsed(&format!("[[nodes]]\nname = \"archive\"\n{keys}")).nodes();
            nodes.map_err(|error| match error {
                BadSettings::Node { source, .. } => source,
                other => panic!("{other}"),
            })
        };
        let (aet, address) = ("aet = \"ARCHIVE\"\n", "address = \"192.0.2.7:104\"\n");
        let url = "url = \"http://orthanc/\"\n";
        for keys in [[aet, address, ""], [aet, address, url]] {
            assert_eq!(opened(&keys.concat()).unwrap().len(), 1);
        }
        for keys in [["", ""], [aet, ""], ["", address], [url, aet]] {
            let refused = opened(&keys.concat()).err();
            assert_eq!(refused, Some(BadNode::NoService), "{keys:?}");
        }
        for keys in [
            "aet = \"A \"\naddress = \"192.0.2.7:104\"",
            "aet = \"ARCHIVE\"\naddress = \"192.0.2.7\"",
        ] {
            let refused = opened(keys).err();
            assert!(
                matches!(refused, Some(BadNode::Aet | BadNode::StorageAddress)),
                "{keys}"
            );
        }
    }

    #[test]
    fn tls_needs_both_files_and_what_they_should_have() {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), "CANARY\n").unwrap();
        let path = file.path().display();
        let dimse = |keys: &str| {
            let text = format!("[dimse]\nlisten = \"127.0.0.1:1\"\n{keys}");
            parsed(&text).dimse().map(|found| found.is_some())
        };
        let [certificate, key, authority] =
            ["certificate", "key", "authority"].map(|name| format!("tls_{name} = \"{path}\"\n"));
        assert!(dimse("").unwrap());
        for half in [&certificate, &key, &authority] {
            assert!(matches!(dimse(half), Err(BadSettings::DimseTls)), "{half}");
        }
        let refused = dimse(&[certificate, key].concat()).unwrap_err();
        assert!(matches!(refused, BadSettings::BadTls(_)));
        assert!(!refused.to_string().contains("CANARY"));
    }
}
