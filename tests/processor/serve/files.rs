//! Files by HTTP: parts of them, versions, what is not served, who may read, and ends that are slow.

use super::client::{Answer, asked, connected, on, serving};
use crate::cases::cases;
use crate::support::Random;
use deepfield::serve::{Certificate, Files, Offer, Running, ServeOptions, Server, Token};
use proptest::prelude::*;
use proptest::test_runner::TestRunner;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{Read, Write};
use std::net::SocketAddr;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant, SystemTime};

const TOKEN: &str = "a-token-of-the-tests";

fn folder(path: &Path, options: ServeOptions) -> Running {
    serving(options, Offer::Files(Files::of(path).unwrap()))
}

fn get(server: &Running, path: &str, headers: &[&str]) -> Answer {
    asked(server.address(), &format!("GET {path}"), headers, b"")
}

/// Bytes that differ everywhere.
fn content(length: usize) -> Vec<u8> {
    let mut random = Random(7);
    (0..length).map(|_| random.whole() as u8).collect()
}

#[test]
fn parts_are_the_bytes_of_the_file() {
    let data = tempfile::tempdir().unwrap();
    // More than two of the pieces that are read at a time.
    let bytes = content(600_000);
    std::fs::write(data.path().join("a b.df"), &bytes).unwrap();
    let server = folder(data.path(), ServeOptions { allow_origin: Some("*".into()), ..ServeOptions::default() });
    let length = bytes.len() as u64;
    let whole = get(&server, "/a%20b.df", &[]);
    assert_eq!((whole.status, &whole.body), (200, &bytes));
    assert_eq!((whole.header("accept-ranges"), whole.header("content-length")), ("bytes", "600000"));
    assert_eq!(
        (whole.header("content-type"), whole.header("access-control-allow-origin")),
        ("application/octet-stream", "*")
    );
    let place = || prop_oneof![0..length + 1000, Just(0), Just(length - 1), Just(length), Just(u64::MAX)];
    let mut runner = TestRunner::new(cases(60));
    let ranges = (place(), place(), 0..3);
    runner
        .run(&ranges, |(first, last, form)| {
            // As the standard says it: the bytes at the places that are asked for.
            let (said, wanted, is_range) = match form {
                0 => (format!("{first}-{last}"), first..=last, first <= last),
                1 => (format!("{first}-"), first..=u64::MAX, true),
                _ => (format!("-{first}"), length.saturating_sub(first)..=u64::MAX, true),
            };
            let found: Vec<u8> = (0..length).filter(|at| wanted.contains(at)).map(|at| bytes[at as usize]).collect();
            let answer = get(&server, "/a%20b.df", &[&format!("Range: bytes={said}")]);
            match (is_range, found.is_empty()) {
                (false, _) => prop_assert_eq!((answer.status, answer.body.len()), (200, bytes.len())),
                (true, true) => {
                    prop_assert_eq!((answer.status, answer.header("content-range")), (416, "bytes */600000"));
                }
                (true, false) => {
                    let from = wanted.start();
                    let to = from + found.len() as u64 - 1;
                    prop_assert_eq!(answer.header("content-range"), format!("bytes {from}-{to}/600000"));
                    prop_assert_eq!(answer.header("content-length"), found.len().to_string());
                    prop_assert!(answer.status == 206 && answer.body == found, "{said}");
                }
            }
            Ok(())
        })
        .unwrap();
}

#[test]
fn a_version_is_told_from_another() {
    let data = tempfile::tempdir().unwrap();
    let path = data.path().join("a.df");
    let mut bytes = content(5000);
    bytes[..8].copy_from_slice(b"\x89DFP\r\n\x1a\n");
    bytes[40..44].copy_from_slice(&0xdead_beef_u32.to_le_bytes());
    let day = SystemTime::UNIX_EPOCH + Duration::from_secs(784_111_777);
    let write = |bytes: &[u8]| {
        std::fs::write(&path, bytes).unwrap();
        File::options().write(true).open(&path).unwrap().set_modified(day).unwrap();
    };
    write(&bytes);
    let server = folder(data.path(), ServeOptions::default());
    let first = get(&server, "/a.df", &[]);
    let tag = first.header("etag").to_owned();
    assert!(tag.starts_with('"') && tag.ends_with("-deadbeef\""), "{tag}");
    assert_eq!(first.header("last-modified"), "Sun, 06 Nov 1994 08:49:37 GMT");
    let head = asked(server.address(), "HEAD /a.df", &["Range: bytes=0-9"], b"");
    assert_eq!((head.status, head.header("content-length"), head.body.len()), (200, "5000", 0));
    let same = get(&server, "/a.df", &[&format!("If-None-Match: {tag}")]);
    assert_eq!((same.status, same.body.len(), same.header("etag")), (304, 0, &*tag));
    let condition = format!("If-Match: {tag}");
    let meant = [&*condition, "Range: bytes=1-2"];
    assert_eq!((get(&server, "/a.df", &meant).status, get(&server, "/a.df", &meant).body), (206, bytes[1..3].to_vec()));
    // Another footer, of the same length and, as far as the system knows, the same time.
    bytes[40] ^= 1;
    write(&bytes);
    let other = get(&server, "/a.df", &meant);
    assert_eq!((other.status, other.header("etag") == tag), (412, false));
    // So it is of runs, of images and volumes, and of heights.
    for kind in *b"PSGH" {
        bytes[3] = kind;
        write(&bytes);
        let tag = get(&server, "/a.df", &[]).header("etag").to_owned();
        assert!(tag.ends_with("-deadbeee\""), "{tag}");
    }
    let whole = get(&server, "/a.df", &[&format!("If-Range: {tag}"), "Range: bytes=1-2"]);
    assert_eq!((whole.status, whole.body), (200, bytes));
    // Written by a clock that is ahead: the tag tells.
    let tomorrow = SystemTime::now() + Duration::from_secs(86_400);
    File::options().write(true).open(&path).unwrap().set_modified(tomorrow).unwrap();
    let ahead = get(&server, "/a.df", &[]);
    assert!(ahead.header("last-modified").is_empty() && ahead.header("etag").ends_with("-deadbeee\""), "{ahead:?}");
}

#[test]
fn only_what_is_served_is_found() {
    let around = tempfile::tempdir().unwrap();
    let data = around.path().join("data");
    std::fs::create_dir_all(data.join("steps")).unwrap();
    std::fs::write(around.path().join("secret"), "s3cret").unwrap();
    std::fs::write(data.join(".hidden"), "s3cret").unwrap();
    std::fs::write(data.join("a&b.df"), b"\x89DFP\r\n\x1a\n and more").unwrap();
    std::fs::write(data.join("notes.txt"), "plain").unwrap();
    #[cfg(unix)]
    std::os::unix::fs::symlink("../secret", data.join("link")).unwrap();
    let server = folder(&data, ServeOptions::default());
    for path in
        ["/../secret", "/%2e%2e/secret", "/..%2fsecret", "/steps/../../secret", "/.hidden", "/link", "/none", "/%00"]
    {
        let answer = get(&server, path, &[]);
        assert!(matches!(answer.status, 400 | 404) && !answer.text().contains("s3cret"), "{path}: {answer:?}");
    }
    let index = get(&server, "/", &[]);
    let text = index.text();
    assert!(text.contains("<a href=\"./a%26b.df\">a&amp;b.df</a><td>17 B") && text.contains("./steps/"), "{text}");
    assert!(!text.contains("notes.txt") && !text.contains("hidden") && !text.contains("<script"), "{text}");
    assert!(index.header("content-security-policy").contains("default-src 'none'"));
    assert_eq!(get(&server, "/notes.txt", &[]).text(), "plain");
    let moved = get(&server, "/steps", &[]);
    assert_eq!((moved.status, moved.header("location")), (308, "./steps/"));
    let post = asked(server.address(), "POST /notes.txt", &[], b"x");
    assert_eq!((post.status, post.header("allow")), (405, "GET, HEAD"));
    let before = asked(server.address(), "OPTIONS /notes.txt", &["Origin: https://example.org"], b"");
    assert!(before.status == 204 && before.header("access-control-allow-headers").contains("range"), "{before:?}");
}

#[test]
fn pages_of_other_sites_read_nothing_that_they_are_not_let() {
    let data = tempfile::tempdir().unwrap();
    std::fs::write(data.path().join("a.txt"), "plain").unwrap();
    let status = |server: &Running, host: &str, fetched: &[&str]| {
        let lines: String = fetched.iter().map(|line| format!("{line}\r\n")).collect();
        let mut stream = connected(server.address());
        write!(stream, "GET /a.txt HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n{lines}\r\n").unwrap();
        let mut said = Vec::new();
        let _ = stream.read_to_end(&mut said);
        let answer = Answer::parsed(&said);
        assert_eq!(answer.status == 200, answer.text() == "plain", "{answer:?}");
        (answer.status, answer.header("access-control-allow-origin").to_owned())
    };
    let (asks, image, goes) = ("Sec-Fetch-Site: cross-site", "Sec-Fetch-Dest: image", "Sec-Fetch-Dest: document");
    let default = ServeOptions::default;
    let own = folder(data.path(), default());
    for host in ["localhost", "LOCALHOST:8080", "a.localhost.", "127.0.0.1:80", "[::1]:80", "192.168.0.7"] {
        assert_eq!(status(&own, host, &[]), (200, String::new()), "{host}");
    }
    // A name of theirs that leads here, and a page of theirs in a browser of this machine.
    for host in ["example.org:8080", "localhost.example.org", "127.0.0.1.example.org", "", "a b"] {
        assert!(matches!(status(&own, host, &[]).0, 400 | 421), "{host}");
    }
    assert_eq!(status(&own, "localhost", &[asks, image]).0, 403);
    assert_eq!(status(&own, "localhost", &["Sec-Fetch-Site: same-site"]).0, 403);
    assert_eq!(status(&own, "localhost", &[asks, goes]).0, 200);
    assert_eq!(status(&own, "localhost", &["Sec-Fetch-Site: same-origin", image]).0, 200);
    let insecure = folder(data.path(), ServeOptions { is_insecure: true, ..default() });
    assert_eq!(status(&insecure, "example.org", &[]).0, 200);
    let origin = "https://example.org";
    let let_in = folder(data.path(), ServeOptions { allow_origin: Some(origin.into()), ..default() });
    assert_eq!(status(&let_in, "localhost", &[asks, image]), (200, origin.to_owned()));
}

#[test]
fn the_token_opens_and_nothing_else() {
    let data = tempfile::tempdir().unwrap();
    std::fs::write(data.path().join("a.txt"), "plain").unwrap();
    let token = Some(Token::new(TOKEN).unwrap());
    let server = folder(data.path(), ServeOptions { token: token.clone(), ..ServeOptions::default() });
    let welcome = get(&server, &format!("//evil/a.txt?token={TOKEN}&x=1"), &[]);
    let cookie = welcome.header("set-cookie");
    let (name, value) = pair(&welcome);
    let wrong = format!("Cookie: {name}=none; other={value}");
    let refused: [&[&str]; 4] = [
        &[],
        &["Authorization: Bearer a-token-of-the-test"],
        &["Authorization: Basic a-token-of-the-tests"],
        &[&*wrong],
    ];
    for headers in refused {
        let answer = get(&server, "/a.txt", headers);
        assert_eq!((answer.status, answer.header("www-authenticate")), (401, "Bearer"), "{headers:?}");
        assert!(!answer.text().contains("plain") && answer.header("access-control-allow-origin").is_empty());
    }
    assert_eq!(get(&server, "/a.txt?token=wrong", &[]).status, 401);
    assert_eq!(get(&server, "/a.txt", &[&format!("authorization: bearer {TOKEN}")]).text(), "plain");
    assert!(cookie.contains("; HttpOnly; SameSite=Strict") && !welcome.text().contains(TOKEN), "{welcome:?}");
    assert!(welcome.text().contains("url=/evil/a.txt?x=1\""), "{}", welcome.text());
    let known = format!("Cookie: other=1; {name}={value}");
    assert_eq!(get(&server, "/a.txt", &[&known]).text(), "plain");
    // Who is known already does not keep it in the address either, and is led nowhere else.
    for (path, to) in [("/a.txt", "/a.txt"), ("/\\evil/a.txt", "/evil/a.txt")] {
        let again = get(&server, &format!("{path}?token={TOKEN}"), &[&known]);
        assert!(again.status == 400 || again.text().contains(&format!("url={to}\"")), "{path}: {again:?}");
    }

    let open = ServeOptions { listen: SocketAddr::from(([0, 0, 0, 0], 0)), ..ServeOptions::default() };
    let bind = |options: &ServeOptions| Server::bind(options.clone(), Offer::Files(Files::of(data.path()).unwrap()));
    let why = bind(&open).map(drop).unwrap_err().to_string();
    assert!(why.starts_with("--listen: found 0.0.0.0:0, which others reach, without a token and TLS"), "{why}");
    let why = bind(&ServeOptions { token, ..open.clone() }).map(drop).unwrap_err().to_string();
    assert!(why.contains("without TLS"), "{why}");
    assert!(ServeOptions { is_insecure: true, ..open }.check().is_ok());
}

/// Name and value of the cookie that is set.
fn pair(welcome: &Answer) -> (String, String) {
    let (name, rest) = welcome.header("set-cookie").split_once('=').unwrap();
    (name.to_owned(), rest.split(';').next().unwrap().to_owned())
}

#[test]
fn servers_of_one_host_with_other_tokens_let_a_browser_stay_in() {
    let data = tempfile::tempdir().unwrap();
    std::fs::write(data.path().join("a.txt"), "plain").unwrap();
    let tokens = [TOKEN, "another-token-of-the-tests"];
    let servers = tokens.map(|token| {
        let options = ServeOptions { token: Some(Token::new(token).unwrap()), ..ServeOptions::default() };
        folder(data.path(), options)
    });
    // What a browser keeps of a host, whatever the port: of each name the cookie that was set last.
    let mut kept = BTreeMap::new();
    for (server, token) in servers.iter().zip(tokens) {
        let (name, value) = pair(&get(server, &format!("/a.txt?token={token}"), &[]));
        kept.insert(name, value);
    }
    let all: Vec<String> = kept.iter().map(|(name, value)| format!("{name}={value}")).collect();
    let known = format!("Cookie: {}", all.join("; "));
    for server in &servers {
        assert_eq!(get(server, "/a.txt", &[&known]).text(), "plain");
    }
}

#[test]
fn tls_is_spoken_and_plain_text_is_not() {
    let data = tempfile::tempdir().unwrap();
    let bytes = content(300_000);
    std::fs::write(data.path().join("a.df"), &bytes).unwrap();
    let made = rcgen::generate_simple_self_signed(["localhost".to_owned()]).unwrap();
    let certificate = Certificate { chain: data.path().join("cert.pem"), key: data.path().join("key.pem") };
    std::fs::write(&certificate.chain, made.cert.pem()).unwrap();
    std::fs::write(&certificate.key, made.signing_key.serialize_pem()).unwrap();
    let options = ServeOptions { certificate: Some(certificate.clone()), ..ServeOptions::default() };
    let server = folder(data.path(), options.clone());

    let mut roots = rustls::RootCertStore::empty();
    roots.add(made.cert.der().clone()).unwrap();
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    let config = rustls::ClientConfig::builder_with_provider(provider).with_safe_default_protocol_versions().unwrap();
    let config = config.with_root_certificates(roots).with_no_client_auth();
    let name = rustls::pki_types::ServerName::try_from("localhost").unwrap();
    let connection = rustls::ClientConnection::new(Arc::new(config), name).unwrap();
    let stream = rustls::StreamOwned::new(connection, connected(server.address()));
    let answer = on(stream, "GET /a.df", &["Range: bytes=100-299999"], b"");
    assert!(answer.status == 206 && answer.body == bytes[100..]);

    let mut plain = connected(server.address());
    plain.write_all(b"GET /a.df HTTP/1.1\r\nHost: localhost\r\n\r\n").unwrap();
    let mut said = Vec::new();
    // Refused or cut off.
    let _ = plain.read_to_end(&mut said);
    assert!(!said.starts_with(b"HTTP"));

    let wrong = Certificate { key: data.path().join("a.df"), ..certificate };
    let options = ServeOptions { certificate: Some(wrong), ..options };
    let why = Server::bind(options, Offer::Files(Files::of(data.path()).unwrap())).map(drop).unwrap_err().to_string();
    assert!(why.contains("a.df: found no private key"), "{why}");
}

#[test]
fn slow_ends_are_let_go_and_many_are_served() {
    let data = tempfile::tempdir().unwrap();
    let bytes = content(200_000);
    std::fs::write(data.path().join("a.df"), &bytes).unwrap();
    File::create(data.path().join("large.df")).unwrap().set_len(256 << 20).unwrap();
    let options = ServeOptions { patience: Duration::from_secs(1), connections: 12, ..ServeOptions::default() };
    let server = folder(data.path(), options);
    // One that never ends its request, and one that never takes its answer.
    let mut half = connected(server.address());
    half.write_all(b"GET /a.df HTTP/1.1\r\nHost: loc").unwrap();
    let mut deaf = connected(server.address());
    deaf.write_all(b"GET /large.df HTTP/1.1\r\nHost: localhost\r\n\r\n").unwrap();
    // More than there are places for, of which the two above hold some.
    let address = server.address();
    let others: Vec<_> = (0..40_usize)
        .map(|index| {
            let said = format!("Range: bytes={}-", 5000 * index);
            (index, std::thread::spawn(move || asked(address, "GET /a.df", &[&said], b"")))
        })
        .collect();
    for (index, other) in others {
        let answer = other.join().unwrap();
        assert!(answer.status == 206 && answer.body == bytes[5000 * index..], "{index}");
    }
    let begun = Instant::now();
    let mut said = Vec::new();
    let _ = half.read_to_end(&mut said);
    // A connection that is closed at the other end takes nothing more.
    while deaf.write_all(b"x").is_ok() && begun.elapsed() < Duration::from_secs(30) {
        std::thread::sleep(Duration::from_millis(20));
    }
    assert!(begun.elapsed() < Duration::from_secs(30) && !said.starts_with(b"HTTP/1.1 200"));
    let mut taken = Vec::new();
    let _ = deaf.read_to_end(&mut taken);
    assert!(taken.len() < 200 << 20, "{} bytes", taken.len());
    // A stopped server ends though somebody is connected.
    let _idle = connected(server.address());
    let begun = Instant::now();
    drop(server);
    assert!(begun.elapsed() < Duration::from_secs(10));
}
