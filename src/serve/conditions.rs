//! What requests ask of the version that is there, and which part of it they want (RFC 9110, 13.2.2 and 14).

use super::version::Version;
use crate::model::http_date;
use hyper::HeaderMap;
use hyper::header::{HeaderName, IF_MATCH, IF_MODIFIED_SINCE, IF_NONE_MATCH, IF_RANGE, IF_UNMODIFIED_SINCE, RANGE};
use std::ops::Range;

/// What is answered.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Verdict {
    /// 200: all of it.
    Whole,
    /// 206: these bytes.
    Part(Range<u64>),
    /// 304: the other end has it.
    NotModified,
    /// 412: it is not the version that is meant.
    Failed,
    /// 416: it has none of the bytes.
    Unsatisfiable,
}

/// What a request with these headers is answered; only GET (`takes_ranges`) has parts.
pub(super) fn judge(headers: &HeaderMap, version: &Version, takes_ranges: bool) -> Verdict {
    let has = |name: HeaderName| headers.contains_key(name);
    let since = |name: HeaderName| one(headers, name).and_then(http_date::read);
    if has(IF_MATCH) {
        if !tags(headers, IF_MATCH).any(|tag| tag == "*" || tag == version.tag) {
            return Verdict::Failed;
        }
    } else if let (Some(date), Some(modified)) = (since(IF_UNMODIFIED_SINCE), version.modified)
        && modified > date
    {
        return Verdict::Failed;
    }
    if has(IF_NONE_MATCH) {
        let is_same = |tag: &str| tag == "*" || tag.strip_prefix("W/").unwrap_or(tag) == version.tag;
        if tags(headers, IF_NONE_MATCH).any(is_same) {
            return Verdict::NotModified;
        }
    } else if let (Some(date), Some(modified)) = (since(IF_MODIFIED_SINCE), version.modified)
        && modified <= date
    {
        return Verdict::NotModified;
    }
    let is_meant = match one(headers, IF_RANGE) {
        None => !has(IF_RANGE),
        Some(said) => said == version.tag || version.date().is_some_and(|date| date == said),
    };
    match one(headers, RANGE).filter(|_| takes_ranges && is_meant) {
        Some(said) => part(said, version.length),
        None => Verdict::Whole,
    }
}

/// The value of a field that stands there once.
fn one(headers: &HeaderMap, name: HeaderName) -> Option<&str> {
    let mut values = headers.get_all(name).iter();
    let first = values.next()?.to_str().ok()?;
    values.next().is_none().then_some(first.trim())
}

/// The entity tags of a field. Our own has no comma.
fn tags(headers: &HeaderMap, name: HeaderName) -> impl Iterator<Item = &str> {
    let values = headers.get_all(name).iter().filter_map(|value| value.to_str().ok());
    values.flat_map(|value| value.split(',')).map(str::trim)
}

/// What is answered to `Range`, of a file of `length` bytes. What is no range, and several of them, are passed over: all of it is answered.
fn part(said: &str, length: u64) -> Verdict {
    let Some((unit, set)) = said.split_once('=') else { return Verdict::Whole };
    let Some((first, last)) = set.trim().split_once('-') else { return Verdict::Whole };
    let is_number = |text: &str| text.bytes().all(|byte| byte.is_ascii_digit());
    if !unit.eq_ignore_ascii_case("bytes") || !is_number(first) || !is_number(last) {
        return Verdict::Whole;
    }
    // More digits than fit are more bytes than any file has.
    let number = |text: &str| text.parse::<u64>().unwrap_or(u64::MAX);
    let range = match (first.is_empty(), last.is_empty()) {
        (true, true) => return Verdict::Whole,
        (true, false) => length.saturating_sub(number(last))..length,
        (false, true) => number(first)..length,
        (false, false) if number(last) < number(first) => return Verdict::Whole,
        (false, false) => number(first)..number(last).saturating_add(1).min(length),
    };
    if range.is_empty() { Verdict::Unsatisfiable } else { Verdict::Part(range) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hyper::header::HeaderValue;

    const DATE: &str = "Sun, 06 Nov 1994 08:49:37 GMT";

    fn judged(fields: &[(HeaderName, &str)]) -> Verdict {
        let version = Version { length: 100, modified: http_date::read(DATE), tag: "\"64-1\"".into() };
        let mut headers = HeaderMap::new();
        for (name, value) in fields {
            headers.append(name, HeaderValue::from_str(value).unwrap());
        }
        judge(&headers, &version, true)
    }

    #[test]
    fn ranges_are_those_of_the_standard() {
        let rows = [
            ("bytes=0-0", Verdict::Part(0..1)),
            ("Bytes=10-", Verdict::Part(10..100)),
            ("bytes=10-999999999999999999999999", Verdict::Part(10..100)),
            ("bytes=-7", Verdict::Part(93..100)),
            ("bytes=-700", Verdict::Part(0..100)),
            ("bytes=99-99", Verdict::Part(99..100)),
            ("bytes=100-", Verdict::Unsatisfiable),
            ("bytes=999999999999999999999999-", Verdict::Unsatisfiable),
            ("bytes=-0", Verdict::Unsatisfiable),
            ("bytes=7-3", Verdict::Whole),
            ("bytes=0-1,5-6", Verdict::Whole),
            ("bytes=-", Verdict::Whole),
            ("bytes=+1-2", Verdict::Whole),
            ("pages=0-1", Verdict::Whole),
            ("bytes", Verdict::Whole),
        ];
        for (said, expected) in rows {
            assert_eq!(judged(&[(RANGE, said)]), expected, "{said}");
        }
        assert_eq!(part("bytes=-5", 0), Verdict::Unsatisfiable);
        assert_eq!(judged(&[(RANGE, "bytes=0-1"), (RANGE, "bytes=2-3")]), Verdict::Whole);
    }

    #[test]
    fn conditions_go_in_the_order_of_the_standard() {
        let (early, late) = ("Sat, 05 Nov 1994 08:49:37 GMT", "Mon, 07 Nov 1994 08:49:37 GMT");
        let (own, other, range) = ("\"64-1\"", "\"64-2\"", (RANGE, "bytes=1-2"));
        let part = Verdict::Part(1..3);
        let rows = [
            (vec![(IF_MATCH, own), range.clone()], part.clone()),
            (vec![(IF_MATCH, "\"a\", \"64-1\""), (IF_UNMODIFIED_SINCE, early)], Verdict::Whole),
            (vec![(IF_MATCH, "*")], Verdict::Whole),
            (vec![(IF_MATCH, other), (IF_NONE_MATCH, own)], Verdict::Failed),
            // A weak tag is no match for a version that must be the same byte by byte.
            (vec![(IF_MATCH, "W/\"64-1\"")], Verdict::Failed),
            (vec![(IF_UNMODIFIED_SINCE, early)], Verdict::Failed),
            (vec![(IF_UNMODIFIED_SINCE, DATE), range.clone()], part.clone()),
            (vec![(IF_NONE_MATCH, "W/\"64-1\""), range.clone()], Verdict::NotModified),
            (vec![(IF_NONE_MATCH, other), (IF_MODIFIED_SINCE, late)], Verdict::Whole),
            (vec![(IF_MODIFIED_SINCE, DATE)], Verdict::NotModified),
            (vec![(IF_MODIFIED_SINCE, early)], Verdict::Whole),
            (vec![(IF_MODIFIED_SINCE, "yesterday")], Verdict::Whole),
            (vec![(IF_RANGE, own), range.clone()], part.clone()),
            (vec![(IF_RANGE, DATE), range.clone()], part),
            (vec![(IF_RANGE, other), range.clone()], Verdict::Whole),
            (vec![(IF_RANGE, late), range], Verdict::Whole),
        ];
        for (fields, expected) in rows {
            assert_eq!(judged(&fields), expected, "{fields:?}");
        }
    }
}
