//! Tokens of an issuer of OpenID Connect: whom they name, what they open, and until when.

mod discovery;
mod keys;
mod roles;

use std::collections::BTreeMap;
use std::sync::{Arc, PoisonError, RwLock};
use std::time::{Duration, Instant, SystemTime};

use axum::http::Uri;
use jsonwebtoken::errors::ErrorKind;
use jsonwebtoken::{Validation, decode_header};
use serde::Serialize;
use serde_json::Value;
use utoipa::ToSchema;

use self::discovery::{Known, is_safe, read};
use self::keys::{Claims, Key};
use crate::client::{HttpClient, http_client};
use crate::problem::AppError;
use crate::tokens::{Holder, name_by};

pub use self::roles::RoleRules;
pub(crate) use self::roles::scopes_of;

/// How much the clocks of the issuer and of this machine may differ.
const LEEWAY: Duration = Duration::from_secs(30);

/// The age at which keys are read again.
const FRESH: Duration = Duration::from_secs(15 * 60);

/// The age at which keys are not used any longer, if they cannot be read again.
const LONGEST: Duration = Duration::from_secs(24 * 3600);

/// The least time between two requests to the issuer.
const PAUSE: Duration = Duration::from_secs(10);

/// What the names of those who sign in begin with, so that none is the name of a token.
const PREFIX: &str = "oidc:";

/// The issuer, and which of its tokens are accepted.
#[derive(Debug, Clone)]
pub struct IssuerOptions {
    /// Its address, as it is in its tokens.
    pub issuer: String,
    /// What its tokens must be for.
    pub audience: String,
    /// How roles are read from a token.
    pub roles: RoleRules,
    /// What the page signs in as; without one, it does not.
    pub client_id: Option<String>,
    /// What the page asks for.
    pub scope: String,
    /// What else the page sends to the issuer.
    pub parameters: BTreeMap<String, String>,
}

/// Why an issuer cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum BadIssuer {
    /// Its address.
    #[error(
        "`issuer` must be an address that begins with https://, without a query, as it is in the tokens"
    )]
    Address,
    /// The audience.
    #[error("`{0}` must not be empty")]
    Empty(&'static str),
    /// A parameter that the page sets.
    #[error("`parameters` must not set `{0}`, which the page sets")]
    Parameter(String),
    /// The system has no certificates of authorities.
    #[error("the certificates of authorities on this system cannot be read: {0}")]
    Roots(std::io::Error),
}

/// Somebody who has signed in at the issuer.
#[derive(Debug, Clone)]
pub(crate) struct SignedIn {
    pub(crate) holder: Holder,
    /// When the token ends.
    pub(crate) ends: SystemTime,
}

/// Where and how the page signs in.
#[derive(Debug, Default, Serialize, ToSchema)]
pub struct SignIn {
    /// The issuer; none if the server knows none, or the page may not sign in by it.
    #[serde(skip_serializing_if = "Option::is_none")]
    issuer: Option<String>,
    /// What the page is at the issuer.
    #[serde(skip_serializing_if = "Option::is_none")]
    client_id: Option<String>,
    /// Where people sign in.
    #[serde(skip_serializing_if = "Option::is_none")]
    authorization_endpoint: Option<String>,
    /// Where the page gets its tokens.
    #[serde(skip_serializing_if = "Option::is_none")]
    token_endpoint: Option<String>,
    /// Where people sign out.
    #[serde(skip_serializing_if = "Option::is_none")]
    end_session_endpoint: Option<String>,
    /// Where the page gives its tokens back.
    #[serde(skip_serializing_if = "Option::is_none")]
    revocation_endpoint: Option<String>,
    /// Whether the request came by a proxy that signs people in.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    by_proxy: bool,
    /// What the page asks for.
    scope: String,
    /// What else the page sends to the issuer.
    parameters: BTreeMap<String, String>,
    /// Whether the issuer names itself when it sends somebody back (RFC 9207).
    names_itself: bool,
}

impl SignIn {
    /// The same, and whether a proxy signs people in.
    #[must_use]
    pub fn by_proxy(self, by_proxy: bool) -> Self {
        Self { by_proxy, ..self }
    }
}

/// An issuer. Cheap to clone: all clones share its keys.
#[derive(Debug, Clone)]
pub struct Issuer(Arc<Inner>);

#[derive(Debug)]
struct Inner {
    options: IssuerOptions,
    client: HttpClient,
    rules: Validation,
    /// Held only briefly.
    known: RwLock<Option<Arc<Known>>>,
    /// The last time that the issuer was asked in vain, and why. Who asks holds it.
    in_vain: tokio::sync::Mutex<Option<(Instant, InVain)>>,
}

/// Why it was in vain to ask the issuer.
#[derive(Debug, Clone, Copy)]
enum InVain {
    /// It did not answer as it must.
    Away,
    /// It does not have the key that a token names.
    NoSuchKey,
}

/// The parameters that the page sets.
const OF_THE_PAGE: [&str; 13] = [
    "client_id",
    "code",
    "code_challenge",
    "code_challenge_method",
    "code_verifier",
    "grant_type",
    "nonce",
    "redirect_uri",
    "refresh_token",
    "response_mode",
    "response_type",
    "scope",
    "state",
];

impl Issuer {
    /// An issuer, of which nothing is asked before its first token comes.
    ///
    /// # Errors
    /// [`BadIssuer`].
    pub fn new(options: IssuerOptions) -> Result<Self, BadIssuer> {
        if !is_safe(&options.issuer) || options.issuer.contains(['?', '#']) {
            return Err(BadIssuer::Address);
        }
        let needed = [
            ("audience", options.audience.as_str()),
            ("roles_claim", &options.roles.claim),
            ("client_id", options.client_id.as_deref().unwrap_or("-")),
        ];
        if let Some((key, _)) = needed.into_iter().find(|(_, value)| value.is_empty()) {
            return Err(BadIssuer::Empty(key));
        }
        let mut further = options.parameters.keys();
        if let Some(key) = further.find(|key| OF_THE_PAGE.contains(&key.as_str())) {
            return Err(BadIssuer::Parameter(key.clone()));
        }
        let mut rules = Validation::default();
        rules.set_required_spec_claims(&["exp", "iss", "aud", "sub"]);
        rules.set_audience(&[&options.audience]);
        rules.set_issuer(&[&options.issuer]);
        rules.leeway = LEEWAY.as_secs();
        rules.validate_nbf = true;
        Ok(Self(Arc::new(Inner {
            options,
            client: http_client().map_err(BadIssuer::Roots)?,
            rules,
            known: RwLock::default(),
            in_vain: tokio::sync::Mutex::default(),
        })))
    }

    /// The configuration.
    pub fn options(&self) -> &IssuerOptions {
        &self.0.options
    }

    /// Scheme, host and port of the issuer, which the page asks for its tokens.
    pub fn origin(&self) -> String {
        origin_of(&self.0.options.issuer).unwrap_or_default()
    }

    /// Who has signed in with a token.
    ///
    /// # Errors
    /// [`AppError::TokenRefused`], [`AppError::SignInEnded`], [`AppError::IssuerAway`].
    pub(crate) async fn open(&self, token: &str) -> Result<SignedIn, AppError> {
        // What has no algorithm of a signature, such as `none`, is no header.
        let header = decode_header(token).map_err(|_| wrong("it cannot be read"))?;
        // A token for something else may be signed by the same key, such as one that ends a session (`logout+jwt`).
        let kind = header.typ.as_deref().unwrap_or("JWT");
        let kind = kind.to_ascii_lowercase();
        let kind = kind.strip_prefix("application/").unwrap_or(&kind);
        // Nor is any extension known that must be understood (RFC 7515 §4.1.11).
        if !["jwt", "at+jwt"].contains(&kind) || header.crit.is_some() {
            return Err(wrong("it is of a kind that is not accepted"));
        }
        let id = header.kid.as_deref();
        let known = self.known().await?;
        let known = match known.names(id) {
            true => known,
            // The issuer may have a new key.
            false => self.asked_again(Some(known.read), id).await?,
        };
        let named: Vec<&Key> = known.keys.iter().filter(|key| key.is_named(id)).collect();
        let mut why = wrong("it is signed by a key that the issuer does not have");
        for key in named {
            match key.open(token, header.alg, &self.0.rules) {
                Ok(claims) => return self.signed_in(&claims),
                Err(kind) => why = refusal(&kind),
            }
            if !matches!(
                why,
                AppError::TokenRefused {
                    is_signed: false,
                    ..
                }
            ) {
                break;
            }
        }
        Err(why)
    }

    fn signed_in(&self, claims: &Claims) -> Result<SignedIn, AppError> {
        let subject = claims.get("sub").and_then(Value::as_str).unwrap_or("");
        // A list of issuers is no name.
        let is_ours = claims.get("iss").and_then(Value::as_str) == Some(&self.0.options.issuer);
        if subject.is_empty() || !is_ours {
            return Err(refused("it does not say who it is from"));
        }
        let ends = claims.get("exp").and_then(Value::as_f64).unwrap_or(0.0);
        let ends = Duration::try_from_secs_f64(ends).ok();
        let ends = ends.and_then(|ends| SystemTime::UNIX_EPOCH.checked_add(ends + LEEWAY));
        Ok(SignedIn {
            holder: Holder {
                name: name_by(PREFIX, subject.as_bytes()),
                scopes: self.0.options.roles.scopes(claims),
            },
            ends: ends.ok_or(refused("its end (`exp`) is too far away"))?,
        })
    }

    /// What is known of the issuer. It is asked if that is nothing, or too old; if it is only not fresh, nobody waits.
    async fn known(&self) -> Result<Arc<Known>, AppError> {
        let Some(known) = self.remembered() else {
            return self.asked_again(None, None).await;
        };
        let age = known.read.elapsed();
        if age > LONGEST {
            return self.asked_again(Some(known.read), None).await;
        }
        // While somebody asks, nobody else need.
        if age > FRESH && self.0.in_vain.try_lock().is_ok() {
            let (issuer, seen) = (self.clone(), known.read);
            tokio::spawn(async move { issuer.asked_again(Some(seen), None).await });
        }
        Ok(known)
    }

    fn remembered(&self) -> Option<Arc<Known>> {
        let known = self.0.known.read().unwrap_or_else(PoisonError::into_inner);
        known.clone()
    }

    /// Asks the issuer for its keys, unless somebody has done so since `seen`, or in vain a moment ago: strangers may name keys that
    /// nobody has.
    async fn asked_again(
        &self,
        seen: Option<Instant>,
        id: Option<&str>,
    ) -> Result<Arc<Known>, AppError> {
        let mut in_vain = self.0.in_vain.lock().await;
        let is_newer = |known: &Arc<Known>| seen.is_none_or(|seen| known.read > seen);
        if let Some(known) = self.remembered().filter(is_newer) {
            return Ok(known);
        }
        if let Some((at, why)) = *in_vain
            && at.elapsed() < PAUSE
        {
            return match (why, self.remembered()) {
                (InVain::NoSuchKey, Some(known)) => Ok(known),
                _ => Err(AppError::IssuerAway),
            };
        }
        let issuer = &self.0.options.issuer;
        match read(&self.0.client, issuer).await {
            Ok(known) => {
                let known = Arc::new(known);
                let is_in_vain = !known.names(id);
                *in_vain = is_in_vain.then(|| (Instant::now(), InVain::NoSuchKey));
                let mut remembered = self.0.known.write().unwrap_or_else(PoisonError::into_inner);
                *remembered = Some(Arc::clone(&known));
                Ok(known)
            }
            Err(why) => {
                tracing::warn!(issuer, %why, "the issuer of tokens cannot be asked for its keys");
                *in_vain = Some((Instant::now(), InVain::Away));
                Err(AppError::IssuerAway)
            }
        }
    }

    /// Where and how the page signs in.
    ///
    /// # Errors
    /// [`AppError::IssuerAway`].
    pub async fn sign_in(&self) -> Result<SignIn, AppError> {
        let options = self.options();
        if options.client_id.is_none() {
            return Ok(SignIn::default());
        }
        let known = self.known().await?;
        let endpoints = &known.endpoints;
        let (Some(authorization), Some(token)) =
            (&endpoints.authorization_endpoint, &endpoints.token_endpoint)
        else {
            return Ok(SignIn::default());
        };
        // The page may ask this one alone.
        let own = |address: &Option<String>| {
            let address = address.as_ref();
            let address = address.filter(|it| origin_of(it) == Some(self.origin()));
            address.cloned()
        };
        let Some(token) = own(&Some(token.clone())) else {
            let issuer = &options.issuer;
            tracing::warn!(
                issuer,
                "the page cannot sign in: the issuer gives out tokens at another host"
            );
            return Ok(SignIn::default());
        };
        Ok(SignIn {
            issuer: Some(options.issuer.clone()),
            client_id: options.client_id.clone(),
            authorization_endpoint: Some(authorization.clone()),
            token_endpoint: Some(token),
            end_session_endpoint: endpoints.end_session_endpoint.clone(),
            revocation_endpoint: own(&endpoints.revocation_endpoint),
            by_proxy: false,
            scope: options.scope.clone(),
            parameters: options.parameters.clone(),
            names_itself: endpoints.authorization_response_iss_parameter_supported,
        })
    }
}

/// Whether bytes may be a token of an issuer: three parts with points between them. Its text, if so.
pub(crate) fn as_token(given: &[u8]) -> Option<&str> {
    let text = std::str::from_utf8(given).ok()?;
    (text.matches('.').count() == 2).then_some(text)
}

fn origin_of(address: &str) -> Option<String> {
    let uri: Uri = address.parse().ok()?;
    Some(format!("{}://{}", uri.scheme_str()?, uri.authority()?))
}

/// A token that the issuer has not signed.
fn wrong(why: &'static str) -> AppError {
    AppError::TokenRefused {
        why,
        is_signed: false,
    }
}

/// A token that the issuer has signed, but not for this.
fn refused(why: &'static str) -> AppError {
    AppError::TokenRefused {
        why,
        is_signed: true,
    }
}

fn refusal(kind: &ErrorKind) -> AppError {
    match kind {
        ErrorKind::ExpiredSignature => AppError::SignInEnded,
        ErrorKind::ImmatureSignature => refused("it is not valid yet (`nbf`)"),
        ErrorKind::InvalidIssuer => refused("it is of another issuer (`iss`)"),
        ErrorKind::InvalidAudience => refused("it is for another service (`aud`)"),
        ErrorKind::MissingRequiredClaim(_) | ErrorKind::InvalidClaimFormat(_) => refused(
            "it lacks one of the claims `iss`, `sub`, `aud` and `exp`, or a claim has a wrong form",
        ),
        ErrorKind::InvalidAlgorithm => wrong("its algorithm is not that of the key"),
        ErrorKind::InvalidSignature => wrong("its signature is wrong"),
        _ => wrong("it cannot be read"),
    }
}
