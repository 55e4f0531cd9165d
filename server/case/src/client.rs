//! Who asks, for limits and turns.

use std::net::IpAddr;

/// Whoever shares limits with others.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash)]
pub enum Client {
    /// This program itself, or a proxy, which asks for many. It may take all.
    #[default]
    Program,
    /// Somebody without a name at an address: for IPv6, its first 64 bits, because a client has all of the others.
    Address(IpAddr),
    /// A person or a token at whatever address, by the first bytes of the BLAKE3 digest of its name.
    Named([u8; 8]),
}

impl Client {
    /// Somebody without a name at an address.
    pub fn at(address: IpAddr) -> Self {
        Self::Address(match address.to_canonical() {
            IpAddr::V6(address) => {
                let [a, b, c, d, ..] = address.segments();
                IpAddr::from([a, b, c, d, 0, 0, 0, 0])
            }
            v4 => v4,
        })
    }

    /// A person or a token with a name that nobody else has.
    pub fn named(name: &str) -> Self {
        let [a, b, c, d, e, f, g, h, ..] = *blake3::hash(name.as_bytes()).as_bytes();
        Self::Named([a, b, c, d, e, f, g, h])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_of_one_ipv6_network_are_one_client() {
        let at = |text: &str| Client::at(text.parse().unwrap());
        assert_eq!(at("2001:db8::1"), at("2001:db8::2:3"));
        assert_ne!(at("2001:db8::1"), at("2001:db8:0:1::1"));
        assert_eq!(at("::ffff:10.0.0.1"), at("10.0.0.1"));
    }
}
