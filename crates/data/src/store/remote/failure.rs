//! Why a request has failed, in a person's words: the server and the cause, never a URL, which may hold a secret.
//!
//! The kinds of error tell what may pass (the link, a server that is busy or broken) from what will not (who asks, what is asked for), and
//! [`ErrorKind::ResourceBusy`] and [`ErrorKind::TimedOut`] that fewer requests at a time may help.

use super::client::Refusal;
use super::pause::in_seconds;
use object_store::Error as StoreFailure;
use object_store::client::{HttpError, HttpErrorKind};
use rustls::CertificateError;
use std::error::Error;
use std::io::{self, ErrorKind};
use std::time::Duration;

/// Time without an answer, or without more of it, after which a request has failed. The whole of it may take any time.
pub(super) const TIMEOUT: Duration = Duration::from_secs(10);

/// How messages call a bucket, before its name.
pub(super) const BUCKET: &str = "bucket ";

/// The error of a request to a server.
pub(super) fn told(host: &str, error: &StoreFailure) -> io::Error {
    let (kind, what) = reason(error, host.starts_with(BUCKET));
    io::Error::new(kind, format!("{host} {what}"))
}

fn reason(error: &StoreFailure, is_bucket: bool) -> (ErrorKind, String) {
    let refusal = causes(error).find_map(|cause| cause.downcast_ref::<Refusal>().copied());
    // Stores that ask no server say the same in their own words.
    let refusal = refusal.or(match error {
        StoreFailure::NotFound { .. } => Some(Refusal::Status(404)),
        StoreFailure::Precondition { .. } => Some(Refusal::Status(412)),
        StoreFailure::PermissionDenied { .. } => Some(Refusal::Status(403)),
        StoreFailure::Unauthenticated { .. } => Some(Refusal::Status(401)),
        StoreFailure::NotSupported { .. } => Some(Refusal::Whole),
        _ => None,
    });
    if let Some(refusal) = refusal {
        return refused(refusal, is_bucket);
    }
    let last = innermost(error);
    match causes(error).find_map(of_tls) {
        Some(rustls::Error::InvalidCertificate(why)) => {
            let what = format!("shows a certificate that is not accepted: {}", of_certificate(why));
            return (ErrorKind::InvalidInput, what);
        }
        Some(rustls::Error::InvalidMessage(_)) => {
            return (ErrorKind::NotConnected, "cannot be reached: what listens at that port does not speak TLS".into());
        }
        _ => {}
    }
    // What begins an answer that is no HTTP at all has no type of its own.
    if last == "invalid HTTP version parsed" {
        let what = "cannot be read: what listens at that port does not speak HTTP, or with TLS only, which is https";
        return (ErrorKind::NotConnected, what.into());
    }
    match causes(error).find_map(|cause| cause.downcast_ref::<HttpError>()).map(HttpError::kind) {
        Some(HttpErrorKind::Timeout) => (ErrorKind::TimedOut, format!("has not answered for {} s", TIMEOUT.as_secs())),
        Some(HttpErrorKind::Connect) => {
            let why = causes(error).find_map(of_connection).map_or(last, str::to_owned);
            (ErrorKind::NotConnected, format!("cannot be reached: {why}"))
        }
        _ => (ErrorKind::Other, format!("gave no sound answer: {last}")),
    }
}

/// What an answer without use means.
fn refused(refusal: Refusal, is_bucket: bool) -> (ErrorKind, String) {
    let (status, pause) = match refusal {
        Refusal::Status(status) => (status, None),
        Refusal::Pause(status, pause) => (status, Some(pause).filter(|pause| !pause.is_zero())),
        Refusal::Whole => {
            let what = "gives whole files only, expected a server that takes byte ranges, such as `deepfield serve`";
            return (ErrorKind::Unsupported, what.into());
        }
        Refusal::Page => {
            let what = "shows a web page there, as of a folder or to log in, expected a built file";
            return (ErrorKind::Unsupported, what.into());
        }
        Refusal::Unsized => {
            let what = "does not say how long its answers are, expected Content-Length, as `deepfield serve` gives it";
            return (ErrorKind::Unsupported, what.into());
        }
        Refusal::Length => return (ErrorKind::Other, "answers with another length than it was asked for".into()),
    };
    let (kind, what) = match status {
        401 => (ErrorKind::PermissionDenied, "asks for a token, or for another one"),
        403 => (ErrorKind::PermissionDenied, "does not let this be read"),
        404 | 410 => (ErrorKind::NotFound, "has no such file"),
        412 => (ErrorKind::StaleNetworkFileHandle, "has another version of the file"),
        416 => (ErrorKind::InvalidInput, "does not have the bytes that are asked for"),
        408 => (ErrorKind::TimedOut, "gave up waiting"),
        429 | 503 => (ErrorKind::ResourceBusy, "asks for fewer requests"),
        // A server may fail because it is asked for too much.
        502 | 504 => (ErrorKind::ResourceBusy, "gets no answer from the server behind it"),
        500.. => (ErrorKind::ResourceBusy, "has a fault of its own"),
        300..=399 => (ErrorKind::InvalidInput, "says that this is elsewhere"),
        _ => (ErrorKind::InvalidInput, "refuses"),
    };
    let help = match status {
        300..=399 if is_bucket => "; AWS_REGION says where a bucket is",
        300..=399 => "; a URL there without TLS takes DEEPFIELD_ALLOW_HTTP=1",
        400 | 401 | 403 if is_bucket => {
            "; AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY say who asks, AWS_SKIP_SIGNATURE=true that it is a public one"
        }
        401 => ", which DEEPFIELD_TOKEN gives; a host before it is that of the URL, without the port",
        _ => "",
    };
    let pause = pause.map(|pause| format!(", and for none within {} s", in_seconds(pause))).unwrap_or_default();
    (kind, format!("{what} (status {status}){pause}{help}"))
}

/// What an error came of in the end, in one line.
pub(super) fn innermost(error: &(dyn Error + 'static)) -> String {
    let last = causes(error).last().map(ToString::to_string).unwrap_or_default();
    last.lines().map(str::trim).collect::<Vec<_>>().join(" ")
}

/// An error and all that it came of.
fn causes<'a>(error: &'a (dyn Error + 'static)) -> impl Iterator<Item = &'a (dyn Error + 'static)> {
    std::iter::successors(Some(error), |error| (*error).source())
}

/// What is wrong with TLS; errors of the system hide what they hold from [`Error::source`].
fn of_tls<'a>(error: &'a (dyn Error + 'static)) -> Option<&'a rustls::Error> {
    error.downcast_ref::<rustls::Error>().or_else(|| of_tls(error.downcast_ref::<io::Error>()?.get_ref()?))
}

/// What is wrong with a certificate.
fn of_certificate(error: &CertificateError) -> String {
    use CertificateError::{
        BadSignature, Expired, ExpiredContext, NotValidForName, NotValidForNameContext, NotValidYet,
        NotValidYetContext, Other, UnknownIssuer,
    };
    match error {
        UnknownIssuer => "nobody whom this machine trusts has signed it",
        Expired | ExpiredContext { .. } => "its time is over",
        NotValidYet | NotValidYetContext { .. } => "its time has not begun, or this machine's clock is wrong",
        NotValidForName | NotValidForNameContext { .. } => "it is for another name than that of the URL",
        BadSignature => "this machine trusts another one of that name, perhaps an older one",
        // A type of the verifier's own.
        Other(why) if format!("{why:?}").contains("CaUsedAsEndEntity") => {
            "it is an authority's, expected a server's: basicConstraints=critical,CA:FALSE"
        }
        other => return rustls::Error::InvalidCertificate(other.clone()).to_string(),
    }
    .into()
}

/// What is wrong with a connection that did not come about.
fn of_connection(error: &(dyn Error + 'static)) -> Option<&'static str> {
    // What the resolver answers has no type of its own.
    if error.to_string().starts_with("dns error") {
        return Some("its name is not known here, as none is without a network");
    }
    match error.downcast_ref::<io::Error>()?.kind() {
        ErrorKind::ConnectionRefused => Some("nothing listens at that port"),
        ErrorKind::HostUnreachable | ErrorKind::NetworkUnreachable => Some("there is no way to it from here"),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::StoreError;
    use std::sync::Arc;

    fn of(cause: impl Into<Box<dyn Error + Send + Sync>>) -> io::Error {
        told("data.example", &StoreFailure::Generic { store: "HTTP", source: cause.into() })
    }

    fn may_pass(source: io::Error) -> bool {
        StoreError::Io { path: "a.df".into(), action: "open", source }.may_pass()
    }

    #[test]
    fn what_may_pass_is_told_from_what_will_not() {
        let status = |status| of(HttpError::new(HttpErrorKind::Unknown, Refusal::Status(status)));
        for passing in [408, 429, 500, 502, 503, 504] {
            let is_of_load = matches!(status(passing).kind(), ErrorKind::ResourceBusy | ErrorKind::TimedOut);
            assert!(is_of_load && may_pass(status(passing)), "{passing}");
        }
        for last in [301, 400, 401, 403, 404, 410, 412, 416, 451] {
            let text = status(last).to_string();
            assert!(text.starts_with("data.example ") && text.contains(&format!("(status {last})")), "{text}");
            assert!(!may_pass(status(last)), "{last}");
        }
        for never in [Refusal::Whole, Refusal::Unsized] {
            assert!(!may_pass(of(HttpError::new(HttpErrorKind::Unknown, never))), "{never}");
        }
        let timeout = of(HttpError::new(HttpErrorKind::Timeout, io::Error::other("x")));
        assert_eq!(
            (timeout.kind(), timeout.to_string().as_str()),
            (ErrorKind::TimedOut, "data.example has not answered for 10 s")
        );
        let refused = of(HttpError::new(HttpErrorKind::Connect, io::Error::other("nobody\n listens")));
        assert!(refused.to_string().ends_with("cannot be reached: nobody listens") && may_pass(refused));
        let refused = of(HttpError::new(HttpErrorKind::Connect, io::Error::from(ErrorKind::ConnectionRefused)));
        assert!(refused.to_string().ends_with("nothing listens at that port") && may_pass(refused));
        let plain = rustls::Error::InvalidMessage(rustls::InvalidMessage::InvalidContentType);
        let plain = of(HttpError::new(HttpErrorKind::Connect, io::Error::new(ErrorKind::InvalidData, plain)));
        assert!(plain.to_string().ends_with("does not speak TLS") && may_pass(plain));
        let pause = Refusal::Pause(503, Duration::from_secs(7));
        let pause = of(HttpError::new(HttpErrorKind::Unknown, pause));
        assert!(pause.to_string().ends_with("fewer requests (status 503), and for none within 7 s") && may_pass(pause));
        let tls = of(HttpError::new(HttpErrorKind::Unknown, io::Error::other("invalid HTTP version parsed")));
        assert!(tls.to_string().ends_with("with TLS only, which is https") && may_pass(tls));
        assert!(!may_pass(of(HttpError::new(HttpErrorKind::Unknown, Refusal::Page))));
        let of_authority = CertificateError::Other(rustls::OtherError(Arc::new(io::Error::other("CaUsedAsEndEntity"))));
        assert!(of_certificate(&of_authority).contains("CA:FALSE"));
        let certificate = rustls::Error::InvalidCertificate(CertificateError::Expired);
        let nested = io::Error::other(io::Error::new(ErrorKind::InvalidData, certificate));
        let bad = of(HttpError::new(HttpErrorKind::Connect, nested));
        assert!(bad.to_string().contains("certificate") && !may_pass(bad));
    }
}
