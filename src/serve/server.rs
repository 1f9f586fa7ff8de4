//! The server: an address, connections within limits, and what is answered on them.

use super::access::{is_for_this_machine, is_from_elsewhere};
use super::answer::{self, Answer};
use super::content::Content;
use super::patience::Patient;
use super::view::Viewing;
use super::{Certificate, Files, ServeError, ServeOptions};
use hyper::body::{Bytes, Incoming};
use hyper::header::{
    ACCESS_CONTROL_ALLOW_HEADERS, ACCESS_CONTROL_ALLOW_METHODS, ACCESS_CONTROL_ALLOW_ORIGIN,
    ACCESS_CONTROL_EXPOSE_HEADERS, ACCESS_CONTROL_MAX_AGE, ALLOW, HOST, VARY,
};
use hyper::http::request::Parts;
use hyper::server::conn::http1;
use hyper::service::service_fn;
use hyper::{Method, Request, Response, StatusCode};
use hyper_util::rt::{TokioIo, TokioTimer};
use std::convert::Infallible;
use std::future::poll_fn;
use std::net::SocketAddr;
use std::pin::pin;
use std::sync::Arc;
use std::task::Poll;
use std::time::Duration;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::{TcpListener, TcpStream};
use tokio::runtime::Runtime;
use tokio::sync::{Semaphore, watch};
use tokio::task::{JoinHandle, spawn_blocking};
use tokio::time::{sleep, timeout};
use tokio_rustls::TlsAcceptor;

/// Threads that answer. What waits for the disk and what draws has others.
const THREADS: usize = 2;
/// Reads of the disk at a time.
const READS: usize = 64;
/// Bytes of the head of a request, and of an answer that waits to be taken.
const BUFFER: usize = 64 << 10;
/// How long the end waits for what is being answered.
const LAST: Duration = Duration::from_secs(2);

/// What is served.
pub enum Offer {
    /// Files as they are.
    Files(Files),
    /// Pictures.
    View(Arc<Viewing>),
}

/// A server that has its address.
pub struct Server {
    shared: Shared,
    listener: std::net::TcpListener,
    address: SocketAddr,
}

/// What connections share.
struct Shared {
    options: ServeOptions,
    acceptor: Option<TlsAcceptor>,
    offer: Offer,
    /// Its own address, where a request does not say by which it came.
    url: String,
}

/// A server that serves until this is dropped.
pub struct Running {
    address: SocketAddr,
    stop: watch::Sender<bool>,
    /// Both are there until the drop.
    runtime: Option<Runtime>,
    accepting: Option<JoinHandle<()>>,
}

impl Server {
    /// Takes the address.
    ///
    /// # Errors
    /// [`ServeError`] for options that make no sense, a certificate that cannot be used, and an address that cannot be had.
    pub fn bind(options: ServeOptions, offer: Offer) -> Result<Server, ServeError> {
        options.check()?;
        let acceptor = options.certificate.as_ref().map(Certificate::acceptor).transpose()?;
        let failed = |source| ServeError::Listen { address: options.listen, source };
        let listener = std::net::TcpListener::bind(options.listen).map_err(failed)?;
        listener.set_nonblocking(true).map_err(failed)?;
        let address = listener.local_addr().map_err(failed)?;
        let scheme = if acceptor.is_some() { "https" } else { "http" };
        let url = format!("{scheme}://{address}");
        Ok(Server { shared: Shared { options, acceptor, offer, url }, listener, address })
    }

    /// Its address, such as `http://127.0.0.1:8080`.
    pub fn url(&self) -> &str {
        &self.shared.url
    }

    /// Begins to serve.
    ///
    /// # Errors
    /// [`ServeError::Start`].
    pub fn start(self) -> Result<Running, ServeError> {
        let Server { shared, listener, address } = self;
        let runtime = tokio::runtime::Builder::new_multi_thread()
            .worker_threads(THREADS)
            .max_blocking_threads(READS)
            .thread_name("deepfield serve")
            .enable_io()
            .enable_time()
            .build()
            .map_err(ServeError::Start)?;
        let listener = {
            let _inside = runtime.enter();
            TcpListener::from_std(listener).map_err(ServeError::Start)?
        };
        let (stop, stopped) = watch::channel(false);
        let accepting = runtime.spawn(accept(listener, Arc::new(shared), stopped));
        Ok(Running { address, stop, runtime: Some(runtime), accepting: Some(accepting) })
    }
}

impl Running {
    /// Where it listens.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Serves until the program is interrupted.
    ///
    /// # Errors
    /// Where the system does not say when that is.
    pub fn wait(self) -> Result<(), ServeError> {
        self.runtime
            .as_ref()
            .map_or(Ok(()), |runtime| runtime.block_on(tokio::signal::ctrl_c()))
            .map_err(ServeError::Start)
    }
}

impl Drop for Running {
    /// What is being answered has a moment to be taken.
    fn drop(&mut self) {
        // Without connections nobody hears it.
        let _ = self.stop.send(true);
        if let Some(runtime) = self.runtime.take() {
            if let Some(accepting) = self.accepting.take() {
                let _ = runtime.block_on(async { timeout(LAST, accepting).await });
            }
            runtime.shutdown_timeout(LAST);
        }
    }
}

/// Takes connections, so many at a time, until the server is stopped and they have ended.
async fn accept(listener: TcpListener, shared: Arc<Shared>, stopped: watch::Receiver<bool>) {
    let most = shared.options.connections.clamp(1, 1 << 16);
    let places = Arc::new(Semaphore::new(most));
    loop {
        let next = async {
            let place = Arc::clone(&places).acquire_owned().await.ok()?;
            loop {
                match listener.accept().await {
                    Ok((stream, _)) => return Some((place, stream)),
                    // Too many open files, or a connection that was gone before it was there.
                    Err(_) => sleep(Duration::from_millis(50)).await,
                }
            }
        };
        let Some(Some((place, stream))) = unless(stopped.clone(), next).await else { break };
        let (shared, stopped) = (Arc::clone(&shared), stopped.clone());
        tokio::spawn(async move {
            shared.serve(stream, stopped).await;
            drop(place);
        });
    }
    drop(listener);
    // All places are free when all connections have ended.
    let _ = places.acquire_many(most as u32).await;
}

/// What a future gives; nothing where the server is stopped first.
async fn unless<T>(mut stopped: watch::Receiver<bool>, future: impl Future<Output = T>) -> Option<T> {
    let mut future = pin!(future);
    let mut stop = pin!(async move {
        let _ = stopped.wait_for(|stopped| *stopped).await;
    });
    poll_fn(|context| match stop.as_mut().poll(context) {
        Poll::Ready(()) => Poll::Ready(None),
        Poll::Pending => future.as_mut().poll(context).map(Some),
    })
    .await
}

impl Shared {
    async fn serve(self: Arc<Shared>, stream: TcpStream, stopped: watch::Receiver<bool>) {
        let patience = self.options.patience;
        // Answers are written whole; waiting for more only delays them.
        let _ = stream.set_nodelay(true);
        let stream = Patient::new(stream, patience);
        let Some(acceptor) = self.acceptor.clone() else { return self.converse(stream, stopped).await };
        if let Ok(Ok(stream)) = timeout(patience, acceptor.accept(stream)).await {
            self.converse(stream, stopped).await;
        }
    }

    async fn converse<T>(self: Arc<Shared>, stream: T, stopped: watch::Receiver<bool>)
    where
        T: AsyncRead + AsyncWrite + Unpin,
    {
        let patience = self.options.patience;
        let service = service_fn(move |request: Request<Incoming>| {
            let shared = Arc::clone(&self);
            async move { Ok::<Answer, Infallible>(shared.answer(request).await) }
        });
        let connection = http1::Builder::new()
            .timer(TokioTimer::new())
            .header_read_timeout(patience)
            .max_buf_size(BUFFER)
            .serve_connection(TokioIo::new(stream), service);
        let mut connection = pin!(connection);
        // Who hangs up or sends nonsense gets no answer, and nobody else is told.
        if unless(stopped, connection.as_mut()).await.is_none() {
            connection.as_mut().graceful_shutdown();
            let _ = timeout(LAST, connection).await;
        }
    }

    async fn answer(self: Arc<Shared>, request: Request<Incoming>) -> Answer {
        let (parts, body) = request.into_parts();
        let is_head = parts.method == Method::HEAD;
        let mut answer = self.routed(parts, body).await;
        if let Some(origin) = self.options.allow_origin.as_deref() {
            let exposed = "accept-ranges, content-length, content-range, etag, last-modified";
            answer = answer::with(answer, ACCESS_CONTROL_ALLOW_ORIGIN, origin);
            answer = answer::with(answer, ACCESS_CONTROL_EXPOSE_HEADERS, exposed);
            if origin != "*" {
                answer = answer::with(answer, VARY, "origin");
            }
        }
        if is_head { answer::without_content(answer) } else { answer }
    }

    async fn routed(&self, parts: Parts, body: Incoming) -> Answer {
        if self.options.is_for_this_machine() && !is_for_this_machine(&parts.headers) {
            let text = "this server is for this machine, as localhost; --insecure lets in who comes by another name";
            return answer::line(StatusCode::MISDIRECTED_REQUEST, text);
        }
        // Browsers ask without the token whether they may ask with it.
        if parts.method == Method::OPTIONS {
            return preflight();
        }
        if self.options.allow_origin.is_none() && is_from_elsewhere(&parts.headers) {
            return answer::line(StatusCode::FORBIDDEN, "pages of other sites may not read here");
        }
        let is_secure = self.acceptor.is_some();
        if let Some(token) = &self.options.token
            && let Err(answer) = token.check(&parts, is_secure)
        {
            return *answer;
        }
        let files = match &self.offer {
            Offer::View(viewing) => return viewing.answer(parts, body, is_secure).await,
            Offer::Files(files) => files.clone(),
        };
        if !matches!(parts.method, Method::GET | Method::HEAD) {
            return not_allowed("GET, HEAD");
        }
        let here = self.here(&parts);
        let found = spawn_blocking(move || files.answer(&parts, &here)).await;
        found.unwrap_or_else(|_| answer::line(StatusCode::INTERNAL_SERVER_ERROR, "the file cannot be read"))
    }

    /// The address by which a request came.
    fn here(&self, request: &Parts) -> String {
        let host = request.headers.get(HOST).and_then(|value| value.to_str().ok());
        let is_host = |host: &&str| {
            !host.is_empty() && host.bytes().all(|byte| byte.is_ascii_alphanumeric() || b"-._:[]".contains(&byte))
        };
        let scheme = if self.acceptor.is_some() { "https" } else { "http" };
        host.filter(is_host).map_or_else(|| self.url.clone(), |host| format!("{scheme}://{host}"))
    }
}

/// What is answered to a method that there is not.
pub(super) fn not_allowed(methods: &str) -> Answer {
    let answer = answer::line(StatusCode::METHOD_NOT_ALLOWED, &format!("this server takes {methods}"));
    answer::with(answer, ALLOW, methods)
}

/// What is answered to a browser that asks what scripts of other sites may do: read.
fn preflight() -> Answer {
    let mut answer = Response::new(Content::Whole(Bytes::new()));
    *answer.status_mut() = StatusCode::NO_CONTENT;
    let taken = "authorization, if-match, if-modified-since, if-none-match, if-range, if-unmodified-since, range";
    let answer = answer::with(answer, ACCESS_CONTROL_ALLOW_METHODS, "GET, HEAD");
    let answer = answer::with(answer, ACCESS_CONTROL_ALLOW_HEADERS, taken);
    answer::with(answer, ACCESS_CONTROL_MAX_AGE, "86400")
}
