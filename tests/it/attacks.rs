//! What an attacker tries, small: the programs of `tests/faults/` try the same in earnest and measure it.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use axum::body::Body;
use axum::http::{Request, StatusCode, header};
use bytes::Bytes;
use isocortex::config::Secret;
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::{TcpSocket, TcpStream};

use crate::head::plain_head;
use crate::nifti::Nifti;
use crate::scopes::TokensFile;
use crate::server::{Answer, CLOSING_BYTES, Server, Socket, form, form_type};

/// Uploads `start` and then 64 MB of `filler`; the answer, and how many bytes were taken of it.
async fn upload_endless(server: &Server, start: &[u8], filler: &'static [u8]) -> (Answer, usize) {
    let taken = Arc::new(AtomicUsize::new(0));
    let counter = Arc::clone(&taken);
    let block = Bytes::from(filler.repeat(4096 / filler.len()));
    let start = Bytes::copy_from_slice(start);
    let pieces = std::iter::once(start)
        .chain(std::iter::repeat_n(block, (64 << 20) / 4096))
        .map(move |piece| {
            counter.fetch_add(piece.len(), Ordering::Relaxed);
            Ok::<_, std::convert::Infallible>(piece)
        });
    let request = Request::post("/v1/cases")
        .header(header::CONTENT_TYPE, form_type())
        .body(Body::from_stream(futures_util::stream::iter(pieces)))
        .unwrap();
    let answer = server.send(request).await;
    (answer, taken.load(Ordering::Relaxed))
}

#[tokio::test]
async fn a_form_without_a_part_is_refused_after_16_kb() {
    let server = Server::start().await;
    let part = form(&[]);
    let boundary = &part[..part.len() - 4];
    let begun = [
        boundary,
        b"\r\nContent-Disposition: form-data; name=\"volume\"\r\nX-Long: ",
    ]
    .concat();
    for (start, filler) in [
        (&b""[..], &b"nothing "[..]),
        (&begun, b"abcdefgh"),
        (&begun, b"a\r\nX-Longer: b"),
    ] {
        let (answer, taken) = upload_endless(&server, start, filler).await;
        assert_eq!(
            (answer.status, answer.problem().as_str()),
            (StatusCode::BAD_REQUEST, "form-unreadable")
        );
        assert!(taken < 64 << 10, "{taken} bytes were taken");
    }
    server.is_empty_and_well().await;
}

/// Sends bytes and reads what comes until the server closes the connection.
async fn exchange(address: std::net::SocketAddr, request: &str) -> String {
    let mut stream = TcpStream::connect(address).await.unwrap();
    // The server may answer before it has read everything, and a reset after the answer is an end, too.
    let _ = stream.write_all(request.as_bytes()).await;
    let mut answer = Vec::new();
    let _ = stream.read_to_end(&mut answer).await;
    String::from_utf8_lossy(&answer).into_owned()
}

fn get(address: &str) -> String {
    format!("GET {address} HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n")
}

/// The beginning of an upload whose rest does not come.
fn half_an_upload() -> String {
    let body = form(&[("volume", b"abc")]);
    let start = String::from_utf8_lossy(&body[..body.len() - CLOSING_BYTES]).into_owned();
    format!(
        "POST /v1/cases HTTP/1.1\r\nHost: localhost\r\nContent-Type: {}\r\nContent-Length: 1000000\r\n\r\n{start}",
        form_type()
    )
}

async fn connections(socket: &Socket, count: usize, sending: &str) -> Vec<TcpStream> {
    let mut open = Vec::new();
    for _ in 0..count {
        let mut stream = TcpStream::connect(socket.address).await.unwrap();
        stream.write_all(sending.as_bytes()).await.unwrap();
        open.push(stream);
    }
    open
}

#[tokio::test]
async fn an_upload_that_drips_is_given_up() {
    let server = Server::start_with(|config| config.http.slow_start_secs = 1).await;
    let socket = server.on_a_socket().await;
    let mut stream = TcpStream::connect(socket.address).await.unwrap();
    stream.write_all(half_an_upload().as_bytes()).await.unwrap();
    let (mut reader, mut writer) = stream.into_split();
    let dripping = tokio::spawn(async move {
        while writer.write_all(b"x").await.is_ok() {
            tokio::time::sleep(Duration::from_millis(50)).await;
        }
    });
    let mut answer = Vec::new();
    let read = reader.read_to_end(&mut answer);
    // A reset after the answer is an end, too.
    let _ = tokio::time::timeout(Duration::from_secs(15), read)
        .await
        .expect("it is given up");
    dripping.abort();
    let answer = String::from_utf8_lossy(&answer);
    assert!(answer.contains("upload-stalled"), "{answer}");
    server.is_empty_and_well().await;
}

#[tokio::test]
async fn one_client_leaves_room_for_the_uploads_of_others() {
    let server = Server::start_with(|config| config.http.max_uploads = 4).await;
    let socket = server.on_a_socket().await;
    let held = connections(&socket, 1, &half_an_upload()).await;
    while server.stored_files().is_empty() {
        tokio::task::yield_now().await;
    }
    let answer = exchange(socket.address, &half_an_upload()).await;
    assert!(answer.starts_with("HTTP/1.1 503"), "{answer}");
    assert!(answer.contains("problem:busy"), "{answer}");
    let answer = server.upload(&[("volume", &plain_head().bytes())]).await;
    assert_eq!(answer.status, StatusCode::ACCEPTED);
    drop(held);
}

/// A connection from an address of this machine, which has sent a request.
async fn from(number: u8, socket: &Socket, sending: &str) -> TcpStream {
    let here = TcpSocket::new_v4().unwrap();
    here.bind(([127, 0, 0, number], 0).into()).unwrap();
    let mut stream = here.connect(socket.address).await.unwrap();
    stream.write_all(sending.as_bytes()).await.unwrap();
    stream
}

/// The first line of an answer.
async fn status_of(stream: &mut TcpStream) -> String {
    let mut answer = vec![0; 4096];
    let length = stream.read(&mut answer).await.unwrap();
    let answer = String::from_utf8_lossy(&answer[..length]);
    answer.lines().next().unwrap_or_default().to_owned()
}

#[tokio::test]
async fn two_tokens_leave_room_for_others_at_however_many_addresses() {
    let mut tokens = TokensFile::new();
    for name in ["greedy", "second", "other"] {
        tokens.add(name, &["--role", "editor"]);
    }
    let server = Server::start_with(|config| {
        config.http.tokens_file = Some(tokens.path());
        config.http.max_uploads = 4;
        config.http.max_connections = 8;
    })
    .await;
    let socket = server.on_a_socket().await;
    let with = |request: &str, name: &str| {
        let host = "Host: localhost\r\n";
        request.replace(
            host,
            &format!("{host}Authorization: {}\r\n", tokens.bearer(name)),
        )
    };
    let half = |name| with(&half_an_upload(), name);
    let mut held = Vec::new();
    // Half of the places, half of the others, and one that is left, at an address that another token has as well.
    for (name, addresses, beyond) in [
        ("greedy", 2..4, Some(4)),
        ("second", 5..6, Some(6)),
        ("other", 2..3, None),
    ] {
        for number in addresses {
            held.push(from(number, &socket, &half(name)).await);
            while server.stored_files().len() < held.len() {
                tokio::task::yield_now().await;
            }
        }
        if let Some(number) = beyond {
            let mut refused = from(number, &socket, &half(name)).await;
            assert!(status_of(&mut refused).await.contains(" 503 "), "{name}");
        }
    }
    drop(held);
    // The same for connections that are kept.
    let list = |name| with(&get("/v1/cases").replace("Connection: close\r\n", ""), name);
    let mut kept = Vec::new();
    for (name, most) in [("greedy", 4), ("second", 6)] {
        loop {
            let mut stream = from(2 + (kept.len() % 3) as u8, &socket, &list(name)).await;
            match status_of(&mut stream).await {
                status if status.contains(" 200 ") => kept.push(stream),
                _ => break,
            }
            assert!(kept.len() <= most, "{name}: {}", kept.len());
        }
    }
    let mut other = from(2, &socket, &list("other")).await;
    assert!(status_of(&mut other).await.contains(" 200 "));
}

/// The same for images of a PACS, which have places of their own.
#[tokio::test]
async fn one_client_leaves_room_for_the_images_of_others() {
    let server = Server::start_with(|config| config.http.max_uploads = 4).await;
    let socket = server.on_a_socket().await;
    let half = "POST /dicomweb/studies HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\
        Content-Type: multipart/related; type=\"application/dicom\"; boundary=x\r\nContent-Length: 9000\r\n\r\n\
        --x\r\nContent-Type: application/dicom\r\n\r\nhalf an image";
    let held = connections(&socket, 1, half).await;
    while server.stored_files().is_empty() {
        tokio::task::yield_now().await;
    }
    let answer = exchange(socket.address, half).await;
    assert!(answer.starts_with("HTTP/1.1 503"), "{answer}");
    // Another client; its body has no image.
    let kind = "multipart/related; type=\"application/dicom\"; boundary=x";
    let request = axum::http::Request::post("/dicomweb/studies")
        .header("host", "localhost")
        .header("content-type", kind)
        .body(axum::body::Body::from("--x--\r\n"));
    let answer = server.send(request.unwrap()).await;
    assert_ne!(answer.status, StatusCode::SERVICE_UNAVAILABLE);
    drop(held);
}

const TOKEN: &str = "correct-horse-battery-staple";

async fn start_with_token() -> Server {
    Server::start_with(|config| config.http.token = Some(Secret(TOKEN.to_owned()))).await
}

fn get_with(token: &str) -> String {
    let rest = "Host: localhost\r\nConnection: close\r\n\r\n";
    format!("GET /v1/cases HTTP/1.1\r\nAuthorization: Bearer {token}\r\n{rest}")
}

#[tokio::test]
async fn strangers_do_not_shut_clients_out() {
    let server = start_with_token().await;
    let socket = server.on_a_socket().await;
    // More than there are places for, from the address of the client itself.
    let mut held = connections(&socket, 200, "GET /v1/ca").await;
    held.append(&mut connections(&socket, 200, "").await);
    for round in 0..8 {
        let guess = exchange(socket.address, &get_with("wrong-token-wrong-token")).await;
        assert!(guess.starts_with("HTTP/1.1 4"), "{round}: {guess}");
        let health = exchange(socket.address, &get("/healthz")).await;
        assert!(health.starts_with("HTTP/1.1 200"), "{round}: {health}");
        let client = exchange(socket.address, &get_with(TOKEN)).await;
        assert!(client.starts_with("HTTP/1.1 200"), "{round}: {client}");
    }
    drop(held);
}

/// Opens a connection as a client, and leaves it open.
async fn a_client(socket: &Socket) -> (TcpStream, String) {
    let mut stream = TcpStream::connect(socket.address).await.unwrap();
    let request = "GET /v1/cases HTTP/1.1\r\nHost: localhost\r\n\r\n";
    stream.write_all(request.as_bytes()).await.unwrap();
    let mut answer = vec![0; 4096];
    let length = stream.read(&mut answer).await.unwrap();
    answer.truncate(length);
    (stream, String::from_utf8(answer).unwrap())
}

#[tokio::test]
async fn clients_beyond_the_cap_are_told_and_health_checks_are_answered() {
    for of_one_address in [false, true] {
        let server = Server::start_with(|config| match of_one_address {
            true => config.http.max_connections_per_address = 2,
            false => config.http.max_connections = 2,
        })
        .await;
        let socket = server.on_a_socket().await;
        let held = [a_client(&socket).await, a_client(&socket).await];
        assert!(
            held.iter()
                .all(|(_, answer)| answer.starts_with("HTTP/1.1 200"))
        );
        let other = exchange(socket.address, &get("/v1/cases")).await;
        assert!(other.starts_with("HTTP/1.1 503"), "{other}");
        assert!(other.to_lowercase().contains("retry-after"), "{other}");
        let health = exchange(socket.address, &get("/healthz")).await;
        assert!(health.starts_with("HTTP/1.1 200"), "{health}");
        drop(held);
        // The server notices the end of both connections a moment later.
        let mut answer = String::new();
        while !answer.starts_with("HTTP/1.1 200") {
            answer = exchange(socket.address, &get("/v1/cases")).await;
        }
    }
}

#[tokio::test]
async fn whoever_goes_on_guessing_is_answered_429_at_once_and_loses_the_connection() {
    let server = start_with_token().await;
    let socket = server.on_a_socket().await;
    let guess = get_with("correct-horse-battery-stapler").replace("Connection: close\r\n", "");
    let mut refused = 0;
    for _ in 0..20 {
        let mut stream = TcpStream::connect(socket.address).await.unwrap();
        stream.write_all(guess.as_bytes()).await.unwrap();
        let mut answer = vec![0; 4096];
        let length = stream.read(&mut answer).await.unwrap();
        let answer = String::from_utf8_lossy(&answer[..length]).to_lowercase();
        if answer.starts_with("http/1.1 401") {
            continue;
        }
        assert!(answer.starts_with("http/1.1 429"), "{answer}");
        assert!(answer.contains("retry-after: "), "{answer}");
        assert!(answer.contains("connection: close"), "{answer}");
        assert_eq!(stream.read(&mut [0]).await.unwrap(), 0, "it is closed");
        refused += 1;
    }
    assert!(refused >= 10, "{refused}");
    let client = exchange(socket.address, &get_with(TOKEN)).await;
    assert!(client.starts_with("HTTP/1.1 200"), "{client}");
}

#[tokio::test]
async fn a_listed_proxy_keeps_its_connections_and_names_who_guesses() {
    let server = Server::start_with(|config| {
        config.http.token = Some(Secret(TOKEN.to_owned()));
        config.http.trusted_proxies = vec!["127.0.0.0/8".parse().unwrap()];
    })
    .await;
    let socket = server.on_a_socket().await;
    let mut proxy = TcpStream::connect(socket.address).await.unwrap();
    let mut ask = async |client: &str, token: &str| {
        let request =
            get_with(token).replace("Connection: close", &format!("X-Forwarded-For: {client}"));
        proxy.write_all(request.as_bytes()).await.unwrap();
        let mut answer = vec![0; 4096];
        let length = proxy.read(&mut answer).await.unwrap();
        let answer = String::from_utf8_lossy(&answer[..length]).into_owned();
        answer[9..12].to_owned()
    };
    let mut last = String::new();
    for _ in 0..20 {
        last = ask("203.0.113.5", "wrong-token-wrong-token").await;
    }
    assert_eq!(last, "429");
    assert_eq!(ask("203.0.113.6", "wrong-token-wrong-token").await, "401");
    assert_eq!(ask("203.0.113.5", TOKEN).await, "200");
}

#[tokio::test]
async fn long_headers_are_refused() {
    let server = Server::start().await;
    let socket = server.on_a_socket().await;
    let request = get("/healthz").replace(
        "Connection",
        &format!("X-Long: {}\r\nConnection", "a".repeat(200_000)),
    );
    let answer = exchange(socket.address, &request).await;
    assert!(!answer.starts_with("HTTP/1.1 200"), "{answer}");
}

/// A volume whose voxels measure so many mm.
fn volume_of(voxel_mm: [f32; 3]) -> Nifti {
    let mut head = plain_head();
    for (row, edge) in head.ras_from_voxel.iter_mut().zip(voxel_mm) {
        let length = row[..3].iter().map(|x| x * x).sum::<f32>().sqrt();
        row[..3].iter_mut().for_each(|x| *x *= edge / length);
    }
    head
}

#[tokio::test]
async fn what_no_head_measures_is_refused_before_it_is_queued() {
    let server = Server::start().await;
    for (voxel_mm, name) in [
        ([100.0, 100.0, 0.01], "voxel-size-implausible"),
        ([0.2; 3], "field-implausible"),
        ([1.0; 3], "field-implausible"),
    ] {
        let answer = server
            .upload(&[("volume", &volume_of(voxel_mm).bytes())])
            .await;
        assert_eq!(
            (answer.status, answer.problem().as_str()),
            (StatusCode::UNPROCESSABLE_ENTITY, name),
            "{answer:?}"
        );
    }
    server.is_empty_and_well().await;
    let server = Server::start_with(|config| config.limits.min_field_mm = 1.0).await;
    // What is in so small a skull the extraction tells, later.
    let small = volume_of([0.2; 3]).bytes();
    let answer = server.upload(&[("volume", &small)]).await;
    let is_taken = answer.status == StatusCode::ACCEPTED;
    assert!(
        is_taken || answer.problem() != "field-implausible",
        "{answer:?}"
    );
}

#[tokio::test]
async fn a_part_that_is_too_large_is_named() {
    let server = Server::start().await;
    let long = vec![b' '; 200_000];
    let answer = server
        .upload(&[("volume", &plain_head().bytes()), ("parameters", &long)])
        .await;
    assert_eq!(
        (answer.status, answer.problem().as_str()),
        (StatusCode::PAYLOAD_TOO_LARGE, "body-too-large")
    );
    let detail = answer.json()["detail"].to_string();
    assert!(
        detail.contains("`parameters`") && detail.contains("65536"),
        "{detail}"
    );
}

#[tokio::test]
async fn no_cache_keeps_what_is_counted() {
    let server = Server::start().await;
    let answer = server.get("/metrics").await;
    assert_eq!(answer.header("cache-control"), "no-store");
}
