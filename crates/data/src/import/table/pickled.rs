//! Lists of names that Python has pickled by its protocol 0 (<https://docs.python.org/3/library/pickletools.html>), as PyTables writes those of
//! pandas' columns into attributes.

use std::collections::HashMap;
use std::rc::Rc;

/// The most bytes of all names: one that is kept may be told again in three.
const LONGEST: usize = 1 << 22;

/// The names in a list of texts and whole numbers; `None` where it is something else.
pub(super) fn names(bytes: &[u8]) -> Option<Vec<String>> {
    let mut rest = bytes.strip_prefix(b"(l")?;
    let (mut names, mut last, mut kept) = (Vec::<Rc<str>>::new(), None::<Rc<str>>, HashMap::new());
    loop {
        let (kind, behind) = rest.split_first()?;
        rest = behind;
        match kind {
            b'.' => {
                let length = names.iter().map(|name| name.len()).sum::<usize>();
                let is_sound = last.is_none() && length <= LONGEST;
                return is_sound.then(|| names.iter().map(|name| String::from(&**name)).collect());
            }
            b'a' => names.push(last.take()?),
            _ => {
                let end = rest.iter().position(|byte| *byte == b'\n')?;
                let (line, behind) = (&rest[..end], &rest[end + 1..]);
                rest = behind;
                match kind {
                    // What was read last is kept under a number; at first that is the list.
                    b'p' => {
                        if let Some(last) = &last {
                            kept.insert(line, Rc::clone(last));
                        }
                    }
                    _ if last.is_some() => return None,
                    b'g' => last = Some(Rc::clone(kept.get(line)?)),
                    b'V' => last = Some(text(line)?.into()),
                    b'S' => last = Some(quoted(line)?.into()),
                    b'I' | b'L' => last = Some(whole(line)?.into()),
                    _ => return None,
                }
            }
        }
    }
}

/// A text in Latin-1, with other letters as `\u` and four, or `\U` and eight digits.
fn text(line: &[u8]) -> Option<String> {
    let line: String = line.iter().map(|byte| char::from(*byte)).collect();
    let (mut text, mut rest) = (String::new(), &*line);
    while let Some((before, behind)) = rest.split_once('\\') {
        text.push_str(before);
        let (digits, behind) = match behind.split_at_checked(1)? {
            ("u", behind) => behind.split_at_checked(4)?,
            ("U", behind) => behind.split_at_checked(8)?,
            _ => {
                text.push('\\');
                rest = behind;
                continue;
            }
        };
        text.push(char::from_u32(u32::from_str_radix(digits, 16).ok()?)?);
        rest = behind;
    }
    text.push_str(rest);
    Some(text)
}

/// A text in quotes, as Python 2 wrote it.
fn quoted(line: &[u8]) -> Option<String> {
    let line = std::str::from_utf8(line).ok()?;
    let quote = line.chars().next().filter(|quote| matches!(quote, '\'' | '"'))?;
    let inner = line.strip_prefix(quote)?.strip_suffix(quote)?;
    (!inner.contains('\\')).then(|| inner.to_owned())
}

fn whole(line: &[u8]) -> Option<String> {
    let number: i64 = std::str::from_utf8(line).ok()?.trim_end_matches('L').parse().ok()?;
    Some(number.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_of_names_are_read_and_nothing_else() {
        let some = |names: &[&str]| Some(names.iter().map(|name| (*name).to_owned()).collect::<Vec<_>>());
        let cases: [(&[u8], Option<Vec<String>>); 12] = [
            // `pickle.dumps(["x", "é\\\n☉", 5, "x"], 0)`, whose last is the first once more where it is the same object.
            (b"(lp0\nVx\np1\naV\xe9\\u005c\\u000a\\u2609\np2\naI5\nag1\na.", some(&["x", "é\\\n☉", "5", "x"])),
            (b"(lp1\nS'x'\np2\naS\"it's\"\np3\naL7L\na.", some(&["x", "it's", "7"])),
            (b"(lp0\n.", some(&[])),
            (b"(lp0\nV\\U0001F30C\np1\na.", some(&["\u{1f30c}"])),
            (b"(lp0\n(Va\np1\nVx\np2\ntp3\na.", None),
            (b"(lp0\nVx\np1\na", None),
            (b"(lp0\nVx\nVy\na.", None),
            (b"(lp0\nVx\n.", None),
            (b"(lp0\na.", None),
            (b"(lp0\ng7\na.", None),
            (b"(lp0\nV\\ud800\na.", None),
            (b"N.", None),
        ];
        for (bytes, expected) in cases {
            assert_eq!(names(bytes), expected, "{}", String::from_utf8_lossy(bytes));
            // However it ends.
            (0..bytes.len()).for_each(|end| assert_eq!(names(&bytes[..end]), None));
        }
    }

    #[test]
    fn names_that_are_told_again_and_again_are_no_names() {
        let name = "x".repeat(1 << 16);
        let of = |times: usize| names(format!("(lp0\nV{name}\np1\na{}.", "g1\na".repeat(times - 1)).as_bytes());
        assert_eq!(of(64).map(|names| names.len()), Some(64));
        assert_eq!(of(65), None);
    }
}
