//! What a URL names: a server, and what is asked of it.

use super::client::Connector;
use super::failure::{BUCKET, TIMEOUT, innermost, told};
use super::pause::Pause;
use super::runtime::wait;
use crate::model::url::shown;
use crate::store::error::may_pass;
use object_store::aws::AmazonS3ConfigKey::{Client, S3Endpoint};
use object_store::aws::{AmazonS3Builder, resolve_bucket_region};
use object_store::http::HttpBuilder;
use object_store::path::Path as Key;
use object_store::{ClientConfigKey, ClientOptions, ObjectStore, RetryConfig};
use reqwest::Url;
use reqwest::header::{AUTHORIZATION, HeaderMap, HeaderValue};
use reqwest::redirect::Policy;
use std::io::{self, ErrorKind};
use std::net::IpAddr;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

/// The environment variable that lets URLs of other machines begin with `http://`.
const ALLOW_HTTP: &str = "DEEPFIELD_ALLOW_HTTP";
/// The environment variable that holds a token for servers that ask for one: the token, or a host and its token.
const TOKEN: &str = "DEEPFIELD_TOKEN";
/// How long a machine of a cloud is given to tell who it is.
const WHO_AM_I: Duration = Duration::from_secs(2);
/// The environment variables that say who asks a bucket, or that nobody does.
const KEYS: [&str; 3] = ["AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY", "AWS_SKIP_SIGNATURE"];
/// Those that name services which tell who asks, each with what it takes besides.
const SERVICES: [(&str, Option<&str>); 3] = [
    ("AWS_WEB_IDENTITY_TOKEN_FILE", Some("AWS_ROLE_ARN")),
    ("AWS_CONTAINER_CREDENTIALS_RELATIVE_URI", None),
    ("AWS_CONTAINER_CREDENTIALS_FULL_URI", Some("AWS_CONTAINER_AUTHORIZATION_TOKEN_FILE")),
];

/// A file of a store.
#[derive(Clone, Debug)]
pub(super) struct Object {
    /// The store.
    pub store: Arc<dyn ObjectStore>,
    /// Its name there.
    pub key: Key,
    /// The pause that its server asks for.
    pub pause: Pause,
}

/// What a URL names.
pub(super) struct Address {
    /// All of the URL; may hold a secret.
    pub url: String,
    /// What is shown of it.
    pub shown: String,
    /// What messages call the server.
    pub host: String,
    /// What is asked for.
    pub object: Object,
}

impl Address {
    /// What `url` names. For a bucket, a server may be asked where it is and who asks.
    ///
    /// # Errors
    /// Where the URL is wrong, or names what is not read from.
    pub fn of(url: &str) -> io::Result<Address> {
        Address::within(url, TIMEOUT)
    }

    /// The same, of a server that is given so long for an answer, and for more of it.
    pub fn within(url: &str, timeout: Duration) -> io::Result<Address> {
        // Whoever makes a client first chooses for the process, and all choose the same.
        let _ = rustls::crypto::ring::default_provider().install_default();
        let shown = shown(Path::new(url)).to_string_lossy().into_owned();
        let (host, object) = match url.get(..5).filter(|scheme| scheme.eq_ignore_ascii_case("s3://")) {
            Some(scheme) => of_bucket(&url[scheme.len()..], timeout)?,
            None => of_web(url, timeout)?,
        };
        Ok(Address { url: url.into(), shown, host, object })
    }
}

fn refused(what: impl Into<String>) -> io::Error {
    io::Error::new(ErrorKind::InvalidInput, what.into())
}

/// Requests are tried once: whoever streams pages tries again, and knows what is still wanted.
fn once() -> RetryConfig {
    RetryConfig { max_retries: 0, retry_timeout: Duration::ZERO, ..RetryConfig::default() }
}

/// Whether an environment variable is set to anything but nothing.
fn is_set(variable: &str) -> bool {
    std::env::var_os(variable).is_some_and(|value| !value.is_empty())
}

/// A file on a server of the web.
fn of_web(url: &str, timeout: Duration) -> io::Result<(String, Object)> {
    let parsed = Url::parse(url).map_err(|error| refused(format!("URL: {error}")))?;
    let host = parsed.host_str().ok_or_else(|| refused("URL: found no host"))?.to_owned();
    if !parsed.username().is_empty() || parsed.password().is_some() {
        return Err(refused(format!("URL: found a user before the host, expected none: {TOKEN} takes a token")));
    }
    check_encrypted("URL", &parsed)?;
    let mut client = client(is_plain(&parsed), is_here(&parsed), timeout);
    // A bucket refuses whoever shows a token beside a signature.
    let is_signed = parsed.query().is_some_and(|query| query.contains("X-Amz-Signature="));
    let may_see = !is_signed && (!is_plain(&parsed) || is_here(&parsed));
    if let Some(token) = token_for(&host)?.filter(|_| may_see) {
        client = client.default_headers(HeaderMap::from_iter([(AUTHORIZATION, token)]));
    }
    let pause = Pause::of(parsed.authority());
    let connector = Connector { client: Some(built(&host, client)?), pause: pause.clone() };
    let store = HttpBuilder::new().with_url(parsed.as_str()).with_retry(once()).with_http_connector(connector);
    let store = store.build().map_err(|error| told(&host, &error))?;
    // The URL is the file itself, its query too; nothing is added to it.
    Ok((host, Object { store: Arc::new(store), key: Key::default(), pause }))
}

/// A client of a server that is asked without TLS, or lies on this machine.
fn client(is_plain: bool, is_here: bool, timeout: Duration) -> reqwest::ClientBuilder {
    // Wherever a server sends a request on, it does not leave the machine unencrypted.
    let on = Policy::custom(|attempt| match is_let(attempt.url()) {
        true => Policy::default().redirect(attempt),
        false => attempt.stop(),
    });
    let client = reqwest::Client::builder()
        .user_agent(concat!("deepfield/", env!("CARGO_PKG_VERSION")))
        .connect_timeout(timeout)
        .read_timeout(timeout)
        .https_only(!is_plain)
        .referer(false)
        .redirect(on)
        // Pages come side by side, each by its own connection.
        .http1_only();
    // What the process's variables say of proxies holds for other machines.
    let client = if is_here { client.no_proxy() } else { client };
    match is_plain && is_here {
        // No certificate is looked at, so none of the system's have to be read.
        true => client.tls_certs_only(std::iter::empty()),
        false => client,
    }
}

fn built(host: &str, client: reqwest::ClientBuilder) -> io::Result<reqwest::Client> {
    client.build().map_err(|error| io::Error::other(format!("{host}: no client can be made: {}", innermost(&error))))
}

fn is_plain(url: &Url) -> bool {
    url.scheme() == "http"
}

fn is_here(url: &Url) -> bool {
    url.host_str().is_some_and(is_this_machine)
}

/// Whether a URL may be asked: with TLS, within this machine, or because the user says so.
fn is_let(url: &Url) -> bool {
    !is_plain(url) || is_here(url) || is_set(ALLOW_HTTP)
}

fn check_encrypted(field: &str, url: &Url) -> io::Result<()> {
    let what = format!(
        "{field}: found http, expected https: what others could read or change on its way is not asked for unless {ALLOW_HTTP}=1"
    );
    if is_let(url) { Ok(()) } else { Err(refused(what)) }
}

fn is_this_machine(host: &str) -> bool {
    let address = host.trim_start_matches('[').trim_end_matches(']').parse::<IpAddr>();
    host.eq_ignore_ascii_case("localhost") || address.is_ok_and(|address| address.is_loopback())
}

/// The token that a server is shown.
fn token_for(host: &str) -> io::Result<Option<HeaderValue>> {
    let wrong = || refused(format!("{TOKEN}: found characters that no header may have, expected a token"));
    let text = match std::env::var(TOKEN) {
        Ok(text) => text,
        Err(std::env::VarError::NotPresent) => return Ok(None),
        Err(_) => return Err(wrong()),
    };
    token_in(&text, host).map(|token| header(token).ok_or_else(wrong)).transpose()
}

/// The token that a variable holds for a host: `TOKEN`, or `HOST TOKEN` for that host alone.
fn token_in<'a>(text: &'a str, host: &str) -> Option<&'a str> {
    let token = match text.trim().split_once(char::is_whitespace) {
        Some((own, token)) => own.eq_ignore_ascii_case(host).then(|| token.trim())?,
        None => text.trim(),
    };
    Some(token).filter(|token| !token.is_empty())
}

fn header(token: &str) -> Option<HeaderValue> {
    let mut header = HeaderValue::from_str(&format!("Bearer {token}")).ok()?;
    header.set_sensitive(true);
    Some(header)
}

/// A file in a bucket: `bucket/key`, of Amazon or of the server that `AWS_ENDPOINT_URL` names.
fn of_bucket(name: &str, timeout: Duration) -> io::Result<(String, Object)> {
    // What else stood in the name of a bucket might name another server.
    let is_bucket = |name: &str| {
        !name.is_empty() && name.bytes().all(|byte| byte.is_ascii_alphanumeric() || b"-._".contains(&byte))
    };
    let (bucket, key) = name
        .split_once('/')
        .filter(|(bucket, key)| is_bucket(bucket) && !key.is_empty())
        .ok_or_else(|| refused("URL: found no file in a bucket, expected s3://BUCKET/KEY"))?;
    let host = format!("{BUCKET}{bucket}");
    let key = Key::parse(key).map_err(|error| refused(format!("URL: {error}")))?;
    let milliseconds = format!("{}ms", timeout.as_millis());
    let mut store = AmazonS3Builder::from_env()
        .with_bucket_name(bucket)
        .with_retry(once())
        .with_config(Client(ClientConfigKey::ConnectTimeout), milliseconds.as_str())
        .with_config(Client(ClientConfigKey::ReadTimeout), milliseconds.as_str())
        // A page may take as long as it comes.
        .with_config(Client(ClientConfigKey::Timeout), "1day");
    let endpoint =
        ["AWS_ENDPOINT_URL_S3", "AWS_ENDPOINT_URL", "AWS_ENDPOINT"].map(std::env::var).into_iter().find_map(Result::ok);
    let (mut is_plainly, mut own) = (false, None);
    if let Some(endpoint) = &endpoint {
        let url = endpoint_of(endpoint)?;
        check_encrypted("AWS_ENDPOINT_URL", &url)?;
        is_plainly = is_plain(&url);
        if is_plainly && is_here(&url) {
            own = Some(built(&host, client(true, true, timeout))?);
        }
        store = store.with_config(S3Endpoint, endpoint.as_str());
    }
    let pause = Pause::of(&host);
    store = store.with_allow_http(is_plainly);
    store = store.with_http_connector(Connector { client: own, pause: pause.clone() });
    if endpoint.is_none() && !is_set("AWS_REGION") && !is_set("AWS_DEFAULT_REGION") {
        let bucket = bucket.to_owned();
        let options = ClientOptions::new().with_connect_timeout(timeout).with_timeout(timeout);
        // Where that is not told, the request itself says why.
        if let Ok(region) = wait(async move { resolve_bucket_region(&bucket, &options).await })? {
            store = store.with_region(region);
        }
    }
    let build = |store: AmazonS3Builder| store.build().map_err(|error| told(&host, &error));
    let mut made = build(store.clone())?;
    if !KEYS.into_iter().any(is_set) {
        let service = SERVICES.into_iter().find(|(name, other)| is_set(name) && other.is_none_or(is_set));
        let limit = if service.is_some() { timeout } else { WHO_AM_I };
        let role = Arc::clone(made.credentials());
        let found = wait(async move { tokio::time::timeout(limit, role.get_credential()).await })?;
        match (service, found) {
            (_, Ok(Ok(_))) => {}
            // A machine of a cloud may have a role; anybody else reads what is public.
            (None, _) => made = build(store.with_skip_signature(true))?,
            (Some((name, _)), Ok(Err(error))) => {
                let error = told(&format!("{host}: the service of {name}"), &error);
                // What may pass is told by requests for the file, unless what is kept of it does.
                if !may_pass(error.kind()) {
                    return Err(error);
                }
            }
            (Some(_), Err(_)) => {}
        }
    }
    Ok((host, Object { store: Arc::new(made), key, pause }))
}

/// The server that `AWS_ENDPOINT_URL` names. What is no URL of the web would end the store's thread.
fn endpoint_of(text: &str) -> io::Result<Url> {
    let url = Url::parse(text).ok().filter(|url| matches!(url.scheme(), "http" | "https") && url.has_host());
    let wrong = "AWS_ENDPOINT_URL: found no URL of a server, expected one such as https://s3.example.org";
    url.ok_or_else(|| refused(wrong))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refusal(url: &str) -> String {
        Address::of(url).map(|_| ()).unwrap_err().to_string()
    }

    #[test]
    fn what_leaves_the_machine_is_encrypted_and_names_no_user() {
        for (url, words) in [
            ("http://data.example/a.df", "expected https"),
            ("http://127.0.0.1.example/a.df", "expected https"),
            ("https://me:word@data.example/a.df", "found a user"),
            ("https:///", "URL"),
            ("s3://bucket", "s3://BUCKET/KEY"),
            ("s3:///key", "s3://BUCKET/KEY"),
            ("s3://me@data.example#/key", "s3://BUCKET/KEY"),
        ] {
            let told = refusal(url);
            assert!(told.contains(words) && !told.contains("word@"), "{url}: {told}");
        }
        let address = Address::of("http://127.0.0.1:9/a.df?sig=1").unwrap();
        assert_eq!((address.shown.as_str(), address.host.as_str()), ("http://127.0.0.1:9/a.df", "127.0.0.1"));
        assert!(is_this_machine("[::1]") && is_this_machine("LocalHost") && !is_this_machine("10.0.0.1"));
    }

    #[test]
    fn another_server_of_buckets_is_a_url_of_the_web() {
        for text in ["", "localhost:9000", "data.example", "ftp://data.example", "s3://bucket", "http://"] {
            assert!(endpoint_of(text).is_err(), "{text}");
        }
        assert_eq!(endpoint_of("http://localhost:9000/x").unwrap().port(), Some(9000));
    }

    #[test]
    fn a_token_of_a_host_is_shown_to_no_other() {
        assert_eq!(token_in(" abc ", "data.example"), Some("abc"));
        assert_eq!(token_in("Data.Example abc", "data.example"), Some("abc"));
        assert_eq!(token_in("data.example abc", "other.example"), None);
        assert_eq!(token_in("  ", "data.example"), None);
        assert!(header("a\nb").is_none() && header("abc").is_some_and(|header| header.is_sensitive()));
    }
}
