//! Paths, headers and the check of the host name.

use std::net::IpAddr;
use std::sync::Arc;

use axum::Router;
use axum::body::{Body, Bytes};
use axum::extract::{Request, State};
use axum::http::header::{self, HeaderName, HeaderValue};
use axum::http::{HeaderMap, StatusCode};
use axum::middleware::{Next, from_fn_with_state};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use futures_util::stream::unfold;
use serde_json::json;
use tokio::sync::{Semaphore, watch};

use super::STREAMS;
use super::commands::{Commands, about, command};
use super::snapshot::Rendered;
use volcomp_engine::fault::CATALOGUE;

/// What all connections share.
#[derive(Debug)]
pub(super) struct Shared {
    rendered: watch::Receiver<Arc<Rendered>>,
    streams: Arc<Semaphore>,
    /// Names by which browsers may address the service.
    hosts: Vec<String>,
    /// The entries of `volcomp explain`.
    codes: Bytes,
    /// The way of commands; `None`: read-only.
    pub(super) commands: Option<Commands>,
}

const SCRIPT: &str = "text/javascript; charset=utf-8";
const STYLE: &str = "text/css; charset=utf-8";
/// The type of OpenMetrics.
const OPEN_METRICS: &str = "application/openmetrics-text";

/// Headers of every answer: nothing from elsewhere, nothing embedded elsewhere, nothing kept.
const HEADERS: [(HeaderName, &str); 5] = [
    (
        header::CONTENT_SECURITY_POLICY,
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; connect-src 'self'; \
         base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    ),
    (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
    (header::REFERRER_POLICY, "no-referrer"),
    (header::CACHE_CONTROL, "no-store"),
    (HeaderName::from_static("cross-origin-resource-policy"), "same-origin"),
];

impl Shared {
    pub(super) fn new(
        rendered: watch::Receiver<Arc<Rendered>>,
        hosts: Vec<String>,
        commands: Option<Commands>,
    ) -> Self {
        let entry = |e: &volcomp_engine::fault::Entry| {
            json!({
                "code": e.code.to_string(), "name": e.name, "severity": e.severity.name(), "text": e.text,
                "cause": e.cause, "reaction": e.reaction, "remedy": e.remedy,
            })
        };
        let codes = serde_json::Value::Array(CATALOGUE.iter().map(entry).collect()).to_string().into();
        Self { rendered, streams: Arc::new(Semaphore::new(STREAMS)), hosts, codes, commands }
    }

    fn rendered(&self) -> Arc<Rendered> {
        Arc::clone(&self.rendered.borrow())
    }
}

pub(super) fn router(shared: &Arc<Shared>) -> Router {
    let text = |kind: &'static str, text: &'static str| get(move || async move { typed(kind, text) });
    let json = |of: fn(&Shared) -> Bytes| {
        get(move |State(shared): State<Arc<Shared>>| async move { typed("application/json", of(&shared)) })
    };
    Router::new()
        .route("/", text("text/html; charset=utf-8", include_str!("page/index.html")))
        .route("/page.js", text(SCRIPT, include_str!("page/page.js")))
        .route("/sections.js", text(SCRIPT, include_str!("page/sections.js")))
        .route("/traces.js", text(SCRIPT, include_str!("page/traces.js")))
        .route("/volume.js", text(SCRIPT, include_str!("page/volume.js")))
        .route("/commands.js", text(SCRIPT, include_str!("page/commands.js")))
        .route("/difference.js", text(SCRIPT, include_str!("page/difference.js")))
        .route("/common.js", text(SCRIPT, include_str!("page/common.js")))
        .route("/page.css", text(STYLE, include_str!("page/page.css")))
        .route("/uplot.js", text(SCRIPT, include_str!("assets/uplot/uPlot.iife.min.js")))
        .route("/uplot.css", text(STYLE, include_str!("assets/uplot/uPlot.min.css")))
        .route("/uplot-license.txt", text("text/plain; charset=utf-8", include_str!("assets/uplot/LICENSE")))
        .route("/icon.svg", text("image/svg+xml", include_str!("page/icon.svg")))
        .route("/metrics", get(metrics))
        .route("/api/v1/status", json(|shared| shared.rendered().status.clone()))
        .route("/api/v1/history", json(|shared| shared.rendered().history.clone()))
        .route("/api/v1/codes", json(|shared| shared.codes.clone()))
        .route("/api/v1/events", get(events))
        .route("/api/v1/volume", json(|shared| shared.rendered().volume.clone()))
        .route("/api/v1/verification", json(|shared| shared.rendered().verification.clone()))
        .route("/api/v1/about", get(about))
        .route("/api/v1/command", post(command))
        .layer(from_fn_with_state(Arc::clone(shared), guard))
        .with_state(Arc::clone(shared))
}

pub(super) fn typed(kind: &'static str, body: impl Into<Body>) -> Response {
    ([(header::CONTENT_TYPE, kind)], body.into()).into_response()
}

/// Refuses names that this service is not known by: a page of another site whose name was made to point here
/// (DNS rebinding) must not read it. A numeric address cannot be made to point elsewhere.
async fn guard(State(shared): State<Arc<Shared>>, request: Request, next: Next) -> Response {
    let mut response = match host(request.headers()) {
        Some(host) if is_known(host, &shared.hosts) => next.run(request).await,
        Some(_) => refusal(
            StatusCode::MISDIRECTED_REQUEST,
            "unknown host name; use localhost or the numeric address, or add the name to hosts in [http] of the machine file\n",
        ),
        None => refusal(StatusCode::BAD_REQUEST, "the request has no usable Host header\n"),
    };
    for (name, value) in HEADERS {
        response.headers_mut().insert(name, HeaderValue::from_static(value));
    }
    response
}

fn refusal(code: StatusCode, text: &'static str) -> Response {
    (code, text).into_response()
}

fn host(headers: &HeaderMap) -> Option<&str> {
    let mut all = headers.get_all(header::HOST).iter();
    let host = all.next()?.to_str().ok()?;
    all.next().is_none().then_some(host)
}

/// Whether a Host header, with or without a port, is a numeric address, `localhost` or one of `hosts`.
fn is_known(host: &str, hosts: &[String]) -> bool {
    let name = match host.strip_prefix('[') {
        Some(rest) => rest.split(']').next().unwrap_or(rest),
        None => host.split(':').next().unwrap_or(host),
    };
    let name = name.to_ascii_lowercase();
    name == "localhost" || name.parse::<IpAddr>().is_ok() || hosts.contains(&name)
}

async fn metrics(State(shared): State<Arc<Shared>>, headers: HeaderMap) -> Response {
    let accepts = headers.get(header::ACCEPT).and_then(|value| value.to_str().ok()).unwrap_or_default();
    let rendered = shared.rendered();
    if accepts.contains(OPEN_METRICS) {
        return typed(
            "application/openmetrics-text; version=1.0.0; charset=utf-8",
            rendered.open_metrics.clone(),
        );
    }
    typed("text/plain; version=0.0.4; charset=utf-8", rendered.prometheus.clone())
}

/// The status as server-sent events: one at once, then one with each snapshot. A client that does not keep up gets the
/// newest one; nothing queues for it.
async fn events(State(shared): State<Arc<Shared>>) -> Response {
    let Ok(place) = Arc::clone(&shared.streams).try_acquire_owned() else {
        return refusal(StatusCode::SERVICE_UNAVAILABLE, "too many event streams; try again\n");
    };
    let mut receiver = shared.rendered.clone();
    receiver.mark_changed();
    let stream = unfold((receiver, place), |(mut receiver, place)| async move {
        receiver.changed().await.ok()?;
        let event = receiver.borrow_and_update().event.clone();
        Some((Ok::<_, std::convert::Infallible>(event), (receiver, place)))
    });
    typed("text/event-stream", Body::from_stream(stream))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_that_point_here_by_somebody_elses_word_are_refused() {
        let hosts = ["cell-7.shop".to_owned()];
        for good in ["localhost", "LOCALHOST:7870", "127.0.0.1:80", "[::1]:7870", "10.0.0.5", "cell-7.shop:1"]
        {
            assert!(is_known(good, &hosts), "{good}");
        }
        for bad in
            ["", "evil.example", "localhost.evil.example", "127.0.0.1.evil.example:7870", "[evil]", "cell-7"]
        {
            assert!(!is_known(bad, &hosts), "{bad}");
        }
    }
}
