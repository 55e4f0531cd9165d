//! TLS for HTTP and for associations of DICOM (PS3.15 annex B): the listener proves who it is, and so may both sides.

use std::sync::{Arc, PoisonError, RwLock};
use std::time::{Duration, SystemTime};

use tokio_rustls::rustls::client::WebPkiServerVerifier;
use tokio_rustls::rustls::client::danger::ServerCertVerifier as _;
use tokio_rustls::rustls::crypto::ring;
use tokio_rustls::rustls::pki_types::pem::PemObject as _;
use tokio_rustls::rustls::pki_types::{CertificateDer, PrivateKeyDer, ServerName, UnixTime};
use tokio_rustls::rustls::server::{ServerSessionMemoryCache, WebPkiClientVerifier};
use tokio_rustls::rustls::{CertificateError, ClientConfig, Error, RootCertStore, ServerConfig};

/// TLS of the listener.
pub type ListeningTls = Arc<ServerConfig>;

/// TLS of the listener, which can be replaced while it listens. Cheap to clone: all clones are replaced together.
#[derive(Debug, Clone)]
pub struct ReloadedTls(Arc<RwLock<ListeningTls>>);

impl ReloadedTls {
    /// Begins with one.
    pub fn new(tls: ListeningTls) -> Self {
        Self(Arc::new(RwLock::new(tls)))
    }

    /// Uses another one for every connection from now on.
    pub fn replace(&self, tls: ListeningTls) {
        *self.0.write().unwrap_or_else(PoisonError::into_inner) = tls;
    }

    /// What a new connection uses.
    pub fn current(&self) -> ListeningTls {
        Arc::clone(&self.0.read().unwrap_or_else(PoisonError::into_inner))
    }
}

/// TLS towards a node.
pub type ConnectingTls = Arc<ClientConfig>;

/// Why TLS cannot be used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum BadTls {
    #[error(
        "`tls_certificate` must be a file with our certificate in PEM, and then those that issued it"
    )]
    Certificate,
    #[error("`tls_key` must be a file with the private key of `tls_certificate` in PEM")]
    Key,
    /// Certificates of others.
    #[error(
        "`tls_authority` must be a file with the certificates in PEM that others' certificates are issued by"
    )]
    Authority,
}

/// Our certificate, those that issued it, and its key.
#[derive(Debug)]
pub struct TlsIdentity {
    chain: Vec<CertificateDer<'static>>,
    key: PrivateKeyDer<'static>,
}

impl TlsIdentity {
    /// Reads them in PEM.
    ///
    /// # Errors
    /// [`BadTls`].
    pub fn read(certificate: &[u8], key: &[u8]) -> Result<Self, BadTls> {
        let key = PrivateKeyDer::from_pem_slice(key).map_err(|_| BadTls::Key)?;
        Ok(Self {
            chain: certificates(certificate).ok_or(BadTls::Certificate)?,
            key,
        })
    }
}

/// Who issues the certificates of others.
#[derive(Debug, Clone)]
pub struct TlsAuthority(Arc<RootCertStore>);

impl TlsAuthority {
    /// Reads their certificates in PEM.
    ///
    /// # Errors
    /// [`BadTls::Authority`].
    pub fn read(certificate: &[u8]) -> Result<Self, BadTls> {
        let mut roots = RootCertStore::empty();
        for certificate in certificates(certificate).ok_or(BadTls::Authority)? {
            roots.add(certificate).map_err(|_| BadTls::Authority)?;
        }
        Ok(Self(Arc::new(roots)))
    }
}

/// At least one certificate.
fn certificates(pem: &[u8]) -> Option<Vec<CertificateDer<'static>>> {
    let read: Result<Vec<_>, _> = CertificateDer::pem_slice_iter(pem).collect();
    read.ok().filter(|chain| !chain.is_empty())
}

/// How long before its end a certificate is warned of.
const NEAR_ITS_END: Duration = Duration::from_secs(14 * 24 * 60 * 60);

/// What is wrong with the time of a certificate in PEM, if anything is. Whether clients trust it is not asked.
pub fn certificate_warning(pem: &[u8], now: SystemTime) -> Option<&'static str> {
    let chain = certificates(pem)?;
    let problem = |at: SystemTime| time_problem(&chain, at);
    match (problem(now), problem(now + NEAR_ITS_END)) {
        (Some(now), _) => Some(now),
        (None, Some(_)) => Some("ends within two weeks"),
        (None, None) => None,
    }
}

/// The last second in which the first certificate of a PEM is valid.
pub fn certificate_end(pem: &[u8]) -> Option<SystemTime> {
    /// The end of the year 9999, the last time that a certificate can state.
    const LAST: u64 = 253_402_300_799;
    let chain = certificates(pem)?;
    let at = |seconds: u64| SystemTime::UNIX_EPOCH + Duration::from_secs(seconds);
    let has_ended = |seconds: u64| time_problem(&chain, at(seconds)) == Some(ENDED);
    // The verifier tells only whether it has ended.
    let (mut valid, mut ended) = (0, LAST + 1);
    while valid + 1 < ended {
        let middle = valid.midpoint(ended);
        if has_ended(middle) {
            ended = middle;
        } else {
            valid = middle;
        }
    }
    Some(at(valid))
}

const ENDED: &str = "has ended";

/// What is wrong with the time of the first certificate of a chain. The verifier looks at that before anything else, so that it does not matter which name
/// and which authority it is asked about.
fn time_problem(chain: &[CertificateDer<'static>], at: SystemTime) -> Option<&'static str> {
    let (first, others) = chain.split_first()?;
    let mut roots = RootCertStore::empty();
    roots.add(first.clone()).ok()?;
    let provider = Arc::new(ring::default_provider());
    let verifier = WebPkiServerVerifier::builder_with_provider(Arc::new(roots), provider).build();
    let at = UnixTime::since_unix_epoch(at.duration_since(SystemTime::UNIX_EPOCH).ok()?);
    let any = ServerName::try_from("isocortex.invalid").ok()?;
    let verified = verifier
        .ok()?
        .verify_server_cert(first, others, &any, &[], at);
    match verified.err()? {
        Error::InvalidCertificate(
            CertificateError::Expired | CertificateError::ExpiredContext { .. },
        ) => Some(ENDED),
        Error::InvalidCertificate(
            CertificateError::NotValidYet | CertificateError::NotValidYetContext { .. },
        ) => Some("is not valid yet"),
        _ => None,
    }
}

/// Sessions that clients may resume. A client of TLS 1.3 gets two with each connection, and a browser opens six.
const SESSIONS: usize = 8192;

/// The side of a listener for HTTP, from PEM. Clients resume their sessions, so that another connection costs no signature, which takes most of
/// the time with a key of RSA.
///
/// # Errors
/// [`BadTls`].
pub fn serving_tls(certificate: &[u8], key: &[u8]) -> Result<ListeningTls, BadTls> {
    let tls = listening_tls(&TlsIdentity::read(certificate, key)?, None)?;
    let mut tls = Arc::unwrap_or_clone(tls);
    tls.alpn_protocols = vec![b"http/1.1".to_vec()];
    tls.session_storage = ServerSessionMemoryCache::new(SESSIONS);
    Ok(Arc::new(tls))
}

/// The side of the listener; with an authority, peers need certificates that it has issued.
///
/// # Errors
/// [`BadTls`].
pub fn listening_tls(
    identity: &TlsIdentity,
    authority: Option<&TlsAuthority>,
) -> Result<ListeningTls, BadTls> {
    let provider = Arc::new(ring::default_provider());
    let config = ServerConfig::builder_with_provider(Arc::clone(&provider));
    let config = config
        .with_safe_default_protocol_versions()
        .map_err(|_| BadTls::Certificate)?;
    let config = match authority {
        None => config.with_no_client_auth(),
        Some(authority) => {
            let roots = Arc::clone(&authority.0);
            let verifier = WebPkiClientVerifier::builder_with_provider(roots, provider).build();
            config.with_client_cert_verifier(verifier.map_err(|_| BadTls::Authority)?)
        }
    };
    let config = config.with_single_cert(identity.chain.clone(), identity.key.clone_key());
    Ok(Arc::new(config.map_err(|_| BadTls::Key)?))
}

/// The side that connects to a node; with an identity, it is shown if the node asks for it.
///
/// # Errors
/// [`BadTls`].
pub fn connecting_tls(
    authority: &TlsAuthority,
    identity: Option<&TlsIdentity>,
) -> Result<ConnectingTls, BadTls> {
    let config = ClientConfig::builder_with_provider(Arc::new(ring::default_provider()));
    let config = config
        .with_safe_default_protocol_versions()
        .map_err(|_| BadTls::Certificate)?;
    let config = config.with_root_certificates(Arc::clone(&authority.0));
    let config = match identity {
        None => config.with_no_client_auth(),
        Some(identity) => config
            .with_client_auth_cert(identity.chain.clone(), identity.key.clone_key())
            .map_err(|_| BadTls::Key)?,
    };
    Ok(Arc::new(config))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of the year 2020, for `localhost`, signed by itself.
    const OF_2020: &[u8] = b"\
-----BEGIN CERTIFICATE-----\n\
MIIBLTCB1aADAgECAgEFMAoGCCqGSM49BAMCMBQxEjAQBgNVBAMMCWxvY2FsaG9z\n\
dDAeFw0yMDAxMDEwMDAwMDBaFw0yMTAxMDEwMDAwMDBaMBQxEjAQBgNVBAMMCWxv\n\
Y2FsaG9zdDBZMBMGByqGSM49AgEGCCqGSM49AwEHA0IABAfaXgobHl70pqHIr73i\n\
/wpKk0wdFIyqjnN4ttfa+2Z5tKlniybw7gM527/DRwtnUqsKF1SU+iZKp4j9QNv3\n\
11WjGDAWMBQGA1UdEQQNMAuCCWxvY2FsaG9zdDAKBggqhkjOPQQDAgNHADBEAiAT\n\
f6sDfItCRZOZEtaAjnVpJEuFC9KkKVeP+5k9cakDkwIgZQcG5b5+OoWZb8Afm8m6\n\
gQiYhiAOy+BoLRauR/2lVxI=\n\
-----END CERTIFICATE-----\n";

    #[test]
    fn a_certificate_that_has_ended_or_soon_will_is_warned_of() {
        let days = |count: u64| SystemTime::UNIX_EPOCH + Duration::from_secs(count * 24 * 60 * 60);
        // 2020-01-01 is day 18,262, and 2021-01-01 day 18,628.
        for (day, expected) in [
            (18_261, Some("is not valid yet")),
            (18_300, None),
            (18_610, None),
            (18_615, Some("ends within two weeks")),
            (18_629, Some("has ended")),
        ] {
            assert_eq!(certificate_warning(OF_2020, days(day)), expected, "{day}");
        }
        assert_eq!(certificate_warning(b"nonsense", days(18_300)), None);
        assert_eq!(certificate_end(OF_2020), Some(days(18_628)));
        assert_eq!(certificate_end(b"nonsense"), None);
    }
}
