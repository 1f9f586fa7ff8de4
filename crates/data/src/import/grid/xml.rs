//! The tags of an XML file, read as far as appended bytes, whatever is between them: no more of it is held than one tag.

use super::content::Content;
use crate::import::ImportError;
use std::io::{BufRead, BufReader, Read};

/// The longest tag, and the most of them.
const LONGEST: u64 = 1 << 14;
const MOST: usize = 1 << 14;

/// A tag: `name` with its attributes, or `/name`.
pub(in crate::import) struct Element {
    pub name: String,
    attributes: Vec<(String, String)>,
    /// The byte behind it.
    pub end: u64,
    /// Bytes from there to the next tag.
    pub text: u64,
}

impl Element {
    /// An attribute.
    pub(in crate::import) fn get(&self, name: &str) -> Option<&str> {
        self.attributes.iter().find(|(known, _)| known == name).map(|(_, value)| &**value)
    }
}

/// All tags up to `AppendedData`, behind which anything may be.
///
/// # Errors
/// When the file cannot be read, or is no XML.
pub(in crate::import) fn elements(content: &Content) -> Result<Vec<Element>, ImportError> {
    let path = &content.path;
    let io = |error| ImportError::io(path, "XML", error);
    let mut reader = BufReader::with_capacity(1 << 18, content.reader(0)?);
    let mut found: Vec<Element> = Vec::new();
    let mut at = 0;
    loop {
        let skipped = reader.skip_until(b'<').map_err(io)? as u64;
        at += skipped;
        if let Some(last) = found.last_mut() {
            last.text = skipped.saturating_sub(1);
        }
        if skipped == 0 {
            return Ok(found);
        }
        let mut tag = Vec::new();
        // A comment ends with -->, and may hold what looks like tags.
        loop {
            let read = (&mut reader).take(LONGEST).read_until(b'>', &mut tag).map_err(io)? as u64;
            at += read;
            if read == 0 || !tag.starts_with(b"!--") || tag.ends_with(b"-->") || tag.len() as u64 > LONGEST {
                break;
            }
        }
        let text = String::from_utf8_lossy(&tag);
        let Some(text) = text.strip_suffix('>') else {
            // What is left of a file that was cut.
            return Ok(found);
        };
        if text.starts_with(['!', '?']) {
            continue;
        }
        if found.len() == MOST {
            return Err(ImportError::malformed(path, "XML", format!("more than {MOST} tags"), "fewer"));
        }
        let text = text.trim_end_matches('/');
        let (name, rest) = text.split_once(char::is_whitespace).unwrap_or((text, ""));
        let name = name.to_owned();
        let is_last = name == "AppendedData";
        found.push(Element { name, attributes: attributes(rest), end: at, text: 0 });
        if is_last {
            return Ok(found);
        }
    }
}

/// `name="value"` one behind the other.
fn attributes(mut text: &str) -> Vec<(String, String)> {
    let mut found = Vec::new();
    while let Some((name, rest)) = text.split_once('=') {
        let rest = rest.trim_start();
        let Some(quote) = rest.chars().next().filter(|quote| ['"', '\''].contains(quote)) else { break };
        let Some((value, after)) = rest[1..].split_once(quote) else { break };
        found.push((name.trim().to_owned(), value.to_owned()));
        text = after;
    }
    found
}
