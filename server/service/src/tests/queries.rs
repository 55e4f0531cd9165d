//! Queries of a ready case: every key that is wrong is named, and nothing of what was sent is repeated.

use super::server::Server;

#[tokio::test]
async fn queries_that_are_not_right() {
    const RANGE: &str = "query-value-out-of-range";
    const UNREADABLE: &str = "query-value-unreadable";
    let (server, case) = Server::with_case().await;
    let table = [
        ("mesh?depth_mm=-1", "depth-negative", "depth_mm"),
        ("mesh?depth_mm=abc", "depth-not-a-number", "depth_mm"),
        ("mesh?depth_mm=NaN", "depth-not-a-number", "depth_mm"),
        ("mesh?depth_mm=1&depth_mm=2", "query-key-twice", "depth_mm"),
        ("mesh?contours=2", RANGE, "contours"),
        ("mesh?contours=513", RANGE, "contours"),
        ("mesh?points=1025", RANGE, "points"),
        ("mesh?points=-3", UNREADABLE, "points"),
        ("mesh?paths=shortest", UNREADABLE, "paths"),
        ("mesh?solid=1", UNREADABLE, "solid"),
        ("mesh?solid=true&depth_mm=-1", "depth-negative", "depth_mm"),
        ("mesh?solid=true&contours=31", RANGE, "contours"),
        ("mesh?solid=true&points=31", RANGE, "points"),
        ("mesh?solid=true&paths=flow", RANGE, "paths"),
        ("mesh?format=Smith", UNREADABLE, "format"),
        ("mesh?format=gifti&values=Smith", UNREADABLE, "values"),
        ("mesh?values=depth", RANGE, "values"),
        ("mesh?values=blur&format=glb", RANGE, "values"),
        ("mesh?by_depth=true&format=gifti", RANGE, "by_depth"),
        (
            "mesh?by_depth=true&format=gifti&values=findings",
            RANGE,
            "by_depth",
        ),
        (
            "mesh?by_depth=true&format=gifti&values=depth&depth_mm=1",
            RANGE,
            "by_depth",
        ),
        (
            "mesh?by_depth=true&format=gifti&values=depth&solid=true",
            RANGE,
            "by_depth",
        ),
        (
            "mesh?by_depth=true&format=freesurfer&values=depth",
            RANGE,
            "by_depth",
        ),
        (
            "mesh?by_depth=true&format=gifti&values=depth&contours=512&points=1024",
            RANGE,
            "contours",
        ),
        ("mesh?depth=8", "query-unknown-key", ""),
        ("mesh/triangles?points=2", RANGE, "points"),
        ("mesh/triangles?depth_mm=2", "query-unknown-key", ""),
        ("mesh/paths?contours=512&points=1024", RANGE, "contours"),
        ("mesh/paths?paths=Smith", UNREADABLE, "paths"),
        ("volume?bits=12", RANGE, "bits"),
        ("volume?x=1", "query-unknown-key", ""),
        ("volume?extent=head", UNREADABLE, "extent"),
        ("distance?step=0", RANGE, "step"),
        ("distance?step=17", RANGE, "step"),
        ("mask?x=1", "query-unknown-key", ""),
        ("quality?width=5", "query-unknown-key", ""),
        ("render?depth_mm=inf", "depth-not-a-number", "depth_mm"),
        ("render?depth_mm=-0.001", "depth-negative", "depth_mm"),
        ("render?width=100000", RANGE, "width"),
        ("render?height=0", RANGE, "height"),
        ("render?width=-1", UNREADABLE, "width"),
        ("render?zoom=0", RANGE, "zoom"),
        ("render?zoom=101", RANGE, "zoom"),
        ("render?pan=1", UNREADABLE, "pan"),
        ("render?pan=20000,0", RANGE, "pan"),
        ("render?view=top", UNREADABLE, "view"),
        ("render?orientation=0,0,0,0", RANGE, "orientation"),
        ("render?orientation=0,0,1", UNREADABLE, "orientation"),
        ("render?view=left&orientation=0,0,0,1", RANGE, "orientation"),
        ("render?window=10,0", RANGE, "window"),
        ("render?window=10,nan", UNREADABLE, "window"),
        ("render?window=2e9,10", RANGE, "window"),
        ("render?ambient=2", RANGE, "ambient"),
        ("render?slab_mm=21", RANGE, "slab_mm"),
        ("render?colormap=Smith", UNREADABLE, "colormap"),
        ("render?annotate=true&width=32", RANGE, "annotate"),
        ("render?contours=2&renderer=splat", RANGE, "contours"),
        ("slices/axial?depth_mm=5,-1", "depth-negative", "depth_mm"),
        ("slices/axial?depth_mm=5,1001", RANGE, "depth_mm"),
        (
            "slices/axial?depth_mm=1,2,3,4,5,6,7,8,9,10,11,12,13,14,15,16,17",
            RANGE,
            "depth_mm",
        ),
        ("slices/axial?position_mm=left", UNREADABLE, "position_mm"),
        ("slices/axial?position_mm=inf", RANGE, "position_mm"),
        ("slices/axial?position_mm=10001", RANGE, "position_mm"),
        ("slices/axial?position=0,0,0", RANGE, "position"),
        ("slices/axial?normal=0,0,1", RANGE, "normal"),
        ("slices/oblique", RANGE, "position"),
        ("slices/oblique?position=1,2", UNREADABLE, "position"),
        ("slices/oblique?position=20000,0,0", RANGE, "position"),
        (
            "slices/oblique?position=0,0,0&normal=0,0,0",
            RANGE,
            "normal",
        ),
        (
            "slices/oblique?position=0,0,0&position_mm=3",
            RANGE,
            "position_mm",
        ),
        ("slices/oblique?turn_deg=5", RANGE, "turn_deg"),
        (
            "slices/oblique?position=0,0,0&normal=0,0,1&turn_deg=5",
            RANGE,
            "turn_deg",
        ),
        (
            "slices/oblique?position=0,0,0&turn_deg=inf",
            RANGE,
            "turn_deg",
        ),
        ("slices/axial?window=0,0.5", RANGE, "window"),
        ("slices/axial?zoom=0", RANGE, "zoom"),
        ("slices/axial?annotate=true&height=32", RANGE, "annotate"),
        ("acquired/axial?depth_mm=5", "query-unknown-key", ""),
        ("acquired/axial?position_mm=inf", RANGE, "position_mm"),
        ("acquired/axial?width=0", RANGE, "width"),
        ("acquired/axial?annotate=true&height=32", RANGE, "annotate"),
    ];
    for (rest, kind, parameter) in table {
        let answer = server.get(&format!("{case}/{rest}")).await;
        assert_eq!(answer.refusal(), (400, kind.to_owned()), "{rest}");
        assert_eq!(answer.parameter(), parameter, "{rest}");
        let detail = answer.json()["detail"].to_string();
        assert!(!detail.contains("Smith"), "{detail}");
    }
    for (address, kind, parameter) in [
        ("/v1/cases?limit=0", RANGE, "limit"),
        ("/v1/cases?limit=201", RANGE, "limit"),
        ("/v1/cases?after=x", RANGE, "after"),
        ("/healthz?deep=1", "query-unknown-key", ""),
        ("/openapi.json?pretty=1", "query-unknown-key", ""),
    ] {
        let answer = server.get(address).await;
        assert_eq!(answer.refusal(), (400, kind.to_owned()), "{address}");
        assert_eq!(answer.parameter(), parameter, "{address}");
    }
}

#[tokio::test]
async fn a_window_without_width_is_explained() {
    let (server, case) = Server::with_case().await;
    for (rest, begins) in [
        ("render?window=0,0", "`window` width is 0"),
        ("slices/axial?window=0,0.5", "`window` width is 0.5"),
        ("render?window=2e9,10", "`window` centre is 2000000000;"),
    ] {
        let answer = server.get(&format!("{case}/{rest}")).await.json();
        let detail = answer["detail"].as_str().unwrap();
        assert!(detail.starts_with(begins), "{detail}");
    }
}

#[tokio::test]
async fn a_depth_beyond_the_deepest_point_is_clamped_and_said_so() {
    let (server, case) = Server::with_case().await;
    let facts = server.get(&case).await.json();
    let deepest = facts["max_depth_mm"].as_f64().unwrap();
    for (asked, shown, is_clamped) in [
        ("9000", deepest, "true"),
        ("3.4e38", deepest, "true"),
        ("1.5", 1.5, "false"),
        ("0", 0.0, "false"),
    ] {
        for route in ["mesh", "render"] {
            let address = format!("{case}/{route}?depth_mm={asked}");
            let answer = server.get(&address).await;
            assert_eq!(answer.status, 200, "{address}");
            assert_eq!(answer.header("x-isocortex-depth-clamped"), is_clamped);
            let depth: f64 = answer.header("x-isocortex-depth-mm").parse().unwrap();
            assert!((depth - shown).abs() < 1e-3, "{address}: {depth}");
        }
    }
}

#[tokio::test]
async fn the_order_and_spelling_of_a_query_do_not_matter() {
    let (server, case) = Server::with_case().await;
    let tag = async |query: &str| {
        let answer = server.get(&format!("{case}/mesh?{query}")).await;
        answer.header("etag").to_owned()
    };
    let expected = tag("depth_mm=8&contours=30").await;
    for same in [
        "contours=30&depth_mm=8.0&paths=forest",
        "depth_mm=8e0",
        "depth_mm=%38",
    ] {
        assert_eq!(tag(same).await, expected, "{same}");
    }
    for other in [
        "depth_mm=8.5",
        "depth_mm=8&contours=31",
        "depth_mm=8&paths=flow",
    ] {
        assert_ne!(tag(other).await, expected, "{other}");
    }
}
