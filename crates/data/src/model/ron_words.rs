//! Words with hyphens in RON (`side-by-side`): RON itself takes them as `r#side-by-side` alone, which nobody thinks of.

use std::borrow::Cow;

/// What RON wants before a word with hyphens.
const MARK: &str = "r#";

/// RON text whose words with hyphens are marked, and where that was done.
pub(super) struct Marked<'a> {
    /// The text for RON.
    pub text: Cow<'a, str>,
    /// Bytes of the text as it was that a mark stands before now, in their order.
    marks: Vec<usize>,
}

impl<'a> Marked<'a> {
    /// Marks a text's words. What is in quotes or in comments, and what is marked already, stays as it is.
    pub fn new(text: &'a str) -> Marked<'a> {
        let bytes = text.as_bytes();
        let mut marks = Vec::new();
        let mut at = 0;
        while let Some(first) = bytes.get(at) {
            let rest = &bytes[at..];
            at += match first {
                b'"' => string(rest),
                b'\'' => character(rest),
                b'/' => comment(rest),
                first if is_word(*first) => {
                    let word = &rest[..word(rest)];
                    if has_hyphen(word) {
                        marks.push(at);
                    }
                    if matches!(word, b"r" | b"br") { raw(rest, word.len()) } else { word.len() }
                }
                _ => 1,
            };
        }
        if marks.is_empty() {
            return Marked { text: Cow::Borrowed(text), marks };
        }
        let mut marked = String::with_capacity(text.len() + marks.len() * MARK.len());
        let mut from = 0;
        for mark in &marks {
            marked.push_str(&text[from..*mark]);
            marked.push_str(MARK);
            from = *mark;
        }
        marked.push_str(&text[from..]);
        Marked { text: Cow::Owned(marked), marks }
    }

    /// Where a column of a line of the marked text (both from 1) is in the `text` as it was.
    pub fn column(&self, text: &str, line: usize, mut column: usize) -> usize {
        let start: usize = text.split_inclusive('\n').take(line.saturating_sub(1)).map(str::len).sum();
        for mark in self.marks.iter().filter(|mark| **mark >= start) {
            let at = 1 + text[start..*mark].chars().count();
            if column <= at {
                break;
            }
            column -= MARK.len().min(column - at);
        }
        column
    }
}

/// Whether a byte may be in a word of RON, or in a number; those of letters beyond ASCII may.
fn is_word(byte: u8) -> bool {
    byte.is_ascii_alphanumeric() || matches!(byte, b'_' | b'-' | b'.' | b'+') || !byte.is_ascii()
}

/// Bytes of a word at the beginning.
fn word(bytes: &[u8]) -> usize {
    bytes.iter().take_while(|byte| is_word(**byte)).count()
}

/// Whether a word is one with hyphens, and no number (`1e-3`, `-inf`).
fn has_hyphen(word: &[u8]) -> bool {
    let is_name = |byte: &u8| byte.is_ascii_alphanumeric() || matches!(byte, b'_' | b'-');
    let begins = word.first().is_some_and(|first| first.is_ascii_alphabetic() || *first == b'_');
    begins && word.contains(&b'-') && word.iter().all(is_name)
}

/// Bytes of a string at the beginning, with its quotes.
fn string(bytes: &[u8]) -> usize {
    let mut is_escaped = false;
    let end = bytes.iter().skip(1).position(|byte| {
        let ends = *byte == b'"' && !is_escaped;
        is_escaped = *byte == b'\\' && !is_escaped;
        ends
    });
    end.map_or(bytes.len(), |end| end + 2)
}

/// Bytes of a character at the beginning, with its quotes. It may be a quote itself.
fn character(bytes: &[u8]) -> usize {
    let inner = if bytes.get(1) == Some(&b'\\') { 3 } else { 2 };
    let end = bytes.iter().skip(inner).position(|byte| *byte == b'\'');
    end.map_or(bytes.len(), |end| inner + end + 1)
}

/// Bytes of a comment at the beginning; of a stroke that begins none its own.
fn comment(bytes: &[u8]) -> usize {
    if bytes.starts_with(b"//") {
        return bytes.iter().position(|byte| *byte == b'\n').unwrap_or(bytes.len());
    }
    let (mut depth, mut at) = (0_usize, 0);
    loop {
        match bytes.get(at..at + 2) {
            Some(b"/*") => (depth, at) = (depth + 1, at + 2),
            Some(b"*/") if depth > 1 => (depth, at) = (depth - 1, at + 2),
            Some(b"*/") => return at + 2,
            _ if depth == 0 => return 1,
            Some(_) => at += 1,
            None => return bytes.len(),
        }
    }
}

/// Bytes of a raw string (`r"..."`, `r##"..."##`) or a marked word whose `prefix` is so long; of a prefix alone its own.
fn raw(bytes: &[u8], prefix: usize) -> usize {
    let hashes = bytes[prefix..].iter().take_while(|byte| **byte == b'#').count();
    let open = prefix + hashes;
    if bytes.get(open) != Some(&b'"') {
        return open + word(&bytes[open..]);
    }
    let mut ends = bytes[open + 1..].windows(hashes + 1);
    let end = ends.position(|end| end[0] == b'"' && end[1..].iter().all(|byte| *byte == b'#'));
    end.map_or(bytes.len(), |end| open + 1 + end + hashes + 1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn words_with_hyphens_are_marked_and_nothing_else_is() {
        for (text, marked) in [
            ("(eyes: side-by-side, kind: off-axis)", "(eyes: r#side-by-side, kind: r#off-axis)"),
            ("[gas,black-holes]", "[gas,r#black-holes]"),
            ("(kind: r#off-axis)", "(kind: r#off-axis)"),
            ("a-b(c-d: -1.5e-3, e: -inf)", "r#a-b(r#c-d: -1.5e-3, e: -inf)"),
            (r#"("a-b", 'c', a-b)"#, r#"("a-b", 'c', r#a-b)"#),
            (r#"("a\"a-b", '\'', ''', '"', a-b)"#, r#"("a\"a-b", '\'', ''', '"', r#a-b)"#),
            (
                r###"(r"a\", a-b, r#"a-b"a-b"#, b"a-b", br"a-b")"###,
                r###"(r"a\", r#a-b, r#"a-b"a-b"#, b"a-b", br"a-b")"###,
            ),
            ("// a-b \"\n/* a-b /* ' */ a-b */ a-b / a-b", "// a-b \"\n/* a-b /* ' */ a-b */ r#a-b / r#a-b"),
            ("ä-b: 3, (\u{2014}a-b)", "ä-b: 3, (\u{2014}a-b)"),
            ("/", "/"),
            ("/*", "/*"),
            ("\"a-b", "\"a-b"),
            ("r#", "r#"),
        ] {
            assert_eq!(Marked::new(text).text, marked);
        }
    }

    #[test]
    fn columns_are_those_of_the_text_as_it_was() {
        let text = "(x: a-b,\n ä: c-d, e: f-g, h)\n";
        let marked = Marked::new(text);
        for (line, now, was) in
            [(1, 4, 4), (1, 5, 5), (1, 6, 5), (1, 7, 5), (1, 8, 6), (2, 2, 2), (2, 5, 5), (2, 8, 6), (2, 18, 14)]
        {
            assert_eq!(marked.column(text, line, now), was, "{line}:{now}");
        }
        // Its letter of two bytes makes up for counting from 1.
        let of = |text: &str| text.lines().nth(1).unwrap().find('h').unwrap();
        assert_eq!(marked.column(text, 2, of(&marked.text)), of(text));
    }

    proptest! {
        #[test]
        fn whatever_it_is_only_marks_come_in(text in r#"[ab\-1.'"\\/*#r(:,)ä\n ]{0,40}"#) {
            let marked = Marked::new(&text);
            let mut rest: &str = &marked.text;
            let mut from = 0;
            for mark in marked.marks.iter().copied() {
                rest = rest.strip_prefix(&text[from..mark]).unwrap().strip_prefix(MARK).unwrap();
                from = mark;
            }
            prop_assert_eq!(rest, &text[from..]);
            if let Ok(value) = ron::from_str::<ron::Value>(&text) {
                prop_assert_eq!(ron::from_str::<ron::Value>(&marked.text), Ok(value), "valid RON means the same");
            }
        }
    }
}
