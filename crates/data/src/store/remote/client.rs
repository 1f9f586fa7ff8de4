//! Requests as they leave and answers as they come in: what is refused before anything of a body is read.

use super::pause::{Pause, asked_for};
use object_store::ClientOptions;
use object_store::client::{
    HttpClient, HttpConnector, HttpError, HttpErrorKind, HttpRequest, HttpResponse, HttpService, ReqwestConnector,
};
use reqwest::header::{ACCEPT_ENCODING, HeaderValue};
use std::pin::Pin;
use std::time::Duration;

/// An answer that is of no use.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub(super) enum Refusal {
    /// Another status than one of success.
    #[error("status {0}")]
    Status(u16),
    /// The same, and for how long to ask for nothing.
    #[error("status {0}")]
    Pause(u16, Duration),
    /// The whole file in place of a part of it.
    #[error("the whole file in place of a part")]
    Whole,
    /// A page for people: the list of a folder, or a form to log in.
    #[error("a web page in place of a part")]
    Page,
    /// A greater length than that of the part that was asked for.
    #[error("another length than that of the part")]
    Length,
    /// No length.
    #[error("no length")]
    Unsized,
}

/// Where clients of a server come from.
#[derive(Debug)]
pub(super) struct Connector {
    /// The client, else one that the options of a store ask for.
    pub client: Option<reqwest::Client>,
    /// The pause that the server asks for.
    pub pause: Pause,
}

impl HttpConnector for Connector {
    fn connect(&self, options: &ClientOptions) -> object_store::Result<HttpClient> {
        let client = match &self.client {
            Some(client) => HttpClient::new(client.clone()),
            None => ReqwestConnector::default().connect(options)?,
        };
        Ok(HttpClient::new(Guarded { client, pause: self.pause.clone() }))
    }
}

/// A client that asks for bytes as they are, and whose answers are looked at first. A server is free to send a body of any length, and the
/// store would read it whole.
#[derive(Debug)]
struct Guarded {
    client: HttpClient,
    pause: Pause,
}

impl HttpService for Guarded {
    // What the attribute of the trait makes of an asynchronous method.
    fn call<'life0, 'async_trait>(
        &'life0 self,
        mut request: HttpRequest,
    ) -> Pin<Box<dyn Future<Output = Result<HttpResponse, HttpError>> + Send + 'async_trait>>
    where
        'life0: 'async_trait,
        Self: 'async_trait,
    {
        // Some servers compress what is asked for without a word about that, and some drop ranges then.
        request.headers_mut().insert(ACCEPT_ENCODING, HeaderValue::from_static("identity"));
        Box::pin(async move {
            let longest = request.headers().get("range").map(|range| range.to_str().ok().and_then(longest));
            let response = self.client.execute(request).await?;
            let header = |name: &str| response.headers().get(name).and_then(|value| value.to_str().ok());
            let status = response.status();
            let refusal = match check(status.as_u16(), status.is_success(), longest, header("content-length")) {
                Ok(()) => return Ok(response),
                Err(Refusal::Status(status @ (408 | 429 | 500..))) => {
                    let pause = header("retry-after").and_then(|after| asked_for(after, header("date")));
                    pause.map_or(Refusal::Status(status), |pause| Refusal::Pause(status, pause))
                }
                Err(Refusal::Whole) if header("content-type").is_some_and(is_page) => Refusal::Page,
                Err(refusal) => refusal,
            };
            if let Refusal::Pause(_, length) = refusal {
                self.pause.begin(length);
            }
            Err(HttpError::new(HttpErrorKind::Unknown, refusal))
        })
    }
}

/// Whether a type of content is that of pages for people.
fn is_page(kind: &str) -> bool {
    kind.split(';').next().is_some_and(|kind| kind.trim().eq_ignore_ascii_case("text/html"))
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
    let length = length.ok_or(Refusal::Unsized)?.trim().parse::<u64>().ok();
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
        for wrong in ["101", "-1", "x"] {
            assert_eq!(part(206, Some(wrong)), Err(Refusal::Length), "{wrong}");
        }
        assert_eq!(part(206, None), Err(Refusal::Unsized));
        assert_eq!(part(200, Some("100")), Err(Refusal::Whole));
        assert_eq!(part(503, Some("100")), Err(Refusal::Status(503)));
        assert_eq!(check(200, true, None, None), Ok(()));
        assert!(is_page("Text/HTML; charset=utf-8") && !is_page("text/plain") && !is_page(""));
    }
}
