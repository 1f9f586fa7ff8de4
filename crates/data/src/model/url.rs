//! Files that are named by a URL: how they are told from paths, and what of such a name is never shown.
//!
//! What follows the `?` of a presigned URL lets whoever has it read the file, and so does a user's name and password before the host. Both
//! are taken off where a URL comes in; messages, scenes and lists of recent files have what is left. Whoever asks the server finds the
//! whole name here, as long as the process runs.

use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

/// How the names of files begin that lie behind a server.
const SCHEMES: [&str; 3] = ["https://", "http://", "s3://"];

/// What URLs were whole, by what is shown of them.
static WHOLE: Mutex<BTreeMap<String, String>> = Mutex::new(BTreeMap::new());

/// Whether a file is named by a URL.
pub fn is_url(path: &Path) -> bool {
    path.to_str().is_some_and(|text| scheme_of(text).is_some())
}

/// Why a URL is not read where something of this machine is expected, such as a file.
pub fn refused(expected: &str) -> io::Error {
    let what = format!("found a URL, expected {expected} of this machine: only built files are read from a server");
    io::Error::new(io::ErrorKind::Unsupported, what)
}

/// What is shown of a file's name, and names it from then on: of a URL all but the query, the fragment, and who asks, and `#2` and so on where
/// another one has that name already; of a path all of it.
pub fn shown(path: &Path) -> PathBuf {
    let Some(text) = path.to_str() else { return path.into() };
    let Some(scheme) = scheme_of(text) else { return path.into() };
    // Buckets and keys may hold what parts URLs of the web.
    if scheme == "s3://" {
        return path.into();
    }
    let rest = &text[scheme.len()..];
    let rest = rest.split(['?', '#']).next().unwrap_or(rest);
    let (host, file) = rest.split_at(rest.find('/').unwrap_or(rest.len()));
    let host = host.rsplit_once('@').map_or(host, |(_, host)| host);
    let shown = format!("{scheme}{host}{file}");
    let mut whole = WHOLE.lock().unwrap_or_else(PoisonError::into_inner);
    if shown == text || whole.contains_key(text) {
        return path.into();
    }
    // Servers may tell files apart by what is not shown, so each has a name of its own in this process.
    let mut name = shown.clone();
    for number in 2.. {
        if whole.get(&name).is_none_or(|own| own == text) {
            break;
        }
        name = format!("{shown}#{number}");
    }
    whole.insert(name.clone(), text.into());
    name.into()
}

/// The same of an argument of a command line, which may hold a URL behind `--name=`, and `@X,Y,Z*SCALE` behind the URL.
pub fn shown_argument(argument: &str) -> String {
    let named = argument.split_once('=').filter(|(name, url)| name.starts_with("--") && scheme_of(url).is_some());
    let url = named.map_or(argument, |(_, url)| url);
    if scheme_of(url).is_none() {
        return argument.into();
    }
    let name = &argument[..argument.len() - url.len()];
    let is_place = |text: &str| text.bytes().all(|byte| byte.is_ascii_digit() || b".,*+-eE ".contains(&byte));
    let (url, place) = match url.rsplit_once('@') {
        Some((before, place)) if place.contains(',') && is_place(place) => (before, &url[before.len()..]),
        _ => (url, ""),
    };
    format!("{name}{}{place}", shown(Path::new(url)).display())
}

/// The whole URL of what is shown of it.
pub fn whole(shown: &Path) -> String {
    let text = shown.to_string_lossy().into_owned();
    let whole = WHOLE.lock().unwrap_or_else(PoisonError::into_inner).get(&text).cloned();
    whole.unwrap_or(text)
}

/// The scheme that a text begins with, and the slashes behind it.
fn scheme_of(text: &str) -> Option<&'static str> {
    SCHEMES.into_iter().find(|scheme| text.get(..scheme.len()).is_some_and(|own| own.eq_ignore_ascii_case(scheme)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn urls_are_told_from_paths_and_show_no_secrets() {
        for url in ["https://h/a.df", "HTTPS://h/a.df", "http://127.0.0.1:80/a", "s3://bucket/key"] {
            assert!(is_url(Path::new(url)), "{url}");
        }
        for path in ["", "a.df", "https:/h/a.df", "/https://h/a.df", "ftp://h/a.df", "s3:/b", "é"] {
            assert!(!is_url(Path::new(path)) && shown(Path::new(path)) == Path::new(path), "{path}");
        }
        let signed = "https://me:word@data.example/secret-test/a.df?sig=s3cr3t@1,2#part";
        let shown_of_it = shown(Path::new(signed));
        assert_eq!(shown_of_it, Path::new("https://data.example/secret-test/a.df"));
        assert_eq!((whole(&shown_of_it).as_str(), shown(&shown_of_it)), (signed, shown_of_it));
        // Another file of the same server, which the query tells from the first; both keep their names.
        let other = "https://data.example/secret-test/a.df?sig=other";
        let shown_of_other = shown(Path::new(other));
        assert_eq!(shown_of_other, Path::new("https://data.example/secret-test/a.df#2"));
        assert_eq!((whole(&shown_of_other).as_str(), shown(Path::new(other))), (other, shown_of_other.clone()));
        assert_eq!((shown(&shown_of_other), whole(&shown(Path::new(signed))).as_str()), (shown_of_other, signed));
        assert_eq!(whole(Path::new("https://h/plain.df")), "https://h/plain.df");
        assert_eq!(shown(Path::new("s3://b/a?b.df")), Path::new("s3://b/a?b.df"));
    }

    #[test]
    fn arguments_keep_what_stands_around_a_url() {
        for (argument, shown) in [
            ("--with=https://h/a.df?sig=x@1,-2.5,3e1*2", "--with=https://h/a.df@1,-2.5,3e1*2"),
            ("https://h/b.df?sig=x", "https://h/b.df"),
            ("https://h/c.df", "https://h/c.df"),
            ("--title=what?", "--title=what?"),
            ("a?.df@1,2,3", "a?.df@1,2,3"),
        ] {
            assert_eq!(shown_argument(argument), shown);
        }
    }
}
