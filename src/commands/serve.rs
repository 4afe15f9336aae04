//! Web page of a study: progress, time left, the ranking of settings, and the report. It is read-only.

use std::{
    net::IpAddr,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    thread::{self, JoinHandle},
    time::Duration,
};

use calib_files::read_regular;
use calib_pipeline::{Context as _, Printer, StandingOf, StatusRequest, StepError};
use rayon::{ThreadPool, ThreadPoolBuilder};
use serde_json::json;
use tiny_http::{Header, Method, Request, Response, Server};

use crate::cli::Address;

const PAGE: &str = include_str!("status.html");
/// Interval between checks whether the page should end.
const LOOK: Duration = Duration::from_millis(100);

/// Content security policy: the page may run its own scripts and ask the same server, and nothing more.
const POLICY: &str = "default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'; img-src 'self' data: blob:; \
                      connect-src 'self'; font-src data:; frame-ancestors 'none'; form-action 'none'; base-uri 'none'";

type PageResponse = Response<std::io::Cursor<Vec<u8>>>;

/// A page that is served until it is dropped.
pub(super) struct Page {
    ends: Arc<AtomicBool>,
    serving: Option<JoinHandle<()>>,
}

impl Page {
    /// Starts to serve the page, and prints its address.
    ///
    /// # Errors
    /// If the address is not available.
    pub(super) fn open(
        request: StatusRequest,
        Address(address): Address,
        printer: &Printer,
    ) -> Result<Self, StepError> {
        let server = Server::http(address).map_err(StepError::Other);
        let server = server.with_context(|| {
            format!("--serve {address}: the address cannot be had; give another port, or 0 for any")
        })?;
        let address = server.server_addr().to_ip().unwrap_or(address);
        if !address.ip().is_loopback() {
            printer.warn(&format!(
                "--serve {address}: everybody who reaches this machine can read the page; 127.0.0.1 is for this machine alone"
            ));
        }
        printer.say(&format!("page: http://{address}/"));
        let pool = ThreadPoolBuilder::new().num_threads(1).build();
        let pool = pool.context("the page cannot be shown")?;
        let ends = Arc::new(AtomicBool::new(false));
        let serving = thread::Builder::new().name("page".to_owned()).spawn({
            let ends = Arc::clone(&ends);
            let shown = Shown { request, is_local: address.ip().is_loopback(), pool };
            move || {
                while !ends.load(Ordering::Relaxed) {
                    if let Ok(Some(asked)) = server.recv_timeout(LOOK) {
                        shown.answer(asked);
                    }
                }
            }
        });
        let serving = serving.context("the page cannot be shown")?;
        Ok(Self { ends, serving: Some(serving) })
    }
}

impl Drop for Page {
    fn drop(&mut self) {
        self.ends.store(true, Ordering::Relaxed);
        if let Some(serving) = self.serving.take() {
            let _ = serving.join();
        }
    }
}

/// State of a served page.
struct Shown {
    request: StatusRequest,
    /// Whether the page serves this machine only.
    is_local: bool,
    /// Thread for reading files: the threads of a run are busy until its end.
    pool: ThreadPool,
}

impl Shown {
    fn answer(&self, asked: Request) {
        let response = if !matches!(asked.method(), Method::Get | Method::Head) {
            refusal(405, "this page only shows")
        } else if self.is_local && !is_for_this_machine(&asked) {
            // Another site may use a host name that resolves to this machine (DNS rebinding).
            refusal(403, "this page is for this machine alone")
        } else {
            match asked.url().split('?').next().unwrap_or_default() {
                "/" => content("text/html; charset=utf-8", PAGE.as_bytes().to_vec()),
                "/status.json" => self.status(),
                "/report" => self.report(),
                _ => refusal(404, "there is no such page"),
            }
        };
        // A client that has disconnected is ignored.
        let _ = asked.respond(response);
    }

    fn standing(&self) -> Result<StandingOf, StepError> {
        self.pool.install(|| calib_pipeline::status(&self.request, &Printer::nobody()))
    }

    fn status(&self) -> PageResponse {
        let told = match self.standing() {
            Ok(standing) => serde_json::to_vec(&standing),
            Err(error) => serde_json::to_vec(&json!({ "error": error.to_string() })),
        };
        content("application/json", told.unwrap_or_default())
    }

    fn report(&self) -> PageResponse {
        let report =
            self.standing().ok().and_then(|standing| read_regular(standing.report()?).ok());
        match report {
            Some(report) => content("text/html; charset=utf-8", report),
            None => refusal(404, "there is no report yet"),
        }
    }
}

/// Whether the browser asked for an address of this machine.
fn is_for_this_machine(asked: &Request) -> bool {
    let host = asked.headers().iter().find(|header| header.field.equiv("Host"));
    host.is_none_or(|header| {
        let host = header.value.as_str();
        let name = host.rsplit_once(':').map_or(host, |(name, port)| {
            if port.bytes().all(|digit| digit.is_ascii_digit()) { name } else { host }
        });
        let name = name.trim_start_matches('[').trim_end_matches(']');
        name == "localhost" || name.parse::<IpAddr>().is_ok_and(|address| address.is_loopback())
    })
}

fn content(kind: &str, bytes: Vec<u8>) -> PageResponse {
    let headers = [
        ("Content-Type", kind),
        ("Cache-Control", "no-store"),
        ("X-Content-Type-Options", "nosniff"),
        ("Content-Security-Policy", POLICY),
        ("Referrer-Policy", "no-referrer"),
    ];
    let headers =
        headers.into_iter().filter_map(|(name, value)| Header::from_bytes(name, value).ok());
    headers.fold(Response::from_data(bytes), Response::with_header)
}

fn refusal(status: u16, reason: &str) -> PageResponse {
    content("text/plain; charset=utf-8", format!("{reason}\n").into_bytes())
        .with_status_code(status)
}
