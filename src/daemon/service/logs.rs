//! The service's log lines about link, engine and real-time settings.

use tracing::{info, warn};

use crate::handshake;
use crate::realtime::RealtimeReport;
use crate::status_collector::StatusCollector;
use volcomp_engine::fault::{self, Code};
use volcomp_engine::{Event, State};
use volcomp_protocol::ControlHello;
use volcomp_units::NS_PER_S;

pub(super) fn log_realtime(report: &RealtimeReport) {
    let (fifo, affinity) = (report.fifo.text(), report.affinity.text());
    let memory_lock = report.memory_lock.text();
    let (priority, cpu) = (report.priority, report.cpu);
    if report.has_refusal() {
        warn!(
            priority,
            fifo,
            cpu,
            affinity,
            memory_lock,
            code = %Code::REALTIME_REFUSED,
            "real-time settings not fully granted; cycles may be late under load \
             (set LimitRTPRIO= and LimitMEMLOCK= in the unit)"
        );
    } else {
        info!(priority, fifo, cpu, affinity, memory_lock, "real-time settings");
    }
}

pub(super) fn log_link_up(address: &std::net::SocketAddr, hello: &ControlHello, held_back: u64) {
    let axes: String = handshake::announced(hello).iter().map(|axis| axis.name.letter()).collect();
    let cycle_s = hello.cycle_ns as f64 / NS_PER_S;
    info!(%address, control = %hello.software, machine = %hello.machine, axes, cycle_s, held_back, "link up");
}

pub(super) fn log_event(event: &Event, held_back: u64, status_collector: &StatusCollector) {
    let Event::StateChanged { from, to, reason, detail } = event;
    let numbers = status_collector.numbers(detail.as_ref());
    let (from, to_name, entry) = (from.name(), to.name(), fault::of_reason(*reason));
    let code = entry.code;
    match (to, reason) {
        (State::Faulted | State::Holding, _) => {
            warn!(from, to = to_name, reason = entry.name, %code, numbers, held_back, "{}", entry.text);
        }
        _ => info!(from, to = to_name, reason = entry.name, %code, numbers, held_back, "{}", entry.text),
    }
}
