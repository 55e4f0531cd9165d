//! People whom a proxy has signed in: whose headers are believed, what they open, and what does not pass for them.

use std::net::SocketAddr;
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;

use access::proxy::ProxyOptions;
use access::scopes::Role;
use isocortex::config::{Config, Secret};
use serde_json::{Value, json};
use tokio::io::{AsyncRead, AsyncReadExt as _, AsyncWrite, AsyncWriteExt as _};
use tokio::net::{TcpStream, UnixStream};

use crate::command_line::run;
use crate::operation::Logged;
use crate::server::Server;

const TOKEN: &str = "correct-horse-battery-staple";

fn proxy() -> ProxyOptions {
    ProxyOptions {
        user_header: "X-Remote-User".to_owned(),
        groups_header: Some("X-Remote-Groups".to_owned()),
        separator: ',',
        roles: [
            ("readers".to_owned(), Role::Editor),
            ("boss".to_owned(), Role::Admin),
        ]
        .into(),
        sign_out: Some("/oauth2/sign_out".to_owned()),
        socket: None,
    }
}

/// A server that believes a proxy at this address.
fn believing(address: &str) -> impl FnOnce(&mut Config) {
    let trusted = vec![address.parse().unwrap()];
    move |config| {
        config.http.token = Some(Secret(TOKEN.to_owned()));
        config.http.trusted_proxies = trusted;
        config.proxy = Some(proxy());
    }
}

/// An answer, as it comes over a connection: its status, its head in lower case, and its body.
struct Raw {
    status: u16,
    head: String,
    body: Value,
}

async fn over(mut stream: impl AsyncRead + AsyncWrite + Unpin, request: &str) -> Raw {
    stream.write_all(request.as_bytes()).await.unwrap();
    let mut answer = String::new();
    stream.read_to_string(&mut answer).await.unwrap();
    let (head, body) = answer.split_once("\r\n\r\n").unwrap();
    Raw {
        status: head[9..12].parse().unwrap(),
        head: head.to_lowercase(),
        body: serde_json::from_str(body).unwrap_or_default(),
    }
}

impl Raw {
    fn problem(&self) -> &str {
        let kind = self.body["type"].as_str().unwrap_or_default();
        kind.strip_prefix("urn:isocortex:problem:").unwrap()
    }
}

fn request(line: &str, headers: &str) -> String {
    format!("{line} HTTP/1.1\r\nHost: localhost\r\n{headers}Connection: close\r\n\r\n")
}

/// Who asks, with these lines of a header.
async fn session(address: SocketAddr, headers: &str) -> Raw {
    let stream = TcpStream::connect(address).await.unwrap();
    over(stream, &request("GET /v1/session", headers)).await
}

const ANA: &str = "X-Remote-User: ana\r\nX-Remote-Groups: staff, readers\r\n";

#[tokio::test]
async fn whom_a_listed_proxy_names_is_signed_in_and_on_record() {
    let folder = tempfile::tempdir().unwrap();
    let server = Server::start_with(|config| {
        believing("127.0.0.0/8")(config);
        config.audit.folder = Some(folder.path().to_owned());
    })
    .await;
    let socket = server.on_a_socket().await;
    let headers = format!("{ANA}X-Forwarded-For: 203.0.113.5\r\n");
    let ana = session(socket.address, &headers).await;
    let expected = json!({
        "name": "proxy:ana",
        "scopes": ["read", "write", "results"],
        "sign_out": "/oauth2/sign_out",
    });
    assert_eq!((ana.status, &ana.body), (200, &expected));
    assert!(ana.head.contains("vary: cookie"), "{}", ana.head);
    // Names of headers have no case, neither those of the configuration nor those of the proxy.
    let shouted = session(socket.address, &ANA.to_uppercase().replace("ANA", "ana")).await;
    assert_eq!(
        (shouted.status, shouted.problem()),
        (403, "missing-scope"),
        "groups have a case"
    );
    let detail = shouted.body["detail"].to_string();
    assert!(detail.contains("`proxy:ana`"), "{detail}");
    // The proxy goes before a token; without a user, a token opens, and has its own way to end.
    let token = format!("Authorization: Bearer {TOKEN}\r\n");
    let both = session(socket.address, &format!("{ANA}{token}")).await;
    assert_eq!(both.body["name"], "proxy:ana");
    let alone = session(socket.address, &token).await;
    assert_eq!(alone.body["name"], "token");
    assert_eq!(alone.body["sign_out"], Value::Null);
    assert!(alone.head.contains("vary: authorization"), "{}", alone.head);
    // The page learns that a window of the proxy signs in.
    let stream = TcpStream::connect(socket.address).await.unwrap();
    let how = over(stream, &request("GET /sign-in", "")).await;
    assert_eq!(how.body["by_proxy"], true);

    let refused = session(socket.address, &format!("{ANA}X-Remote-User: boss\r\n")).await;
    assert_eq!(refused.status, 401);
    let stream = TcpStream::connect(socket.address).await.unwrap();
    let listed = over(stream, &request("GET /v1/cases", &headers)).await;
    assert_eq!(listed.status, 200);
    server.state.audit().shut_down();
    let files = std::fs::read_dir(folder.path()).unwrap();
    let record: String = files
        .map(|file| std::fs::read_to_string(file.unwrap().path()).unwrap())
        .collect();
    let of_ana = |line: &&str| {
        line.contains("\"who\":\"proxy:ana\"") && line.contains("\"from\":\"203.0.113.5\"")
    };
    let listed = record.lines().find(of_ana).expect(&record);
    assert!(listed.contains("\"object\":\"list\""), "{listed}");
}

#[tokio::test]
async fn a_header_of_anybody_else_opens_nothing() {
    let server = Server::start_with(believing("203.0.113.9")).await;
    let socket = server.on_a_socket().await;
    for more in [
        "",
        "X-Forwarded-For: 203.0.113.9\r\n",
        "Forwarded: for=203.0.113.9\r\nX-Real-IP: 203.0.113.9\r\n",
    ] {
        // It is no guess of a token, however often it comes.
        for _ in 0..10 {
            let spoofed = session(socket.address, &format!("{ANA}{more}")).await;
            assert_eq!((spoofed.status, spoofed.problem()), (401, "unauthorized"));
        }
    }
    let stream = TcpStream::connect(socket.address).await.unwrap();
    let how = over(stream, &request("GET /sign-in", ANA)).await;
    assert_eq!(how.body["by_proxy"], false);
    let token = format!("{ANA}Authorization: Bearer {TOKEN}\r\n");
    assert_eq!(
        session(socket.address, &token).await.body["name"],
        "token",
        "a token opens all the same"
    );
}

#[tokio::test]
async fn what_a_client_adds_to_the_headers_of_a_proxy_is_worth_nothing() {
    let server = Server::start_with(|config| {
        believing("127.0.0.1")(config);
        config.http.allowed_origins = vec!["https://viewer.example".to_owned()];
    })
    .await;
    let socket = server.on_a_socket().await;
    // A proxy that has added its own headers to those of a client.
    for more in [
        "X-Remote-User: boss\r\n",
        "x-REMOTE-user: boss\r\n",
        "X-Remote-User: ana\r\n",
        "X-Remote-User:\r\n",
        "X-Remote-Groups: boss\r\n",
    ] {
        for headers in [format!("{ANA}{more}"), format!("{more}{ANA}")] {
            let refused = session(socket.address, &headers).await;
            assert_eq!(
                (refused.status, refused.problem()),
                (401, "proxy-refused"),
                "{headers}"
            );
        }
    }
    let joined = session(socket.address, "X-Remote-User: ana, boss\r\n").await;
    assert_eq!(
        (joined.status, joined.problem()),
        (401, "proxy-refused"),
        "one header of two"
    );
    // Nobody, and other headers that some programs take for the right ones.
    for headers in [
        "X-Remote-User:\r\nX-Remote-Groups: boss\r\n",
        "X-Remote-User:   \r\n",
        "X-Remote-User: (null)\r\n",
        "X_Remote_User: boss\r\nX_Remote_Groups: boss\r\n",
        "X-Remote_User: boss\r\n",
        "HTTP_X_REMOTE_USER: boss\r\n",
        "X-Remote-Groups: boss\r\n",
    ] {
        let nobody = session(socket.address, headers).await;
        assert_eq!(
            (nobody.status, nobody.problem()),
            (401, "unauthorized"),
            "{headers}"
        );
    }
    // Lines that a proxy and a server may read in two ways are no request.
    for headers in [
        "X-Remote-User : boss\r\n",
        "X-Remote-User\t: boss\r\n",
        " X-Remote-User: boss\r\n",
        "X-Other: a\r\n X-Remote-User: boss\r\n",
        "X-Remote-User: ana\0boss\r\n",
    ] {
        let mut stream = TcpStream::connect(socket.address).await.unwrap();
        let sent = request("GET /v1/session", headers);
        stream.write_all(sent.as_bytes()).await.unwrap();
        let mut answer = Vec::new();
        let _ = stream.read_to_end(&mut answer).await;
        let answer = String::from_utf8_lossy(&answer);
        assert!(!answer.contains("200 OK"), "{headers:?}: {answer}");
    }
    // A page of a listed origin has no part in the cookie of the proxy.
    let change = |headers: &str| {
        let line = "DELETE /v1/cases/00000000000000000000000000000000";
        request(line, &format!("{ANA}{headers}"))
    };
    for (headers, status) in [
        ("Origin: https://viewer.example\r\n", 401),
        (
            "Origin: https://viewer.example\r\nSec-Fetch-Site: cross-site\r\n",
            401,
        ),
        ("Origin: https://evil.example\r\n", 403),
        ("Sec-Fetch-Site: same-site\r\n", 403),
        ("Sec-Fetch-Site: same-origin\r\n", 404),
        ("", 404),
    ] {
        let stream = TcpStream::connect(socket.address).await.unwrap();
        let answer = over(stream, &change(headers)).await;
        assert_eq!(answer.status, status, "{headers}: {}", answer.body);
    }
    // Nor has any in what it reads: an export would be on record as one of the person.
    for (headers, status) in [
        (
            "Sec-Fetch-Site: cross-site\r\nSec-Fetch-Mode: no-cors\r\n",
            403,
        ),
        (
            "Sec-Fetch-Site: cross-site\r\nSec-Fetch-Mode: navigate\r\n",
            403,
        ),
        ("Sec-Fetch-Site: same-site\r\n", 403),
        ("Origin: https://evil.example\r\n", 403),
        ("Origin: https://viewer.example\r\n", 401),
        ("Sec-Fetch-Site: same-origin\r\n", 404),
        ("Sec-Fetch-Site: none\r\n", 404),
        ("", 404),
    ] {
        let line = "GET /v1/cases/00000000000000000000000000000000/mask";
        let stream = TcpStream::connect(socket.address).await.unwrap();
        let answer = over(stream, &request(line, &format!("{ANA}{headers}"))).await;
        assert_eq!(answer.status, status, "{headers}: {}", answer.body);
    }
}

#[tokio::test]
async fn without_a_socket_nobody_is_a_proxy() {
    let server = Server::start_with(believing("127.0.0.1")).await;
    let headers = [("x-remote-user", "ana"), ("x-remote-groups", "boss")];
    let answer = server.get_with("/v1/session", &headers).await;
    assert_eq!(answer.status, 401);
}

#[tokio::test(flavor = "multi_thread")]
async fn whoever_may_open_the_socket_of_the_proxy_is_one_and_nobody_on_the_network() {
    let folder = tempfile::tempdir().unwrap();
    let socket = folder.path().join("proxy.sock");
    let config = folder.path().join("isocortex.toml");
    let text = format!(
        "[http]\nlisten = \"127.0.0.1:0\"\n[storage]\ndata = \"{}\"\n[proxy]\nuser_header = \"X-Remote-User\"\nsocket = \"{}\"\n[proxy.roles]\nana = \"viewer\"\n",
        folder.path().join("data").display(),
        socket.display()
    );
    std::fs::write(&config, text).unwrap();
    let config = config.display().to_string();
    let start = || {
        let mut server = Logged::start(&["serve", "--gpu", "off", "--config", &config]);
        let listening = server.until("listening")["address"]
            .as_str()
            .map(str::to_owned);
        (server, listening.unwrap())
    };
    let by_socket = async |path: &Path, headers: &str| {
        let stream = UnixStream::connect(path).await.unwrap();
        over(stream, &request("GET /v1/session", headers)).await
    };
    let (server, address) = start();
    let mode = std::fs::metadata(&socket).unwrap().permissions().mode();
    assert_eq!(mode & 0o777, 0o660, "{mode:o}");
    let ana = by_socket(&socket, "X-Remote-User: ana\r\n").await;
    assert_eq!(
        ana.body,
        json!({"name": "proxy:ana", "scopes": ["read"]}),
        "{}",
        ana.head
    );
    let nobody = by_socket(&socket, "").await;
    assert_eq!(nobody.status, 401);
    let on_network = session(address.parse().unwrap(), "X-Remote-User: ana\r\n").await;
    assert_eq!(on_network.status, 401);
    // A killed server leaves its socket behind; the next one takes its place, and removes it when it stops.
    drop(server);
    assert!(socket.exists());
    let (server, _) = start();
    assert_eq!(
        by_socket(&socket, "X-Remote-User: ana\r\n").await.status,
        200
    );
    let (status, said) = run(&["serve", "--gpu", "off", "--config", &config]);
    assert_eq!(status, Some(69), "{said}");
    assert!(said.contains("`proxy.socket`"), "{said}");
    server.end();
    assert!(!socket.exists());
}

#[test]
fn check_config_says_whom_it_believes_and_refuses_what_lets_everybody_in() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("isocortex.toml");
    let check = |http: &str, proxy: &str| {
        let text = format!(
            "[http]\nlisten = \"0.0.0.0:8640\"\n{http}\n[proxy]\nuser_header = \"X-Remote-User\"\n{proxy}\n"
        );
        std::fs::write(&path, text).unwrap();
        run(&["check-config", "--config", &path.display().to_string()])
    };
    let groups = "groups_header = \"X-Remote-Groups\"\n[proxy.roles]\nreaders = \"editor\"";
    let one = "trusted_proxies = [\"10.0.0.5\"]";
    let (status, said) = check(one, groups);
    assert_eq!(status, Some(0), "{said}");
    for part in [
        "with the headers of a proxy",
        "believes whom the header X-Remote-User names, from 10.0.0.5/32 alone",
        "roles are those of the groups in X-Remote-Groups: readers = editor",
        "does not sign out",
        "warning: whoever can change what the network carries",
    ] {
        assert!(said.contains(part), "{part}: {said}");
    }
    for (http, proxy, part) in [
        (
            "trusted_proxies = [\"10.0.0.0/8\"]",
            groups,
            "every machine in 10.0.0.0/8 can sign in as anybody",
        ),
        (
            "trusted_proxies = [\"127.0.0.1\"]",
            groups,
            "every program on this machine can sign in as anybody",
        ),
        (
            one,
            "groups_header = \"X-Remote-Groups\"",
            "a group that is called `admin`",
        ),
    ] {
        let (status, said) = check(http, proxy);
        assert_eq!(status, Some(0), "{said}");
        assert!(said.contains(&format!("warning: {part}")), "{said}");
    }
    for (http, proxy, part) in [
        ("", groups, "`http.trusted_proxies`"),
        (
            "trusted_proxies = [\"0.0.0.0/0\"]",
            groups,
            "everybody could name anybody",
        ),
        (
            "trusted_proxies = [\"10.0.0.5\", \"::/0\"]",
            groups,
            "everybody could name anybody",
        ),
        (one, "", "`roles` must list the users"),
        (
            one,
            "groups_header = \"X_Remote_Groups\"",
            "proxies mistake `_`",
        ),
        (
            one,
            "groups_header = \"Authorization\"",
            "clients send themselves",
        ),
        (one, "groups_header = \"x-remote-user\"", "must differ"),
        (
            one,
            "sign_out = \"//evil.example\"\n[proxy.roles]\na = \"viewer\"",
            "`sign_out`",
        ),
        (one, "[proxy.roles]\na = \"boss\"", "`boss` is no role"),
    ] {
        let (status, said) = check(http, proxy);
        assert_eq!(status, Some(78), "{proxy}: {said}");
        assert!(said.contains(part), "{part}: {said}");
    }
}
