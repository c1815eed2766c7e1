//! `cncsim` as a control: commands, link, TLS, monitor.

mod bench_link;
mod cli;
mod input_limits;
mod link;
mod link_tls;
mod monitor_link;
mod ranges;
mod support;
mod tls_support;
