//! Certificates: a server is read from where this machine trusts the one that it shows, for the name that the URL has.

use super::sound;
use crate::serve::client::serving;
use crate::support::program;
use deepfield::serve::{Certificate, Files, Offer, ServeOptions};
use rcgen::{CertificateParams, DistinguishedName, DnType, KeyPair};
use std::path::Path;

/// Writes a certificate with this subject for an address or a name, which it has signed itself.
fn certificate(folder: &Path, file: &str, subject: &str, name: &str) -> Certificate {
    let key = KeyPair::generate().unwrap();
    let mut about = CertificateParams::new([name.to_owned()]).unwrap();
    about.distinguished_name = DistinguishedName::new();
    about.distinguished_name.push(DnType::CommonName, subject);
    let made = about.self_signed(&key).unwrap();
    let certificate =
        Certificate { chain: folder.join(format!("{file}.pem")), key: folder.join(format!("{file}.key.pem")) };
    std::fs::write(&certificate.chain, made.pem()).unwrap();
    std::fs::write(&certificate.key, key.serialize_pem()).unwrap();
    certificate
}

#[test]
fn a_certificate_is_accepted_that_is_trusted_and_of_that_name() {
    let folder = tempfile::tempdir().unwrap();
    let files = folder.path().join("files");
    std::fs::create_dir(&files).unwrap();
    std::fs::write(files.join("sound.df"), sound()).unwrap();
    let here = "127.0.0.1";
    let own = certificate(folder.path(), "own", "own", here);
    let older = certificate(folder.path(), "older", "own", here);
    let other = certificate(folder.path(), "other", "other", here);
    let elsewhere = certificate(folder.path(), "elsewhere", "elsewhere", "data.example");
    let info = |shown: &Certificate, trusted: &Certificate| {
        let options = ServeOptions { certificate: Some(shown.clone()), ..ServeOptions::default() };
        let server = serving(options, Offer::Files(Files::of(&files).unwrap()));
        let mut info = program();
        info.args(["info", &format!("https://{}/sound.df", server.address())]);
        // What is kept would be shown where a server does not answer.
        let cache = tempfile::tempdir().unwrap();
        info.env("XDG_CACHE_HOME", cache.path()).env_remove("SSL_CERT_DIR").env("SSL_CERT_FILE", &trusted.chain);
        let output = info.output().unwrap();
        let told = String::from_utf8(output.stderr).unwrap();
        (output.status.success(), told)
    };
    let (is_read, told) = info(&own, &own);
    assert!(is_read, "{told}");
    for (shown, trusted, words) in [
        (&own, &other, "nobody whom this machine trusts has signed it"),
        (&own, &older, "certificate"),
        (&elsewhere, &elsewhere, "it is for another name than that of the URL"),
    ] {
        let (is_read, told) = info(shown, trusted);
        assert!(!is_read && told.lines().count() == 1, "{words}: {told}");
        assert!(told.contains("127.0.0.1 shows a certificate that is not accepted") && told.contains(words), "{told}");
    }
}
