//! The proxies that are trusted, and the clients that they name.

use std::net::{IpAddr, Ipv4Addr};
use std::sync::Arc;

use axum::http::HeaderMap;
use ipnet::IpNet;

/// Where a proxy is that comes by a socket in the file system.
const THIS_MACHINE: IpAddr = IpAddr::V4(Ipv4Addr::LOCALHOST);

/// The networks of the proxies that name the client in `X-Forwarded-For`. Cheap to clone.
#[derive(Debug, Clone, Default)]
pub struct TrustedProxies(pub Arc<[IpNet]>);

impl TrustedProxies {
    /// Whether a peer is a listed proxy, or comes by the socket in the file system, which is for a proxy alone.
    pub(crate) fn contains(&self, peer: Option<IpAddr>) -> bool {
        let Some(peer) = peer.map(|peer| peer.to_canonical()) else {
            return true;
        };
        self.0.iter().any(|network| network.contains(&peer))
    }

    /// The address of the client of a request: the last one in `X-Forwarded-For` that no listed proxy has, if the
    /// request comes from a listed proxy.
    pub(crate) fn client_of(&self, peer: Option<IpAddr>, headers: &HeaderMap) -> IpAddr {
        let mut client = peer.unwrap_or(THIS_MACHINE);
        if !self.contains(peer) {
            return client;
        }
        let lines = headers.get_all("x-forwarded-for").iter().rev();
        let named = lines.flat_map(|line| line.to_str().unwrap_or("").rsplit(','));
        for named in named {
            let Some(address) = address_of(named.trim()) else {
                break;
            };
            client = address;
            if !self.contains(Some(address)) {
                break;
            }
        }
        client
    }
}

/// `10.0.0.1`, `10.0.0.1:80`, `2001:db8::1` or `[2001:db8::1]:80`.
fn address_of(text: &str) -> Option<IpAddr> {
    let with_port = || {
        text.parse()
            .map(|address: std::net::SocketAddr| address.ip())
    };
    let bare = text.trim_start_matches('[').trim_end_matches(']');
    bare.parse().or_else(|_| with_port()).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_listed_proxy_names_the_client() {
        let networks = ["10.1.0.0/16", "fd00::/8"].map(|network| network.parse().unwrap());
        let proxies = TrustedProxies(networks.into());
        let client = |peer: &str, named: &[&str]| {
            let lines = named.iter().map(|line| {
                let name = axum::http::HeaderName::from_static("x-forwarded-for");
                (name, line.parse().unwrap())
            });
            let peer = peer.parse().unwrap();
            proxies.client_of(Some(peer), &lines.collect()).to_string()
        };
        assert_eq!(client("192.0.2.1", &["203.0.113.5"]), "192.0.2.1");
        assert_eq!(client("10.1.0.1", &[]), "10.1.0.1");
        assert_eq!(client("10.1.0.1", &["203.0.113.5"]), "203.0.113.5");
        assert_eq!(client("::ffff:10.1.0.1", &["203.0.113.5:9"]), "203.0.113.5");
        assert_eq!(client("10.1.0.1", &["[2001:db8::1]:80"]), "2001:db8::1");
        // What a client writes itself stands before what the proxies add.
        assert_eq!(
            client("10.1.0.1", &["1.2.3.4, 203.0.113.5, 10.1.9.9"]),
            "203.0.113.5"
        );
        assert_eq!(
            client("10.1.0.1", &["1.2.3.4", "203.0.113.5"]),
            "203.0.113.5"
        );
        assert_eq!(client("10.1.0.1", &["1.2.3.4, unknown"]), "10.1.0.1");
        assert_eq!(
            client("fd00::1", &["203.0.113.5, nonsense, 10.1.0.2"]),
            "10.1.0.2"
        );
    }
}
