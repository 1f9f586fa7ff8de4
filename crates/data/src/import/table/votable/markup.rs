//! An XML file tag by tag. No more of it is held than one tag and the text before it, and of both there is a longest: readers of whole
//! documents and of events hold a text of any length, such as all rows in base64, before anybody sees it.

use crate::import::ImportError;
use std::io::{BufRead, Read};
use std::path::{Path, PathBuf};

/// The longest tag, bytes.
const LONGEST_TAG: u64 = 1 << 16;

/// The longest text between two tags, bytes.
const LONGEST_TEXT: u64 = 1 << 20;

/// The longest reference to a character, bytes with its end.
const LONGEST_REFERENCE: usize = 12;

/// A file, and the tag at which it is.
pub(super) struct Markup {
    path: PathBuf,
    reader: Box<dyn BufRead>,
    /// What stands between `<` and `>`.
    tag: Vec<u8>,
    /// The text before the tag.
    text: String,
    raw: Vec<u8>,
}

impl Markup {
    pub(super) fn new(path: &Path, reader: Box<dyn BufRead>) -> Markup {
        Markup { path: path.into(), reader, tag: Vec::new(), text: String::new(), raw: Vec::new() }
    }

    /// Goes on to the next tag; false at the end of the file. The text before it is kept where `keep` says so.
    ///
    /// # Errors
    /// When the file cannot be read, or a tag or a text that is kept is too long.
    pub(super) fn next(&mut self, keep: bool) -> Result<bool, ImportError> {
        self.text.clear();
        loop {
            if !self.read_text(keep)? {
                return Ok(false);
            }
            self.tag.clear();
            self.read_tag()?;
            if self.tag.starts_with(b"!--") {
                self.skip_to(b"-->", 6)?;
            } else if self.tag.starts_with(b"![CDATA[") {
                self.read_characters(keep)?;
            } else if self.tag.starts_with(b"?") {
                self.skip_to(b"?>", 2)?;
            } else if !self.tag.starts_with(b"!") {
                self.tag.pop();
                return Ok(true);
            }
        }
    }

    /// Reads up to the next `<`; false at the end of the file.
    fn read_text(&mut self, keep: bool) -> Result<bool, ImportError> {
        let io = |error| ImportError::io(&self.path, "XML", error);
        if !keep {
            // Without a `<` there is nothing behind what was skipped.
            let skipped = self.reader.skip_until(b'<').map_err(io)?;
            return Ok(skipped > 0 && !self.reader.fill_buf().map_err(io)?.is_empty());
        }
        self.raw.clear();
        let read = (&mut self.reader).take(LONGEST_TEXT).read_until(b'<', &mut self.raw).map_err(io)? as u64;
        if self.raw.pop_if(|last| *last == b'<').is_some() {
            decode(&self.raw, &mut self.text);
            return Ok(true);
        }
        if read == LONGEST_TEXT {
            return Err(self.too_long("text", LONGEST_TEXT));
        }
        Ok(false)
    }

    /// Reads up to the `>` that ends a tag, behind that of any value in quotes.
    fn read_tag(&mut self) -> Result<(), ImportError> {
        loop {
            self.read_part()?;
            let is_special = self.tag.starts_with(b"!") || self.tag.starts_with(b"?");
            if is_special || !is_in_quotes(&self.tag) {
                return Ok(());
            }
        }
    }

    /// Appends to the tag up to the next `>`.
    fn read_part(&mut self) -> Result<(), ImportError> {
        let left = LONGEST_TAG.saturating_sub(self.tag.len() as u64);
        let read = (&mut self.reader).take(left).read_until(b'>', &mut self.tag);
        let read = read.map_err(|error| ImportError::io(&self.path, "XML", error))?;
        // A part that was there before may end with one, too.
        if read > 0 && self.tag.ends_with(b">") {
            return Ok(());
        }
        if self.tag.len() as u64 >= LONGEST_TAG {
            return Err(self.too_long("tag", LONGEST_TAG));
        }
        Err(ImportError::malformed(&self.path, "XML", "the file's end in a tag", "its end"))
    }

    /// Goes on to the end of what is no tag, which has at least so many bytes; none of it is held.
    fn skip_to(&mut self, end: &[u8], mut least: usize) -> Result<(), ImportError> {
        while self.tag.len() < least || !self.tag.ends_with(end) {
            // Every part ends with `>`, so that its end does not lie across two.
            self.tag.clear();
            least = 0;
            self.read_part()?;
        }
        Ok(())
    }

    /// Reads characters that stand for themselves.
    fn read_characters(&mut self, keep: bool) -> Result<(), ImportError> {
        while !self.tag.ends_with(b"]]>") {
            self.read_part()?;
        }
        let characters = self.tag.strip_prefix(b"![CDATA[").and_then(|rest| rest.strip_suffix(b"]]>"));
        if keep {
            self.text.push_str(&String::from_utf8_lossy(characters.unwrap_or_default()));
        }
        // Many such parts make one text.
        if self.text.len() as u64 > LONGEST_TEXT { Err(self.too_long("text", LONGEST_TEXT)) } else { Ok(()) }
    }

    fn too_long(&self, what: &str, most: u64) -> ImportError {
        ImportError::malformed(&self.path, "XML", format!("a {what} of more than {most} bytes"), "a shorter one")
    }

    /// Whether the tag ends an element.
    pub(super) fn is_end(&self) -> bool {
        self.tag.starts_with(b"/")
    }

    /// Whether the tag is that of an element without content.
    pub(super) fn is_empty(&self) -> bool {
        self.tag.ends_with(b"/")
    }

    /// The name of the element, without that of a name space.
    pub(super) fn name(&self) -> &[u8] {
        let tag = self.tag.strip_prefix(b"/").unwrap_or(&self.tag);
        let end = tag.iter().position(|byte| byte.is_ascii_whitespace() || *byte == b'/').unwrap_or(tag.len());
        tag[..end].rsplit(|byte| *byte == b':').next().unwrap_or_default()
    }

    /// The text before the tag.
    pub(super) fn text(&self) -> &str {
        &self.text
    }

    /// An attribute of the tag.
    pub(super) fn attribute(&self, name: &str) -> Option<String> {
        let tag = String::from_utf8_lossy(&self.tag);
        let (_, mut rest) = tag.split_once(char::is_whitespace)?;
        while let Some((key, after)) = rest.split_once('=') {
            let after = after.trim_start();
            let quote = after.chars().next().filter(|quote| ['"', '\''].contains(quote))?;
            let (value, behind) = after[1..].split_once(quote)?;
            if key.trim() == name {
                let mut decoded = String::new();
                decode(value.as_bytes(), &mut decoded);
                return Some(decoded);
            }
            rest = behind;
        }
        None
    }

    /// What stands behind the tag.
    pub(super) fn into_reader(self) -> Box<dyn BufRead> {
        self.reader
    }
}

/// Whether a value in quotes goes on behind the end of `tag`.
fn is_in_quotes(tag: &[u8]) -> bool {
    let mut open = None;
    for byte in tag {
        match open {
            Some(quote) if quote == *byte => open = None,
            None if matches!(byte, b'"' | b'\'') => open = Some(*byte),
            _ => {}
        }
    }
    open.is_some()
}

/// Adds a text with its references to characters decoded; those that are not known stay as they are.
fn decode(raw: &[u8], text: &mut String) {
    let raw = String::from_utf8_lossy(raw);
    let mut rest = &*raw;
    while let Some((before, after)) = rest.split_once('&') {
        text.push_str(before);
        let end = after.bytes().take(LONGEST_REFERENCE).position(|byte| byte == b';');
        let reference = end.and_then(|end| Some((character(&after[..end])?, &after[end + 1..])));
        match reference {
            Some((letter, behind)) => {
                text.push(letter);
                rest = behind;
            }
            None => {
                text.push('&');
                rest = after;
            }
        }
    }
    text.push_str(rest);
}

/// The character that a reference names.
fn character(name: &str) -> Option<char> {
    match name {
        "lt" => Some('<'),
        "gt" => Some('>'),
        "amp" => Some('&'),
        "quot" => Some('"'),
        "apos" => Some('\''),
        _ => {
            let number = name.strip_prefix('#')?;
            let code = match number.strip_prefix('x') {
                Some(digits) => u32::from_str_radix(digits, 16),
                None => number.parse(),
            };
            char::from_u32(code.ok()?)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every tag with the text before it.
    fn tags(text: &'static str) -> Result<Vec<String>, ImportError> {
        let mut markup = Markup::new(Path::new("t.vot"), Box::new(text.as_bytes()));
        let mut found = Vec::new();
        while markup.next(true)? {
            let end = if markup.is_end() { "/" } else { "" };
            found.push(format!("{}<{end}{}", markup.text(), String::from_utf8_lossy(markup.name())));
        }
        Ok(found)
    }

    #[test]
    fn tags_and_texts_come_in_their_order() {
        let text = "<?xml version='1.0'?><!DOCTYPE a><!-- <b> -- > <c --><v:a n=\"x>y\">1 &lt; &#50;&#x33;&no;<![CDATA[<d>]]>!\
            <e f = 'g'/></v:a><!-->--> tail";
        assert_eq!(tags(text).unwrap(), ["<a", "1 < 23&no;<d>!<e", "</a"]);
        let mut markup = Markup::new(Path::new("t.vot"), Box::new(&b"<a b='&quot;' c=\"d\ne\" b='no'/>"[..]));
        assert!(markup.next(false).unwrap() && markup.is_empty());
        assert_eq!(markup.attribute("b").as_deref(), Some("\""));
        assert_eq!(markup.attribute("c").as_deref(), Some("d\ne"));
        assert_eq!(markup.attribute("d"), None);
    }

    #[test]
    fn what_has_no_end_is_an_error() {
        for text in ["<a", "<a b='>", "<!-- ", "<![CDATA[x", "<?x>"] {
            assert!(tags(text).is_err(), "{text}");
        }
        let long = format!("<a>{}</a>", "x".repeat(LONGEST_TEXT as usize + 5));
        assert!(tags(long.leak()).unwrap_err().to_string().contains("a text of more than"));
    }
}
