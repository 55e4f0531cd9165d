//! Objects in a bucket of an S3-compatible store.
//!
//! The usual `AWS_…` variables configure it. The credentials come from a file (`AWS_SHARED_CREDENTIALS_FILE`) or from the
//! machine, never from variables. Conditional writes are not needed, because objects are named by their contents.

use std::collections::HashMap;
use std::ffi::OsString;
use std::sync::Arc;
use std::time::Duration;

use async_trait::async_trait;
use bytes::Bytes;
use futures_util::stream::{self, StreamExt as _};
use http_body_util::{BodyExt as _, StreamBody};
use hyper::body::{Frame, Incoming};
use hyper_rustls::HttpsConnector;
use hyper_util::client::legacy::{self, connect};
use hyper_util::rt::{TokioExecutor, TokioTimer};
use object_store::aws::{AmazonS3Builder, AmazonS3ConfigKey};
use object_store::client::{
    ClientConfigKey, HttpClient, HttpConnector, HttpError, HttpErrorKind, HttpRequest,
    HttpRequestBody, HttpResponse, HttpResponseBody, HttpService,
};
use object_store::prefix::PrefixStore;
use object_store::{ClientOptions, RetryConfig};

use super::error::BUCKET;
use super::{ObjectError, Objects};

/// How long to repeat a failed request: shorter than a client waits for an answer.
const RETRY_FOR: Duration = Duration::from_secs(15);

/// How long to wait for the next bytes of an answer.
const SILENCE: Duration = Duration::from_secs(30);

/// How long to keep unused connections.
const IDLE: Duration = Duration::from_secs(30);

impl Objects {
    /// Objects in a bucket, below a prefix (which may be empty). The `AWS_…` variables name its address and the file of its
    /// credentials.
    ///
    /// # Errors
    /// If these variables are invalid.
    pub(crate) fn in_bucket(bucket: &str, prefix: &str) -> Result<Self, ObjectError> {
        let as_text = |(name, value): (OsString, OsString)| {
            Some((name.into_string().ok()?, value.into_string().ok()?))
        };
        Self::in_bucket_with(
            bucket,
            prefix,
            &std::env::vars_os().filter_map(as_text).collect(),
        )
    }

    /// As [`Objects::in_bucket`], with the given variables.
    ///
    /// # Errors
    /// If they are invalid.
    pub(crate) fn in_bucket_with(
        bucket: &str,
        prefix: &str,
        variables: &HashMap<String, String>,
    ) -> Result<Self, ObjectError> {
        let mut builder = AmazonS3Builder::new();
        for (name, value) in variables {
            if name.starts_with("AWS_")
                && let Ok(key) = name.to_ascii_lowercase().parse()
            {
                builder = builder.with_config(key, value);
            }
        }
        builder = builder.with_bucket_name(bucket);
        if let Some([key, secret, token]) = shared_credentials(variables)? {
            builder = builder
                .with_access_key_id(key)
                .with_secret_access_key(secret);
            if !token.is_empty() {
                builder = builder.with_token(token);
            }
        }
        let is = |key| builder.get_config_value(&key).unwrap_or_default();
        let named = [AmazonS3ConfigKey::S3Endpoint, AmazonS3ConfigKey::Endpoint].map(is);
        // An endpoint without TLS is intended.
        let without_tls = named.iter().any(|endpoint| endpoint.starts_with("http://"));
        let retry = RetryConfig {
            retry_timeout: RETRY_FOR,
            ..RetryConfig::default()
        };
        let files = builder
            .with_allow_http(without_tls)
            .with_retry(retry)
            .with_http_connector(Connector)
            .build()?;
        Ok(match prefix.trim_matches('/') {
            "" => Self::new(Arc::new(files)),
            prefix => Self::new(Arc::new(PrefixStore::new(files, prefix))),
        })
    }
}

/// Key, secret and token from the file `AWS_SHARED_CREDENTIALS_FILE`, if there is one.
fn shared_credentials(
    variables: &HashMap<String, String>,
) -> Result<Option<[String; 3]>, ObjectError> {
    let Some(file) = variables.get("AWS_SHARED_CREDENTIALS_FILE") else {
        return Ok(None);
    };
    let profile = variables
        .get("AWS_PROFILE")
        .map_or("default", String::as_str);
    let text = std::fs::read_to_string(file)?;
    let credentials = profile_of(&text, profile);
    credentials.map(Some).ok_or_else(|| {
        ObjectError::Store(
            "the credentials file has no key and secret for the profile; set AWS_PROFILE".into(),
        )
    })
}

/// Key, secret and token (or nothing) of a profile.
fn profile_of(text: &str, profile: &str) -> Option<[String; 3]> {
    let header = format!("[{profile}]");
    let lines = text
        .lines()
        .map(str::trim)
        .skip_while(|line| *line != header);
    let settings: Vec<_> = lines
        .skip(1)
        .take_while(|line| !line.starts_with('['))
        .filter_map(|line| line.split_once('='))
        .collect();
    let value = |name| {
        let found = settings.iter().find(|(key, _)| key.trim() == name);
        found.map(|(_, value)| value.trim().to_owned())
    };
    Some([
        value("aws_access_key_id")?,
        value("aws_secret_access_key")?,
        value("aws_session_token").unwrap_or_default(),
    ])
}

/// Makes clients that speak HTTP/1 and TLS by rustls, with the roots that the system trusts.
#[derive(Debug)]
struct Connector;

impl HttpConnector for Connector {
    fn connect(&self, options: &ClientOptions) -> object_store::Result<HttpClient> {
        let without_roots = |error| object_store::Error::Generic {
            store: BUCKET,
            source: Box::new(error),
        };
        let builder = hyper_rustls::HttpsConnectorBuilder::new()
            .with_native_roots()
            .map_err(without_roots)?;
        let allow_http = options.get_config_value(&ClientConfigKey::AllowHttp);
        let builder = match allow_http.as_deref() {
            Some("true") => builder.https_or_http(),
            _ => builder.https_only(),
        };
        let client = legacy::Client::builder(TokioExecutor::new())
            .pool_timer(TokioTimer::new())
            .pool_idle_timeout(IDLE)
            .build(builder.enable_http1().build());
        Ok(HttpClient::new(Client(client)))
    }
}

#[derive(Debug)]
struct Client(legacy::Client<HttpsConnector<connect::HttpConnector>, HttpRequestBody>);

#[async_trait]
impl HttpService for Client {
    async fn call(&self, request: HttpRequest) -> Result<HttpResponse, HttpError> {
        let answer = tokio::time::timeout(2 * SILENCE, self.0.request(request));
        let answer = answer.await.map_err(silent)?.map_err(|error| {
            let kind = match error.is_connect() {
                true => HttpErrorKind::Connect,
                false => HttpErrorKind::Interrupted,
            };
            HttpError::new(kind, error)
        })?;
        Ok(answer.map(|body| HttpResponseBody::new(StreamBody::new(frames(body)))))
    }
}

/// The frames of a body, none of which may take too long.
fn frames(
    body: Incoming,
) -> impl futures_util::Stream<Item = Result<Frame<Bytes>, HttpError>> + Send + Sync {
    stream::unfold(Some(body), |body| async {
        let mut body = body?;
        match tokio::time::timeout(SILENCE, body.frame()).await {
            Ok(None) => None,
            Ok(Some(Ok(frame))) => Some((Ok(frame), Some(body))),
            Ok(Some(Err(error))) => {
                let error = HttpError::new(HttpErrorKind::Interrupted, error);
                Some((Err(error), None))
            }
            Err(elapsed) => Some((Err(silent(elapsed)), None)),
        }
    })
    .fuse()
}

fn silent(elapsed: tokio::time::error::Elapsed) -> HttpError {
    HttpError::new(HttpErrorKind::Timeout, elapsed)
}

#[cfg(test)]
mod tests {
    use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};

    use case::PublicError as _;

    use crate::StoreError;

    use super::*;

    /// The error of a request that a bucket answers with the status 403 and a code.
    async fn refused_with(code: &str) -> StoreError {
        let bucket = tokio::net::TcpListener::bind("127.0.0.1:0").await.unwrap();
        let address = bucket.local_addr().unwrap();
        let refuse = async {
            let reason = format!("<Error><Code>{code}</Code><RequestId>7</RequestId></Error>");
            let length = reason.len();
            let head =
                "HTTP/1.1 403 Forbidden\r\nconnection: close\r\ncontent-type: application/xml";
            let answer = format!("{head}\r\ncontent-length: {length}\r\n\r\n{reason}");
            let (mut asked, _) = bucket.accept().await.unwrap();
            let _request = asked.read(&mut [0; 4096]).await.unwrap();
            asked.write_all(answer.as_bytes()).await.unwrap();
        };
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(
            &file,
            "[default]\naws_access_key_id=A\naws_secret_access_key=B\n",
        )
        .unwrap();
        let credentials = file.path().to_str().unwrap().to_owned();
        let variables = [
            ("AWS_ENDPOINT_URL", format!("http://{address}")),
            ("AWS_SHARED_CREDENTIALS_FILE", credentials),
        ];
        let variables = variables.map(|(name, value)| (name.to_owned(), value));
        let objects = Objects::in_bucket_with("heads", "", &variables.into()).unwrap();
        let (checked, ()) = tokio::join!(objects.label(), refuse);
        checked.unwrap_err().into()
    }

    #[tokio::test]
    async fn a_bucket_that_refuses_our_clock_or_our_signature_is_told_from_one_that_is_away() {
        let clock = refused_with("RequestTimeTooSkewed").await;
        assert!(matches!(clock, StoreError::ClocksDiffer(_)), "{clock:?}");
        assert!(clock.is_away(), "a clock is often set a little later");
        for code in [
            "SignatureDoesNotMatch",
            "InvalidAccessKeyId",
            "AccessDenied",
        ] {
            let denied = refused_with(code).await;
            assert!(matches!(denied, StoreError::AccessDenied(_)), "{denied:?}");
            assert!(!denied.is_away());
            assert_eq!(denied.cause(), code);
            let sentence = denied.sentence();
            assert!(
                sentence.contains("check the key and the secret"),
                "{sentence}"
            );
            assert!(!sentence.contains("heads"), "{sentence}");
        }
    }

    #[test]
    fn credentials_are_those_of_the_profile() {
        let file = "# ours\n[default]\naws_access_key_id = A\naws_secret_access_key=B=\n\n\
                    [other]\naws_access_key_id=C\naws_secret_access_key = D\naws_session_token = E\n";
        let of = |profile| profile_of(file, profile);
        let expected = |three: [&str; 3]| Some(three.map(ToOwned::to_owned));
        assert_eq!(of("default"), expected(["A", "B=", ""]));
        assert_eq!(of("other"), expected(["C", "D", "E"]));
        assert_eq!(of("none"), None);
    }

    #[test]
    fn a_file_of_credentials_without_the_profile_is_an_error() {
        let directory = tempfile::tempdir().unwrap();
        let file = directory.path().join("credentials");
        std::fs::write(
            &file,
            "[a]\naws_access_key_id=KEY\naws_secret_access_key=SECRET\n",
        )
        .unwrap();
        let path = file.to_str().unwrap();
        let nowhere = directory.path().join("nowhere");
        let named = ("AWS_SHARED_CREDENTIALS_FILE", path);
        let of = |variables: &[(&str, &str)]| {
            let owned = |&(name, value): &(&str, &str)| (name.to_owned(), value.to_owned());
            shared_credentials(&variables.iter().map(owned).collect())
        };
        assert_eq!(of(&[]).unwrap(), None);
        let found = of(&[named, ("AWS_PROFILE", "a")]).unwrap();
        assert_eq!(found.unwrap(), ["KEY", "SECRET", ""]);
        let other = of(&[named, ("AWS_PROFILE", "b")]).unwrap_err();
        let words = std::error::Error::source(&other).unwrap().to_string();
        assert!(words.contains("set AWS_PROFILE"), "{words}");
        let lost = of(&[(named.0, nowhere.to_str().unwrap())]);
        assert!(matches!(lost, Err(ObjectError::Disk(_))), "{lost:?}");
    }
}
