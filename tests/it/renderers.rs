//! Who draws: on this machine, whatever it has, and on one without graphics.

use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use axum::http::StatusCode;
use cases::pictures::GraphicsState;
use cases::settings::GpuUse;
use cases::settings::MapsUse;
use futures_util::future::join_all;
use nix::time::{ClockId, clock_gettime};

use crate::server::{Answer, Server};
use crate::until::until;

async fn without_graphics() -> Server {
    Server::start_with(|config| config.render.gpu = GpuUse::Off).await
}

/// A server that draws with any device, whose driver has answered, and whether there is one.
async fn with_graphics() -> (Server, bool) {
    let server = Server::start_with(|config| config.render.gpu = GpuUse::Always).await;
    let has_device = until("the driver answers", async || {
        match server.state.cases.graphics.state() {
            GraphicsState::Starting => None,
            GraphicsState::Present(_) => Some(true),
            GraphicsState::Absent(_) => Some(false),
        }
    })
    .await;
    if !has_device {
        eprintln!("SKIPPED in part: no graphics device on this machine");
    }
    (server, has_device)
}

/// The shares of the picture that are lit, left and right half.
fn lit(answer: &Answer) -> [f64; 2] {
    let picture = answer.grey();
    let half = picture.width() / 2;
    let share = |left: bool| {
        let pixels = picture
            .enumerate_pixels()
            .filter(|(x, _, pixel)| (*x < half) == left && pixel.0[0] > 20);
        pixels.count() as f64 / f64::from(half * picture.height())
    };
    [share(true), share(false)]
}

#[tokio::test]
async fn every_renderer_draws_the_same_head() {
    draw_the_same_head(without_graphics().await, false).await;
    let (server, has_graphics) = with_graphics().await;
    if has_graphics {
        draw_the_same_head(server, true).await;
    }
}

async fn draw_the_same_head(server: Server, has_graphics: bool) {
    let case = server.plain_case().await;
    let mut pictures = Vec::new();
    for renderer in ["splat", "mesh", "trace"] {
        let address = format!(
            "{case}/render?view=anterior&depth_mm=6&renderer={renderer}&contours=80&points=80"
        );
        let answer = server.get(&address).await;
        assert_eq!(
            answer.header("x-isocortex-renderer"),
            renderer,
            "{answer:?}"
        );
        let on_processor = answer.header("x-isocortex-device") == "cpu";
        assert_eq!(on_processor, !has_graphics || renderer == "splat");
        let again = server
            .get_with(&address, &[("if-none-match", answer.header("etag"))])
            .await;
        assert_eq!(again.status, StatusCode::NOT_MODIFIED, "{renderer}");
        pictures.push((renderer, answer));
    }
    let expected = lit(&pictures[0].1);
    for (renderer, picture) in &pictures {
        let found = lit(picture);
        for side in 0..2 {
            let off = (found[side] - expected[side]).abs();
            assert!(off < 0.02, "{renderer}: {found:?}, not {expected:?}");
        }
    }
    let mut tags: Vec<_> = pictures
        .iter()
        .map(|(_, answer)| answer.header("etag"))
        .collect();
    tags.dedup();
    assert_eq!(tags.len(), pictures.len(), "each renderer has its own tag");
}

#[tokio::test]
async fn the_mesh_is_as_fine_as_it_is_asked_for() {
    let server = without_graphics().await;
    let case = server.plain_case().await;
    let mesh = async |rest: &str| {
        let address = format!("{case}/render?renderer=mesh&depth_mm=6&width=96&height=96{rest}");
        let answer = server.get(&address).await;
        assert_eq!(answer.status, StatusCode::OK, "{answer:?}");
        answer.grey()
    };
    let default = mesh("").await;
    assert_ne!(mesh("&contours=5&points=6").await, default);
    assert_ne!(mesh("&paths=forest").await, default);
    assert_eq!(mesh("&contours=200&points=200&paths=flow").await, default);
}

#[tokio::test]
async fn a_server_without_graphics_draws_with_the_processor_alone() {
    let server = without_graphics().await;
    let case = server.plain_case().await;
    let version = server.get("/version").await.json();
    assert_eq!(
        version["renderers"],
        serde_json::json!(["splat", "mesh", "trace"])
    );
    assert!(version["graphics"].as_str().unwrap().starts_with("none"));
    for (asked, used) in [
        ("auto", "trace"),
        ("splat", "splat"),
        ("mesh", "mesh"),
        ("trace", "trace"),
    ] {
        let answer = server
            .get(&format!("{case}/render?depth_mm=6&renderer={asked}"))
            .await;
        assert_eq!(answer.header("x-isocortex-renderer"), used);
        assert_eq!(answer.header("x-isocortex-device"), "cpu");
        assert!(lit(&answer)[0] > 0.05);
    }
    let again = server.get("/version").await.json();
    assert_eq!(again["graphics"], version["graphics"], "nothing was opened");
}

/// The log of a server of its own process, once it listens and has looked for a driver, which `driver` describes.
fn log_with_driver(program: &Path, folder: &Path, driver: &Path) -> String {
    let log = folder.join("log");
    let file = std::fs::File::create(&log).unwrap();
    let started = Instant::now();
    let mut child = Command::new(program)
        .args([
            "serve",
            "--gpu",
            "always",
            "--listen",
            "127.0.0.1:0",
            "--data",
        ])
        .arg(folder.join("data"))
        .env("ISOCORTEX_CREATE", "true")
        .env("VK_DRIVER_FILES", driver)
        .env("VK_ICD_FILENAMES", driver)
        .env("__EGL_VENDOR_LIBRARY_FILENAMES", "/nowhere.json")
        .stdout(file.try_clone().unwrap())
        .stderr(file)
        .stdin(Stdio::null())
        .spawn()
        .unwrap();
    let mut text = String::new();
    while started.elapsed() < Duration::from_secs(60) {
        text = std::fs::read_to_string(&log).unwrap();
        if text.contains("listening") && text.contains("no graphics device") {
            break;
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    text
}

#[test]
fn with_no_driver_or_one_that_fails_the_program_starts_and_says_so_once() {
    let Some(program) = program() else {
        eprintln!("SKIPPED: the program isocortex is not built");
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let library = folder.path().join("driver.so");
    std::fs::write(&library, "this is no driver").unwrap();
    let manifest = folder.path().join("broken.json");
    let icd = serde_json::json!({"library_path": library, "api_version": "1.3.0"});
    let text = serde_json::json!({"file_format_version": "1.0.0", "ICD": icd}).to_string();
    std::fs::write(&manifest, text).unwrap();
    for driver in [Path::new("/nowhere.json"), &manifest] {
        let text = log_with_driver(&program, folder.path(), driver);
        assert!(text.contains("listening"), "{text}");
        assert_eq!(text.matches("no graphics device").count(), 1, "{text}");
    }
}

/// The program beside this test's own.
fn program() -> Option<std::path::PathBuf> {
    let test = std::env::current_exe().ok()?;
    let program = test.parent()?.parent()?.join("isocortex");
    program.exists().then_some(program)
}

#[tokio::test]
async fn many_renders_at_once_on_two_threads_are_all_drawn() {
    let server = Server::start_with(|config| config.render.threads = 2).await;
    let case = server.plain_case().await;
    for renderer in ["splat", "trace", "mesh"] {
        let pictures = (0..16).map(|depth_mm| {
            let address =
                format!("{case}/render?renderer={renderer}&depth_mm={depth_mm}&width=64&height=64");
            let server = &server;
            async move { server.get(&address).await }
        });
        for answer in join_all(pictures).await {
            assert_eq!(answer.status, StatusCode::OK, "{renderer}: {answer:?}");
        }
    }
}

#[tokio::test]
async fn a_client_that_leaves_takes_its_pictures_with_it() {
    for renderer in ["mesh", "trace"] {
        leave(renderer).await;
    }
}

/// Twenty clients that leave cost less than five pictures. Processor time is counted, because other work on the machine does not change it.
async fn leave(renderer: &str) {
    let server = Server::start_with(|config| {
        config.render.threads = 1;
        config.limits.maps = MapsUse::Off;
    })
    .await;
    let case = server.plain_case().await;
    let picture = format!("{case}/render?renderer={renderer}&zoom=2&width=2048");
    let address = format!("{picture}&height=2048");
    server.get(&format!("{case}/render")).await;
    let begun = processor_time();
    for _ in 0..20 {
        let left = tokio::time::timeout(Duration::from_millis(1), server.get(&address));
        assert!(
            left.await.is_err(),
            "the picture came before the client could leave"
        );
    }
    let one = server.get(&address).await;
    assert_eq!(one.status, StatusCode::OK);
    let before = processor_time();
    server.get(&format!("{picture}&height=2047")).await;
    let (spent, alone) = (before - begun, processor_time() - before);
    assert!(spent < 6 * alone, "{spent:?} for 21, {alone:?} for one");
    assert_eq!(server.state.cases.queue.waiting(), 0);
}

/// What all threads of this process have used.
fn processor_time() -> Duration {
    let used = clock_gettime(ClockId::CLOCK_PROCESS_CPUTIME_ID).expect("a clock of the process");
    Duration::from(used)
}

#[tokio::test]
async fn impossible_pictures_are_refused_by_every_renderer() {
    let server = Server::start().await;
    let case = server.plain_case().await;
    let refused = [
        ("orientation=0,0,0,0", "orientation"),
        ("orientation=nan,0,0,1", "orientation"),
        ("zoom=0", "zoom"),
        ("zoom=NaN", "zoom"),
        ("width=5000", "width"),
        ("width=0", "width"),
        ("width=4096&height=4097", "height"),
        ("width=64&height=64&annotate=true", "annotate"),
        ("contours=2", "contours"),
        ("paths=straight", "paths"),
    ];
    for renderer in ["auto", "splat", "trace", "mesh"] {
        for (query, parameter) in refused {
            let address = format!("{case}/render?renderer={renderer}&{query}");
            let answer = server.get(&address).await;
            assert_eq!(answer.status, StatusCode::BAD_REQUEST, "{query}");
            answer.problem();
            assert_eq!(answer.json()["parameter"], parameter, "{query}");
        }
    }
    let after = server.get(&format!("{case}/render")).await;
    assert_eq!(after.status, StatusCode::OK);
}

/// The texts of a PNG.
fn texts(png: &[u8]) -> std::collections::BTreeMap<String, String> {
    let mut texts = std::collections::BTreeMap::new();
    let mut rest = &png[8..];
    while let Some((head, after)) = rest.split_at_checked(8) {
        let length = u32::from_be_bytes(head[..4].try_into().unwrap()) as usize;
        if &head[4..] == b"tEXt" {
            let text = String::from_utf8(after[..length].to_vec()).unwrap();
            let (keyword, value) = text.split_once('\0').unwrap();
            texts.insert(keyword.to_owned(), value.to_owned());
        }
        rest = &after[length + 4..];
    }
    texts
}

#[tokio::test]
async fn a_picture_tells_how_it_was_made() {
    let server = without_graphics().await;
    let case = server.plain_case().await;
    let answer = server
        .get(&format!(
            "{case}/render?depth_mm=6&view=superior&zoom=2&pan=3,-4&window=300,400&colormap=hot&renderer=trace"
        ))
        .await;
    let texts = texts(&answer.body);
    let expected = [
        ("depth_mm", "6"),
        ("zoom", "2"),
        ("pan", "3,-4"),
        ("window", "300,400"),
        ("colormap", "hot"),
        ("renderer", "trace"),
        ("device", "cpu"),
        ("case", case.rsplit('/').next().unwrap()),
    ];
    for (keyword, value) in expected {
        assert_eq!(texts[keyword], value, "{keyword}");
    }
    assert!(texts["Disclaimer"].contains("research"));
    assert!(texts["Software"].starts_with("Isocortex "));
    assert_eq!(texts["orientation"].split(',').count(), 4);
}

#[tokio::test]
async fn a_slice_tells_how_it_was_made() {
    let server = without_graphics().await;
    let case = server.plain_case().await;
    let answer = server
        .get(&format!(
            "{case}/slices/coronal?position_mm=-12.5&depth_mm=5,10&zoom=2&pan=3,-4&window=300,400&colormap=hot"
        ))
        .await;
    let texts = texts(&answer.body);
    let expected = [
        ("plane", "coronal"),
        ("position_mm", "-12.5"),
        ("depth_mm", "5,10"),
        ("convention", "left R, right L, up S, down I"),
        ("zoom", "2"),
        ("pan", "3,-4"),
        ("window", "300,400"),
        ("colormap", "hot"),
        ("case", case.rsplit('/').next().unwrap()),
    ];
    for (keyword, value) in expected {
        assert_eq!(texts[keyword], value, "{keyword}");
    }
    assert!(texts["Disclaimer"].contains("research"));
    assert!(texts["Software"].starts_with("Isocortex "));
}

#[tokio::test]
async fn a_neurological_slice_is_the_mirror_image_with_its_own_letters() {
    let server = without_graphics().await;
    let case = server.plain_case().await;
    for (plane, convention, is_mirrored) in [
        ("axial", "left L, right R, up A, down P", true),
        ("coronal", "left L, right R, up S, down I", true),
        ("sagittal", "left A, right P, up S, down I", false),
    ] {
        let slice = format!("{case}/slices/{plane}?width=90&height=80");
        let usual = server.get(&slice).await;
        let same = server
            .get(&format!("{slice}&convention=radiological"))
            .await;
        assert_eq!(same.header("etag"), usual.header("etag"));
        let other = server
            .get(&format!("{slice}&convention=neurological"))
            .await;
        assert_ne!(other.header("etag"), usual.header("etag"));
        assert_eq!(texts(&other.body)["convention"], convention);
        let (mut expected, found) = (usual.grey(), other.grey());
        if is_mirrored {
            image::imageops::flip_horizontal_in_place(&mut expected);
        }
        for (a, b) in expected.pixels().zip(found.pixels()) {
            assert!(a.0[0].abs_diff(b.0[0]) <= 1, "{plane}");
        }
    }
    let unknown = server
        .get(&format!("{case}/slices/axial?convention=other"))
        .await;
    assert_eq!(unknown.problem(), "query-value-unreadable");
}

#[tokio::test]
async fn a_slice_drawn_from_its_own_texts_is_the_same() {
    let server = without_graphics().await;
    let case = server.plain_case().await;
    let first = server
        .get(&format!("{case}/slices/axial?depth_mm=4&colormap=bone"))
        .await;
    let texts = texts(&first.body);
    let keys = [
        "position_mm",
        "depth_mm",
        "zoom",
        "pan",
        "window",
        "colormap",
    ];
    let query = keys.map(|key| format!("{key}={}", texts[key])).join("&");
    let again = server
        .get(&format!("{case}/slices/{}?{query}", texts["plane"]))
        .await;
    assert!(again.body == first.body, "{query}");
}

#[tokio::test]
async fn the_quality_sheet_tells_of_which_case_it_is() {
    let server = without_graphics().await;
    let case = server.plain_case().await;
    let texts = texts(&server.get(&format!("{case}/quality")).await.body);
    assert_eq!(texts["case"], case.rsplit('/').next().unwrap());
    assert_eq!(texts["window"].split(',').count(), 2);
}

#[tokio::test]
async fn slices_are_annotated_on_request_only() {
    let server = without_graphics().await;
    let case = server.plain_case().await;
    let slice = async |query: &str| {
        let address = format!("{case}/slices/axial?zoom=0.5&{query}");
        server.get(&address).await
    };
    let [plain, annotated] = [slice("").await.grey(), slice("annotate=true").await.grey()];
    // At this zoom nothing of the head is at the edges.
    let bright = |picture: &image::GrayImage, columns: std::ops::Range<u32>| {
        let pixels = picture.enumerate_pixels();
        pixels
            .filter(|(x, y, pixel)| {
                columns.contains(x) && (240..272).contains(y) && pixel.0[0] > 240
            })
            .count()
    };
    for columns in [0..40, 472..512] {
        assert_eq!(bright(&plain, columns.clone()), 0);
        assert!(bright(&annotated, columns) > 15);
    }
    let small = slice("annotate=true&width=127").await;
    assert_eq!(small.problem(), "query-value-out-of-range");
}

#[tokio::test]
async fn annotations_are_written_on_request_only() {
    let server = without_graphics().await;
    let case = server.plain_case().await;
    let plain = server
        .get(&format!("{case}/render?depth_mm=6"))
        .await
        .grey();
    let address = format!("{case}/render?depth_mm=6&annotate=true");
    let annotated = server.get(&address).await.grey();
    // Nothing is behind the corner but the depth.
    let corner = |picture: &image::GrayImage| {
        let pixels = picture.enumerate_pixels();
        pixels
            .filter(|(x, y, pixel)| *x < 100 && *y < 50 && pixel.0[0] > 240)
            .count()
    };
    assert_eq!(corner(&plain), 0);
    assert!(corner(&annotated) > 50);
}

#[tokio::test]
async fn an_annotated_picture_names_its_case_and_follows_its_label() {
    let server = without_graphics().await;
    let head = crate::head::plain_head().bytes();
    let labelled = async |name: &str| {
        let parameters = format!(r#"{{"name": "{name}", "keep_name": false}}"#);
        server
            .prepared(&[("volume", &head), ("parameters", parameters.as_bytes())])
            .await
    };
    let case = labelled("First").await;
    for picture in ["render?depth_mm=6", "slices/axial?position_mm=0"] {
        let plain = server.get(&format!("{case}/{picture}")).await;
        assert!(
            plain.header("cache-control").contains("immutable"),
            "{plain:?}"
        );
        let address = format!("{case}/{picture}&annotate=true");
        let first = server.get(&address).await;
        assert_eq!(
            first.header("cache-control"),
            "private, no-cache",
            "its label may change"
        );
        let known = [("if-none-match", first.header("etag"))];
        let again = server.get_with(&address, &known).await;
        assert_eq!(again.status, StatusCode::NOT_MODIFIED);
        assert_eq!(labelled("Another label").await, case);
        let renamed = server.get_with(&address, &known).await;
        assert_eq!(renamed.status, StatusCode::OK);
        // Label, day and id stand in the first line, and nowhere else.
        let (before, after) = (first.grey(), renamed.grey());
        let differs = |(x, y): (u32, u32)| before.get_pixel(x, y) != after.get_pixel(x, y);
        let places = (0..512).flat_map(|y| (0..512).map(move |x| (x, y)));
        let rows: Vec<_> = places
            .filter(|&place| differs(place))
            .map(|(_, y)| y)
            .collect();
        assert!(rows.len() > 20 && rows.iter().all(|&y| y < 40), "{picture}");
        assert_eq!(labelled("First").await, case);
    }
}
