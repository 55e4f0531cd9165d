//! What only a real socket shows: slow clients, cut uploads, an orderly end.

use std::time::{Duration, Instant};

use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::TcpStream;

use crate::head::plain_head;
use crate::server::{Server, form, form_type};

/// Sends bytes and reads until the server closes the connection.
async fn exchange(address: std::net::SocketAddr, request: &[u8]) -> String {
    let mut stream = TcpStream::connect(address).await.unwrap();
    // The server may close a connection before it is written to.
    let _ = stream.write_all(request).await;
    let mut answer = Vec::new();
    // A reset after the answer is an end, too.
    let _ = stream.read_to_end(&mut answer).await;
    String::from_utf8_lossy(&answer).into_owned()
}

#[tokio::test]
async fn half_a_header_does_not_hold_a_connection() {
    let server =
        Server::start_with(|config| config.http.timeouts.header = Duration::from_secs(1)).await;
    let socket = server.on_a_socket().await;
    for half in ["", "GET /healthz HTTP/1.1\r\nHost: local"] {
        let started = Instant::now();
        let closed = exchange(socket.address, half.as_bytes());
        tokio::time::timeout(Duration::from_secs(15), closed)
            .await
            .unwrap();
        assert!(started.elapsed() >= Duration::from_millis(900));
    }
}

#[tokio::test]
async fn slow_clients_beyond_the_cap_do_not_stop_the_server_for_good() {
    let server = Server::start_with(|config| {
        config.http.timeouts.header = Duration::from_secs(1);
        config.http.max_connections = 4;
    })
    .await;
    let socket = server.on_a_socket().await;
    let mut slow = TcpStream::connect(socket.address).await.unwrap();
    slow.write_all(b"GET / HT").await.unwrap();
    let request = b"GET /healthz HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n";
    let answered = async {
        while !exchange(socket.address, request)
            .await
            .starts_with("HTTP/1.1 200")
        {
            tokio::task::yield_now().await;
        }
    };
    let answered = tokio::time::timeout(Duration::from_secs(20), answered);
    answered.await.expect("the slow one is given up");
}

#[tokio::test]
async fn an_upload_cut_in_the_middle_leaves_nothing() {
    let server = Server::start().await;
    let socket = server.on_a_socket().await;
    let body = form(&[("volume", &plain_head().bytes())]);
    let head = format!(
        "POST /v1/cases HTTP/1.1\r\nHost: localhost\r\nContent-Type: {}\r\nContent-Length: {}\r\n\r\n",
        form_type(),
        body.len()
    );
    for cut in [0, 1000, body.len() / 2, body.len() - 10] {
        let mut stream = TcpStream::connect(socket.address).await.unwrap();
        stream.write_all(head.as_bytes()).await.unwrap();
        stream.write_all(&body[..cut]).await.unwrap();
        drop(stream);
    }
    server.is_empty_and_well().await;
}

#[tokio::test]
async fn a_body_of_two_gigabytes_is_answered_before_it_is_sent() {
    let server = Server::start().await;
    let socket = server.on_a_socket().await;
    let request = format!(
        "POST /v1/cases HTTP/1.1\r\nHost: localhost\r\nContent-Type: {}\r\nContent-Length: 2000000000\r\nConnection: close\r\n\r\n",
        form_type()
    );
    let answer = tokio::time::timeout(
        Duration::from_secs(10),
        exchange(socket.address, request.as_bytes()),
    );
    let answer = answer.await.unwrap();
    assert!(answer.starts_with("HTTP/1.1 413"), "{answer}");
    assert!(answer.contains("urn:isocortex:problem:body-too-large"));
    server.is_empty_and_well().await;
}

#[tokio::test]
async fn a_stopping_server_finishes_what_it_has_begun() {
    let server = Server::start().await;
    let case = server.plain_case().await;
    let socket = server.on_a_socket().await;
    let request =
        format!("GET {case}/render?width=2048&height=2048 HTTP/1.1\r\nHost: localhost\r\n\r\n");
    let mut stream = TcpStream::connect(socket.address).await.unwrap();
    stream.write_all(request.as_bytes()).await.unwrap();
    // Until the request is at work.
    tokio::time::sleep(Duration::from_millis(20)).await;
    socket.stop.send(()).unwrap();
    let mut answer = Vec::new();
    stream.read_to_end(&mut answer).await.unwrap();
    assert!(answer.starts_with(b"HTTP/1.1 200"));
    tokio::time::timeout(Duration::from_secs(10), socket.serving)
        .await
        .unwrap()
        .unwrap();
    assert!(TcpStream::connect(socket.address).await.is_err());
}
