//! Files of a folder, or one file, as they are: whole, in parts, or not where the other end has them already.

use super::ServeError;
use super::answer::{self, Answer};
use super::conditions::{Verdict, judge};
use super::content::Content;
use super::version::{Opened, open};
use super::{index, percent};
use hyper::header::{
    ACCEPT_RANGES, CACHE_CONTROL, CONTENT_LENGTH, CONTENT_RANGE, CONTENT_TYPE, ETAG, HeaderValue, LAST_MODIFIED,
    LOCATION, X_CONTENT_TYPE_OPTIONS,
};
use hyper::http::request::Parts;
use hyper::{Method, Response, StatusCode};
use std::ffi::OsString;
use std::path::{Path, PathBuf};

/// A folder, or one file of it. Nothing outside is served, nor what is hidden.
#[derive(Clone, Debug)]
pub struct Files {
    /// The folder, without symbolic links.
    folder: PathBuf,
    /// The one file.
    only: Option<OsString>,
}

/// What an address names.
enum Found {
    File(PathBuf),
    Folder(PathBuf),
    /// A folder, whose address lacks its slash.
    Unfinished,
}

impl Files {
    /// What is at `path`: a folder, or a file.
    ///
    /// # Errors
    /// Where there is nothing, or it cannot be read.
    pub fn of(path: &Path) -> Result<Files, ServeError> {
        let failed = |source| ServeError::File { file: path.to_owned(), source };
        let whole = path.canonicalize().map_err(failed)?;
        if whole.is_dir() {
            std::fs::read_dir(&whole).map_err(failed)?;
            return Ok(Files { folder: whole, only: None });
        }
        open(&whole).map_err(failed)?;
        let (folder, name) = (whole.parent().unwrap_or(Path::new("/")), whole.file_name().unwrap_or_default());
        if !name.to_str().is_some_and(is_shown) {
            let why = "found a name that is not served, expected one in UTF-8 that does not begin with a dot";
            return Err(failed(std::io::Error::new(std::io::ErrorKind::InvalidInput, why)));
        }
        Ok(Files { folder: folder.to_owned(), only: Some(name.to_owned()) })
    }

    /// The address of the one file below the server's.
    pub fn address(&self) -> String {
        self.only.as_ref().map(|name| percent::encoded(&name.to_string_lossy())).unwrap_or_default()
    }

    /// Answers GET and HEAD. Waits for the disk. `here` is the server's own address.
    pub(super) fn answer(&self, request: &Parts, here: &str) -> Answer {
        let path = request.uri.path();
        match self.find(path) {
            Some(Found::File(file)) => match open(&file) {
                Ok(opened) => file_answer(request, &file, opened),
                Err(error) => failed(&error),
            },
            Some(Found::Folder(folder)) => match index::page(&folder, path, here, self.only.as_deref()) {
                Ok(page) => answer::html(StatusCode::OK, page),
                Err(error) => failed(&error),
            },
            Some(Found::Unfinished) => {
                let name = path.rsplit('/').next().unwrap_or_default();
                // Relative: whatever stands before it leads nowhere else.
                let answer = answer::line(StatusCode::PERMANENT_REDIRECT, "a folder");
                answer::with(answer, LOCATION, &format!("./{name}/"))
            }
            None => failed(&std::io::ErrorKind::NotFound.into()),
        }
    }

    /// What is at a path of an address; nothing where it leads out of the folder, or to something hidden.
    fn find(&self, path: &str) -> Option<Found> {
        let segments = path.strip_prefix('/')?;
        let (segments, is_folder) = match segments.strip_suffix('/') {
            Some(before) => (before, true),
            None => (segments, segments.is_empty()),
        };
        let mut file = self.folder.clone();
        for segment in segments.split('/').filter(|_| !segments.is_empty()) {
            let name = percent::decoded(segment)?;
            if !is_shown(&name) {
                return None;
            }
            file.push(name);
        }
        if let Some(only) = &self.only
            && !segments.is_empty()
            && file != self.folder.join(only)
        {
            return None;
        }
        let file = file.canonicalize().ok()?;
        let below = file.strip_prefix(&self.folder).ok()?;
        // A symbolic link may lead to something hidden.
        if !below.iter().all(|name| name.to_str().is_some_and(is_shown)) {
            return None;
        }
        let about = std::fs::metadata(&file).ok()?;
        match (about.is_dir(), about.is_file(), is_folder) {
            (true, _, true) => Some(Found::Folder(file)),
            (true, _, false) => Some(Found::Unfinished),
            (_, true, false) => Some(Found::File(file)),
            _ => None,
        }
    }
}

/// Whether a name is one of a file that is served: not hidden, and nothing but a name.
pub(super) fn is_shown(name: &str) -> bool {
    // Elsewhere names may hold a time of day.
    let apart: &[char] = if cfg!(windows) { &['/', '\\', ':', '\0'] } else { &['/', '\0'] };
    !name.is_empty() && !name.starts_with('.') && !name.contains(apart)
}

/// What is answered where the system refuses; nobody is told more than that.
fn failed(error: &std::io::Error) -> Answer {
    match error.kind() {
        std::io::ErrorKind::NotFound => answer::line(StatusCode::NOT_FOUND, "there is no such file"),
        std::io::ErrorKind::PermissionDenied => answer::line(StatusCode::FORBIDDEN, "the file may not be read"),
        _ => answer::line(StatusCode::INTERNAL_SERVER_ERROR, "the file cannot be read"),
    }
}

fn file_answer(request: &Parts, path: &Path, Opened { file, version }: Opened) -> Answer {
    let verdict = judge(&request.headers, &version, request.method == Method::GET);
    let length = version.length;
    let (status, range) = match verdict {
        Verdict::Whole => (StatusCode::OK, 0..length),
        Verdict::Part(range) => (StatusCode::PARTIAL_CONTENT, range),
        Verdict::NotModified => (StatusCode::NOT_MODIFIED, 0..0),
        Verdict::Failed => {
            let answer = answer::line(StatusCode::PRECONDITION_FAILED, "the file is another version");
            return answer::with(answer, ETAG, &version.tag);
        }
        Verdict::Unsatisfiable => {
            let text = format!("the file has {length} bytes");
            let answer = answer::line(StatusCode::RANGE_NOT_SATISFIABLE, &text);
            return answer::with(answer, CONTENT_RANGE, &format!("bytes */{length}"));
        }
    };
    let mut answer = Response::new(Content::part(file, range.clone()));
    *answer.status_mut() = status;
    let headers = answer.headers_mut();
    headers.insert(ACCEPT_RANGES, HeaderValue::from_static("bytes"));
    // What is kept is asked for again before it is used.
    headers.insert(CACHE_CONTROL, HeaderValue::from_static("no-cache"));
    headers.insert(X_CONTENT_TYPE_OPTIONS, HeaderValue::from_static("nosniff"));
    if status != StatusCode::NOT_MODIFIED {
        headers.insert(CONTENT_TYPE, HeaderValue::from_static(content_type(path)));
        headers.insert(CONTENT_LENGTH, HeaderValue::from(range.end - range.start));
    }
    if status == StatusCode::PARTIAL_CONTENT {
        let said = format!("bytes {}-{}/{length}", range.start, range.end.saturating_sub(1));
        answer = answer::with(answer, CONTENT_RANGE, &said);
    }
    let answer = answer::with(answer, ETAG, &version.tag);
    match version.date() {
        Some(date) => answer::with(answer, LAST_MODIFIED, &date),
        None => answer,
    }
}

/// The type of a file by its name. Nothing that a browser would run.
fn content_type(path: &Path) -> &'static str {
    match path.extension().and_then(|extension| extension.to_str()) {
        Some("png") => "image/png",
        Some("jpg" | "jpeg") => "image/jpeg",
        Some("json") => "application/json",
        Some("csv") => "text/csv; charset=utf-8",
        Some("ron" | "txt" | "md") => "text/plain; charset=utf-8",
        _ => "application/octet-stream",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The file that an address leads to, from the folder on.
    fn found(files: &Files, address: &str) -> Option<PathBuf> {
        match files.find(address)? {
            Found::File(file) => file.strip_prefix(&files.folder).ok().map(Path::to_owned),
            Found::Folder(_) | Found::Unfinished => None,
        }
    }

    #[test]
    fn nothing_outside_the_folder_and_nothing_hidden_is_found() {
        let around = tempfile::tempdir().unwrap();
        let root = around.path().join("data");
        std::fs::create_dir_all(root.join("steps")).unwrap();
        std::fs::create_dir(root.join(".git")).unwrap();
        for file in ["secret", "data/a b.df", "data/steps/0.df", "data/.hidden", "data/.git/config"] {
            std::fs::write(around.path().join(file), "x").unwrap();
        }
        #[cfg(unix)]
        for (target, link) in [("../secret", "out"), ("steps/0.df", "inside"), (".hidden", "shown"), ("..", "up")] {
            std::os::unix::fs::symlink(target, root.join(link)).unwrap();
        }
        let files = Files::of(&root).unwrap();
        assert_eq!(found(&files, "/a%20b.df"), Some("a b.df".into()));
        assert_eq!(found(&files, "/steps/0.df"), Some("steps/0.df".into()));
        #[cfg(unix)]
        assert_eq!(found(&files, "/inside"), Some("steps/0.df".into()));
        let refused = [
            "",
            "a b.df",
            "/../secret",
            "/%2e%2e/secret",
            "/..%2fsecret",
            "/steps/../../secret",
            "/steps/..%5c..%5csecret",
            "/./a%20b.df",
            "//a%20b.df",
            "/.hidden",
            "/%2ehidden",
            "/.git/config",
            "/out",
            "/shown",
            "/up/secret",
            "/steps//0.df",
            "/a%20b.df/",
            "/a%20b.df%00",
            "/a%20b.df::$DATA",
            "/c:/secret",
            "/none",
            "/%ff",
        ];
        for address in refused {
            assert_eq!(found(&files, address), None, "{address}");
        }
        let why = Files::of(&root.join(".hidden")).unwrap_err().to_string();
        assert!(why.contains(".hidden: found a name that is not served"), "{why}");
        #[cfg(unix)]
        {
            std::fs::write(root.join("12:30\\.df"), "x").unwrap();
            assert_eq!(found(&files, "/12:30%5C.df"), Some("12:30\\.df".into()));
        }
        let one = Files::of(&root.join("a b.df")).unwrap();
        assert_eq!((found(&one, "/a%20b.df"), one.address()), (Some("a b.df".into()), "a%20b.df".into()));
        assert_eq!(found(&one, "/steps/0.df"), None);
        assert!(matches!(one.find("/"), Some(Found::Folder(_))) && one.find("/steps/").is_none());
    }
}
