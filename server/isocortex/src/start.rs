//! Starts a server from a configuration.

use std::time::Duration;

use axum::Router;
use cases::{Cases, Library};
use http_support::oidc::Issuer;
use http_support::scopes::Role;
use http_support::uploads::UploadLimits;
use pacs::Pacs;
use service::app::{Beside, app_beside};
use service::state::{AppState, HttpOptions};

use crate::config::{Config, ConfigError, DICOM_UNPACKING};

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
    config.check()?;
    let access = config.access()?;
    config.origins()?;
    let location = config.cases()?.location;
    let nodes = config.pacs.nodes()?;
    let dimse = config.pacs.dimse()?;
    config.pacs.time_zone()?;
    config.check_ports()?;
    config.check_audit()?;
    config.tls()?;
    let mut checked = Checked::default();
    let named = config.named_tokens()?.len();
    let guard = match (access.wants_token(), named, access.issuer()) {
        (true, 0, Some(_)) => "with the tokens of an issuer".to_owned(),
        (true, 0, None) => "with a token".to_owned(),
        (true, named, _) => format!("with {named} named tokens"),
        (false, ..) => "without a token, for this machine alone".to_owned(),
    };
    let mut say = |line: String| checked.lines.push(line);
    let scheme = config.scheme();
    say(format!(
        "listens on {scheme}://{} {guard}",
        config.http.listen
    ));
    if let Some(issuer) = access.issuer() {
        issuer_lines(issuer).into_iter().for_each(&mut say);
    }
    let database = location.database.map(|database| database.to_string());
    let objects = location.objects.map(|objects| objects.to_string());
    let place = location.folder.display();
    say(match location.folder.is_dir() {
        true => format!("the store is in {place}"),
        false => format!("the store will be in {place}, which does not exist yet"),
    });
    say(match location.keys.current() {
        Some(key) => format!("its objects are encrypted with the key {key}"),
        None => "its objects are not encrypted (`storage.key_file`)".to_owned(),
    });
    match &config.audit.folder {
        Some(folder) => say(format!("who does what is recorded in {}", folder.display())),
        None => say("nothing is recorded of who does what (`audit.folder`)".to_owned()),
    }
    for (what, place) in [("database", database), ("objects", objects)] {
        if let Some(place) = place {
            say(format!("its {what}: {place}"));
        }
    }
    for node in &nodes {
        say(format!("sends to the node `{}`", node.name()));
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

/// Whose tokens are accepted, who may do what in which project, and whether the page signs in.
fn issuer_lines(issuer: &Issuer) -> Vec<String> {
    let options = issuer.options();
    let roles = &options.roles;
    let known: Vec<_> = match roles.roles.is_empty() {
        true => Role::ALL.map(|role| role.name().to_owned()).into(),
        false => (roles.roles.iter())
            .map(|(value, role)| format!("{value} = {}", role.name()))
            .collect(),
    };
    let page = match &options.client_id {
        Some(client) => format!("the page signs in there as the client {client}"),
        None => "the page does not sign in there: `oidc.client_id` is not set".to_owned(),
    };
    let projects = &options.projects;
    let of_projects = (projects.projects.iter()).map(|(value, project)| match project.name() {
        "" => format!("{value} = the project without a name"),
        name => format!("{value} = {name}"),
    });
    let of_projects: Vec<_> = of_projects.collect();
    let of_projects = (!of_projects.is_empty()).then(|| {
        format!(
            "projects are read from the claim {}: {}",
            projects.claim,
            of_projects.join(", ")
        )
    });
    let lines = [
        format!(
            "accepts tokens of {} for {}, whom nobody has asked yet",
            options.issuer, options.audience
        ),
        format!(
            "roles are read from the claim {}: {}",
            roles.claim,
            known.join(", ")
        ),
        page,
    ];
    lines.into_iter().chain(of_projects).collect()
}

/// Opens the store for serving. Cases are prepared only after workers are started on the library.
///
/// # Errors
/// If the configuration is invalid or the store cannot be opened.
pub async fn open(config: &Config) -> Result<AppState, StartError> {
    config.check()?;
    let [_, frame_ancestors] = config.origins()?;
    let options = HttpOptions {
        access: config.access()?,
        uploads: UploadLimits {
            max_bytes: config.limits.max_upload_bytes,
            at_a_time: config.http.max_uploads,
            idle: Duration::from_secs(config.http.upload_idle_secs),
            whole: Duration::from_secs(config.http.upload_timeout_secs),
        },
        answer_timeout: Duration::from_secs(config.http.answer_timeout_secs),
        frame_ancestors,
        guard_all: config.http.guard_all,
    };
    let cases = cases::Options {
        audit: config.audit()?,
        ..config.cases()?
    };
    Ok(AppState::new(Cases::open(cases).await?, options))
}

/// What images from a PACS go to, on the application that is served.
///
/// # Errors
/// If a node in the configuration cannot be used.
pub fn pacs(config: &Config, cases: &Cases) -> Result<Pacs, ConfigError> {
    let options = pacs::Options {
        uploads: UploadLimits {
            max_bytes: config
                .limits
                .max_upload_bytes
                .saturating_mul(DICOM_UNPACKING),
            at_a_time: config.http.max_uploads,
            idle: Duration::from_secs(config.http.upload_idle_secs),
            whole: Duration::from_secs(config.http.upload_timeout_secs),
        },
        nodes: config.pacs.nodes()?,
        ignores_other_objects: config.pacs.ignore_other_objects,
        serves_source: config.pacs.keep_source,
        shows_patient: config.shows_patient()?,
        time_zone: config.pacs.time_zone()?,
    };
    Ok(Pacs::new(cases.clone(), options))
}

/// Everything that is served over HTTP.
pub fn router(state: &AppState, pacs: &Pacs) -> Router {
    let (guarded, description) = pacs::guarded_routes(pacs);
    let beside = Beside {
        guarded,
        scopes: pacs::SCOPES,
        description,
    };
    app_beside(state.clone(), beside)
}

/// Opens the store for preparing cases only.
///
/// # Errors
/// If the configuration is invalid or the store cannot be opened.
pub async fn open_library(config: &Config) -> Result<Library, StartError> {
    config.check()?;
    let options = cases::Options {
        audit: config.audit()?,
        ..config.cases()?
    };
    Ok(cases::open_library(&options).await?)
}
