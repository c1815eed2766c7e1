//! Commands by HTTP: who may give them, and their way to the service.
//!
//! A client shows the token in a header; a page of another site cannot (it would need a permission by CORS, which is
//! never given), and there is no cookie that a browser would add by itself. The service carries a command out as it does
//! those of the status socket ([`crate::command_handler`]).

use core::net::IpAddr;
use std::sync::Arc;
use std::time::Duration;

use axum::body::{Body, HttpBody, to_bytes};
use axum::extract::{Extension, Request, State};
use axum::http::StatusCode;
use axum::http::header::{self, HeaderMap, HeaderValue};
use axum::response::{IntoResponse, Response};
use serde_json::json;
use tokio::sync::{Semaphore, mpsc, oneshot};
use tokio::time::timeout;
use tracing::warn;

use super::routes::{Shared, typed};
use super::token::{Token, WrongTokens};
use crate::clock::Clock;
use crate::command_handler::{Peer, carry_out};
use crate::logging::LogLimiter;
use crate::service::Service;
use crate::socket::{Answer, Ask, REQUEST_BYTES_MAX};
use crate::sync::Mutex;

/// Commands that are read or carried out at the same time.
const PLACES: usize = 4;
/// Time for a command to arrive in full.
const BODY_PATIENCE: Duration = Duration::from_secs(10);
/// Lines of the log about wrong tokens, and their interval.
const LOGGED: (u32, Duration) = (3, Duration::from_secs(60));

/// The address of the client of a connection.
#[derive(Debug, Clone, Copy)]
pub(super) struct Client(pub(super) IpAddr);

/// A command on its way to the service.
#[derive(Debug)]
pub(crate) struct Order {
    ask: Ask,
    client: IpAddr,
    answer: oneshot::Sender<Answer>,
}

/// The way of commands, where the machine file names a token.
#[derive(Debug)]
pub(super) struct Commands {
    token: Token,
    orders: mpsc::Sender<Order>,
    wrong: Mutex<(WrongTokens, LogLimiter)>,
    places: Semaphore,
    clock: Clock,
}

/// The service's end of the orders.
pub(crate) type Orders = mpsc::Receiver<Order>;

impl Commands {
    pub(super) fn new(token: Token, clock: Clock) -> (Self, Orders) {
        let (orders, receiver) = mpsc::channel(PLACES);
        let wrong = Mutex::new((WrongTokens::default(), LogLimiter::new(LOGGED.0, LOGGED.1)));
        (Self { token, orders, wrong, places: Semaphore::new(PLACES), clock }, receiver)
    }

    /// Whether a client may command.
    fn admit(&self, headers: &HeaderMap, client: IpAddr) -> Result<(), Refusal> {
        let now = self.clock.now();
        let mut wrong = self.wrong.lock();
        let (tokens, limiter) = &mut *wrong;
        if let Some(wait_s) = tokens.wait_s(now, client) {
            return Err(Refusal::TooMany { wait_s });
        }
        let mut lines = headers.get_all(header::AUTHORIZATION).iter();
        let Some(line) = lines.next() else { return Err(Refusal::NoToken) };
        let shown = line.as_bytes().strip_prefix(b"Bearer ").filter(|_| lines.next().is_none());
        if shown.is_some_and(|shown| self.token.is(shown)) {
            return Ok(());
        }
        tokens.record(now, client);
        if let Some(held_back) = limiter.admit(now) {
            warn!(%client, held_back, "a wrong token on the HTTP service");
        }
        Err(Refusal::WrongToken)
    }

    /// Reads a command and has it carried out.
    async fn take(&self, body: Body, client: IpAddr) -> Result<Answer, Refusal> {
        let _place = self.places.try_acquire().map_err(|_| Refusal::Busy)?;
        let limit = usize::try_from(REQUEST_BYTES_MAX).unwrap_or(usize::MAX);
        // a length that is stated is judged before anything is read
        if body.size_hint().lower() > REQUEST_BYTES_MAX {
            return Err(Refusal::TooLong);
        }
        let body = timeout(BODY_PATIENCE, to_bytes(body, limit)).await.map_err(|_| Refusal::Slow)?;
        let body = body.map_err(|_| Refusal::TooLong)?;
        let ask: Ask = serde_json::from_slice(&body)
            .map_err(|e| Refusal::NotUnderstood(volcomp_config::with_nearest(&e.to_string())))?;
        if !ask.command.is_read_only() && ask.reason.as_ref().is_none_or(|reason| reason.trim().is_empty()) {
            return Err(Refusal::NoReason);
        }
        let (answer, answered) = oneshot::channel();
        self.orders.try_send(Order { ask, client, answer }).map_err(|_| Refusal::Busy)?;
        answered.await.map_err(|_| Refusal::Busy)
    }
}

/// Why a command does not reach the service.
#[derive(Debug)]
enum Refusal {
    /// The machine file names no token.
    ReadOnly,
    NoToken,
    WrongToken,
    TooMany {
        wait_s: f64,
    },
    NotJson,
    NotUnderstood(String),
    NoReason,
    TooLong,
    Slow,
    Busy,
}

impl Refusal {
    fn words(&self) -> (StatusCode, String) {
        let (code, text) = match self {
            Self::ReadOnly => (
                StatusCode::FORBIDDEN,
                "this page can only be read; to allow commands name a file in token-file of [http] of the machine file",
            ),
            Self::NoToken => {
                (StatusCode::UNAUTHORIZED, "a command needs the token, in a header Authorization: Bearer")
            }
            Self::WrongToken => (StatusCode::UNAUTHORIZED, "this is not the token"),
            Self::TooMany { wait_s } => {
                let text =
                    format!("too many wrong tokens from this address; try again in {:.0} s", wait_s.ceil());
                return (StatusCode::TOO_MANY_REQUESTS, text);
            }
            Self::NotJson => {
                (StatusCode::UNSUPPORTED_MEDIA_TYPE, "a command is JSON: Content-Type: application/json")
            }
            Self::NotUnderstood(why) => {
                return (StatusCode::BAD_REQUEST, format!("the request is not understood: {why}"));
            }
            Self::NoReason => {
                (StatusCode::BAD_REQUEST, "a command by HTTP needs a reason, for the audit log")
            }
            Self::TooLong => {
                let text = format!("the request breaks off or is longer than {REQUEST_BYTES_MAX} bytes");
                return (StatusCode::PAYLOAD_TOO_LARGE, text);
            }
            Self::Slow => (StatusCode::REQUEST_TIMEOUT, "the request did not arrive in time"),
            Self::Busy => {
                (StatusCode::SERVICE_UNAVAILABLE, "other commands are being carried out; try again")
            }
        };
        (code, text.to_owned())
    }
}

impl IntoResponse for Refusal {
    fn into_response(self) -> Response {
        let (code, text) = self.words();
        let mut response = (code, typed("application/json", json!({"ok": false, "error": text}).to_string()));
        let headers = response.1.headers_mut();
        match self {
            Self::NoToken | Self::WrongToken => {
                headers.insert(header::WWW_AUTHENTICATE, HeaderValue::from_static("Bearer"));
            }
            Self::TooMany { wait_s } => {
                headers.insert(header::RETRY_AFTER, HeaderValue::from(wait_s.ceil() as u64));
            }
            _ => {}
        }
        response.into_response()
    }
}

/// `GET /api/v1/about`: whether commands can be given.
pub(super) async fn about(State(shared): State<Arc<Shared>>) -> Response {
    typed("application/json", json!({ "commands": shared.commands.is_some() }).to_string())
}

/// `POST /api/v1/command`: the request and the answer of the status socket; 409 where the daemon refuses.
pub(super) async fn command(
    State(shared): State<Arc<Shared>>,
    Extension(Client(client)): Extension<Client>,
    request: Request,
) -> Response {
    let Some(commands) = &shared.commands else { return Refusal::ReadOnly.into_response() };
    if let Err(refusal) = commands.admit(request.headers(), client) {
        return refusal.into_response();
    }
    let kind = request.headers().get(header::CONTENT_TYPE).map_or(&b""[..], HeaderValue::as_bytes);
    if kind.split(|c| *c == b';').next().is_none_or(|kind| !kind.eq_ignore_ascii_case(b"application/json")) {
        return Refusal::NotJson.into_response();
    }
    match commands.take(request.into_body(), client).await {
        Ok(answer) => {
            let code = if answer.ok { StatusCode::OK } else { StatusCode::CONFLICT };
            // plain data: it can always be written
            (code, typed("application/json", serde_json::to_string(&answer).unwrap_or_default()))
                .into_response()
        }
        Err(refusal) => refusal.into_response(),
    }
}

/// Carries orders out on the service's thread, the way of the status socket; ends with the HTTP service.
pub(crate) async fn serve_orders(mut orders: Orders, service: Arc<Mutex<Service>>) {
    while let Some(Order { ask, client, answer }) = orders.recv().await {
        let service = Arc::clone(&service);
        // each on its own: a comparison of models must not keep a disable waiting
        tokio::spawn(async move {
            let done = carry_out(ask, &service, Peer::Http { address: client }).await;
            // a client that is gone has its command carried out all the same
            let _ = answer.send(done);
        });
    }
}
