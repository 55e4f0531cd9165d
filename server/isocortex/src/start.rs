//! Starts a server from a configuration.

use std::collections::BTreeMap;
use std::time::SystemTime;

use access::audit::{Action, Audit, Event, EventKind, Outcome};
use access::proxy::SignInProxy;
use access::scopes::Role;
use access::tokens::NamedToken;
use axum::Router;
use cases::{BeforeRemoval, Cases, Library};
use http::uploads::UploadLimits;
use pacs::Pacs;
use service::app::app_with;
use service::state::{AppState, HttpOptions};
use storage::DatabaseAddress;

use crate::config::{Config, ConfigError, Network};

/// Why a server cannot start.
#[derive(Debug, thiserror::Error)]
pub enum StartError {
    /// The configuration is invalid.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The application cannot start.
    #[error(transparent)]
    Cases(#[from] cases::StartError),
}

/// What a configuration comes to, in words.
#[derive(Debug, Default)]
pub struct Checked {
    /// What may not be meant so.
    pub warnings: Vec<String>,
    /// Where it listens, what it opens and whom it knows.
    pub lines: Vec<String>,
}

/// Checks everything in a configuration that can be checked without opening a store or a port.
///
/// # Errors
/// If a server could not start with it.
pub fn check(config: &Config) -> Result<Checked, ConfigError> {
    let open_files = config.open_files();
    config.check()?;
    let access = config.access()?;
    config.origins()?;
    let cases::Options {
        location, children, ..
    } = config.cases()?;
    let nodes = config.pacs.nodes()?;
    let dimse = config.pacs.dimse()?;
    config.pacs.time_zone()?;
    config.check_ports()?;
    config.check_audit()?;
    config.tls()?;
    let mut checked = Checked::default();
    checked.warnings.extend(open_files);
    checked.warnings.extend(config.memory_warning()?);
    let tokens = config.named_tokens()?;
    let named = tokens.len();
    let now = SystemTime::now();
    let ended = |token: &&NamedToken| token.ends.is_some_and(|end| end <= now);
    let ended: Vec<_> = tokens
        .iter()
        .filter(ended)
        .map(|token| &*token.holder.name)
        .collect();
    let guard = match (access.wants_token(), named) {
        (true, 0) if access.proxy().is_some() => "with the headers of a proxy".to_owned(),
        (true, 0) => "with a token".to_owned(),
        (true, 1) if ended.is_empty() => "with one named token".to_owned(),
        (true, named) if ended.is_empty() => format!("with {named} named tokens"),
        (true, named) => format!(
            "with {named} named tokens, of which these have ended: {}",
            ended.join(", ")
        ),
        (false, _) => "without a token, for this machine alone".to_owned(),
    };
    checked.warnings.extend(config.warn_of_no_tokens()?);
    let lines = &mut checked.lines;
    let mut say = |line: String| lines.push(line);
    let scheme = config.scheme();
    say(format!(
        "listens on {scheme}://{} {guard}",
        config.http.listen
    ));
    if let Some(proxy) = access.proxy() {
        proxy_lines(config, proxy).into_iter().for_each(&mut say);
        checked.warnings.extend(proxy_warnings(config, proxy));
    }
    let place = location.folder.display();
    let is_elsewhere = location.database.is_some() && location.objects.is_some();
    let what = match is_elsewhere {
        true => "the folder of uploads in progress",
        false => "the store",
    };
    say(match location.folder.is_dir() {
        true => format!("{what} is {place}"),
        false => format!("{what} is {place}, which does not exist yet"),
    });
    match &location.database {
        Some(database) => say(format!("its database is {database}")),
        None => say("its database is a file in this folder".to_owned()),
    }
    match &location.objects {
        Some(objects) => say(format!("its objects are in {objects}")),
        None => say("its objects are in this folder".to_owned()),
    }
    if let (Some(DatabaseAddress::Postgres(_)), None) = (&location.database, &location.objects) {
        let warning = "the database is for several machines, and the objects are in a folder of this one: name a bucket or a shared folder in `storage.objects`";
        checked.warnings.push(warning.to_owned());
    }
    say(format!(
        "processes that read files and prepare cases may use {} MiB together",
        children.bytes >> 20
    ));
    match &config.audit.folder {
        Some(folder) => say(format!("who does what is recorded in {}", folder.display())),
        None => say("nothing is recorded of who does what (`audit.folder`)".to_owned()),
    }
    for node in &nodes {
        say(format!("sends to the node `{}`", node.name()));
    }
    if dimse.is_none() && !config.pacs.dimse.peers.is_empty() {
        let warning = "nobody can send images by C-STORE: `pacs.dimse.peers` has peers, but `pacs.dimse.listen` is not set";
        checked.warnings.push(warning.to_owned());
    }
    if let Some((listen, options)) = dimse {
        let tls = if options.tls.is_some() { " by TLS" } else { "" };
        let peers = options.peers.len();
        say(format!(
            "listens for C-STORE on {listen}{tls} as {}, from {peers} peers",
            options.aet
        ));
        if peers == 0 {
            let warning = "nobody may send images by C-STORE: list the peers in `pacs.dimse.peers`";
            checked.warnings.push(warning.to_owned());
        }
    }
    Ok(checked)
}

/// The roles of a table, in words.
fn role_words(roles: &BTreeMap<String, Role>) -> String {
    let known: Vec<_> = match roles.is_empty() {
        true => Role::ALL.map(|role| role.name().to_owned()).into(),
        false => (roles.iter())
            .map(|(value, role)| format!("{value} = {}", role.name()))
            .collect(),
    };
    known.join(", ")
}

/// Whose headers are believed, and who may do what by them.
fn proxy_lines(config: &Config, proxy: &SignInProxy) -> Vec<String> {
    let options = proxy.options();
    let socket = config.proxy.as_ref().and_then(|it| it.socket.as_ref());
    let socket = socket.map(|socket| format!("the socket {}", socket.display()));
    let listed = config.http.trusted_proxies.iter();
    let listed = listed.map(|network| network.0.to_string());
    let trusted: Vec<_> = listed.chain(socket).collect();
    let named = match &options.groups_header {
        Some(groups) => format!("groups in {groups}"),
        None => format!("users in {}", options.user_header),
    };
    vec![
        format!(
            "believes whom the header {} names, from {} alone",
            options.user_header,
            trusted.join(", ")
        ),
        format!(
            "roles are those of the {named}: {}",
            role_words(&options.roles)
        ),
        match &options.sign_out {
            Some(place) => format!("the page signs out at {place}"),
            None => "the page does not sign out: `proxy.sign_out` is not set".to_owned(),
        },
    ]
}

/// Who else than a proxy could name anybody in its headers.
fn proxy_warnings(config: &Config, proxy: &SignInProxy) -> Vec<String> {
    let mut warnings = Vec::new();
    for Network(network) in &config.http.trusted_proxies {
        if network.addr().is_loopback() {
            warnings.push(format!(
                "every program on this machine can sign in as anybody, because `http.trusted_proxies` has {network}: use `proxy.socket` for a proxy on this machine"
            ));
        } else if network.prefix_len() < network.max_prefix_len() {
            warnings.push(format!(
                "every machine in {network} can sign in as anybody: list the addresses of the proxies alone in `http.trusted_proxies`"
            ));
        }
    }
    let is_listening = !config.http.listen.ip().is_loopback();
    if is_listening && !config.http.trusted_proxies.is_empty() && config.scheme() == "http" {
        warnings.push(
            "whoever can change what the network carries between the proxy and this server can sign in as anybody: set `http.tls_certificate`".to_owned(),
        );
    }
    let options = proxy.options();
    if options.roles.is_empty() {
        warnings.push(
            "a group that is called `admin` may do everything, because there is no table `proxy.roles`".to_owned(),
        );
    }
    warnings
}

fn warn_of_memory(config: &Config) -> Result<(), ConfigError> {
    if let Some(warning) = config.memory_warning()? {
        tracing::warn!("{warning}");
    }
    Ok(())
}

/// What requests with files of at most so many bytes may take.
fn uploads(config: &Config, max_bytes: u64) -> UploadLimits {
    let timeouts = &config.http.timeouts;
    UploadLimits {
        max_bytes,
        at_a_time: config.http.max_uploads,
        idle: timeouts.idle,
        whole: timeouts.whole,
    }
}

/// Opens the store for serving. Cases are prepared only after workers are started on the library. Who does what is recorded in `audit`
/// ([`Config::audit`]), which is begun once, however often the store must be opened until it answers.
///
/// # Errors
/// If the configuration is invalid or the store cannot be opened.
pub async fn open(config: &Config, audit: &Audit) -> Result<AppState, StartError> {
    config.check()?;
    warn_of_memory(config)?;
    let [_, frame_ancestors] = config.origins()?;
    let options = HttpOptions {
        access: config.access()?,
        uploads: uploads(config, config.limits.max_upload_bytes),
        answer_timeout: config.http.timeouts.answer,
        frame_ancestors,
        guard_all: config.http.guard_all,
        audit: audit.clone(),
    };
    let cases = cases::Options {
        before_removal: recorded(audit),
        ..config.cases()?
    };
    Ok(AppState::new(Cases::open(cases).await?, options))
}

/// Has each expired case on record before it goes; if it cannot be recorded, it stays.
pub fn recorded(audit: &Audit) -> BeforeRemoval {
    let audit = audit.clone();
    BeforeRemoval::new(move |id| {
        let event = Event {
            outcome: Outcome::Allowed,
            case: Some(id.to_string().into()),
            ..Event::new(
                EventKind::StudyDeleted,
                Action::Delete,
                "expired case",
                "isocortex",
            )
        };
        let audit = audit.clone();
        async move { audit.record(event).await.is_ok() }
    })
}

/// What images from a PACS go to, on the application that is served.
///
/// # Errors
/// If a node in the configuration cannot be used.
pub fn pacs(config: &Config, state: &AppState) -> Result<Pacs, ConfigError> {
    let options = pacs::Options {
        uploads: uploads(config, config.limits.max_dicom_bytes()),
        nodes: config.pacs.nodes()?,
        shows_patient: config.shows_patient()?,
        time_zone: config.pacs.time_zone()?,
        audit: state.audit().clone(),
    };
    Ok(Pacs::new(state.cases.clone(), options))
}

/// Everything that is served over HTTP.
pub fn router(state: &AppState, pacs: &Pacs) -> Router {
    app_with(state.clone(), pacs::guarded_routes(pacs))
}

/// Opens the store for preparing cases only; `audit` as for [`open`].
///
/// # Errors
/// If the configuration is invalid or the store cannot be opened.
pub async fn open_library(config: &Config, audit: &Audit) -> Result<Library, StartError> {
    config.check()?;
    warn_of_memory(config)?;
    let options = cases::Options {
        before_removal: recorded(audit),
        ..config.cases()?
    };
    Ok(cases::open_library(&options).await?)
}
