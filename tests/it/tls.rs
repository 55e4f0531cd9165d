//! The server's own TLS: what it serves, what it does not, and how a certificate is replaced.

use std::net::SocketAddr;
use std::time::Duration;

use ::http::tls::{ConnectingTls, TlsAuthority, connecting_tls};
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::TcpStream;
use tokio_rustls::TlsConnector;
use tokio_rustls::rustls::HandshakeKind;

use crate::command_line::run;
use crate::operation::Logged;
use crate::server::Server;
use crate::storage_nodes::Certificates;

const REQUEST: &[u8] = b"GET /healthz HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n";

/// The answer to a request by TLS, if the certificate of the server is of this authority.
async fn ask(address: SocketAddr, authority: &Certificates) -> std::io::Result<String> {
    let authority = TlsAuthority::read(&authority.read("ca.pem")).unwrap();
    let tls = connecting_tls(&authority, None).unwrap();
    let stream = TcpStream::connect(address).await?;
    let name = address.ip().into();
    let mut stream = TlsConnector::from(tls).connect(name, stream).await?;
    stream.write_all(REQUEST).await?;
    let mut answer = String::new();
    stream.read_to_string(&mut answer).await?;
    Ok(answer)
}

#[tokio::test]
async fn a_client_resumes_its_session_although_many_others_came() {
    let Some(ours) = Certificates::make() else {
        return;
    };
    let server = Server::start_with(|config| {
        config.http.tls_certificate = Some(ours.path("cert.pem"));
        config.http.tls_key = Some(ours.path("key.pem"));
    })
    .await;
    let socket = server.on_a_socket().await;
    let authority = TlsAuthority::read(&ours.read("ca.pem")).unwrap();
    let client = || connecting_tls(&authority, None).unwrap();
    let handshake = async |tls: &ConnectingTls| {
        let stream = TcpStream::connect(socket.address).await.unwrap();
        let name = socket.address.ip().into();
        let connector = TlsConnector::from(tls.clone());
        let mut stream = connector.connect(name, stream).await.unwrap();
        stream.write_all(REQUEST).await.unwrap();
        let mut answer = Vec::new();
        stream.read_to_end(&mut answer).await.unwrap();
        stream.get_ref().1.handshake_kind().unwrap()
    };
    let ours = client();
    assert_eq!(handshake(&ours).await, HandshakeKind::Full);
    for _ in 0..200 {
        assert_eq!(handshake(&client()).await, HandshakeKind::Full);
    }
    assert_eq!(handshake(&ours).await, HandshakeKind::Resumed);
}

/// What comes to a client that sends these bytes, until the server closes the connection.
async fn plainly(address: SocketAddr, bytes: &[u8]) -> Vec<u8> {
    let mut stream = TcpStream::connect(address).await.unwrap();
    stream.write_all(bytes).await.unwrap();
    let mut answer = Vec::new();
    // A reset is an end, too.
    let _ = stream.read_to_end(&mut answer).await;
    answer
}

#[tokio::test]
async fn a_server_with_a_certificate_speaks_tls_alone() {
    let (Some(ours), Some(other)) = (Certificates::make(), Certificates::make()) else {
        return;
    };
    let server = Server::start_with(|config| {
        config.http.tls_certificate = Some(ours.path("cert.pem"));
        config.http.tls_key = Some(ours.path("key.pem"));
        config.http.timeouts.header = Duration::from_secs(1);
    })
    .await;
    let socket = server.on_a_socket().await;
    let answer = ask(socket.address, &ours).await.unwrap();
    assert!(answer.starts_with("HTTP/1.1 200"), "{answer}");
    assert!(
        answer.contains("strict-transport-security: max-age="),
        "{answer}"
    );
    assert!(ask(socket.address, &other).await.is_err());
    let plain = plainly(socket.address, REQUEST).await;
    assert!(
        !String::from_utf8_lossy(&plain).contains("HTTP/"),
        "{plain:?}"
    );
    // A handshake that is not begun, or not ended, has the time of a header.
    for half in [&b""[..], b"\x16\x03\x01\x02\x00"] {
        let closed = tokio::time::timeout(Duration::from_secs(30), plainly(socket.address, half));
        assert_eq!(closed.await.expect("it is closed"), b"");
    }
    let without = Server::start().await;
    let answer = without.get("/healthz").await;
    assert_eq!(answer.header("strict-transport-security"), "");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_certificate_is_read_again_when_its_file_changes() {
    let (Some(ours), Some(next)) = (Certificates::make(), Certificates::make()) else {
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path().display().to_string();
    let [certificate, key] = ["cert.pem", "key.pem"].map(|name| ours.text(name));
    let arguments = ["--tls-cert", &certificate, "--tls-key", &key];
    let mut server = Logged::serve(&data, &arguments);
    let line = server.until("listening");
    let address: SocketAddr = line["address"].as_str().unwrap().parse().unwrap();
    assert!(ask(address, &ours).await.is_ok());
    assert!(ask(address, &next).await.is_err());
    // The one file after the other: what does not fit together changes nothing.
    std::fs::write(ours.path("cert.pem"), next.read("cert.pem")).unwrap();
    server.until("the certificates of HTTP stay as they were");
    assert!(ask(address, &ours).await.is_ok());
    std::fs::write(ours.path("key.pem"), next.read("key.pem")).unwrap();
    server.until("the certificates of HTTP were read again");
    assert!(ask(address, &next).await.is_ok());
    server.end();
}

#[test]
fn a_certificate_needs_its_key() {
    let Some(ours) = Certificates::make() else {
        return;
    };
    let [certificate, key] = ["cert.pem", "key.pem"].map(|name| ours.text(name));
    let (status, said) = run(&[
        "check-config",
        "--tls-cert",
        &certificate,
        "--tls-key",
        &key,
    ]);
    assert_eq!(status, Some(0), "{said}");
    assert!(said.contains("listens on https://"), "{said}");
    let (status, said) = run(&["check-config", "--tls-cert", &key, "--tls-key", &key]);
    assert_eq!(status, Some(78), "{said}");
    assert!(said.contains("TLS of HTTP: `tls_certificate`"), "{said}");
    let (status, _) = run(&["check-config", "--tls-cert", &certificate]);
    assert_eq!(status, Some(2));
}
