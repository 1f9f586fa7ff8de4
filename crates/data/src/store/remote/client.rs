//! Requests as they leave and answers as they come in: what is refused before anything of a body is read.

use object_store::ClientOptions;
use object_store::client::{
    HttpClient, HttpConnector, HttpError, HttpErrorKind, HttpRequest, HttpResponse, HttpService, ReqwestConnector,
};
use std::pin::Pin;

/// An answer that is of no use.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub(super) enum Refusal {
    /// Another status than one of success.
    #[error("status {0}")]
    Status(u16),
    /// The whole file in place of a part of it.
    #[error("the whole file in place of a part")]
    Whole,
    /// No length, or a greater one than that of the part that was asked for.
    #[error("another length than that of the part")]
    Length,
}

/// Where clients come from: this one, or one that the options of a store ask for.
#[derive(Debug)]
pub(super) struct Connector(pub Option<reqwest::Client>);

impl HttpConnector for Connector {
    fn connect(&self, options: &ClientOptions) -> object_store::Result<HttpClient> {
        let client = match &self.0 {
            Some(client) => HttpClient::new(client.clone()),
            None => ReqwestConnector::default().connect(options)?,
        };
        Ok(HttpClient::new(Guarded(client)))
    }
}

/// A client whose answers are looked at first. A server is free to send a body of any length, and the store would read it whole.
#[derive(Debug)]
struct Guarded(HttpClient);

impl HttpService for Guarded {
    // What the attribute of the trait makes of an asynchronous method.
    fn call<'life0, 'async_trait>(
        &'life0 self,
        request: HttpRequest,
    ) -> Pin<Box<dyn Future<Output = Result<HttpResponse, HttpError>> + Send + 'async_trait>>
    where
        'life0: 'async_trait,
        Self: 'async_trait,
    {
        Box::pin(async move {
            let longest = request.headers().get("range").map(|range| range.to_str().ok().and_then(longest));
            let response = self.0.execute(request).await?;
            let status = response.status();
            let length = response.headers().get("content-length").and_then(|length| length.to_str().ok());
            match check(status.as_u16(), status.is_success(), longest, length) {
                Ok(()) => Ok(response),
                Err(refusal) => Err(HttpError::new(HttpErrorKind::Unknown, refusal)),
            }
        })
    }
}

/// The length of a range as requests name it: `bytes=0-99` or `bytes=-100`.
fn longest(range: &str) -> Option<u64> {
    let (first, last) = range.strip_prefix("bytes=")?.split_once('-')?;
    let last: u64 = last.parse().ok()?;
    match first {
        "" => Some(last),
        first => last.checked_sub(first.parse().ok()?)?.checked_add(1),
    }
}

/// Whether the answer to a request is of use; `longest` is the length of the part that was asked for, if one was.
fn check(status: u16, is_success: bool, longest: Option<Option<u64>>, length: Option<&str>) -> Result<(), Refusal> {
    if !is_success {
        return Err(Refusal::Status(status));
    }
    let Some(longest) = longest else { return Ok(()) };
    if status != 206 {
        return Err(Refusal::Whole);
    }
    let length = length.and_then(|length| length.trim().parse::<u64>().ok());
    match length.is_some_and(|length| longest.is_some_and(|longest| length <= longest)) {
        true => Ok(()),
        false => Err(Refusal::Length),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_parts_of_the_length_that_was_asked_for_are_read() {
        assert_eq!(longest("bytes=10-19"), Some(10));
        assert_eq!(longest("bytes=-100"), Some(100));
        assert_eq!(longest("bytes=0-18446744073709551615"), None);
        for wrong in ["bytes=5-", "bytes=9-3", "items=0-1", "bytes=", ""] {
            assert_eq!(longest(wrong), None, "{wrong}");
        }
        let part = |status, length| check(status, (200..300).contains(&status), Some(Some(100)), length);
        assert_eq!(part(206, Some("100")), Ok(()));
        assert_eq!(part(206, Some("7")), Ok(()));
        for wrong in [Some("101"), Some("-1"), Some("x"), None] {
            assert_eq!(part(206, wrong), Err(Refusal::Length), "{wrong:?}");
        }
        assert_eq!(part(200, Some("100")), Err(Refusal::Whole));
        assert_eq!(part(503, Some("100")), Err(Refusal::Status(503)));
        assert_eq!(check(200, true, None, None), Ok(()));
    }
}
