//! Pictures in DICOMweb's own terms: `rendered3D`.

use image::RgbImage;
use serde_json::Value;

use crate::pacs::Neighbour;
use crate::results::identified_case;
use crate::server::{Answer, Server};

const STUDY: &str = "/dicomweb/studies/1.2.3";
const PNG: [(&str, &str); 1] = [("accept", "image/png")];

fn pixels(answer: &Answer) -> RgbImage {
    assert_eq!(answer.status, 200, "{answer:?}");
    image::load_from_memory(&answer.body).unwrap().into_rgb8()
}

fn are_near(a: &RgbImage, b: &RgbImage) -> bool {
    let near = a.iter().zip(b.iter()).all(|(a, b)| a.abs_diff(*b) <= 1);
    a.dimensions() == b.dimensions() && near
}

/// The parts of a multipart answer.
fn parts(answer: &Answer) -> Vec<Vec<u8>> {
    let kind = answer.header("content-type");
    let (_, boundary) = kind.split_once("boundary=").unwrap();
    let delimiter = format!("--{boundary}");
    let mut places: Vec<_> = memchr::memmem::find_iter(&answer.body, &delimiter).collect();
    let last = places.pop().unwrap();
    let ends: Vec<_> = places[1..].iter().copied().chain([last]).collect();
    let part = |(begin, end): (&usize, usize)| {
        let part = &answer.body[*begin..end];
        let head = memchr::memmem::find(part, b"\r\n\r\n").unwrap();
        part[head + 4..part.len() - 2].to_vec()
    };
    places.iter().zip(ends).map(part).collect()
}

fn list(value: &Value) -> String {
    let values = value["Value"].as_array().unwrap();
    let texts: Vec<String> = values.iter().map(ToString::to_string).collect();
    texts.join(",")
}

/// The query with an explicit viewpoint that the metadata of another query tells.
async fn fed_back(server: &Server, query: &str) -> String {
    let address = format!("{STUDY}/rendered3D?{query}&renderedvolumetricmetadata=yes");
    let answer = server.get(&address).await;
    assert_eq!(answer.status, 200, "{answer:?}");
    assert_eq!(answer.header("content-type"), "application/dicom+json");
    let told = &answer.json()[0];
    assert_eq!(told["00701602"]["Value"][0], "ORTHOGRAPHIC");
    let function = match told["00281056"]["Value"][0].as_str().unwrap() {
        "LINEAR" => "linear",
        "LINEAR_EXACT" => "linear-exact",
        "SIGMOID" => "sigmoid",
        other => panic!("{other}"),
    };
    format!(
        "viewpointposition={}&viewpointlookat={}&viewpointup={}&window={},{},{function}&viewport={},{}",
        list(&told["00701603"]),
        list(&told["00701604"]),
        list(&told["00701605"]),
        list(&told["00281050"]),
        list(&told["00281051"]),
        list(&told["00280011"]),
        list(&told["00280010"]),
    )
}

#[tokio::test]
async fn a_study_is_rendered_in_the_terms_of_the_standard() {
    let neighbour = Neighbour::start(|_| {}).await;
    let case = identified_case(&neighbour).await;
    let server = &neighbour.server;
    // JPEG is the default; both spellings, the study and its series show the same.
    let first = server.get(&format!("{STUDY}/rendered3D")).await;
    assert_eq!(first.header("content-type"), "image/jpeg");
    assert_eq!(pixels(&first).dimensions(), (512, 512));
    for same in ["rendered3d", "series/1.2.3.1/rendered3D"] {
        let answer = server.get(&format!("{STUDY}/{same}")).await;
        assert!(answer.body == first.body, "{same}");
    }
    let coarse = server.get(&format!("{STUDY}/rendered3D?quality=10")).await;
    assert!(coarse.body.len() < first.body.len());

    // What it shows is what `render` shows.
    for (letter, view) in [
        ("l", "left"),
        ("r", "right"),
        ("a", "anterior"),
        ("h", "superior"),
    ] {
        let ours = format!("{case}/render?depth_mm=5&width=160&height=120&view={view}");
        let ours = pixels(&server.get(&ours).await);
        let address =
            format!("{STUDY}/rendered3D?depth_mm=5&viewport=160,120&orientation={letter}");
        let theirs = server.get_with(&address, &PNG).await;
        assert_eq!(theirs.header("content-type"), "image/png");
        assert!(are_near(&ours, &pixels(&theirs)), "{letter}");
    }

    // The told values give the same picture, byte for byte.
    for query in [
        "orientation=r&viewport=150,130",
        "orientation=h",
        "viewpointposition=-130.1,-77.77,33.3&viewpointlookat=1.5,2.5,-3.25&viewpointup=0.1,0.2,0.9&viewport=160,120",
        "window=600.5,700.25,linear-exact&viewport=120,120",
        "window=600.5,0.75,sigmoid&viewport=120,120",
        "window=600.5,700.25,sigmoid&viewport=120,120",
    ] {
        let again = fed_back(server, query).await;
        for headers in [&PNG[..], &[]] {
            let [one, other] = [query, &again].map(|query| format!("{STUDY}/rendered3D?{query}"));
            let [one, other] = [
                server.get_with(&one, headers).await,
                server.get_with(&other, headers).await,
            ];
            assert_eq!(other.status, 200, "{again}: {other:?}");
            assert!(one.body == other.body, "{query} and {again} differ");
        }
    }

    // A turn comes in parts, and as no GIF.
    let turn = format!("{STUDY}/rendered3D?swivelrange=360&animationstepsize=90&viewport=100,100");
    let headers = [("accept", "multipart/related; type=\"image/png\"")];
    let turned = parts(&server.get_with(&turn, &headers).await);
    assert_eq!(turned.len(), 4);
    let left = format!("{STUDY}/rendered3D?viewport=100,100");
    let left = pixels(&server.get_with(&left, &PNG).await);
    let shown = image::load_from_memory(&turned[0]).unwrap().into_rgb8();
    assert!(are_near(&shown, &left), "a full turn begins at the view");
    assert_ne!(turned[0], turned[1]);
    for (address, accept) in [
        (&turn, "image/jpeg"),
        (&turn, "image/gif"),
        (&format!("{STUDY}/rendered3D"), "image/gif"),
    ] {
        let refused = server.get_with(address, &[("accept", accept)]).await;
        assert_eq!(refused.status, 406, "{address} {accept}");
        assert_eq!(refused.problem(), "not-acceptable");
    }
}

/// The brightness 0 to 255 of a value through a sigmoid (PS3.3 C.11.2.1.3.1).
fn sigmoid(value: f64, centre: f64, width: f64) -> f64 {
    255.0 / (1.0 + (-4.0 * (value - centre) / width).exp())
}

#[tokio::test]
async fn a_sigmoid_window_is_that_of_the_standard() {
    let neighbour = Neighbour::start(|_| {}).await;
    let case = identified_case(&neighbour).await;
    let server = &neighbour.server;
    // A wide linear window tells the intensities themselves: from 0 to 2550, ten to a level.
    let flat = "viewport=150,130&ambient=1&depth_mm=5";
    let linear = format!("{STUDY}/rendered3D?{flat}&window=1275,2550,linear-exact");
    let linear = pixels(&server.get_with(&linear, &PNG).await);
    let (centre, width) = (600.0, 900.0);
    let curved = format!("{STUDY}/rendered3D?{flat}&window={centre},{width},sigmoid");
    let curved = pixels(&server.get_with(&curved, &PNG).await);
    let ours = format!(
        "{case}/render?view=left&width=150&height=130&ambient=1&depth_mm=5&window={centre},{width}&window_function=sigmoid"
    );
    let ours = pixels(&server.get(&ours).await);
    assert!(are_near(&ours, &curved));
    let mut shown = 0;
    for (x, y, brightness) in curved.enumerate_pixels() {
        // Pixels near the edge of the head are mixed with the background.
        let around = (-2..=2).flat_map(|down| (-2..=2).map(move |right| (right, down)));
        let mut around = around.map(|(right, down)| {
            let place = (x.checked_add_signed(right), y.checked_add_signed(down));
            let (Some(x), Some(y)) = place else { return 0 };
            linear.get_pixel_checked(x, y).map_or(0, |pixel| pixel[0])
        });
        let level = f64::from(linear.get_pixel(x, y)[0]);
        if around.any(|level| level == 0) || level == 255.0 {
            continue;
        }
        let [least, most] = [-5.5, 5.5].map(|half| sigmoid(10.0 * level + half, centre, width));
        let found = f64::from(brightness[0]);
        assert!(
            (least - 0.6..=most + 0.6).contains(&found),
            "{level}: {found} is not within {least} to {most}"
        );
        shown += 1;
    }
    assert!(shown > 1000, "{shown} pixels");
    let alone = server
        .get(&format!("{case}/render?window_function=sigmoid"))
        .await;
    assert_eq!(alone.problem(), "query-value-out-of-range");
}

#[tokio::test]
async fn what_cannot_be_rendered_is_refused_with_its_reason() {
    let neighbour = Neighbour::start(|_| {}).await;
    let server = &neighbour.server;
    let none = server.get(&format!("{STUDY}/rendered3D")).await;
    assert_eq!(none.problem(), "no-such-study");
    identified_case(&neighbour).await;
    for other in [
        "/dicomweb/studies/1.2.99/rendered3D",
        "/dicomweb/studies/Smith/rendered3D",
        "/dicomweb/studies/1.2.3/series/1.2/rendered3D",
    ] {
        let refused = server.get(other).await;
        assert_eq!(refused.problem(), "no-such-study");
        assert!(!String::from_utf8_lossy(&refused.body).contains("Smith"));
    }
    for (query, kind, named) in [
        ("depht_mm=5", "query-unknown-key", "depth_mm"),
        ("orientation=a&orientation=p", "query-unreadable", "once"),
        (
            "renderedvolumetricmetadata=maybe",
            "query-value-out-of-range",
            "`renderedvolumetricmetadata`",
        ),
        ("orientation=x", "query-value-out-of-range", "`orientation`"),
        (
            "orientation=l&viewpointup=0,0,1",
            "query-value-out-of-range",
            "`orientation`",
        ),
        (
            "viewpointup=0,0,1",
            "query-value-out-of-range",
            "`viewpointposition`",
        ),
        (
            "viewpointposition=0,0,0&viewpointlookat=0,0,0&viewpointup=0,0,1",
            "query-value-out-of-range",
            "`viewpointposition`",
        ),
        (
            "viewpointposition=0,0,9&viewpointlookat=0,0,0&viewpointup=0,0,1",
            "query-value-out-of-range",
            "`viewpointup`",
        ),
        ("window=50,0,sigmoid", "query-value-out-of-range", "sigmoid"),
        ("window=50,100,cubic", "query-value-out-of-range", "sigmoid"),
        ("viewport=0,5", "query-value-out-of-range", "`viewport`"),
        ("quality=101", "query-value-out-of-range", "`quality`"),
        (
            "renderingmethod=maximum_ip",
            "query-value-out-of-range",
            "`renderingmethod`",
        ),
        (
            "animationstepsize=5",
            "query-value-out-of-range",
            "`swivelrange`",
        ),
        (
            "swivelrange=360&animationstepsize=1",
            "query-value-out-of-range",
            "`animationstepsize`",
        ),
        (
            "annotation=name",
            "query-value-out-of-range",
            "`annotation`",
        ),
        ("depth_mm=NaN", "query-value-out-of-range", "`depth_mm`"),
        ("colormap=pink", "query-value-out-of-range", "`colormap`"),
        ("surface=back", "query-value-out-of-range", "`surface`"),
    ] {
        let refused = server.get(&format!("{STUDY}/rendered3D?{query}")).await;
        assert_eq!(refused.status, 400, "{query}");
        assert_eq!(refused.problem(), kind, "{query}");
        let detail = refused.json()["detail"].as_str().unwrap().to_owned();
        assert!(detail.contains(named), "{query}: {detail}");
    }
    // The voxels of this head are too large to tell its hemispheres apart.
    let part = server
        .get(&format!("{STUDY}/rendered3D?surface=left"))
        .await;
    assert_eq!(
        (part.status.as_u16(), &*part.problem()),
        (409, "no-surfaces")
    );
    let address = format!("{STUDY}/rendered3D?viewport=64,64");
    let whole = server.get(&format!("{address}&surface=whole")).await;
    assert!(whole.body == server.get(&address).await.body);
}
