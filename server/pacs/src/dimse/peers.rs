//! Who may connect: titles with addresses, networks or names of hosts.

use std::collections::HashMap;
use std::fmt;
use std::net::IpAddr;
use std::time::Duration;

use ipnet::IpNet;
use tokio::sync::Mutex;
use tokio::time::Instant;

/// How long the addresses of a host are taken as they are.
const RESOLVED_FOR: Duration = Duration::from_secs(30);

/// How long to wait for the addresses of a host.
const RESOLVE: Duration = Duration::from_secs(2);

/// A peer that may store images.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Peer {
    /// Its application entity title.
    pub aet: String,
    /// Where it connects from.
    pub address: PeerAddress,
    /// Whether its rejection notes count.
    pub may_reject: bool,
}

/// Where a peer connects from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum PeerAddress {
    /// One address, or a network of them.
    Network(IpNet),
    /// The addresses of a host, which may change.
    Host(String),
}

impl PeerAddress {
    /// Parses an address (`192.0.2.7`), a network (`10.0.0.0/8`) or the name of a host (`orthanc.example`); `None` for
    /// anything else.
    pub fn parse(text: &str) -> Option<Self> {
        if let Ok(address) = text.parse::<IpAddr>() {
            return Some(address.into());
        }
        if let Ok(network) = text.parse() {
            return Some(Self::Network(network));
        }
        let is_label = |label: &str| {
            let allowed = |byte: u8| byte.is_ascii_alphanumeric() || byte == b'-' || byte == b'_';
            (1..=63).contains(&label.len()) && label.bytes().all(allowed)
        };
        // A misspelt address is no name.
        let has_letter = text.bytes().any(|byte| byte.is_ascii_alphabetic());
        let is_host = has_letter && text.split('.').all(is_label);
        is_host.then(|| Self::Host(text.to_owned()))
    }
}

impl From<[u8; 4]> for PeerAddress {
    fn from(address: [u8; 4]) -> Self {
        IpAddr::from(address).into()
    }
}

impl From<IpAddr> for PeerAddress {
    fn from(address: IpAddr) -> Self {
        // An IPv4 address may come in the form of IPv6.
        Self::Network(address.to_canonical().into())
    }
}

/// Those who may connect, and the addresses of their hosts.
pub(crate) struct Peers {
    listed: Vec<Peer>,
    resolved: Mutex<HashMap<String, (Instant, Vec<IpAddr>)>>,
}

impl fmt::Debug for Peers {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.listed.fmt(formatter)
    }
}

impl Peers {
    pub(crate) fn new(listed: Vec<Peer>) -> Self {
        Self {
            listed,
            resolved: Mutex::default(),
        }
    }

    /// Those who connect from an address; none for a stranger.
    pub(crate) async fn at(&self, address: IpAddr) -> Vec<Peer> {
        let address = address.to_canonical();
        let mut peers = Vec::new();
        for peer in &self.listed {
            let is_theirs = match &peer.address {
                PeerAddress::Network(network) => network.contains(&address),
                PeerAddress::Host(host) => self.addresses_of(host).await.contains(&address),
            };
            if is_theirs {
                peers.push(peer.clone());
            }
        }
        peers
    }

    /// The addresses of a host; those of before if they cannot be had now.
    async fn addresses_of(&self, host: &str) -> Vec<IpAddr> {
        let mut resolved = self.resolved.lock().await;
        if let Some((at, addresses)) = resolved.get(host)
            && at.elapsed() < RESOLVED_FOR
        {
            return addresses.clone();
        }
        let found = tokio::time::timeout(RESOLVE, tokio::net::lookup_host((host, 0))).await;
        let addresses = match found {
            Ok(Ok(found)) => found.map(|found| found.ip().to_canonical()).collect(),
            _ => {
                tracing::warn!(host, "the addresses of a peer cannot be had");
                let before = resolved.get(host);
                before.map_or_else(Vec::new, |(_, addresses)| addresses.clone())
            }
        };
        resolved.insert(host.to_owned(), (Instant::now(), addresses.clone()));
        addresses
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_peer_is_an_address_a_network_or_a_host() {
        let network = |text: &str| Some(PeerAddress::Network(text.parse().unwrap()));
        for (text, expected) in [
            ("192.0.2.7", network("192.0.2.7/32")),
            ("10.0.0.0/8", network("10.0.0.0/8")),
            ("orthanc", Some(PeerAddress::Host("orthanc".to_owned()))),
            (
                "pacs-1.example",
                Some(PeerAddress::Host("pacs-1.example".to_owned())),
            ),
            ("10.0.0.0/33", None),
            ("10.0.0/8", None),
            ("10.0.0.256", None),
            ("orthanc/8", None),
            ("a b", None),
            ("orthanc:4242", None),
            ("", None),
        ] {
            assert_eq!(PeerAddress::parse(text), expected, "{text}");
        }
    }

    #[tokio::test]
    async fn an_address_has_the_titles_of_its_peers() {
        let peer = |aet: &str, address: &str| Peer {
            aet: aet.to_owned(),
            address: PeerAddress::parse(address).unwrap(),
            may_reject: false,
        };
        let peers = Peers::new(vec![
            peer("ONE", "192.0.2.0/24"),
            peer("TWO", "192.0.2.7"),
            peer("HERE", "localhost"),
        ]);
        let titles = async |address: &str| -> Vec<_> {
            let there = peers.at(address.parse().unwrap()).await.into_iter();
            there.map(|peer| peer.aet).collect()
        };
        assert_eq!(titles("192.0.2.7").await, ["ONE", "TWO"]);
        assert_eq!(titles("::ffff:192.0.2.8").await, ["ONE"]);
        assert_eq!(titles("127.0.0.1").await, ["HERE"]);
        assert!(titles("192.0.3.1").await.is_empty());
    }
}
