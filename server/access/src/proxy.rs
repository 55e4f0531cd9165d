//! Signing in by a proxy: whom its headers name, and what they may do.
//!
//! Headers are believed if they come by a connection of a proxy that the configuration lists, and from nobody else. The name of the user and
//! the groups must come once each: a proxy that adds a header to the one that a client has sent lets everybody be everybody.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use axum::http::{HeaderMap, HeaderName, HeaderValue};
use serde::Deserialize;

use crate::error::AccessError;
use crate::origins::Origins;
use crate::scopes::{Role, Scope};
use crate::tokens::{Holder, PROXY_PREFIX, name_by};

/// The name of somebody as people know it.
pub fn plain_name(name: &str) -> &str {
    name.strip_prefix(PROXY_PREFIX).unwrap_or(name)
}

/// The time after which an endless answer ends, so that the proxy is asked again who it is for.
pub(crate) const ASKED_AGAIN_AFTER: Duration = Duration::from_secs(15 * 60);

/// What Apache sends for a variable that has no value.
const NOTHING: &[u8] = b"(null)";

/// Headers that clients send themselves, and that proxies pass on.
const OF_CLIENTS: [&str; 12] = [
    "accept",
    "authorization",
    "connection",
    "content-type",
    "cookie",
    "forwarded",
    "host",
    "origin",
    "referer",
    "user-agent",
    "x-forwarded-for",
    "x-request-id",
];

/// How a proxy names people; `[proxy]` of the configuration.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ProxyOptions {
    /// The header with the name of the user.
    pub user_header: String,
    /// The header with the groups of the user. Without one, the tables have names of users.
    pub groups_header: Option<String>,
    /// What is between two groups.
    #[serde(default = "default_separator")]
    pub separator: char,
    /// The role of each group. If this is empty, the groups are the names of roles.
    #[serde(default)]
    pub roles: BTreeMap<String, Role>,
    /// Where the proxy signs people out: a path, or an address.
    pub sign_out: Option<String>,
    /// A socket in the file system for the proxy, beside the address. Whoever may open it may name anybody.
    pub socket: Option<PathBuf>,
}

fn default_separator() -> char {
    ','
}

/// Why nobody can sign in by a proxy.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum BadProxy {
    /// The name of a header.
    #[error(
        "`{0}` is no name of a header; use letters, digits and `-`: proxies mistake `_` for `-`, or drop the header"
    )]
    Name(String),
    /// A header that others send.
    #[error(
        "`{0}` is a header that clients send themselves; choose one that the proxy alone sets, such as `X-Remote-User`"
    )]
    OfClients(String),
    /// One header for both.
    #[error("`user_header` and `groups_header` must differ")]
    Same,
    /// Nobody could do anything.
    #[error("without `groups_header`, `roles` must list the users and their roles")]
    NoRoles,
    /// The separator of groups.
    #[error("`separator` must be a printable ASCII character other than a letter or a digit")]
    Separator,
    /// Where people sign out.
    #[error(
        "`sign_out` must be a path that begins with `/`, or an address that begins with https://"
    )]
    SignOut,
}

/// How people sign in by a proxy. Cheap to clone.
#[derive(Debug, Clone)]
pub struct SignInProxy(Arc<Inner>);

#[derive(Debug)]
struct Inner {
    options: ProxyOptions,
    user: HeaderName,
    groups: Option<HeaderName>,
}

impl SignInProxy {
    /// The way to sign in that the options describe.
    ///
    /// # Errors
    /// [`BadProxy`].
    pub fn new(options: ProxyOptions) -> Result<Self, BadProxy> {
        let user = header(&options.user_header)?;
        let groups = options.groups_header.as_deref().map(header).transpose()?;
        if groups.as_ref() == Some(&user) {
            return Err(BadProxy::Same);
        }
        if groups.is_none() && options.roles.is_empty() {
            return Err(BadProxy::NoRoles);
        }
        let is_separator = |c: char| c == ' ' || c.is_ascii_punctuation();
        if !is_separator(options.separator) {
            return Err(BadProxy::Separator);
        }
        if !options.sign_out.as_deref().is_none_or(is_place) {
            return Err(BadProxy::SignOut);
        }
        Ok(Self(Arc::new(Inner {
            options,
            user,
            groups,
        })))
    }

    pub fn options(&self) -> &ProxyOptions {
        &self.0.options
    }

    /// Whom the headers of a proxy name; `None` if they name nobody.
    ///
    /// # Errors
    /// [`AccessError::ProxyRefused`] if they name several people.
    pub(crate) fn open(&self, headers: &HeaderMap) -> Result<Option<Holder>, AccessError> {
        let options = &self.0.options;
        let Some(user) = one(headers, &self.0.user)? else {
            return Ok(None);
        };
        let user = user.as_bytes().trim_ascii();
        if user.is_empty() || user == NOTHING {
            return Ok(None);
        }
        // A proxy may have joined two headers.
        if user.contains(&b',') {
            return Err(refused("names more than one user"));
        }
        let words = match &self.0.groups {
            None => Some(user),
            Some(groups) => one(headers, groups)?.map(HeaderValue::as_bytes),
        };
        let words = str::from_utf8(words.unwrap_or_default());
        let words = words.map_err(|_| refused("sends names that are not in UTF-8"))?;
        let words: Vec<_> = match &self.0.groups {
            None => vec![words],
            Some(_) => words.split(options.separator).map(str::trim).collect(),
        };
        let scopes = scopes_of(&options.roles, &words);
        Ok(Some(Holder {
            name: name_by(PROXY_PREFIX, user),
            scopes,
        }))
    }
}

/// What the groups of somebody permit, by a table of the role of each. If it is empty, they are the names of roles.
fn scopes_of(roles: &BTreeMap<String, Role>, groups: &[&str]) -> BTreeSet<Scope> {
    let role = |group: &&str| match roles.is_empty() {
        true => group.parse().ok(),
        false => roles.get(*group).copied(),
    };
    let roles = groups.iter().filter_map(role);
    roles.flat_map(Role::scopes).copied().collect()
}

/// The only value of a header, if there is one.
fn one<'a>(
    headers: &'a HeaderMap,
    name: &HeaderName,
) -> Result<Option<&'a HeaderValue>, AccessError> {
    let mut values = headers.get_all(name).iter();
    match (values.next(), values.next()) {
        (value, None) => Ok(value),
        _ => Err(refused("sends a header twice that names the user")),
    }
}

fn refused(why: &'static str) -> AccessError {
    AccessError::ProxyRefused { why }
}

fn header(name: &str) -> Result<HeaderName, BadProxy> {
    let is_plain = |byte: u8| byte.is_ascii_alphanumeric() || byte == b'-';
    let wrong = || BadProxy::Name(name.to_owned());
    if !name.bytes().all(is_plain) {
        return Err(wrong());
    }
    let header = HeaderName::from_bytes(name.as_bytes()).map_err(|_| wrong())?;
    match OF_CLIENTS.contains(&header.as_str()) {
        true => Err(BadProxy::OfClients(name.to_owned())),
        false => Ok(header),
    }
}

/// Whether a page may go there: a path of this server, or an address with TLS.
fn is_place(text: &str) -> bool {
    let is_plain = text.bytes().all(|byte| byte.is_ascii_graphic()) && !text.contains('\\');
    let is_path = text.starts_with('/') && !text.starts_with("//");
    let is_address = text.strip_prefix("https://").is_some_and(|rest| {
        let host = rest.split(['/', '?', '#']).next().unwrap_or_default();
        Origins::parse(&[format!("https://{host}")]).is_ok()
    });
    is_plain && (is_path || is_address)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn options() -> ProxyOptions {
        ProxyOptions {
            user_header: "X-Remote-User".to_owned(),
            groups_header: Some("X-Remote-Groups".to_owned()),
            separator: ',',
            roles: [
                ("readers".to_owned(), Role::Editor),
                ("guests".to_owned(), Role::Viewer),
            ]
            .into(),
            sign_out: None,
            socket: None,
        }
    }

    fn named(headers: &[(&str, &str)]) -> Result<Option<Holder>, AccessError> {
        let mut map = HeaderMap::new();
        for (name, value) in headers {
            let name = HeaderName::from_bytes(name.as_bytes()).unwrap();
            map.append(name, HeaderValue::from_bytes(value.as_bytes()).unwrap());
        }
        let proxy = SignInProxy::new(options()).unwrap();
        proxy.open(&map)
    }

    fn user(name: &str) -> Result<Option<Holder>, AccessError> {
        named(&[("x-remote-user", name), ("x-remote-groups", "guests")])
    }

    #[test]
    fn groups_have_roles() {
        let found = named(&[
            ("X-REMOTE-USER", " ana "),
            ("x-remote-groups", "staff, readers,,"),
        ]);
        let found = found.unwrap().unwrap();
        assert_eq!(&*found.name, "proxy:ana");
        assert_eq!(
            found.scopes,
            [Scope::Read, Scope::Write, Scope::Results].into()
        );
        for groups in ["admin", "", "Readers", "readers guests"] {
            let found = named(&[("x-remote-user", "ana"), ("x-remote-groups", groups)]);
            assert!(found.unwrap().unwrap().scopes.is_empty(), "{groups}");
        }
        let found = named(&[("x-remote-user", "ana")]).unwrap().unwrap();
        assert!(found.scopes.is_empty());
    }

    #[test]
    fn without_a_table_groups_are_names_of_roles_and_add_up() {
        let of = |groups: &[&str]| scopes_of(&BTreeMap::new(), groups);
        assert_eq!(
            of(&["viewer", "pacs", "surgeon"]),
            [Scope::Read, Scope::DicomStore].into()
        );
        assert!(of(&["Admin", ""]).is_empty());
    }

    #[test]
    fn nobody_is_named_by_an_empty_header_or_by_another_one() {
        for name in ["", " ", "(null)"] {
            assert!(user(name).unwrap().is_none(), "{name:?}");
        }
        for header in [
            "x_remote_user",
            "x-remote-users",
            "remote-user",
            "x-remote--user",
        ] {
            let found = named(&[(header, "ana"), ("x-remote-groups", "readers")]);
            assert!(found.unwrap().is_none(), "{header}");
        }
    }

    #[test]
    fn what_names_two_is_refused() {
        let twice = |name, value| {
            let all = [
                ("x-remote-user", "ana"),
                ("x-remote-groups", "guests"),
                (name, value),
            ];
            named(&all).is_err()
        };
        assert!(twice("X-Remote-User", "eve") && twice("x-remote-user", "ana"));
        assert!(twice("x-remote-user", "") && twice("x-remote-groups", "readers"));
        assert!(user("ana, eve").is_err() && user("ana,").is_err());
    }

    #[test]
    fn what_is_no_plain_word_is_known_by_its_digest() {
        for name in ["Ana Silva", "Ána", &"a".repeat(129)] {
            let found = user(name).unwrap().unwrap().name;
            assert!(
                found.starts_with(PROXY_PREFIX) && found.len() == PROXY_PREFIX.len() + 32,
                "{found}"
            );
        }
    }

    #[test]
    fn users_have_roles_where_there_are_no_groups() {
        let of_users = ProxyOptions {
            groups_header: None,
            ..options()
        };
        let proxy = SignInProxy::new(of_users.clone()).unwrap();
        let mut headers = HeaderMap::new();
        headers.insert("x-remote-user", HeaderValue::from_static("guests"));
        headers.insert("x-remote-groups", HeaderValue::from_static("readers"));
        let found = proxy.open(&headers).unwrap().unwrap();
        assert_eq!(found.scopes, [Scope::Read].into());
        let nobody = ProxyOptions {
            roles: BTreeMap::new(),
            ..of_users
        };
        assert_eq!(SignInProxy::new(nobody).unwrap_err(), BadProxy::NoRoles);
    }

    #[test]
    fn headers_and_places_that_are_not_safe_are_refused() {
        let with = |change: fn(&mut ProxyOptions)| {
            let mut changed = options();
            change(&mut changed);
            SignInProxy::new(changed).err()
        };
        assert_eq!(with(|_| {}), None);
        let wrong = with(|all| all.user_header = "X_Remote_User".to_owned());
        assert!(matches!(wrong, Some(BadProxy::Name(_))));
        let wrong = with(|all| all.user_header = String::new());
        assert!(matches!(wrong, Some(BadProxy::Name(_))));
        let wrong = with(|all| all.user_header = "Authorization".to_owned());
        assert!(matches!(wrong, Some(BadProxy::OfClients(_))));
        let wrong = with(|all| all.groups_header = Some("x-remote-USER".to_owned()));
        assert_eq!(wrong, Some(BadProxy::Same));
        let wrong = with(|all| all.separator = 'a');
        assert_eq!(wrong, Some(BadProxy::Separator));
        for place in ["/oauth2/sign_out?rd=%2F", "https://id.example/out"] {
            assert!(is_place(place), "{place}");
        }
        for place in [
            "",
            "out",
            "//evil.example",
            "/\\evil.example",
            "javascript:alert(1)",
            "http://id.example/",
            "https://",
            "https://a@evil.example/",
            "/a b",
        ] {
            assert!(!is_place(place), "{place}");
        }
    }
}
