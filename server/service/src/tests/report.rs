//! The report of a reading: what a reader wrote, as text, with pictures and nothing from elsewhere.

use std::time::Duration;

use axum::http::Method;
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use cases::jobs::start_workers;
use geometry::phantom::PhantomHead;
use geometry::{Mask, Volume};
use glam::DVec3;
use pipeline::testing::{nifti, nifti_mask, phantom};
use serde_json::{Value, json};

use super::layers::{added, flair};
use super::server::{Server, head};

const PDF: [(&str, &str); 1] = [("accept", "application/pdf")];

/// Stores findings, each with its id, its place from the centre of the head in mm, and its label.
pub(super) async fn mark(server: &Server, case: &str, findings: &[(&str, [f64; 3], &str)]) {
    let centre = server.get(case).await.json()["envelope_sphere"]["center_in_patient"].clone();
    let finding = |(id, from_centre, label): &(&str, [f64; 3], &str)| {
        let at = [0, 1, 2].map(|axis| centre[axis].as_f64().unwrap() + from_centre[axis]);
        json!({
            "id": id, "kind": "point", "points_in_patient": [at], "depth_mm": 6.0, "label": label,
            "note": "</style></table><img src=x onerror=alert(1)>", "certainty": "probable",
            "is_dismissed": *id == "dismissed",
        })
    };
    let list: Vec<Value> = findings.iter().map(finding).collect();
    let address = format!("{case}/findings");
    let none = server.get(&address).await;
    let tag = [("if-match", none.header("etag"))];
    let body = json!({ "findings": list }).to_string();
    let stored = server.ask(Method::PUT, &address, &tag, body).await;
    assert_eq!(stored.status, 200, "{stored:?}");
}

async fn html(server: &Server, address: &str) -> String {
    let report = server.get(address).await;
    assert_eq!(report.status, 200, "{report:?}");
    String::from_utf8(report.body.to_vec()).unwrap()
}

/// How many pages and pictures a PDF has.
fn counted(pdf: &[u8]) -> [usize; 2] {
    let text = String::from_utf8_lossy(pdf);
    ["/Type /Page\n", "/Subtype /Image\n"].map(|kind| text.matches(kind).count())
}

#[tokio::test]
async fn the_report_shows_what_was_marked_and_runs_nothing() {
    let (server, case) = Server::with_case().await;
    let findings = [
        ("a", [25.0, 0.0, 0.0], "<script>alert(1)</script>"),
        ("b", [-25.0, 0.0, 0.0], "second"),
        ("dismissed", [-10.0, 0.0, 0.0], "nothing here"),
    ];
    mark(&server, &case, &findings).await;

    let report = server.get(&format!("{case}/report")).await;
    assert_eq!(report.status, 200, "{:?}", report.headers);
    assert_eq!(report.header("content-type"), "text/html; charset=utf-8");
    let policy = report.header("content-security-policy");
    assert!(policy.starts_with("default-src 'none'; img-src data:"));
    assert!(policy.ends_with("; frame-ancestors 'none'"), "{policy}");
    let html = String::from_utf8(report.body.to_vec()).unwrap();
    assert!(html.contains("&lt;script&gt;alert(1)&lt;/script&gt;"));
    for forbidden in ["<script", "<img src=x", "http://", "https://", "src=\"/"] {
        assert!(!html.contains(forbidden), "{forbidden}");
    }
    assert_eq!(html.matches("class=\"page finding\"").count(), 2);
    // Each is named by the head of a table, which is printed again on the pages that it goes on to.
    for head in [
        "<thead><tr><td><h2>Finding 1: ",
        "<thead><tr><td><h2>Finding 2: ",
    ] {
        assert_eq!(html.matches(head).count(), 1, "{head}");
    }
    assert!(html.contains("<strong>left</strong>") && html.contains("<strong>right</strong>"));
    assert!(html.contains("left, as acquired") && html.contains("right, flipped"));
    assert!(html.contains("Looked at and dismissed") && html.contains("nothing here"));
    assert!(html.contains("There are no maps of this case:") && !html.contains("stands out"));
    // What is flipped says so by its letters: a letter for each edge of each picture.
    // Those of the overview have no bar of 10 mm.
    let (images, bars) = (
        html.matches("<image").count(),
        html.matches(">10 mm</text>").count(),
    );
    assert_eq!(bars, images - 24);
    assert_eq!(html.matches("</text>").count(), 4 * images + bars);
    assert_eq!(
        html.matches("scale(-1 1)").count(),
        html.matches(", flipped</figcaption>").count()
    );
    // The first page has one; each finding has its cut, three slices and the one across the sulcus, of both sides; the overview has six
    // views at four depths.
    let pictures = html.matches("<image").count();
    assert_eq!(pictures, 1 + 2 * (2 + 8) + 24);
    assert!(html.len() < 3_000_000, "{}", html.len());
    let known = [("if-none-match", report.header("etag"))];
    let address = format!("{case}/report");
    assert_eq!(server.get_with(&address, &known).await.status, 304);

    let portuguese = self::html(&server, &format!("{case}/report?language=pt-BR")).await;
    assert!(
        portuguese.contains("lang=\"pt-BR\"") && portuguese.contains("Examinados e descartados")
    );
    assert!(portuguese.contains("Somente para pesquisa."));

    // The same as PDF: a page for each finding, one before and one after them.
    let pdf = server.get_with(&address, &PDF).await;
    assert_eq!(pdf.status, 200, "{:?}", pdf.headers);
    assert_eq!(pdf.header("content-type"), "application/pdf");
    assert_eq!(pdf.header("vary"), "accept");
    assert!(pdf.body.starts_with(b"%PDF-1.7") && pdf.body.ends_with(b"%%EOF"));
    // The first page shows a picture of the first finding, which is in the file once.
    assert_eq!(counted(&pdf.body), [4, pictures - 1]);
    assert!(pdf.body.len() < report.body.len());
    assert!(pdf.header("etag").starts_with('"') && pdf.header("etag") != report.header("etag"));
    let known = [PDF[0], ("if-none-match", pdf.header("etag"))];
    assert_eq!(server.get_with(&address, &known).await.status, 304);
    let other = [("accept", "image/png")];
    let refused = server.get_with(&address, &other).await;
    assert_eq!(refused.refusal(), (406, "not-acceptable".to_owned()));
}

#[tokio::test]
async fn a_flair_layer_stands_beside_the_anatomy() {
    let (server, case) = Server::with_case().await;
    mark(&server, &case, &[("a", [25.0, 0.0, 0.0], "here")]).await;
    let workers = start_workers(server.cases.library.clone(), 1);
    for (name, shift_mm) in [("Second contrast", 2.0), ("3D FLAIR <b>", 0.0)] {
        let parameters = json!({"name": name, "kind": "mr", "transform": "none"});
        added(&server, &case, &flair(shift_mm), parameters).await;
    }
    workers.shut_down(Duration::from_secs(60)).await;
    let report = html(&server, &format!("{case}/report")).await;
    assert_eq!(report.matches("<image").count(), 1 + 2 * 2 + 2 * 8 + 24);
    assert!(
        report.contains("<bdi>3D FLAIR &lt;b&gt;</bdi>, axial"),
        "a slice of it"
    );
    assert!(
        report.contains("<bdi>3D FLAIR &lt;b&gt;</bdi>, 6.0 mm: <strong>right</strong>, flipped")
    );
    assert!(!report.contains("Second contrast"), "one layer is shown");
    // Its voxels lie where its file says, which nobody checked.
    let doubted = report.matches("its place was not checked").count();
    let layers = server.get(&format!("{case}/layers")).await.json();
    let is_checked = layers["layers"]
        .as_array()
        .unwrap()
        .iter()
        .any(|layer| layer["name"] == "3D FLAIR <b>" && layer["quality"] == "ok");
    // On the first page and on the one of the finding.
    assert_eq!(doubted, 2 * usize::from(!is_checked), "{layers}");
    let pdf = server.get_with(&format!("{case}/report"), &PDF).await;
    assert_eq!(counted(&pdf.body)[1], 2 * 2 + 2 * 8 + 24);
}

#[tokio::test]
async fn a_doubtful_mask_is_named_on_every_page() {
    let PhantomHead { volume, brain } = phantom();
    let grid = brain.grid().clone();
    let middle = grid
        .patient_from_voxel()
        .transform_point3(DVec3::from_array(grid.size().map(|side| side as f64)) / 2.0);
    let is_near = |index: usize| {
        let voxel = DVec3::from_array(grid.voxel(index).map(|along| along as f64));
        grid.patient_from_voxel()
            .transform_point3(voxel)
            .distance(middle)
            < 40.0
    };
    let voxels = (0..grid.voxel_count()).map(is_near).collect();
    let mask = nifti_mask(&Mask::new(grid.clone(), voxels).unwrap());
    let (server, case) = Server::with_head(&nifti(&volume), &mask).await;
    let quality = server.get(&case).await.json()["quality"].clone();
    assert_eq!(quality["state"], "review", "{quality}");
    mark(&server, &case, &[("a", [15.0, 0.0, 0.0], "here")]).await;
    for (language, doubt, reason) in [
        (
            "en",
            "Brain mask: CHECK IT",
            "The volume of the mask is not that of a brain.",
        ),
        (
            "pt-BR",
            "Máscara do encéfalo: VERIFIQUE",
            "O volume da máscara não é o de um encéfalo.",
        ),
    ] {
        let address = format!("{case}/report?language={language}");
        let report = html(&server, &address).await;
        // The first page, one for the finding, and the overview; and the margin of each printed page.
        let pages = 1 + report.matches("class=\"page").count();
        assert_eq!(pages, 3);
        let said = format!("<strong>{doubt}</strong>");
        assert_eq!(report.matches(&said).count(), pages, "{language}");
        assert!(
            report.contains("@top-right") && report.contains(reason),
            "{language}"
        );
    }
}

/// A picture of a report as it is shown.
struct Shown {
    /// At the left, right, upper and lower edge.
    letters: Vec<String>,
    caption: String,
    is_flipped: bool,
    has_mark: bool,
    side: f64,
    /// The brightness of each pixel, and how far it is from the left edge.
    pixels: Vec<(u8, f64)>,
}

impl Shown {
    /// How many pixels are white, and how far from the left edge on average.
    fn white(&self) -> (usize, f64) {
        mean(self.pixels.iter().filter(|(value, _)| *value > 250))
    }

    /// How far the brightest hundredth of what is lit is from the left edge on average.
    fn brightest(&self) -> f64 {
        let mut lit: Vec<_> = self.pixels.iter().filter(|(value, _)| *value > 0).collect();
        lit.sort_by_key(|(value, _)| std::cmp::Reverse(*value));
        let count = lit.len() / 100;
        mean(lit.into_iter().take(count)).1
    }
}

fn mean<'a>(pixels: impl Iterator<Item = &'a (u8, f64)>) -> (usize, f64) {
    let (count, sum) = pixels.fold((0, 0.0), |(count, sum), (_, x)| (count + 1, sum + x));
    (count, sum / (count.max(1)) as f64)
}

fn shown(html: &str) -> Vec<Shown> {
    let pictures = html.split("<svg ").skip(1);
    pictures
        .map(|svg| picture(svg.split("</svg>").next().unwrap()))
        .collect()
}

fn picture(svg: &str) -> Shown {
    let between = |from: &str, to: &str| {
        let (_, after) = svg.split_once(from).unwrap();
        after.split(to).next().unwrap()
    };
    let png = STANDARD.decode(between("base64,", "\"")).unwrap();
    let mut reader = png::Decoder::new(std::io::Cursor::new(png))
        .read_info()
        .unwrap();
    let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut bytes).unwrap();
    let is_flipped = svg.contains("scale(-1 1)");
    let pixel = |(at, channels): (usize, &[u8])| {
        let x = at as u32 % info.width;
        let x = if is_flipped { info.width - 1 - x } else { x };
        (*channels.iter().min().unwrap(), f64::from(x) + 0.5)
    };
    let pixels = bytes.chunks(info.color_type.samples()).enumerate();
    let texts = svg.split("<text ").skip(1);
    let letters = texts.map(|text| {
        let (_, after) = text.split_once('>').unwrap();
        after.split('<').next().unwrap().to_owned()
    });
    Shown {
        letters: letters.filter(|text| text != "10 mm").collect(),
        caption: between("aria-label=\"", "\"").to_owned(),
        is_flipped,
        has_mark: svg.contains("<path"),
        side: f64::from(info.width),
        pixels: pixels.map(pixel).collect(),
    }
}

/// A place on the patient's left, in front.
const BALL: DVec3 = DVec3::new(20.0, -66.0, 10.0);

/// The report of a head with painted balls, and a finding still farther to the left than [`BALL`].
async fn report_of_balls(balls: &[DVec3], language: &str) -> String {
    let PhantomHead { volume, brain } = phantom();
    let grid = volume.grid().clone();
    let painted = |(index, &voxel): (usize, &u16)| {
        let place = DVec3::from_array(grid.voxel(index).map(|along| along as f64));
        let place = grid.patient_from_voxel().transform_point3(place);
        if balls.iter().any(|ball| place.distance(*ball) < 9.0) {
            4000
        } else {
            voxel
        }
    };
    let voxels = volume.voxels().iter().enumerate().map(painted).collect();
    let volume = Volume::new(grid.clone(), voxels, volume.rescale()).unwrap();
    let (server, case) = Server::with_head(&nifti(&volume), &nifti_mask(&brain)).await;
    let facts = server.get(&case).await.json();
    let centre = facts["envelope_sphere"]["center_in_patient"].clone();
    let finding = BALL + DVec3::X * 14.0;
    let offset = [0, 1, 2].map(|axis| finding[axis] - centre[axis].as_f64().unwrap());
    mark(&server, &case, &[("a", offset, "here")]).await;
    html(&server, &format!("{case}/report?language={language}")).await
}

/// The ball is on the left alone.
#[tokio::test]
async fn what_is_on_the_left_is_on_the_side_of_the_letter_for_left() {
    let report = report_of_balls(&[BALL], "pt-BR").await;
    let (mut of_overview, mut of_slices) = (Vec::new(), 0);
    // The slices of the other side have a test of their own: scalp is as white as the ball.
    let is_told = |each: &Shown| !each.caption.contains("outro lado");
    for each in shown(&report).into_iter().filter(is_told) {
        let side = |letter: &str| match each.letters.iter().position(|other| other == letter) {
            Some(0) => -1.0,
            Some(1) => 1.0,
            _ => 0.0,
        };
        let left = side("L");
        assert_eq!(left, -side("R"), "{}", each.caption);
        let middle = each.side / 2.0;
        let (count, white) = each.white();
        if each.is_flipped {
            // It shows the other side, on which nothing was painted.
            assert!(count < 40, "{}: {count}", each.caption);
        } else if each.has_mark && count >= 40 && left != 0.0 {
            // In the middle is the finding, and the ball is to the patient's right of it.
            let beside = (white - middle) * left;
            assert!(beside < -20.0, "{}: {beside}", each.caption);
            of_slices += 1;
        } else if each.caption.ends_with("visto de frente") {
            of_overview.push((each.brightest() - middle) * left);
        }
    }
    assert!(of_slices >= 2, "axial and coronal: {of_slices}");
    assert!(
        of_overview.iter().all(|&beside| beside > 2.0),
        "{of_overview:?}"
    );
    assert_eq!(of_overview.len(), 4);
}

/// The slices through the finding, and those of the other side.
async fn slices_of(balls: &[DVec3]) -> [Vec<Shown>; 2] {
    let report = report_of_balls(balls, "en").await;
    let planes = ["axial", "coronal", "sagittal", "across"];
    let is_slice = |each: &Shown| planes.iter().any(|plane| each.caption.contains(plane));
    let slices = shown(&report).into_iter().filter(is_slice);
    let (other, own): (Vec<_>, Vec<_>) =
        slices.partition(|each| each.caption.contains("other side"));
    assert_eq!([own.len(), other.len()], [4, 4]);
    [own, other]
}

/// A ball on the right is seen on the other side alone, at the same pixels as one on the left beside it.
#[tokio::test]
async fn a_slice_of_the_other_side_is_the_mirror_image_of_its_place() {
    let [alone, none] = slices_of(&[BALL]).await;
    let both = [BALL, DVec3::new(-BALL.x, BALL.y, BALL.z)];
    let [own, other] = slices_of(&both).await;
    for (own, other) in own.iter().zip(&other) {
        let mirrored = |letters: &String| {
            let turned = letters.chars().map(|letter| match letter {
                'L' => 'R',
                'R' => 'L',
                other => other,
            });
            turned.collect::<String>()
        };
        let letters: Vec<_> = own.letters.iter().map(mirrored).collect();
        assert_eq!(other.letters, letters, "{}", other.caption);
    }
    // The balls lie in the axial and the coronal slice, whose mirror images are flipped.
    for at in 0..2 {
        assert!(other[at].is_flipped && !own[at].is_flipped);
        let [alone, none, own, other] =
            [&alone, &none, &own, &other].map(|slices: &Vec<Shown>| slices[at].white());
        assert!(own.0.abs_diff(alone.0) < 40, "{own:?} {alone:?}");
        assert!(other.0 > none.0 + 300, "{other:?} {none:?}");
        assert!((own.1 - other.1).abs() < 8.0, "{own:?} {other:?}");
    }
}

#[tokio::test]
async fn a_report_that_cannot_be_made_says_why() {
    let server = Server::start().await;
    let (volume, mask) = head();
    let answer = server.upload(&[("volume", volume), ("mask", mask)]).await;
    let case = answer.header("location").to_owned();
    for (query, status, kind) in [
        ("", 409, "case-not-ready"),
        ("?language=fr", 400, "query-value-unreadable"),
        ("?patient=yes", 400, "query-value-unreadable"),
        ("?fruit=1", 400, "query-unknown-key"),
    ] {
        for headers in [&[][..], &PDF] {
            let answer = server
                .get_with(&format!("{case}/report{query}"), headers)
                .await;
            assert_eq!(answer.refusal(), (status, kind.to_owned()), "{query}");
        }
    }
}
