//! `volcompd` as a process, with a control and sensors on loopback.

mod adversary;
mod browser;
mod calls;
mod commands;
mod gateway;
mod http;
mod learned_state;
mod link;
mod models;
mod page;
mod page_banner;
mod recording;
mod replay_damage;
mod retained_state;
mod sensors;
mod service;
mod soak;
mod status;
mod support;
mod thermal;
