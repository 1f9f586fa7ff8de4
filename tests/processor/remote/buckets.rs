//! Buckets: who asks is what variables say, or a role that a service tells of.

use super::{served, without_keys};
use crate::support::fault_server::{Asked, Fault, FaultServer};
use crate::support::program;
use std::process::Output;

/// What a server of buckets is asked for by `s3://bucket/runs/a b.df`.
const FILE: &str = "/bucket/runs/a%20b.df";
/// Where a machine of a cloud asks for its roles.
const ROLES: &str = "/latest/meta-data/iam/security-credentials/";
/// What services tell of a role.
const ROLE: &str = r#"{"Code": "Success", "Type": "AWS-HMAC", "LastUpdated": "2026-01-01T00:00:00Z", "AccessKeyId": "role",
    "SecretAccessKey": "s3cr3t", "Token": "t0ken", "Expiration": "2100-01-01T00:00:00Z"}"#;

fn endpoint(server: &FaultServer) -> String {
    server.url("").trim_end_matches('/').to_owned()
}

/// Asks for a file of a bucket.
fn info(server: &FaultServer, variables: &[(&str, &str)]) -> Output {
    let cache = tempfile::tempdir().unwrap();
    let mut info = program();
    info.args(["info", "s3://bucket/runs/a b.df"]).env("XDG_CACHE_HOME", cache.path());
    without_keys(&mut info).env("AWS_ENDPOINT_URL", endpoint(server)).envs(variables.iter().copied());
    info.output().unwrap()
}

/// What the server is asked for until the file has been found.
fn asked(server: &FaultServer, variables: &[(&str, &str)]) -> Vec<Asked> {
    let output = info(server, variables);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    server.asked()
}

/// Both ends of the file were asked for by whoever has this key, or by nobody.
fn are_ends(asked: &[Asked], key: Option<&str>, session_token: Option<&str>) {
    let signature = key.map(|key| format!("AWS4-HMAC-SHA256 Credential={key}/"));
    assert_eq!(asked.len(), 2, "{asked:?}");
    for asked in asked {
        let is_by = match (&asked.authorization, &signature) {
            (Some(own), Some(begin)) => own.starts_with(begin),
            (own, begin) => own.is_none() && begin.is_none(),
        };
        assert!(is_by && asked.target == FILE, "{asked:?}");
        assert_eq!(asked.session_token.as_deref(), session_token);
    }
}

#[test]
fn a_bucket_is_read_signed_and_unsigned() {
    let (id, secret) = (("AWS_ACCESS_KEY_ID", "me"), ("AWS_SECRET_ACCESS_KEY", "s3cr3t"));
    are_ends(&asked(&served(), &[("AWS_SKIP_SIGNATURE", "true")]), None, None);
    are_ends(&asked(&served(), &[id, secret]), Some("me"), None);
    are_ends(&asked(&served(), &[id, secret, ("AWS_SESSION_TOKEN", "t0ken")]), Some("me"), Some("t0ken"));
}

#[test]
fn a_bucket_is_read_by_the_role_that_a_container_has() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("shown");
    std::fs::write(&file, "b3arer").unwrap();
    let server = served();
    server.answer(|asked| match asked.target.as_str() {
        FILE => Fault::Sound,
        "/role" if asked.authorization.as_deref() == Some("b3arer") => Fault::Text(ROLE),
        _ => Fault::Status(403, None),
    });
    let service = server.url("role");
    let variables = [
        ("AWS_CONTAINER_CREDENTIALS_FULL_URI", service.as_str()),
        ("AWS_CONTAINER_AUTHORIZATION_TOKEN_FILE", file.to_str().unwrap()),
    ];
    let asked = asked(&server, &variables);
    assert_eq!(asked[0].target, "/role");
    are_ends(&asked[1..], Some("role"), Some("t0ken"));
    // A service that refuses is told from a bucket that does, of which nothing is asked.
    std::fs::write(&file, "s3cr3t").unwrap();
    let output = info(&server, &variables);
    let told = String::from_utf8(output.stderr).unwrap();
    let words =
        "bucket bucket: the service of AWS_CONTAINER_CREDENTIALS_FULL_URI does not let this be read (status 403)";
    assert!(!output.status.success() && told.contains(words) && !told.contains("s3cr3t"), "{told}");
    assert_eq!(server.asked().iter().filter(|asked| asked.target == FILE).count(), 2);
}

#[test]
fn a_bucket_is_read_by_the_role_of_a_machine_or_by_nobody() {
    for has_role in [true, false] {
        let server = served();
        server.answer(move |asked| match asked.target.as_str() {
            FILE => Fault::Sound,
            "/latest/api/token" => Fault::Text("t0ken"),
            ROLES if has_role => Fault::Text("reader"),
            role if has_role && role.strip_prefix(ROLES) == Some("reader") => Fault::Text(ROLE),
            _ => Fault::Status(404, None),
        });
        let service = endpoint(&server);
        let asked = asked(&server, &[("AWS_METADATA_ENDPOINT", service.as_str())]);
        let (of_service, of_file) = asked.split_at(asked.len() - 2);
        assert_eq!(of_service.len(), if has_role { 3 } else { 2 }, "{asked:?}");
        match has_role {
            true => are_ends(of_file, Some("role"), Some("t0ken")),
            false => are_ends(of_file, None, None),
        }
    }
}
