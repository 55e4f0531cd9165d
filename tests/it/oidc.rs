//! Tokens of an issuer of OpenID Connect: what opens, what does not and why, and what happens if the issuer is away.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use axum::body::Body;
use axum::http::{Method, Request, StatusCode};
use axum::routing::get;
use axum::{Json, Router};
use base64::Engine as _;
use base64::prelude::BASE64_URL_SAFE_NO_PAD as BASE64;
use http_body_util::BodyExt as _;
use isocortex::config::{Config, Oidc};
use ring::rand::SystemRandom;
use ring::signature::{ECDSA_P256_SHA256_FIXED_SIGNING, EcdsaKeyPair, KeyPair as _};
use serde_json::{Value, json};
use tower::ServiceExt as _;

use crate::command_line::run;
use crate::head::plain_head;
use crate::scopes::TokensFile;
use crate::server::{Answer, Server, form, form_type};

/// What the tokens must be for.
const AUDIENCE: &str = "isocortex-of-this-site";

/// A key by which an issuer signs.
pub(crate) struct SigningKey {
    pair: EcdsaKeyPair,
    id: String,
}

impl SigningKey {
    pub(crate) fn new(id: &str) -> Self {
        let (scheme, random) = (&ECDSA_P256_SHA256_FIXED_SIGNING, SystemRandom::new());
        let made = EcdsaKeyPair::generate_pkcs8(scheme, &random).unwrap();
        Self {
            pair: EcdsaKeyPair::from_pkcs8(scheme, made.as_ref(), &random).unwrap(),
            id: id.to_owned(),
        }
    }

    fn public(&self) -> Value {
        let point = self.pair.public_key().as_ref();
        let [x, y] = [1, 33].map(|at| BASE64.encode(&point[at..at + 32]));
        json!({"kty": "EC", "crv": "P-256", "kid": self.id, "use": "sig", "x": x, "y": y})
    }

    fn header(&self) -> Value {
        json!({"alg": "ES256", "typ": "at+jwt", "kid": self.id})
    }

    /// A token with this header and these claims.
    fn sign(&self, header: &Value, claims: &Value) -> String {
        let [header, claims] = [header, claims].map(|part| BASE64.encode(part.to_string()));
        let text = format!("{header}.{claims}");
        let signature = self.pair.sign(&SystemRandom::new(), text.as_bytes());
        format!("{text}.{}", BASE64.encode(signature.unwrap()))
    }
}

/// An issuer on this machine.
pub(crate) struct Issuer {
    pub(crate) address: String,
    pub(crate) key: SigningKey,
    /// What it publishes.
    keys: Arc<Mutex<Value>>,
    /// How often it was asked for its keys.
    asked: Arc<AtomicUsize>,
    serving: tokio::task::JoinHandle<()>,
}

impl Issuer {
    pub(crate) async fn start() -> Self {
        let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await.unwrap();
        let address = format!("http://{}", listener.local_addr().unwrap());
        let key = SigningKey::new("first");
        let keys = Arc::new(Mutex::new(json!({"keys": [key.public()]})));
        let asked = Arc::new(AtomicUsize::new(0));
        let document = json!({
            "issuer": address,
            "jwks_uri": format!("{address}/keys"),
            "authorization_endpoint": format!("{address}/authorize"),
            "token_endpoint": format!("{address}/token"),
            "end_session_endpoint": format!("{address}/end"),
            "authorization_response_iss_parameter_supported": true,
        });
        let publish = {
            let (keys, asked) = (Arc::clone(&keys), Arc::clone(&asked));
            async move || {
                asked.fetch_add(1, Ordering::Relaxed);
                Json(keys.lock().unwrap().clone())
            }
        };
        let app = Router::new()
            .route(
                "/.well-known/openid-configuration",
                get(async move || Json(document)),
            )
            .route("/keys", get(publish));
        Self {
            address,
            key,
            keys,
            asked,
            serving: tokio::spawn(async move { axum::serve(listener, app).await.unwrap() }),
        }
    }

    /// Makes a server take its tokens.
    pub(crate) fn configure(&self, config: &mut Config) {
        config.oidc = Some(oidc(&self.address));
    }

    fn times_asked(&self) -> usize {
        self.asked.load(Ordering::Relaxed)
    }

    /// The claims of somebody who may read, with changes; `null` removes a claim.
    fn claims(&self, changes: &Value) -> Value {
        let mut claims = json!({
            "iss": self.address, "aud": AUDIENCE, "sub": "u-17", "exp": seconds(600),
            "name": "Dr. Ana CANARY", "roles": ["viewer"],
        });
        for (name, value) in changes.as_object().unwrap() {
            match value {
                Value::Null => drop(claims.as_object_mut().unwrap().remove(name)),
                value => claims[name] = value.clone(),
            }
        }
        claims
    }

    /// A token of somebody who may read, with changes of the claims.
    pub(crate) fn bearer(&self, changes: &Value) -> String {
        let token = self.key.sign(&self.key.header(), &self.claims(changes));
        format!("Bearer {token}")
    }

    /// The same with changes of the header, signed as before.
    fn with_header(&self, changes: &Value) -> String {
        let mut header = self.key.header();
        let changes = changes.as_object().unwrap().clone();
        header.as_object_mut().unwrap().extend(changes);
        let token = self.key.sign(&header, &self.claims(&json!({})));
        format!("Bearer {token}")
    }

    /// The same as [`Issuer::bearer`], signed by another key.
    pub(crate) fn signed_by(&self, key: &SigningKey, changes: &Value) -> String {
        format!("Bearer {}", key.sign(&key.header(), &self.claims(changes)))
    }

    /// A token that nobody has signed.
    pub(crate) fn unsigned(&self) -> String {
        let parts = [json!({"alg": "none"}), self.claims(&json!({}))];
        let [header, claims] = parts.map(|part| BASE64.encode(part.to_string()));
        format!("Bearer {header}.{claims}.")
    }
}

impl Drop for Issuer {
    fn drop(&mut self) {
        self.serving.abort();
    }
}

fn oidc(issuer: &str) -> Oidc {
    Oidc {
        issuer: issuer.to_owned(),
        audience: AUDIENCE.to_owned(),
        client_id: Some("page".to_owned()),
        scope: "openid profile".to_owned(),
        parameters: BTreeMap::new(),
        roles_claim: "roles".to_owned(),
        projects_claim: None,
        projects: BTreeMap::new(),
        roles: BTreeMap::new(),
    }
}

/// So many seconds from now, as a claim.
pub(crate) fn seconds(from_now: i64) -> i64 {
    let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap();
    now.as_secs().cast_signed() + from_now
}

async fn ask(server: &Server, path: &str, authorization: &str) -> Answer {
    server
        .get_with(path, &[("authorization", authorization)])
        .await
}

#[tokio::test]
async fn somebody_who_has_signed_in_is_known_by_the_subject_alone() {
    let (issuer, folder) = (Issuer::start().await, tempfile::tempdir().unwrap());
    let server = Server::start_with(|config| {
        issuer.configure(config);
        config.audit.folder = Some(folder.path().to_owned());
    })
    .await;
    let bearer = issuer.bearer(&json!({"roles": ["editor", "surgeon"]}));
    let answer = ask(&server, "/v1/session", &bearer).await;
    let scopes = json!(["read", "write", "results"]);
    assert_eq!(
        answer.json(),
        json!({"name": "oidc:u-17", "scopes": scopes})
    );
    assert_eq!(answer.header("cache-control"), "no-store");
    assert_eq!(ask(&server, "/v1/cases", &bearer).await.status, 200);
    // A subject that is no plain word could be a name.
    let odd = issuer.bearer(&json!({"sub": "Ana Silva\n"}));
    let odd = ask(&server, "/v1/session", &odd).await.json();
    let name = odd["name"].as_str().unwrap();
    assert!(name.starts_with("oidc:") && name.len() == 37, "{name}");
    // Nobody without a role may do anything.
    let nobody = issuer.bearer(&json!({"roles": null}));
    let answer = ask(&server, "/v1/cases", &nobody).await;
    assert_eq!(answer.status, 403);
    assert_eq!(answer.problem(), "missing-scope");
    server.state.cases.audit().shut_down();
    let files = std::fs::read_dir(folder.path()).unwrap();
    let record: String = files
        .map(|file| std::fs::read_to_string(file.unwrap().path()).unwrap())
        .collect();
    assert!(record.contains("\"who\":\"oidc:u-17\""), "{record}");
    for secret in ["CANARY", "Silva", &bearer[7..40]] {
        assert!(!record.contains(secret), "{record}");
    }
}

#[tokio::test]
async fn a_token_that_is_not_as_it_must_be_opens_nothing_and_the_answer_says_why() {
    let issuer = Issuer::start().await;
    let server = Server::start_with(|config| issuer.configure(config)).await;
    let refused = async |bearer: &str, kind: &str, part: &str| {
        let answer = ask(&server, "/v1/cases", bearer).await;
        assert_eq!(answer.status, 401, "{part}: {answer:?}");
        assert_eq!(answer.problem(), kind, "{part}");
        let detail = answer.json()["detail"].to_string();
        assert!(detail.contains(part), "{detail}");
        assert!(answer.header("www-authenticate").contains("invalid_token"));
    };
    for (changes, kind, part) in [
        (
            json!({"exp": seconds(-60)}),
            "sign-in-ended",
            "sign in again",
        ),
        (json!({"nbf": seconds(120)}), "token-refused", "(`nbf`)"),
        (json!({"aud": "another"}), "token-refused", "(`aud`)"),
        (json!({"aud": ["a", "b"]}), "token-refused", "(`aud`)"),
        (json!({"aud": null}), "token-refused", "lacks"),
        (
            json!({"iss": "https://other.example"}),
            "token-refused",
            "(`iss`)",
        ),
        (
            json!({"iss": format!("{}/", issuer.address)}),
            "token-refused",
            "(`iss`)",
        ),
        (
            json!({"iss": [issuer.address, "x"]}),
            "token-refused",
            "who it is from",
        ),
        (json!({"iss": null}), "token-refused", "lacks"),
        (json!({"sub": null}), "token-refused", "lacks"),
        (json!({"sub": ""}), "token-refused", "who it is from"),
        (json!({"exp": null}), "token-refused", "lacks"),
        (json!({"exp": "never"}), "token-refused", "lacks"),
        (json!({"exp": 1e300}), "token-refused", ""),
    ] {
        refused(&issuer.bearer(&changes), kind, part).await;
    }
    // Clocks differ a little.
    for changes in [
        json!({"exp": seconds(-10)}),
        json!({"nbf": seconds(10)}),
        json!({"aud": ["x", AUDIENCE]}),
    ] {
        let answer = ask(&server, "/v1/cases", &issuer.bearer(&changes)).await;
        assert_eq!(answer.status, 200, "{changes}");
    }
    assert_eq!(issuer.times_asked(), 1);
}

#[tokio::test]
async fn a_token_that_the_issuer_has_not_signed_opens_nothing() {
    let issuer = Issuer::start().await;
    let server = Server::start_with(|config| issuer.configure(config)).await;
    let stranger = SigningKey::new("first");
    let claims = issuer.claims(&json!({"roles": ["admin"]}));
    let own_key = json!({"alg": "ES256", "kid": "first", "jwk": stranger.public()});
    let elsewhere = json!({"alg": "ES256", "kid": "first", "jku": "http://127.0.0.1:9/keys", "x5u": "http://127.0.0.1:9/"});
    let public = issuer.key.public().to_string();
    let hmac = |secret: &[u8]| {
        let key = ring::hmac::Key::new(ring::hmac::HMAC_SHA256, secret);
        let parts = [&json!({"alg": "HS256", "kid": "first"}), &claims];
        let text = parts.map(|part| BASE64.encode(part.to_string())).join(".");
        let signature = BASE64.encode(ring::hmac::sign(&key, text.as_bytes()));
        format!("Bearer {text}.{signature}")
    };
    let right = issuer.bearer(&json!({}));
    let (start, _) = right.rsplit_once('.').unwrap();
    let other_claims = BASE64.encode(claims.to_string());
    let parts: Vec<_> = right.split('.').collect();
    let signed = |header: &Value| format!("Bearer {}", stranger.sign(header, &claims));
    for (what, bearer) in [
        ("nothing is signed", issuer.unsigned()),
        ("no signature", format!("{start}.")),
        ("another key of the same id", signed(&stranger.header())),
        ("a key in the token", signed(&own_key)),
        ("an address of keys in the token", signed(&elsewhere)),
        ("the public key as a secret", hmac(public.as_bytes())),
        ("an empty secret", hmac(b"")),
        (
            "other claims",
            [parts[0], &other_claims, parts[2]].join("."),
        ),
        (
            "a token that ends a session",
            issuer.with_header(&json!({"typ": "logout+jwt"})),
        ),
        (
            "an extension",
            issuer.with_header(&json!({"crit": ["b64"], "b64": false})),
        ),
        ("no JSON", "Bearer a.b.c".to_owned()),
        ("nothing but points", "Bearer ..".to_owned()),
    ] {
        let answer = ask(&server, "/v1/session", &bearer).await;
        assert_eq!(answer.status, 401, "{what}: {answer:?}");
        assert!(answer.json()["name"].is_null());
    }
    for id in ["../../etc/passwd", "' OR 1=1 --", "", "FIRST", "first\0"] {
        let bearer = issuer.with_header(&json!({"kid": id}));
        let answer = ask(&server, "/v1/session", &bearer).await;
        assert_eq!(answer.status, 401, "{id:?}");
    }
    // A right one is right all the same, also as a password.
    let token = right.strip_prefix("Bearer ").unwrap();
    let basic = base64::prelude::BASE64_STANDARD.encode(format!("anybody:{token}"));
    for bearer in [right.clone(), format!("Basic {basic}")] {
        assert_eq!(ask(&server, "/v1/session", &bearer).await.status, 200);
    }
}

#[tokio::test]
async fn a_new_key_is_found_at_once_and_unknown_ones_do_not_make_the_server_ask_again_and_again() {
    let issuer = Issuer::start().await;
    let server = Server::start_with(|config| issuer.configure(config)).await;
    let status = async |bearer: &str| ask(&server, "/v1/session", bearer).await.status.as_u16();
    assert_eq!(status(&issuer.bearer(&json!({}))).await, 200);
    let next = SigningKey::new("next");
    *issuer.keys.lock().unwrap() = json!({"keys": [next.public(), {"kty": "unknown"}]});
    let renewed = issuer.signed_by(&next, &json!({}));
    assert_eq!(status(&renewed).await, 200);
    assert_eq!(issuer.times_asked(), 2);
    // The one of before is withdrawn.
    assert_eq!(status(&issuer.bearer(&json!({}))).await, 401);
    for number in 0..20 {
        let bearer = issuer.with_header(&json!({"kid": number.to_string()}));
        assert_eq!(status(&bearer).await, 401);
    }
    assert_eq!(issuer.times_asked(), 3);
    assert_eq!(status(&renewed).await, 200);
}

#[tokio::test]
async fn without_the_issuer_known_keys_open_and_unknown_ones_wait_for_it() {
    let issuer = Issuer::start().await;
    let file = TokensFile::new();
    let configure = |config: &mut Config| {
        issuer.configure(config);
        config.http.tokens_file = Some(file.path());
    };
    let (known, never) = (
        Server::start_with(configure).await,
        Server::start_with(configure).await,
    );
    let bearer = issuer.bearer(&json!({}));
    assert_eq!(ask(&known, "/v1/cases", &bearer).await.status, 200);
    issuer.serving.abort();
    assert_eq!(ask(&known, "/v1/cases", &bearer).await.status, 200);
    assert_eq!(ask(&known, "/sign-in", "").await.status, 200);
    for (server, bearer) in [
        (&known, &issuer.with_header(&json!({"kid": "new"}))),
        (&never, &bearer),
    ] {
        let answer = ask(server, "/v1/cases", bearer).await;
        assert_eq!(answer.status, 503);
        assert_eq!(answer.problem(), "issuer-away");
        assert!(!answer.header("retry-after").is_empty());
    }
    assert_eq!(ask(&never, "/sign-in", "").await.problem(), "issuer-away");
    // Named tokens do not need the issuer, and what cannot be one of its tokens is not kept waiting.
    let named = file.bearer("read");
    assert_eq!(ask(&never, "/v1/cases", &named).await.status, 200);
    let wrong = ask(&never, "/v1/cases", "Bearer isocortex_0").await;
    assert_eq!(wrong.problem(), "unauthorized");
}

#[tokio::test]
async fn an_issuer_with_another_name_or_with_unsafe_addresses_is_not_believed() {
    for change in [
        json!({"issuer": "https://other.example"}),
        json!({"jwks_uri": "http://keys.example/"}),
        json!({"token_endpoint": "http://tokens.example/"}),
        json!({"jwks_uri": null}),
    ] {
        let real = Issuer::start().await;
        let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await.unwrap();
        let address = format!("http://{}", listener.local_addr().unwrap());
        let mut document = json!({"issuer": address, "jwks_uri": format!("{}/keys", real.address)});
        document
            .as_object_mut()
            .unwrap()
            .extend(change.as_object().unwrap().clone());
        let app = Router::new().route(
            "/.well-known/openid-configuration",
            get(async move || Json(document)),
        );
        let serving = tokio::spawn(async move { axum::serve(listener, app).await.unwrap() });
        let server = Server::start_with(|config| config.oidc = Some(oidc(&address))).await;
        let bearer = real.bearer(&json!({"iss": address}));
        let answer = ask(&server, "/v1/cases", &bearer).await;
        assert_eq!(answer.problem(), "issuer-away", "{change}");
        serving.abort();
    }
}

#[tokio::test]
async fn a_stream_of_events_ends_with_the_sign_in() {
    let issuer = Issuer::start().await;
    let server = Server::start_with(|config| {
        issuer.configure(config);
        // The case never becomes ready, so its events do not end by themselves.
        config.prepare.workers = 0;
    })
    .await;
    let upload = Request::post("/v1/cases")
        .header("content-type", form_type())
        .header("authorization", issuer.bearer(&json!({"roles": "editor"})))
        .body(Body::from(form(&[("volume", &plain_head().bytes())])));
    let uploaded = server.send(upload.unwrap()).await;
    assert_eq!(uploaded.status, 202, "{uploaded:?}");
    // The clocks may differ by 30 s, which are nearly over.
    let bearer = issuer.bearer(&json!({"exp": seconds(-22)}));
    let request = Request::builder()
        .method(Method::GET)
        .uri(format!("{}/events", uploaded.header("location")))
        .header("authorization", bearer);
    let request = request.body(Body::empty()).unwrap();
    let answer = server.router().oneshot(request).await.unwrap();
    assert_eq!(answer.status(), StatusCode::OK);
    let streamed = answer.into_body().collect();
    let ended = tokio::time::timeout(Duration::from_secs(60), streamed).await;
    ended.expect("the stream ends").unwrap();
}

#[tokio::test]
async fn the_page_may_ask_the_issuer_by_whom_it_signs_in_and_nobody_else() {
    let issuer = Issuer::start().await;
    let policy = async |server: &Server| {
        let page = server.get("/").await;
        page.header("content-security-policy").to_owned()
    };
    let with = Server::start_with(|config| issuer.configure(config)).await;
    let only_tokens = Server::start_with(|config| {
        issuer.configure(config);
        config.oidc.as_mut().unwrap().client_id = None;
    })
    .await;
    let without = Server::start().await;
    let named = format!("connect-src 'self' {};", issuer.address);
    let before = policy(&without).await;
    assert_eq!(
        policy(&with).await,
        before.replace("connect-src 'self';", &named)
    );
    assert_eq!(policy(&only_tokens).await, before);
    let sign_in = with.get("/sign-in").await;
    assert_eq!(sign_in.header("cache-control"), "no-store");
    let sign_in = sign_in.json();
    assert_eq!(sign_in["issuer"], issuer.address);
    assert_eq!(sign_in["client_id"], "page");
    assert_eq!(
        sign_in["token_endpoint"],
        format!("{}/token", issuer.address)
    );
    for server in [&only_tokens, &without] {
        assert!(server.get("/sign-in").await.json()["issuer"].is_null());
    }
    let schemes = with.get("/openapi.json").await.json();
    let scheme = &schemes["components"]["securitySchemes"]["openid"];
    assert_eq!(scheme["type"], "openIdConnect");
    let security = &schemes["paths"]["/v1/cases"]["get"]["security"];
    assert!(!security.as_array().unwrap().contains(&json!({})));
}

#[test]
fn check_config_says_who_may_sign_in_and_refuses_what_is_not_safe() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("isocortex.toml");
    let check = |text: &str| {
        std::fs::write(&path, text).unwrap();
        run(&["check-config", "--config", &path.display().to_string()])
    };
    let good = "[http]\nlisten = \"0.0.0.0:8640\"\n[oidc]\nissuer = \"https://id.example/realms/site\"\naudience = \"isocortex\"\n";
    let (status, said) = check(good);
    assert_eq!(status, Some(0), "{said}");
    for part in [
        "with the tokens of an issuer",
        "accepts tokens of https://id.example/realms/site for isocortex",
        "from the claim roles: viewer, editor, pacs, admin",
        "does not sign in there: `oidc.client_id`",
    ] {
        assert!(said.contains(part), "{said}");
    }
    let table = format!(
        "{good}client_id = \"page\"\nroles_claim = \"groups\"\n[oidc.roles]\nradiology = \"editor\"\n"
    );
    let (status, said) = check(&table);
    assert_eq!(status, Some(0), "{said}");
    assert!(said.contains("claim groups: radiology = editor"), "{said}");
    assert!(said.contains("as the client page"), "{said}");
    for (wrong, part) in [
        (
            good.replace("https://id", "http://id"),
            "must be an address that begins with https://",
        ),
        (
            good.replace("/site", "/site?x=1"),
            "must be an address that begins with https://",
        ),
        (
            good.replace("https://", "https://user@"),
            "must be an address that begins with https://",
        ),
        (
            good.replace("\"isocortex\"", "\"\""),
            "`audience` must not be empty",
        ),
        (good.replace("audience", "audiences"), "unknown field"),
        (
            format!("{good}[oidc.roles]\nradiology = \"boss\"\n"),
            "`boss` is no role",
        ),
        (
            format!("{good}[oidc.parameters]\nstate = \"x\"\n"),
            "must not set `state`",
        ),
    ] {
        let (status, said) = check(&wrong);
        assert_eq!(status, Some(78), "{wrong}\n{said}");
        assert!(said.contains(part), "{said}");
    }
}
