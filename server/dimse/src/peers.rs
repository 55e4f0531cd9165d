//! Who may connect: titles with addresses, networks or names of hosts.

use std::collections::HashMap;
use std::fmt;
use std::net::IpAddr;
use std::time::Duration;

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
}

/// Where a peer connects from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum PeerAddress {
    /// One address, or all that begin with so many bits of it.
    Network(IpAddr, u8),
    /// The addresses of a host, which may change.
    Host(String),
}

impl PeerAddress {
    /// Parses an address (`192.0.2.7`), a network (`10.0.0.0/8`) or the name of a host (`orthanc.example`); `None` for
    /// anything else.
    pub fn parse(text: &str) -> Option<Self> {
        let (address, bits) = match text.split_once('/') {
            Some((address, bits)) => (address, Some(bits)),
            None => (text, None),
        };
        if let Ok(address) = address.parse::<IpAddr>() {
            let address = address.to_canonical();
            let most = if address.is_ipv4() { 32 } else { 128 };
            let bits = bits.map_or(Some(most), |bits| bits.parse().ok())?;
            return (bits <= most).then_some(Self::Network(address, bits));
        }
        let is_label = |label: &str| {
            let allowed = |byte: u8| byte.is_ascii_alphanumeric() || byte == b'-' || byte == b'_';
            (1..=63).contains(&label.len()) && label.bytes().all(allowed)
        };
        // A misspelt address is no name.
        let has_letter = address.bytes().any(|byte| byte.is_ascii_alphabetic());
        let is_host = bits.is_none() && has_letter && address.split('.').all(is_label);
        is_host.then(|| Self::Host(address.to_owned()))
    }
}

impl From<[u8; 4]> for PeerAddress {
    fn from(address: [u8; 4]) -> Self {
        IpAddr::from(address).into()
    }
}

impl From<IpAddr> for PeerAddress {
    fn from(address: IpAddr) -> Self {
        let bits = if address.is_ipv4() { 32 } else { 128 };
        Self::Network(address, bits)
    }
}

/// Whether an address begins with so many bits of another one.
fn is_within(address: IpAddr, network: IpAddr, bits: u8) -> bool {
    let shares = |address: u128, network: u128, length: u32| {
        let other_bits = length - u32::from(bits).min(length);
        address.checked_shr(other_bits) == network.checked_shr(other_bits)
    };
    match (address, network) {
        (IpAddr::V4(address), IpAddr::V4(network)) => {
            shares(address.to_bits().into(), network.to_bits().into(), 32)
        }
        (IpAddr::V6(address), IpAddr::V6(network)) => {
            shares(address.to_bits(), network.to_bits(), 128)
        }
        _ => false,
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

    /// The titles that may be used from an address; none of a stranger.
    pub(crate) async fn titles_at(&self, address: IpAddr) -> Vec<String> {
        // An IPv4 address may come in the form of IPv6.
        let address = address.to_canonical();
        let mut titles = Vec::new();
        for peer in &self.listed {
            let is_theirs = match &peer.address {
                PeerAddress::Network(network, bits) => {
                    is_within(address, network.to_canonical(), *bits)
                }
                PeerAddress::Host(host) => self.addresses_of(host).await.contains(&address),
            };
            if is_theirs {
                titles.push(peer.aet.clone());
            }
        }
        titles
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
        for (text, expected) in [
            ("192.0.2.7", Some(PeerAddress::Network([192, 0, 2, 7].into(), 32))),
            ("10.0.0.0/8", Some(PeerAddress::Network([10, 0, 0, 0].into(), 8))),
            ("orthanc", Some(PeerAddress::Host("orthanc".to_owned()))),
            ("pacs-1.example", Some(PeerAddress::Host("pacs-1.example".to_owned()))),
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

    #[test]
    fn a_network_has_the_addresses_that_begin_with_it() {
        for (address, network, bits, expected) in [
            ("10.1.2.3", "10.0.0.0", 8, true),
            ("11.1.2.3", "10.0.0.0", 8, false),
            ("192.0.2.7", "192.0.2.7", 32, true),
            ("192.0.2.6", "192.0.2.7", 32, false),
            ("203.0.113.9", "0.0.0.0", 0, true),
            ("2001:db8::1", "2001:db8::", 32, true),
            ("2001:db9::1", "2001:db8::", 32, false),
            ("2001:db8::1", "0.0.0.0", 0, false),
        ] {
            let [address, network] = [address, network].map(|text| text.parse().unwrap());
            assert_eq!(is_within(address, network, bits), expected, "{address} {network}/{bits}");
        }
    }

    #[tokio::test]
    async fn the_titles_of_an_address_are_those_of_its_peers() {
        let peer = |aet: &str, address: &str| Peer {
            aet: aet.to_owned(),
            address: PeerAddress::parse(address).unwrap(),
        };
        let peers = Peers::new(vec![
            peer("ONE", "192.0.2.0/24"),
            peer("TWO", "192.0.2.7"),
            peer("HERE", "localhost"),
        ]);
        let titles = async |address: &str| peers.titles_at(address.parse().unwrap()).await;
        assert_eq!(titles("192.0.2.7").await, ["ONE", "TWO"]);
        assert_eq!(titles("::ffff:192.0.2.8").await, ["ONE"]);
        assert_eq!(titles("127.0.0.1").await, ["HERE"]);
        assert!(titles("192.0.3.1").await.is_empty());
    }
}
