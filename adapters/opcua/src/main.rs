//! `volcomp-opcua`: what the daemon says, by OPC UA.
//!
//! A process of its own that asks the daemon's status socket once a second. Read-only: no node can be written, no method
//! can be called. Reading order: this file, [`values`] (status to values, pure), [`space`] (nodes).

mod daemon;
mod space;
mod values;

use std::net::SocketAddr;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

use clap::Parser;
use opcua::server::ServerBuilder;
use tokio::net::TcpListener;
use tokio::time::{MissedTickBehavior, interval};

use space::{Identification, Space};

/// Interval at which the daemon is asked.
const ASK: Duration = Duration::from_secs(1);
/// Sessions at the same time.
const SESSIONS: usize = 16;
/// As in the other programs: 64 wrong command line, 74 socket not usable, 70 error of the program.
const EX_USAGE: u8 = 64;
const EX_IOERR: u8 = 74;
const EX_SOFTWARE: u8 = 70;

/// Publishes the status of volcompd by OPC UA, read-only, until stopped
///
/// The model is OPC 40501-1: a machine tool below Objects/Machines, with the compensation as an element of its Monitoring. It asks the
/// daemon's status socket once a second; where the daemon does not answer, values are Bad_NoCommunication.
///
/// OPC UA is neither encrypted nor authenticated here: keep it on loopback, or on a network that is protected otherwise.
///
/// Example:
///
///   volcomp-opcua --socket /run/volcomp/volcompd.sock --listen 127.0.0.1:4840
#[derive(Debug, Parser)]
#[command(name = "volcomp-opcua", version)]
struct Args {
    /// The daemon's status socket.
    #[arg(long, value_name = "PATH", default_value = "/run/volcomp/volcompd.sock")]
    socket: PathBuf,
    /// Address and port for clients.
    #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1:4840")]
    listen: SocketAddr,
    /// Print the manual page, for packages.
    #[arg(long, hide = true)]
    manual: bool,
    /// Listen beyond this computer, although everybody who reaches the address can read.
    #[arg(long)]
    plain_remote: bool,
    /// Identification: manufacturer of the machine tool.
    #[arg(long, value_name = "TEXT", value_parser = short_text, env = "MANUFACTURER")]
    manufacturer: Option<String>,
    /// Identification: serial number of the machine tool.
    #[arg(long, value_name = "TEXT", value_parser = short_text, env = "SERIAL_NUMBER")]
    serial_number: Option<String>,
    /// Identification: globally unique URI of the machine tool.
    #[arg(long, value_name = "URI", value_parser = short_text, env = "PRODUCT_INSTANCE_URI")]
    product_instance_uri: Option<String>,
}

/// A text of at most 256 bytes without control characters.
fn short_text(text: &str) -> Result<String, String> {
    if text.len() > 256 || text.chars().any(char::is_control) {
        return Err("at most 256 bytes, without control characters".to_owned());
    }
    Ok(text.to_owned())
}

/// A line on stderr; a closed stderr is no failure.
fn note(text: &str) {
    use std::io::Write as _;
    let _ = writeln!(std::io::stderr(), "{text}");
}

fn main() -> ExitCode {
    let args = match Args::try_parse() {
        Ok(args) => args,
        Err(error) => {
            let _ = error.print();
            return if error.use_stderr() { ExitCode::from(EX_USAGE) } else { ExitCode::SUCCESS };
        }
    };
    if args.manual {
        let page = clap_mangen::Man::new(<Args as clap::CommandFactory>::command());
        return if page.render(&mut std::io::stdout()).is_ok() {
            ExitCode::SUCCESS
        } else {
            ExitCode::from(EX_IOERR)
        };
    }
    if !args.listen.ip().is_loopback() && !args.plain_remote {
        note(&format!(
            "error: --listen {}: everybody who reaches this address could read\n  \
             hint: listen on 127.0.0.1, or add --plain-remote where the network is protected",
            args.listen
        ));
        return ExitCode::from(EX_USAGE);
    }
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build();
    let ended = match runtime {
        Ok(runtime) => runtime.block_on(serve(args)),
        Err(error) => Err((EX_SOFTWARE, format!("error: {error}"))),
    };
    match ended {
        Ok(()) => ExitCode::SUCCESS,
        Err((code, message)) => {
            note(&message);
            ExitCode::from(code)
        }
    }
}

async fn serve(args: Args) -> Result<(), (u8, String)> {
    use tokio::signal::unix::{SignalKind, signal};
    let software = |text: String| (EX_SOFTWARE, format!("error: {text}"));
    let signals = || Ok((signal(SignalKind::terminate())?, signal(SignalKind::interrupt())?));
    let (mut terminate, mut interrupt) = signals().map_err(|e: std::io::Error| software(e.to_string()))?;
    let listener = TcpListener::bind(args.listen).await.map_err(|error| {
        (
            EX_IOERR,
            format!(
                "error: --listen {}: {error}\n  hint: choose a free port of an address of this computer",
                args.listen
            ),
        )
    })?;
    let address = listener.local_addr().map_err(|e| software(e.to_string()))?;
    let mut builder = ServerBuilder::new_anonymous("volcomp")
        .application_uri("urn:volcomp:opcua")
        .product_uri("urn:volcomp")
        .host(address.ip().to_string())
        .port(address.port())
        .max_sessions(SESSIONS)
        .discovery_urls(vec![format!("opc.tcp://{address}/")]);
    for manager in space::managers().map_err(software)? {
        builder = builder.with_node_manager(manager);
    }
    let (server, handle) = builder.build().map_err(software)?;
    let identification = Identification {
        manufacturer: args.manufacturer,
        serial_number: args.serial_number,
        product_instance_uri: args.product_instance_uri,
    };
    let mut space = Space::new(&handle).map_err(software)?;
    let running = tokio::spawn(server.run_with(listener));
    note(&format!("OPC UA on opc.tcp://{address}/"));

    let publishing = async {
        let mut ticks = interval(ASK);
        ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let mut answered = None;
        loop {
            ticks.tick().await;
            let reading = daemon::status(&args.socket).await;
            if answered != Some(reading.is_ok()) {
                answered = Some(reading.is_ok());
                match &reading {
                    Ok(status) => note(&format!("volcompd of {} answers", values::machine(status))),
                    Err(error) => note(&format!("error: {}: {error}", args.socket.display())),
                }
            }
            if let Err(error) = space.publish(reading.ok().as_ref(), &identification) {
                return software(error);
            }
        }
    };
    let ended = tokio::select! {
        failed = publishing => Err(failed),
        ended = running => match ended {
            Ok(Err(error)) => Err(software(error)),
            Ok(Ok(())) => Ok(()),
            Err(error) => Err(software(error.to_string())),
        },
        _ = terminate.recv() => Ok(()),
        _ = interrupt.recv() => Ok(()),
    };
    handle.cancel();
    ended
}
