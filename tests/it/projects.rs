//! Projects: for whoever is in another one, a case is not there, on any route, in any list, search or link.

use axum::body::Body;
use axum::http::{Method, Request, header};
use bytes::Bytes;
use case::Project;
use isocortex::config::MapsUse;
use pacs::dimse::Peer;
use serde_json::{Value, json};

use crate::dicom::head_slices;
use crate::head::plain_head;
use crate::pacs::{Neighbour, dcmtk, dimse, dimse_options, run};
use crate::results::{add_node, identified_head, small};
use crate::scopes::{TokensFile, rows};
use crate::series_builder::{Syntax, files};
use crate::server::{Answer, Server, form, form_type};
use crate::until::until;

/// A token with every scope in each of two projects, and in the one without a name.
fn three_holders() -> TokensFile {
    let mut file = TokensFile::new();
    file.add("one", &["--role", "admin", "--project", "one"]);
    file.add("two", &["--role", "admin", "--project", "two"]);
    file.add("plain", &["--role", "admin"]);
    file
}

async fn asked(server: &Server, method: &Method, address: &str, body: impl Into<Body>) -> Answer {
    let request = Request::builder().method(method).uri(address);
    server.send(request.body(body.into()).unwrap()).await
}

async fn posted(server: &Server, address: &str, body: &Value) -> Answer {
    asked(server, &Method::POST, address, body.to_string()).await
}

async fn uploaded(server: &Server) -> Answer {
    server.upload(&[("volume", &plain_head().bytes())]).await
}

async fn list(server: &Server) -> Vec<Value> {
    let list = server.get("/v1/cases").await.json();
    let cases = list["cases"].as_array().unwrap().iter();
    cases.map(|case| case["id"].clone()).collect()
}

/// The one series of the project of the holder, once it is settled.
async fn settled(server: &Server) -> Value {
    until("the series is settled", async || {
        let list = server.get("/v1/arrivals").await.json();
        match &list["arrivals"].as_array().unwrap()[..] {
            [arrival] if arrival["state"] != "receiving" => Some(arrival.clone()),
            _ => None,
        }
    })
    .await
}

/// Replaces the list of findings by one that is empty and has an author.
async fn marked(server: &Server, case: &str) -> Answer {
    let findings = format!("{case}/findings");
    let before = server.get(&findings).await;
    let list = json!({"findings": [{
        "id": "a", "kind": "point", "points_in_patient": [[0, 0, 0]], "depth_mm": 0, "label": "here", "note": "",
    }]});
    let request = Request::put(findings)
        .header(header::IF_MATCH, before.header("etag"))
        .body(Body::from(list.to_string()));
    server.send(request.unwrap()).await
}

/// What addresses name.
struct Named {
    case: String,
    layer: String,
    arrival: String,
    retrieval: String,
    result: String,
    study: String,
    series: String,
}

impl Named {
    fn nothing() -> Self {
        let none = || "0".repeat(32);
        Self {
            case: none(),
            layer: none(),
            arrival: none(),
            retrieval: none(),
            result: none(),
            study: "1.2.99".to_owned(),
            series: "1.2.99.1".to_owned(),
        }
    }

    /// The address of a route with these names.
    fn address(&self, template: &str) -> String {
        let id = match template.split('/').nth(2) {
            Some("arrivals") => &self.arrival,
            Some("retrievals") => &self.retrieval,
            Some("dicom-results") => &self.result,
            _ => &self.case,
        };
        let address = template
            .replace("{id}", id)
            .replace("{layer}", &self.layer)
            .replace("{plane}", "axial")
            .replace("{study}", &self.study)
            .replace("{series}", &self.series)
            .replace("{name}", "node");
        match template {
            "/v1/cases/{id}/registration" => format!("{address}?with={}", self.case),
            "/v1/arrivals" | "/v1/retrievals" | "/v1/dicom-results" => {
                format!("{address}?case={}", self.case)
            }
            _ => address,
        }
    }

    /// A body with which the route does something.
    fn body(&self, method: &Method, template: &str) -> Body {
        let body = match (method.as_str(), template) {
            ("PATCH", _) => json!({"name": "another"}),
            ("POST", "/v1/launch") => json!({"query": format!("study={}", self.study)}),
            ("POST", "/v1/arrivals/{id}") => json!({"as": "layer"}),
            ("POST", "/v1/cases/{id}/renders") => json!({"renders": [{}]}),
            ("POST", "/v1/cases/{id}/dicom-results") => {
                json!({"what": "view", "render": small(), "node": "node"})
            }
            ("PUT", "/v1/cases/{id}/mask") => return Body::from(plain_head().bytes()),
            ("PUT", "/v1/cases/{id}/findings") => json!({"findings": []}),
            _ => return Body::empty(),
        };
        Body::from(body.to_string())
    }

    async fn ask(&self, server: &Server, method: &Method, template: &str) -> Answer {
        let request = Request::builder()
            .method(method)
            .uri(self.address(template))
            .header(header::IF_MATCH, "\"0\"")
            .header(header::CONTENT_TYPE, "application/json")
            .body(self.body(method, template));
        server.send(request.unwrap()).await
    }
}

/// What one project has of everything that an address can name.
async fn everything(neighbour: &Neighbour) -> Named {
    let server = &neighbour.server;
    let stored = neighbour.store(&identified_head()).await;
    assert_eq!(stored.status, 200, "{stored:?}");
    let arrival = settled(server).await;
    assert_eq!(arrival["state"], "case", "{arrival}");
    let text = |value: &Value| value.as_str().unwrap().to_owned();
    let case = text(&arrival["case"]);
    let address = format!("/v1/cases/{case}");
    server.until_ready(&address).await;
    let findings = marked(server, &address).await;
    assert_eq!(findings.status, 200, "{findings:?}");
    let layer = Request::post(format!("{address}/layers"))
        .header(header::CONTENT_TYPE, form_type())
        .body(Body::from(form(&[("volume", &plain_head().bytes())])));
    let layer = server.send(layer.unwrap()).await;
    assert!(layer.status.is_success(), "{layer:?}");
    let view = json!({"what": "view", "render": small(), "node": "node"});
    let result = posted(server, &format!("{address}/dicom-results"), &view).await;
    assert_eq!(result.status, 202, "{result:?}");
    let (study, series) = (text(&arrival["study"]), text(&arrival["series"]));
    let order = json!({"node": "node", "study": study, "series": series});
    let retrieval = posted(server, "/v1/retrievals", &order).await;
    assert_eq!(retrieval.status, 202, "{retrieval:?}");
    Named {
        case,
        layer: text(&layer.json()["id"]),
        arrival: text(&arrival["id"]),
        retrieval: text(&retrieval.json()["id"]),
        result: text(&result.json()["id"]),
        study,
        series,
    }
}

/// What a holder sees of it all.
async fn seen(server: &Server, named: &Named) -> Vec<Bytes> {
    let case = format!("/v1/cases/{}", named.case);
    let mut seen = Vec::new();
    for address in [
        &case,
        &format!("{case}/findings"),
        &format!("/v1/arrivals/{}", named.arrival),
        "/v1/cases",
        "/v1/arrivals",
        "/v1/retrievals",
        "/v1/dicom-results",
    ] {
        let answer = server.get(address).await;
        assert_eq!(answer.status, 200, "{address}: {answer:?}");
        seen.push(answer.body);
    }
    seen
}

/// The column *another project* of the matrix of routes, methods and scopes: every route that there is, asked by
/// somebody with every scope.
#[tokio::test]
async fn on_every_route_what_another_project_has_is_not_there() {
    let file = three_holders();
    let neighbour = Neighbour::start(|config| {
        config.http.tokens_file = Some(file.path());
        add_node(config, "node", "http://127.0.0.1:1/rs".to_owned());
    })
    .await;
    let server = &neighbour.server;
    server.authorize(&file.bearer("one"));
    let theirs = everything(&neighbour).await;
    let layer = format!("/v1/cases/{}/layers/{}", theirs.case, theirs.layer);
    server.until_settled(&layer).await;
    let before = seen(server, &theirs).await;
    let nothing = Named::nothing();
    let mut not_there = 0;
    for stranger in ["two", "plain"] {
        server.authorize(&file.bearer(stranger));
        for (method, template) in rows().keys() {
            let method: Method = method.parse().unwrap();
            let route = format!("{method} {template} by {stranger}");
            let asked = theirs.ask(server, &method, template).await;
            let expected = nothing.ask(server, &method, template).await;
            assert_eq!(asked.status, expected.status, "{route}");
            let names_something = template.contains("{id}") || template.contains("{study}");
            if names_something && method == Method::GET {
                assert!(
                    [400, 404, 204].contains(&asked.status.as_u16()),
                    "{route}: {asked:?}"
                );
                not_there += 1;
            }
            let text = |answer: &Answer| String::from_utf8_lossy(&answer.body).into_owned();
            let is_of_server =
                ["/metrics", "/v1/pacs"].contains(template) || template.starts_with("/v1/pacs/");
            if !is_of_server {
                assert_eq!(text(&asked), text(&expected), "{route}");
            }
        }
    }
    assert!(not_there > 60, "{not_there}");
    server.authorize(&file.bearer("one"));
    assert_eq!(
        seen(server, &theirs).await,
        before,
        "nobody has changed anything"
    );
    // Whoever is in the project finds it by each of these addresses.
    for (method, template) in rows().keys() {
        let is_of_case = template.contains("{id}") || template.contains("{study}");
        if is_of_case && method == "GET" && !template.contains("/events") {
            let method = Method::GET;
            let answer = theirs.ask(server, &method, template).await;
            let is_there = answer.status != 404 || template.contains("/registration");
            assert!(is_there, "{template}: {answer:?}");
        }
    }
}

#[tokio::test]
async fn the_same_head_in_three_projects_is_three_cases_and_each_upload_is_answered_alike() {
    let file = three_holders();
    let server = Server::start_with(|config| {
        config.http.tokens_file = Some(file.path());
        // So that a case has all its objects as soon as it is ready.
        config.limits.maps = MapsUse::Off;
    })
    .await;
    let mut answers = Vec::new();
    let mut objects = 0;
    for holder in ["one", "two", "plain"] {
        server.authorize(&file.bearer(holder));
        assert_eq!(list(&server).await, Vec::<Value>::new(), "{holder}");
        let answer = uploaded(&server).await;
        assert_eq!(answer.status, 202, "{holder}: {answer:?}");
        let address = answer.header("location").to_owned();
        server.until_ready(&address).await;
        let mut body = answer.json();
        assert_eq!(list(&server).await, [body["id"].clone()]);
        for changing in ["created_at", "uploaded_at", "expires_at"] {
            body.as_object_mut().unwrap().remove(changing);
        }
        answers.push((address, body));
        let stored = server.stored_files().len();
        assert!(objects == 0 || stored == objects, "the objects are shared");
        objects = stored;
    }
    assert_eq!(answers[0], answers[1]);
    assert_eq!(answers[0], answers[2]);
    let case = answers[0].0.clone();
    let named = async |holder: &str| {
        server.authorize(&file.bearer(holder));
        server.get(&case).await.json()["name"].clone()
    };
    server.authorize(&file.bearer("one"));
    let patch = json!({"name": "ours"}).to_string();
    assert_eq!(
        asked(&server, &Method::PATCH, &case, patch).await.status,
        200
    );
    assert_eq!(marked(&server, &case).await.status, 200);
    assert_eq!(named("one").await, "ours");
    for holder in ["two", "plain"] {
        assert_eq!(named(holder).await, Value::Null);
        let findings = server.get(&format!("{case}/findings")).await.json();
        assert_eq!(findings["findings"], json!([]));
        assert_eq!(uploaded(&server).await.status, 200, "it is there already");
    }
    for holder in ["one", "plain"] {
        server.authorize(&file.bearer(holder));
        let deleted = server.method(Method::DELETE, &case).await;
        assert_eq!(deleted.status, 204, "{holder}");
        assert_eq!(server.get(&case).await.status, 404);
        assert_eq!(list(&server).await, Vec::<Value>::new());
        server.authorize(&file.bearer("two"));
        assert_eq!(server.get(&format!("{case}/mesh")).await.status, 200);
    }
    assert_eq!(server.method(Method::DELETE, &case).await.status, 204);
    server.is_empty_and_well().await;
}

#[tokio::test]
async fn a_series_goes_to_the_project_of_its_token_or_its_peer() {
    let Some(storescu) = dcmtk("storescu") else {
        return;
    };
    let file = three_holders();
    let neighbour = Neighbour::start(|config| config.http.tokens_file = Some(file.path())).await;
    let server = &neighbour.server;
    let slices = head_slices();
    server.authorize(&file.bearer("one"));
    assert_eq!(
        neighbour
            .store(&files(&slices, Syntax::Explicit))
            .await
            .status,
        200
    );
    let of_one = settled(server).await;
    let mut options = dimse_options();
    options.peers.push(Peer {
        aet: "SCANNER".to_owned(),
        project: Project::parse("two").unwrap(),
        address: [127, 0, 0, 1].into(),
    });
    let address = dimse(&neighbour, options).await.to_string();
    let folder = tempfile::tempdir().unwrap();
    for (number, file) in files(&slices, Syntax::Explicit).iter().enumerate() {
        std::fs::write(folder.path().join(format!("{number}.dcm")), file).unwrap();
    }
    let (host, port) = address.rsplit_once(':').unwrap();
    let to_us = ["-aet", "SCANNER", "-aec", "ISOCORTEX", host, port];
    let arguments = [&["+sd"], &to_us[..], &[folder.path().to_str().unwrap()]].concat();
    let stored = run(&storescu, &arguments).await;
    assert!(stored.status.success(), "{stored:?}");
    server.authorize(&file.bearer("two"));
    let of_two = settled(server).await;
    assert_eq!(
        (&of_one["source"], &of_two["source"]),
        (&json!("stow"), &json!("c-store"))
    );
    assert_ne!(of_one["id"], of_two["id"]);
    assert_eq!(of_one["case"], of_two["case"], "the same head");
    for (holder, expected) in [
        ("one", Some(&of_one)),
        ("two", Some(&of_two)),
        ("plain", None),
    ] {
        server.authorize(&file.bearer(holder));
        let launched = posted(server, "/v1/launch", &json!({"query": "study=1.2.3"}))
            .await
            .json();
        let Some(arrival) = expected else {
            assert_eq!(launched["state"], "absent");
            assert_eq!(list(server).await, Vec::<Value>::new());
            continue;
        };
        assert_eq!(launched["case"], arrival["case"], "{holder}");
        let case = format!("/v1/cases/{}", arrival["case"].as_str().unwrap());
        server.until_ready(&case).await;
        assert_eq!(list(server).await.len(), 1, "{holder}");
        let session = server.get("/v1/session").await.json();
        assert_eq!(session["project"], holder);
    }
}
