//! Nothing in memory is needed to answer.

use axum::http::StatusCode;

use crate::server::Server;

#[tokio::test]
async fn a_restarted_server_serves_the_same_bytes() {
    let server = Server::start().await;
    let case = server.plain_case().await;
    let routes = [
        "mesh?depth_mm=8",
        "mesh?depth_mm=11&contours=9&points=12&paths=flow",
        "mesh/paths",
        "volume",
        "distance",
        "render?depth_mm=8",
        "slices/coronal?depth_mm=5",
    ];
    let mut before = Vec::new();
    for route in routes {
        before.push(server.get(&format!("{case}/{route}")).await);
    }
    let server = server.restart().await;
    for (route, before) in routes.iter().zip(&before) {
        let after = server.get(&format!("{case}/{route}")).await;
        assert_eq!(after.status, StatusCode::OK, "{route}");
        assert!(after.body == before.body, "{route} has other bytes");
        assert_eq!(after.header("etag"), before.header("etag"));
    }
}
