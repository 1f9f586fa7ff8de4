//! TLS: a chain of certificates and its key, as PEM files.

use super::ServeError;
use rustls::ServerConfig;
use rustls::pki_types::pem::PemObject;
use rustls::pki_types::{CertificateDer, PrivateKeyDer};
use std::path::PathBuf;
use std::sync::Arc;
use tokio_rustls::TlsAcceptor;

/// Where the certificate is.
#[derive(Clone, Debug)]
pub struct Certificate {
    /// The chain, the server's own first.
    pub chain: PathBuf,
    /// Its key.
    pub key: PathBuf,
}

impl Certificate {
    /// What takes connections with it.
    ///
    /// # Errors
    /// Where a file cannot be read, has nothing of the kind, or they do not fit together; the message names it.
    pub(super) fn acceptor(&self) -> Result<TlsAcceptor, ServeError> {
        let Certificate { chain, key } = self;
        let refused = |file: &PathBuf, why: String| ServeError::Certificate { file: file.clone(), why };
        let read = CertificateDer::pem_file_iter(chain).and_then(|sections| sections.collect::<Result<Vec<_>, _>>());
        let certificates = read.map_err(|error| refused(chain, format!("found no certificate: {error}")))?;
        if certificates.is_empty() {
            return Err(refused(chain, "found no certificate, expected -----BEGIN CERTIFICATE-----".into()));
        }
        let own = PrivateKeyDer::from_pem_file(key);
        let own = own.map_err(|error| refused(key, format!("found no private key: {error}")))?;
        let unfit = |error: rustls::Error| refused(chain, format!("with the key {}: {error}", key.display()));
        // The provider is named: other parts of the program may have another one.
        let provider = Arc::new(rustls::crypto::ring::default_provider());
        let config =
            ServerConfig::builder_with_provider(provider).with_safe_default_protocol_versions().map_err(unfit)?;
        let mut config = config.with_no_client_auth().with_single_cert(certificates, own).map_err(unfit)?;
        config.alpn_protocols = vec![b"http/1.1".to_vec()];
        Ok(TlsAcceptor::from(Arc::new(config)))
    }
}
