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
async fn an_upload_that_drips_has_the_time_of_an_upload() {
    let server =
        Server::start_with(|config| config.http.timeouts.whole = Duration::from_secs(1)).await;
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
async fn a_token_is_one_client_at_however_many_addresses() {
    let mut tokens = TokensFile::new();
    for name in ["greedy", "other"] {
        tokens.add(name, &["--role", "editor"]);
    }
    let server = Server::start_with(|config| {
        config.http.tokens_file = Some(tokens.path());
        config.http.max_uploads = 8;
    })
    .await;
    let socket = server.on_a_socket().await;
    let half = |name: &str| {
        let host = "Host: localhost\r\n";
        let authorization = format!("{host}Authorization: {}\r\n", tokens.bearer(name));
        half_an_upload().replace(host, &authorization)
    };
    let mut held = Vec::new();
    // A quarter each, the other one at an address that the first has as well.
    for (name, numbers) in [("greedy", [2, 3, 4]), ("other", [2, 2, 2])] {
        for number in &numbers[..2] {
            held.push(from(*number, &socket, &half(name)).await);
            while server.stored_files().len() < held.len() {
                tokio::task::yield_now().await;
            }
        }
        let mut refused = from(numbers[2], &socket, &half(name)).await;
        assert!(status_of(&mut refused).await.contains(" 503 "), "{name}");
    }
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

fn get_with(token: &str) -> String {
    let rest = "Host: localhost\r\nConnection: close\r\n\r\n";
    format!("GET /v1/cases HTTP/1.1\r\nAuthorization: Bearer {token}\r\n{rest}")
}

#[tokio::test]
async fn one_address_has_a_quarter_of_the_connections_and_a_listed_proxy_all() {
    for by_proxy in [false, true] {
        let server = Server::start_with(|config| {
            config.http.token = Some(Secret(TOKEN.to_owned()));
            config.http.max_connections = 16;
            if by_proxy {
                config.http.trusted_proxies = vec!["127.0.0.2".parse().unwrap()];
            }
        })
        .await;
        let socket = server.on_a_socket().await;
        // Before any of them is read.
        let mut held = Vec::new();
        for _ in 0..4 {
            held.push(from(2, &socket, "GET /v1/ca").await);
        }
        let fifth = from(2, &socket, &get("/healthz")).await;
        let mut answer = Vec::new();
        let _ = { fifth }.read_to_end(&mut answer).await;
        assert_eq!(answer.starts_with(b"HTTP/1.1 200"), by_proxy);
        for request in [get("/healthz"), get_with(TOKEN)] {
            let mut other = from(3, &socket, &request).await;
            assert!(status_of(&mut other).await.contains(" 200 "));
        }
        drop(held);
    }
}

#[tokio::test]
async fn a_listed_proxy_names_the_client() {
    let server = Server::start_with(|config| {
        config.http.max_uploads = 4;
        config.http.trusted_proxies = vec!["127.0.0.0/8".parse().unwrap()];
    })
    .await;
    let socket = server.on_a_socket().await;
    let half = |client: &str| {
        let host = "Host: localhost\r\n";
        half_an_upload().replace(host, &format!("{host}X-Forwarded-For: {client}\r\n"))
    };
    let _held = from(2, &socket, &half("203.0.113.5")).await;
    while server.stored_files().is_empty() {
        tokio::task::yield_now().await;
    }
    let mut refused = from(3, &socket, &half("203.0.113.5")).await;
    assert!(status_of(&mut refused).await.contains(" 503 "));
    let _other = from(2, &socket, &half("203.0.113.6")).await;
    while server.stored_files().len() < 2 {
        tokio::task::yield_now().await;
    }
}

/// What one token asks for does not keep another one waiting, be it pictures, textures or meshes.
#[tokio::test]
async fn one_client_has_half_of_the_threads() {
    let mut tokens = TokensFile::new();
    for name in ["greedy", "other"] {
        tokens.add(name, &["--role", "editor"]);
    }
    let server = Server::start_with(|config| {
        config.http.tokens_file = Some(tokens.path());
        config.render.threads = 2;
        config.limits.max_queued_renders = 14;
    })
    .await;
    let upload = Request::post("/v1/cases")
        .header(header::CONTENT_TYPE, form_type())
        .header(header::AUTHORIZATION, tokens.bearer("greedy"))
        .body(Body::from(form(&[("volume", &plain_head().bytes())])));
    let uploaded = server.send(upload.unwrap()).await;
    let address = uploaded.header("location").to_owned();
    let ask = async |path: &str, name: &str| {
        let bearer = tokens.bearer(name);
        let path = format!("{address}{path}");
        server.get_with(&path, &[("authorization", &bearer)]).await
    };
    ask("/events", "greedy").await;
    // As if one of its pictures took for ever.
    let greedy = case::Client::named("greedy");
    let queue = &server.state.cases.queue;
    let held = cases::for_client(greedy, queue.turn()).await.unwrap();
    let wanted = [
        "/render?width=64&height=64",
        "/volume?extent=whole",
        "/distance?step=2",
        "/mesh?depth_mm=5&contours=31&points=31",
    ];
    for path in wanted {
        let mut waiting = Box::pin(ask(path, "greedy"));
        let other = ask(path, "other");
        tokio::select! {
            biased;
            answer = &mut waiting => panic!("{path}: {answer:?}"),
            answer = other => assert_ne!(answer.status, 503, "{path}"),
        }
    }
    // Half of the places, too.
    let entered = async { (0..8).map(|_| queue.enter()).collect::<Vec<_>>() };
    let entered = cases::for_client(greedy, entered).await;
    assert_eq!(entered.iter().filter(|entered| entered.is_ok()).count(), 7);
    let refused = ask(wanted[0], "greedy").await;
    assert_eq!(
        (refused.status.as_u16(), refused.problem().as_str()),
        (503, "busy")
    );
    assert!(!refused.header("retry-after").is_empty());
    assert_eq!(ask(wanted[0], "other").await.status, 200);
    drop(held);
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
