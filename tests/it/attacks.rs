//! What an attacker tries, small: the programs of `tests/faults/` try the same in earnest and measure it.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use axum::body::Body;
use axum::http::{Request, StatusCode, header};
use bytes::Bytes;
use isocortex::config::Secret;
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::TcpStream;

use crate::head::plain_head;
use crate::nifti::Nifti;
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
    stream.write_all(request.as_bytes()).await.unwrap();
    let mut answer = Vec::new();
    // A reset after the answer is an end, too.
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
    for _ in 0..100 {
        if server.stored_files().is_empty() {
            break;
        }
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
    server.is_empty_and_well().await;
}

#[tokio::test]
async fn uploads_leave_room_for_everybody_else() {
    let server = Server::start_with(|config| config.http.max_uploads = 2).await;
    let socket = server.on_a_socket().await;
    let held = connections(&socket, 2, &half_an_upload()).await;
    while server.stored_files().len() < 2 {
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
    let answer = server.upload(&[("volume", &plain_head().bytes())]).await;
    assert_eq!(
        (answer.status, answer.problem().as_str()),
        (StatusCode::SERVICE_UNAVAILABLE, "busy")
    );
    assert_eq!(server.get("/v1/cases").await.status, StatusCode::OK);
    drop(held);
}

/// What a health check and another request are answered while all places are taken.
async fn answers_beyond_all_places(socket: &Socket) -> [String; 2] {
    let mut answers = [String::new(), String::new()];
    for _ in 0..100 {
        answers = [
            exchange(socket.address, &get("/healthz")).await,
            exchange(socket.address, &get("/v1/cases")).await,
        ];
        if !answers[1].starts_with("HTTP/1.1 200") {
            break;
        }
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
    answers
}

#[tokio::test]
async fn health_checks_are_answered_when_all_connections_are_taken() {
    for of_one_address in [false, true] {
        let server = Server::start_with(|config| match of_one_address {
            true => config.http.max_connections_per_address = 4,
            false => config.http.max_connections = 4,
        })
        .await;
        let socket = server.on_a_socket().await;
        // More than can be spared as well.
        let held = connections(&socket, 200, "GET /healthz HT").await;
        let [health, other] = answers_beyond_all_places(&socket).await;
        assert!(health.starts_with("HTTP/1.1 200"), "{health}");
        assert!(other.starts_with("HTTP/1.1 503"), "{other}");
        assert!(other.to_lowercase().contains("retry-after"), "{other}");
        drop(held);
        for _ in 0..100 {
            let answer = exchange(socket.address, &get("/v1/cases")).await;
            if answer.starts_with("HTTP/1.1 200") {
                break;
            }
            tokio::time::sleep(Duration::from_millis(50)).await;
        }
        let answer = exchange(socket.address, &get("/v1/cases")).await;
        assert!(answer.starts_with("HTTP/1.1 200"), "{answer}");
    }
}

#[tokio::test]
async fn wrong_tokens_are_answered_later_each_time() {
    const TOKEN: &str = "correct-horse-battery-staple";
    let server =
        Server::start_with(|config| config.http.token = Some(Secret(TOKEN.to_owned()))).await;
    let ask = async |token: &str| {
        let started = Instant::now();
        let value = format!("Bearer {token}");
        let answer = server
            .get_with("/v1/cases", &[("authorization", &value)])
            .await;
        (answer.status, started.elapsed())
    };
    for least_ms in [100, 200, 400] {
        let (status, took) = ask("correct-horse-battery-stapler").await;
        assert_eq!(status, StatusCode::UNAUTHORIZED);
        assert!(took >= Duration::from_millis(least_ms), "{took:?}");
    }
    let (status, _) = ask(TOKEN).await;
    assert_eq!(status, StatusCode::OK);
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
    let long = vec![b' '; 70_000];
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
