//! Who may read: those who have the token, where there is one. Programs say it in `Authorization`; browsers once in the address, which
//! gives them a cookie. What pages of other sites have browsers ask for is told by what these say of it.

use super::answer::{self, Answer};
use hyper::header::{AUTHORIZATION, COOKIE, HOST, SET_COOKIE, WWW_AUTHENTICATE};
use hyper::http::request::Parts;
use hyper::http::uri::Authority;
use hyper::{HeaderMap, StatusCode};
use std::fmt;
use std::net::IpAddr;

/// How the name of the cookie with the token begins.
const NAME: &str = "deepfield-token";

/// The fewest letters of a token.
const LEAST: usize = 16;

/// A secret that readers have to know.
#[derive(Clone)]
pub struct Token(String);

impl Token {
    /// A token.
    ///
    /// # Errors
    /// What was expected, without the text.
    pub fn new(text: &str) -> Result<Token, String> {
        // Letters that stand for themselves in addresses, headers and cookies.
        let fits = |byte: u8| byte.is_ascii_alphanumeric() || b"-._~".contains(&byte);
        match text.len() >= LEAST && text.bytes().all(fits) {
            true => Ok(Token(text.to_owned())),
            false => Err(format!("expected at least {LEAST} letters, digits and -._~, and no host before them")),
        }
    }

    /// Whether a text is the token, in a time that does not depend on where they differ.
    fn is(&self, text: &str) -> bool {
        let pairs = self.0.bytes().zip(text.bytes());
        let differences = std::hint::black_box(pairs.fold(0, |all, (own, said)| all | (own ^ said)));
        self.0.len() == text.len() && differences == 0
    }

    /// Browsers keep one cookie of a name for all ports of a host, so each token has a name of its own. A port would not do: behind another
    /// server, or in a container, it is not the one that the browser knows. The name is seen by nobody who does not see the token beside it.
    fn cookie_name(&self) -> String {
        format!("{NAME}-{:08x}", crc32c::crc32c(self.0.as_bytes()))
    }

    /// What is answered to a request that may not read, or that has the token in its address; nothing where it may go on.
    pub(super) fn check(&self, request: &Parts, is_secure: bool) -> Result<(), Box<Answer>> {
        let query = request.uri.query().unwrap_or_default();
        if query.split('&').filter_map(|part| part.strip_prefix("token=")).any(|said| self.is(said)) {
            return Err(Box::new(self.welcome(request, query, is_secure)));
        }
        let bearer = request.headers.get(AUTHORIZATION).and_then(|value| value.to_str().ok());
        let bearer =
            bearer.and_then(|value| value.split_once(' ')).filter(|(scheme, _)| scheme.eq_ignore_ascii_case("bearer"));
        if bearer.is_some_and(|(_, said)| self.is(said.trim()))
            || cookies(&request.headers, &self.cookie_name()).any(|said| self.is(said))
        {
            return Ok(());
        }
        let text = "this server asks for a token: DEEPFIELD_TOKEN for deepfield, ?token=... in a browser";
        let answer = answer::line(StatusCode::UNAUTHORIZED, text);
        Err(Box::new(answer::with(answer, WWW_AUTHENTICATE, "Bearer")))
    }

    /// Gives the cookie, and leads to the address without the token. It is a page that goes on by itself: after a redirection a browser that
    /// comes by a link from elsewhere would not send a cookie of `SameSite=Strict`.
    fn welcome(&self, request: &Parts, query: &str, is_secure: bool) -> Answer {
        let rest: Vec<&str> = query.split('&').filter(|part| !part.starts_with("token=")).collect();
        let mark = if rest.is_empty() { "" } else { "?" };
        // Two slashes would lead to another host; browsers take either kind.
        let path = format!("/{}{mark}{}", request.uri.path().trim_start_matches(['/', '\\']), rest.join("&"));
        let path = crate::explore::xml_escaped(&path);
        let page = format!(
            "<!doctype html><meta charset=\"utf-8\"><meta http-equiv=\"refresh\" content=\"0; url={path}\">\
             <title>deepfield</title><p><a href=\"{path}\">Go on</a></p>\n"
        );
        let answer = answer::html(StatusCode::OK, page);
        answer::with(answer, SET_COOKIE, &cookie(&self.cookie_name(), &self.0, is_secure))
    }
}

/// Whether a request came by a name that can only be this machine's, or by an address. A site of another's may have its name lead to this
/// machine, so that its scripts read what is here as their own; browsers say by which name they came, programs need not.
pub(super) fn is_for_this_machine(headers: &HeaderMap) -> bool {
    let Some(host) = headers.get(HOST) else { return true };
    let Some(authority) = host.to_str().ok().and_then(|host| host.parse::<Authority>().ok()) else { return false };
    let name = authority.host().trim_end_matches('.').to_ascii_lowercase();
    let address = name.trim_start_matches('[').trim_end_matches(']');
    name == "localhost" || name.ends_with(".localhost") || address.parse::<IpAddr>().is_ok()
}

/// Whether a page of another site asks, in place of a visitor who goes there (Fetch Metadata).
pub(super) fn is_from_elsewhere(headers: &HeaderMap) -> bool {
    let says = |name: &str| headers.get(name).and_then(|value| value.to_str().ok());
    matches!(says("sec-fetch-site"), Some("cross-site" | "same-site")) && says("sec-fetch-dest") != Some("document")
}

impl fmt::Debug for Token {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Token")
    }
}

/// The value of `Set-Cookie` for a cookie that no script and no other site gets.
pub(super) fn cookie(name: &str, value: &str, is_secure: bool) -> String {
    let secure = if is_secure { "; Secure" } else { "" };
    format!("{name}={value}; Path=/; HttpOnly; SameSite=Strict{secure}")
}

/// The values of the cookies of a name.
pub(super) fn cookies<'a>(headers: &'a HeaderMap, name: &'a str) -> impl Iterator<Item = &'a str> {
    let values: Vec<&str> = headers.get_all(COOKIE).iter().filter_map(|value| value.to_str().ok()).collect();
    let pairs = values.into_iter().flat_map(|value| value.split(';')).filter_map(|pair| pair.trim().split_once('='));
    pairs.filter_map(move |(own, value)| (own == name).then_some(value))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_token_is_the_token() {
        let token = Token::new("abcdefghijklmnop").unwrap();
        assert!(token.is("abcdefghijklmnop"));
        for wrong in ["", "abcdefghijklmnoq", "abcdefghijklmno", "abcdefghijklmnopq", "Abcdefghijklmnop"] {
            assert!(!token.is(wrong), "{wrong}");
        }
        for wrong in ["", "short", "with a space in it", "with;a;semicolon;in;it"] {
            let why = Token::new(wrong).unwrap_err();
            assert!(why.starts_with("expected") && (wrong.is_empty() || !why.contains(wrong)), "{why}");
        }
        assert_eq!(format!("{token:?}"), "Token");
    }
}
