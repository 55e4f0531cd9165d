//! TLS for HTTP and for associations of DICOM (PS3.15 annex B): the listener proves who it is, and so may both sides.

use std::sync::{Arc, PoisonError, RwLock};

use tokio_rustls::rustls::crypto::ring;
use tokio_rustls::rustls::pki_types::pem::PemObject as _;
use tokio_rustls::rustls::pki_types::{CertificateDer, PrivateKeyDer};
use tokio_rustls::rustls::server::{ServerSessionMemoryCache, WebPkiClientVerifier};
use tokio_rustls::rustls::{ClientConfig, RootCertStore, ServerConfig};

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
        "`tls_authority` must be a file in PEM with the certificates of the authorities that issue the others' certificates"
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
