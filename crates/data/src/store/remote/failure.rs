//! Why a request has failed, in a person's words: the server and the cause, never a URL, which may hold a secret.
//!
//! The kinds of error tell what may pass (the link, a server that is busy or broken) from what will not (who asks, what is asked for).

use super::client::Refusal;
use object_store::Error as StoreFailure;
use object_store::client::{HttpError, HttpErrorKind};
use std::error::Error;
use std::io::{self, ErrorKind};
use std::time::Duration;

/// Time without an answer, or without more of it, after which a request has failed. The whole of it may take any time.
pub(super) const TIMEOUT: Duration = Duration::from_secs(10);

/// The error of a request to a server.
pub(super) fn told(host: &str, error: &StoreFailure) -> io::Error {
    let (kind, what) = reason(error);
    io::Error::new(kind, format!("{host} {what}"))
}

fn reason(error: &StoreFailure) -> (ErrorKind, String) {
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
        return refused(refusal);
    }
    let last = innermost(error);
    if let Some(why) = causes(error).find_map(of_certificate) {
        return (ErrorKind::InvalidInput, format!("shows a certificate that is not accepted: {why}"));
    }
    match causes(error).find_map(|cause| cause.downcast_ref::<HttpError>()).map(HttpError::kind) {
        Some(HttpErrorKind::Timeout) => (ErrorKind::TimedOut, format!("has not answered for {} s", TIMEOUT.as_secs())),
        Some(HttpErrorKind::Connect) => (ErrorKind::NotConnected, format!("cannot be reached: {last}")),
        _ => (ErrorKind::Other, format!("gave no sound answer: {last}")),
    }
}

/// What an answer without use means.
fn refused(refusal: Refusal) -> (ErrorKind, String) {
    let status = match refusal {
        Refusal::Status(status) => status,
        Refusal::Whole => {
            let what = "gives whole files only, expected a server that takes byte ranges, such as `deepfield serve`";
            return (ErrorKind::Unsupported, what.into());
        }
        Refusal::Length => return (ErrorKind::Other, "answers with another length than it was asked for".into()),
    };
    let (kind, what) = match status {
        401 => (ErrorKind::PermissionDenied, "asks for a token, which DEEPFIELD_TOKEN gives"),
        403 => (ErrorKind::PermissionDenied, "does not let this be read"),
        404 | 410 => (ErrorKind::NotFound, "has no such file"),
        412 => (ErrorKind::StaleNetworkFileHandle, "has another version of the file"),
        416 => (ErrorKind::InvalidInput, "does not have the bytes that are asked for"),
        408 => (ErrorKind::TimedOut, "gave up waiting"),
        429 | 503 => (ErrorKind::ResourceBusy, "asks for fewer requests"),
        500.. => (ErrorKind::Other, "has a fault of its own"),
        300..=399 => (ErrorKind::InvalidInput, "says that this is elsewhere; AWS_REGION says where a bucket is"),
        _ => (ErrorKind::InvalidInput, "refuses"),
    };
    (kind, format!("{what} (status {status})"))
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

/// What is wrong with a certificate; errors of the system hide what they hold from [`Error::source`].
fn of_certificate(error: &(dyn Error + 'static)) -> Option<String> {
    match error.downcast_ref::<rustls::Error>() {
        Some(found) => matches!(found, rustls::Error::InvalidCertificate(_)).then(|| found.to_string()),
        None => of_certificate(error.downcast_ref::<io::Error>()?.get_ref()?),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::StoreError;

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
            assert!(may_pass(status(passing)), "{passing}");
        }
        for last in [301, 400, 401, 403, 404, 410, 412, 416, 451] {
            let text = status(last).to_string();
            assert!(text.starts_with("data.example ") && text.ends_with(&format!("(status {last})")), "{text}");
            assert!(!may_pass(status(last)), "{last}");
        }
        assert!(!may_pass(of(HttpError::new(HttpErrorKind::Unknown, Refusal::Whole))));
        let timeout = of(HttpError::new(HttpErrorKind::Timeout, io::Error::other("x")));
        assert_eq!(
            (timeout.kind(), timeout.to_string().as_str()),
            (ErrorKind::TimedOut, "data.example has not answered for 10 s")
        );
        let refused = of(HttpError::new(HttpErrorKind::Connect, io::Error::other("nobody\n listens")));
        assert!(refused.to_string().ends_with("cannot be reached: nobody listens") && may_pass(refused));
        let certificate = rustls::Error::InvalidCertificate(rustls::CertificateError::Expired);
        let nested = io::Error::other(io::Error::new(ErrorKind::InvalidData, certificate));
        let bad = of(HttpError::new(HttpErrorKind::Connect, nested));
        assert!(bad.to_string().contains("certificate") && !may_pass(bad));
    }
}
