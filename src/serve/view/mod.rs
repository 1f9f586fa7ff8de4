//! Pictures for browsers: a page in which data is turned, dragged and asked, drawn here as Python's widget draws it.
//!
//! Every visitor has a thread that draws one picture at a time, and a share of the memory; what is asked for newest is drawn next.

mod asked;
mod drawer;
mod shown;
mod studio;
mod visitors;

pub use shown::ViewOptions;

use super::access::{cookie, cookies};
use super::answer::{self, Answer};
use super::server::not_allowed;
use crate::picture::asked::Failure;
use drawer::{Outcome, Task};
use http_body_util::{BodyExt, Limited};
use hyper::body::Incoming;
use hyper::header::{CONTENT_SECURITY_POLICY, CONTENT_TYPE, HeaderName, RETRY_AFTER, SET_COOKIE};
use hyper::http::request::Parts;
use hyper::{HeaderMap, Method, StatusCode};
use serde_json::{Value, json};
use shown::Shown;
use std::sync::Arc;
use std::time::Duration;
use tokio::time::timeout;
use visitors::{NoPlace, Visitors};

/// The header with what a picture shows, as JSON in ASCII.
const FACTS: &str = "x-deepfield-facts";
/// The cookie by which a visitor is known.
const VISITOR: &str = "deepfield-visitor";
/// The largest request, bytes, and how long it may take to come.
const LARGEST: usize = 16 << 10;
const SLOWEST: Duration = Duration::from_secs(10);
/// After how many seconds somebody who found no place may try again.
const AGAIN: &str = "30";

const PAGE: &str = include_str!("../page/page.html");
const SCRIPT: &str = include_str!("../page/page.js");
const STYLE: &str = include_str!("../page/page.css");
/// What the notebook shows, too.
const WIDGET: &str = include_str!("../../../python/deepfield/widget.js");
/// Nothing from elsewhere, and no script in the page itself. The widget brings its own style.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; connect-src 'self'; \
                      img-src blob: data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

/// Data that visitors look at.
pub struct Viewing {
    shown: Arc<Shown>,
    visitors: Visitors,
}

impl Viewing {
    /// Opens the data; sources of particles are built into the cache first, unless they are there.
    ///
    /// # Errors
    /// When the data, the scene or the tour cannot be read, or do not fit together.
    pub fn open(options: &ViewOptions) -> Result<Viewing, Failure> {
        let shown = Arc::new(Shown::open(options)?);
        Ok(Viewing { visitors: Visitors::new(options.visitors, Arc::clone(&shown)), shown })
    }

    /// How many look at the moment.
    pub fn visitors(&self) -> usize {
        self.visitors.count()
    }

    pub(super) async fn answer(&self, request: Parts, body: Incoming, is_secure: bool) -> Answer {
        let Parts { method, uri, headers, .. } = request;
        let path = uri.path();
        let is_read = matches!(method, Method::GET | Method::HEAD);
        match path {
            "/" if is_read => self.page(&headers, is_secure),
            "/view/page.js" if is_read => answer::whole(StatusCode::OK, "text/javascript; charset=utf-8", SCRIPT),
            "/view/widget.js" if is_read => answer::whole(StatusCode::OK, "text/javascript; charset=utf-8", WIDGET),
            "/view/page.css" if is_read => answer::whole(StatusCode::OK, "text/css; charset=utf-8", STYLE),
            "/view/about" if is_read => match self.visitors.admit(known(&headers)) {
                Ok((id, _)) => self.to(&id, is_secure, answer::json(StatusCode::OK, &self.shown.about)),
                Err(reason) => self.full(reason),
            },
            "/view/frame" | "/view/pick" | "/view/leave" if method == Method::POST => {
                self.post(path, &headers, body, is_secure).await
            }
            "/view/frame" | "/view/pick" | "/view/leave" => not_allowed("POST"),
            "/" | "/view/page.js" | "/view/widget.js" | "/view/page.css" | "/view/about" => not_allowed("GET, HEAD"),
            _ => answer::refused(StatusCode::NOT_FOUND, "there is no such page"),
        }
    }

    /// The page; in plain words that there is no place, where there is none.
    fn page(&self, headers: &HeaderMap, is_secure: bool) -> Answer {
        let id = known(headers);
        if !self.visitors.has_place(id.as_deref()) {
            let text = format!(
                "<!doctype html>\n<html lang=\"en\"><meta charset=\"utf-8\"><title>deepfield is full</title>\n\
                 <meta name=\"viewport\" content=\"width=device-width\"><style>{STYLE}</style>\n\
                 <meta http-equiv=\"refresh\" content=\"{AGAIN}\">\n<h1>All places are taken</h1>\n\
                 <p>As many look at this data already as the server draws for, which are {}. This page tries again by \
                 itself every {AGAIN} seconds; somebody who leaves makes room.\n</html>\n",
                self.visitors.most()
            );
            return answer::with(answer::html(StatusCode::SERVICE_UNAVAILABLE, text), RETRY_AFTER, AGAIN);
        }
        let text = PAGE.replace("TITLE", &crate::explore::xml_escaped(&self.shown.name));
        let page = answer::whole(StatusCode::OK, "text/html; charset=utf-8", text);
        let page = answer::with(page, CONTENT_SECURITY_POLICY, POLICY);
        // A place is taken when the page asks what there is to see.
        self.to(&id.unwrap_or_else(visitors::new_id), is_secure, page)
    }

    async fn post(&self, path: &str, headers: &HeaderMap, body: Incoming, is_secure: bool) -> Answer {
        let id = known(headers);
        if path == "/view/leave" {
            id.iter().for_each(|id| self.visitors.leave(id));
            return answer::json(StatusCode::OK, &json!({}));
        }
        // Forms of other sites cannot say so.
        let kind = headers.get(CONTENT_TYPE).and_then(|value| value.to_str().ok()).unwrap_or_default();
        if !kind.to_ascii_lowercase().starts_with("application/json") {
            let why = "content-type: expected application/json";
            return answer::refused(StatusCode::UNSUPPORTED_MEDIA_TYPE, why);
        }
        let bytes = match timeout(SLOWEST, Limited::new(body, LARGEST).collect()).await {
            Err(_) => return answer::refused(StatusCode::REQUEST_TIMEOUT, "the request took too long"),
            Ok(Err(_)) => {
                let why = format!("expected at most {LARGEST} bytes");
                return answer::refused(StatusCode::PAYLOAD_TOO_LARGE, &why);
            }
            Ok(Ok(collected)) => collected.to_bytes(),
        };
        let task = match path {
            "/view/frame" => serde_json::from_slice(&bytes).map(Task::Frame),
            _ => serde_json::from_slice(&bytes).map(Task::Pick),
        };
        let task = match task {
            Ok(task) => task,
            Err(error) => return answer::refused(StatusCode::BAD_REQUEST, &error.to_string()),
        };
        let (id, drawer) = match self.visitors.admit(id) {
            Ok(admitted) => admitted,
            Err(reason) => return self.full(reason),
        };
        let answer = match drawer.ask(task).await {
            Outcome::Frame { kind, bytes, facts } => {
                answer::with(answer::whole(StatusCode::OK, kind, bytes), HeaderName::from_static(FACTS), &ascii(&facts))
            }
            Outcome::Picked(found) => answer::json(StatusCode::OK, &found),
            Outcome::Superseded => answer::refused(StatusCode::CONFLICT, "something newer was asked for"),
            Outcome::Untaken => answer::refused(StatusCode::CONFLICT, "pictures before it have not been taken"),
            Outcome::Failed(why) => {
                answer::refused(StatusCode::UNPROCESSABLE_ENTITY, &self.shown.without_folders(&why))
            }
        };
        self.to(&id, is_secure, answer)
    }

    /// An answer for a visitor, who is known by it from now on.
    fn to(&self, id: &str, is_secure: bool, answer: Answer) -> Answer {
        answer::with(answer, SET_COOKIE, &cookie(VISITOR, id, is_secure))
    }

    fn full(&self, reason: NoPlace) -> Answer {
        let why = match reason {
            NoPlace::Full => {
                format!("all {} places are taken: the page tries again by itself", self.visitors.most())
            }
            NoPlace::NoThread => "the server has no thread left to draw with".into(),
        };
        answer::with(answer::refused(StatusCode::SERVICE_UNAVAILABLE, &why), RETRY_AFTER, AGAIN)
    }
}

/// The visitor that a request says it is from.
fn known(headers: &HeaderMap) -> Option<String> {
    cookies(headers, VISITOR).find(|id| visitors::is_id(id)).map(str::to_owned)
}

/// JSON without letters that headers do not hold.
fn ascii(value: &Value) -> String {
    let text = value.to_string();
    let mut ascii = String::with_capacity(text.len());
    for letter in text.chars() {
        match letter.is_ascii() {
            true => ascii.push(letter),
            false => letter.encode_utf16(&mut [0; 2]).iter().for_each(|unit| ascii.push_str(&format!("\\u{unit:04x}"))),
        }
    }
    ascii
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn facts_are_ascii_and_the_same() {
        let facts = json!({ "unit": "M\u{2609}/kpc\u{b2}", "name": "\u{1f30c} \"a\"" });
        let text = ascii(&facts);
        assert!(text.is_ascii());
        assert_eq!(serde_json::from_str::<Value>(&text).unwrap(), facts);
    }
}
