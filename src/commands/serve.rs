//! `deepfield serve`: files for those who read them from afar, or pictures for browsers.

use super::arguments::{bytes, count};
use super::{CommandResult, print_line};
use crate::build::default_memory;
use crate::model::is_url;
use crate::serve::view::{ViewOptions, Viewing};
use crate::serve::{Certificate, Files, Offer, ServeOptions, Server, Token};
use std::env::VarError;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Serves built files to those who read them from afar, or pictures of one to browsers; read-only (docs/serve.md).
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:
  deepfield serve runs/                        its built files, and a list of them, for this machine
  deepfield serve snapshot_099.df --view       a page in which anybody on this machine turns and zooms it
  deepfield serve runs/ --listen 0.0.0.0:8443 --certificate cert.pem --key key.pem --token-file token
  deepfield view https://example.org:8443/snapshot_099.df        at the other end, with the token in DEEPFIELD_TOKEN
  deepfield serve run.df --view --scene halo.scene.ron --tour fly.ron --visitors 20")]
pub struct Arguments {
    /// A folder, or one file; with --view also the URL of a built file.
    #[arg(value_name = "FOLDER|FILE")]
    pub path: PathBuf,
    /// Address and port. Addresses that others reach ask for a token and TLS.
    #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1:8080")]
    pub listen: SocketAddr,
    /// A secret that readers have to know, at least 16 letters and digits [default: DEEPFIELD_TOKEN]. Other users of this machine see it;
    /// not so what is in a file or in the environment.
    #[arg(long, value_name = "TOKEN", conflicts_with = "token_file")]
    pub token: Option<String>,
    /// A file with the secret.
    #[arg(long, value_name = "FILE")]
    pub token_file: Option<PathBuf>,
    /// Certificates for TLS, PEM, the server's own first.
    #[arg(long, value_name = "FILE.pem", requires = "key")]
    pub certificate: Option<PathBuf>,
    /// The certificate's key, PEM.
    #[arg(long, value_name = "FILE.pem", requires = "certificate")]
    pub key: Option<PathBuf>,
    /// Let others read without a token or without TLS, and this machine by any name.
    #[arg(long)]
    pub insecure: bool,
    /// The other site whose scripts may read, or `*` for all [default: none].
    #[arg(long, value_name = "ORIGIN")]
    pub allow_origin: Option<String>,
    /// Connections at a time; more wait.
    #[arg(long, value_name = "N", value_parser = count, default_value = "256")]
    pub connections: u64,
    /// Show the file in browsers, in place of its bytes.
    #[arg(long)]
    pub view: bool,
    /// A scene, whose look, camera and bookmarks the page has.
    #[arg(long, value_name = "SCENE.ron", requires = "view")]
    pub scene: Option<PathBuf>,
    /// A tour of the data, which the page plays.
    #[arg(long, value_name = "TOUR.ron", requires = "view")]
    pub tour: Option<PathBuf>,
    /// Visitors of the page at a time; others are told that it is full.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1000), default_value = "8", requires = "view")]
    pub visitors: u16,
    /// Memory for what is read for all visitors, such as 8GiB [default: half of what is free].
    #[arg(long, value_name = "SIZE", value_parser = bytes, requires = "view")]
    pub memory: Option<u64>,
}

/// Serves until the program is interrupted.
///
/// # Errors
/// When the data, the token or the certificate cannot be read, the address is not to be had, or others could read what was not said to
/// be for them.
pub fn run(arguments: &Arguments) -> CommandResult {
    let options = arguments.options()?;
    options.check()?;
    let offer = match arguments.view {
        true => Offer::View(Arc::new(Viewing::open(&arguments.view_options())?)),
        false if is_url(&arguments.path) => {
            let path = arguments.path.display();
            return Err(format!("{path}: found a URL, expected a folder or a file here, or --view").into());
        }
        false => Offer::Files(Files::of(&arguments.path)?),
    };
    let address = match &offer {
        Offer::Files(files) => files.address(),
        Offer::View(_) => String::new(),
    };
    let has_token = options.token.is_some();
    let server = Server::bind(options, offer)?;
    print_line(format_args!("{}", arguments.said(server.url(), &address, has_token)))?;
    server.start()?.wait()?;
    Ok(())
}

impl Arguments {
    fn options(&self) -> Result<ServeOptions, Box<dyn std::error::Error + Send + Sync>> {
        let certificate = self.certificate.clone().zip(self.key.clone());
        Ok(ServeOptions {
            listen: self.listen,
            token: self.token()?,
            certificate: certificate.map(|(chain, key)| Certificate { chain, key }),
            is_insecure: self.insecure,
            allow_origin: self.allow_origin.clone(),
            connections: usize::try_from(self.connections).unwrap_or(usize::MAX),
            ..ServeOptions::default()
        })
    }

    fn token(&self) -> Result<Option<Token>, Box<dyn std::error::Error + Send + Sync>> {
        let (from, text) = match (&self.token, &self.token_file) {
            (Some(text), _) => ("--token".to_owned(), text.clone()),
            (None, Some(file)) => (file.display().to_string(), read(file)?),
            (None, None) => match std::env::var("DEEPFIELD_TOKEN") {
                Ok(text) if !text.is_empty() => ("DEEPFIELD_TOKEN".to_owned(), text),
                Ok(_) | Err(VarError::NotPresent) => return Ok(None),
                Err(VarError::NotUnicode(_)) => return Err("DEEPFIELD_TOKEN: expected letters and digits".into()),
            },
        };
        Ok(Some(Token::new(text.trim()).map_err(|expected| format!("{from}: found another text, {expected}"))?))
    }

    fn view_options(&self) -> ViewOptions {
        ViewOptions {
            path: self.path.clone(),
            scene: self.scene.clone(),
            tour: self.tour.clone(),
            visitors: self.visitors.into(),
            memory: self.memory.unwrap_or_else(default_memory),
        }
    }

    /// The line that is printed when the server serves: its address, and what is done with it at the other end.
    fn said(&self, url: &str, address: &str, has_token: bool) -> String {
        let path = self.path.display();
        // Nobody comes by the address that stands for all of this machine's.
        let url = match self.listen.ip().is_unspecified() {
            true => url.replace("0.0.0.0", "HOST").replace("[::]", "HOST"),
            false => url.to_owned(),
        };
        match (self.view, has_token) {
            (true, false) => format!("serving pictures of {path}: open {url}/ in a browser"),
            (true, true) => format!("serving pictures of {path}: open {url}/?token=TOKEN in a browser"),
            (false, _) => {
                let file = if address.is_empty() { "FILE" } else { address };
                let token = if has_token { "DEEPFIELD_TOKEN=TOKEN " } else { "" };
                format!("serving {path} at {url}/: {token}deepfield view {url}/{file}")
            }
        }
    }
}

fn read(file: &Path) -> Result<String, String> {
    std::fs::read_to_string(file).map_err(|error| format!("{}: {error}", file.display()))
}
