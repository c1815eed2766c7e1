//! The link over mutual TLS: the real daemon as a process, the simulated control, certificates good and bad.

#![expect(clippy::disallowed_methods, reason = "a test of processes, files and sockets")]
#![expect(clippy::unwrap_used, reason = "helpers of tests")]

use std::io::{ErrorKind, Read, Write};
use std::net::TcpStream;
use std::sync::Arc;
use std::time::Duration;

use crate::tls_support::*;
use rustls::pki_types::pem::PemObject;
use rustls::pki_types::{CertificateDer, ServerName};
use simulator::certificates::{Authority, Role, Validity};
use simulator::control::{ControlIdentity, Flow, IdealMachine, LinkEvent};
use volcomp::protocol::CloseReason;

/// A control of the folder's own identity.
fn secure(folder: &Folder) -> Machine {
    Machine::new(|config| config.identity = Some(folder.control_identity()))
}

#[test]
fn a_link_over_tls_corrects_and_ends_in_order() {
    let folder = Folder::new();
    let mut machine = secure(&folder);
    folder.machine_file(&machine.address(), TLS);
    let mut daemon = folder.daemon();
    machine.control.wait_for_daemon(PATIENCE).unwrap_or_else(|e| panic!("{e}\n{}", daemon.log()));
    assert!(machine.until_corrected(), "{}\n{}", machine.said(), daemon.log());
    let status = folder.volcomp(&["status", "--json", "--config", "machine.toml"]);
    let status: serde_json::Value = serde_json::from_slice(&status.stdout).unwrap();
    assert_eq!(status["link"]["tls"], true, "{status}");
    daemon.terminate();
    let mut ended = |_: &simulator::control::CycleRecord| {
        let closed = machine.events.borrow().iter().any(|e| matches!(e, LinkEvent::Closed { .. }));
        Ok(if closed { Flow::Stop } else { Flow::GoOn })
    };
    machine.control.run_until(&mut IdealMachine, 60.0, &mut ended).unwrap();
    assert_eq!(daemon.wait(), Some(0), "{}", daemon.log());
    let events = machine.events.borrow();
    assert!(events.contains(&LinkEvent::Closed { reason: CloseReason::Shutdown }), "{events:?}");
}

#[test]
fn a_link_over_tls_comes_back() {
    let folder = Folder::new();
    let mut machine = secure(&folder);
    folder.machine_file(&machine.address(), TLS);
    for _ in 0..2 {
        let daemon = folder.daemon();
        machine.control.wait_for_daemon(PATIENCE).unwrap_or_else(|e| panic!("{e}\n{}", daemon.log()));
        assert!(machine.until_corrected());
        drop(daemon);
        machine.control.idle(Duration::from_millis(200));
    }
}

#[test]
fn a_control_of_another_authority_is_refused() {
    let folder = Folder::new();
    let other = Authority::new("other", Validity::days(1)).unwrap();
    let control = other.issue(Role::Control, &["127.0.0.1"], Validity::days(1)).unwrap();
    folder.keep("control", &control);
    let mut machine = secure(&folder);
    folder.machine_file(&machine.address(), TLS);
    machine.expect(
        &folder.daemon(),
        "the control's certificate was not issued by an authority in link.tls.ca",
        "the daemon refuses this control's certificate (UnknownCA)",
    );
}

#[test]
fn a_daemon_of_another_authority_is_refused() {
    let folder = Folder::new();
    let other = Authority::new("other", Validity::days(1)).unwrap();
    folder.keep("daemon", &other.issue(Role::Daemon, &["volcompd"], Validity::days(1)).unwrap());
    let mut machine = secure(&folder);
    folder.machine_file(&machine.address(), TLS);
    machine.expect(
        &folder.daemon(),
        "the control refuses this daemon's certificate as not issued by an authority that it knows",
        "the daemon's certificate was not issued by an authority of --tls-ca",
    );
}

#[test]
fn expired_certificates_are_refused_on_both_sides() {
    let folder = Folder::new();
    folder.keep("control", &folder.issue(Role::Control, "127.0.0.1", Validity::over()));
    let mut machine = secure(&folder);
    folder.machine_file(&machine.address(), TLS);
    machine.expect(
        &folder.daemon(),
        "the control's certificate has expired 1 days ago",
        "the daemon refuses this control's certificate (CertificateExpired)",
    );

    let folder = Folder::new();
    folder.keep("daemon", &folder.issue(Role::Daemon, "volcompd", Validity::over()));
    let mut machine = secure(&folder);
    folder.machine_file(&machine.address(), TLS);
    machine.expect(
        &folder.daemon(),
        "the control refuses this daemon's certificate as expired",
        "the daemon's certificate has expired",
    );
}

#[test]
fn a_control_with_another_name_is_refused() {
    let folder = Folder::new();
    folder.keep("control", &folder.issue(Role::Control, "cnc-2.shop", Validity::days(1)));
    let mut machine = secure(&folder);
    folder.machine_file(&machine.address(), &format!("{TLS}\nserver-name = \"cnc-1.shop\""));
    machine.expect(
        &folder.daemon(),
        "the control's certificate is not for \"cnc-1.shop\" but for",
        "the daemon refuses this control's certificate (BadCertificate)",
    );
    // and with the right name the same files do
    folder.machine_file(&machine.address(), &format!("{TLS}\nserver-name = \"cnc-2.shop\""));
    let _daemon = folder.daemon();
    machine.control.wait_for_daemon(PATIENCE).unwrap();
}

#[test]
fn certificates_do_not_change_roles() {
    let folder = Folder::new();
    folder.keep("control", &folder.issue(Role::Daemon, "127.0.0.1", Validity::days(1)));
    let mut machine = secure(&folder);
    folder.machine_file(&machine.address(), TLS);
    let said = "the control's certificate is not one for a server";
    machine.expect(&folder.daemon(), said, "the daemon refuses this control's certificate");

    let folder = Folder::new();
    folder.keep("daemon", &folder.issue(Role::Control, "127.0.0.1", Validity::days(1)));
    let mut machine = secure(&folder);
    folder.machine_file(&machine.address(), TLS);
    let said = "the control refuses this daemon's certificate as not one for a client";
    machine.expect(&folder.daemon(), said, "the daemon's certificate is not one for a client");
}

#[test]
fn a_client_without_a_certificate_gets_no_answer() {
    let folder = Folder::new();
    let mut machine = secure(&folder);
    let mut roots = rustls::RootCertStore::empty();
    roots.add(CertificateDer::from_pem_file(folder.path("ca.pem")).unwrap()).unwrap();
    let config =
        rustls::ClientConfig::builder_with_provider(Arc::new(rustls::crypto::ring::default_provider()))
            .with_protocol_versions(&[&rustls::version::TLS13])
            .unwrap()
            .with_root_certificates(roots)
            .with_no_client_auth();
    let name = ServerName::try_from("127.0.0.1").unwrap();
    let mut tls = rustls::ClientConnection::new(Arc::new(config), name).unwrap();
    let mut socket = TcpStream::connect(machine.control.address()).unwrap();
    let mut stream = rustls::Stream::new(&mut tls, &mut socket);
    // this side believes that all is well until it reads the answer
    let _ = stream.write_all(b"VCMP");
    let error = stream.read(&mut [0; 16]).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::InvalidData, "{error}");
    assert!(error.to_string().contains("CertificateRequired"), "{error}");
    machine.control.idle(Duration::from_millis(100));
    assert!(machine.said().contains("it showed no certificate"), "{}", machine.said());
}

#[test]
fn plain_and_tls_tell_each_other_apart() {
    let folder = Folder::new();
    let mut machine = secure(&folder);
    folder.machine_file(&machine.address(), "");
    machine.expect(
        &folder.daemon(),
        "speaks TLS; add [link.tls] to the machine file",
        "it does not speak TLS; add [link.tls] to the machine file of the daemon",
    );

    let folder = Folder::new();
    let mut machine = Machine::new(|_| {});
    folder.machine_file(&machine.address(), TLS);
    machine.expect(
        &folder.daemon(),
        "the control does not speak TLS: switch TLS on at the control",
        "BadFrame",
    );
}

#[test]
fn who_is_silent_is_not_waited_for() {
    let folder = Folder::new();
    let mut machine = secure(&folder);
    let silent = TcpStream::connect(machine.control.address()).unwrap();
    machine.control.idle(Duration::from_millis(1500));
    assert!(machine.said().contains("no TLS handshake in time"), "{}", machine.said());
    drop(silent);

    // a control that accepts and says nothing
    let listener = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    folder.machine_file(&listener.local_addr().unwrap().to_string(), TLS);
    let daemon = folder.daemon();
    let (_held, _) = listener.accept().unwrap();
    machine.expect(&daemon, "no TLS handshake within 1 s", "");

    // and one that hangs up
    let daemon = folder.daemon();
    std::thread::spawn(move || listener.incoming().for_each(drop));
    machine.expect(&daemon, "closed the connection during the TLS handshake", "");
}

#[test]
fn one_address_may_connect_and_no_other() {
    let folder = Folder::new();
    for identity in [None, Some(folder.control_identity())] {
        let tls = if identity.is_some() { TLS } else { "" };
        // from elsewhere
        let mut machine = Machine::new(|config| {
            config.peer = Some([127, 0, 0, 2].into());
            config.identity.clone_from(&identity);
        });
        folder.machine_file(&machine.address(), tls);
        let says = if identity.is_some() {
            "closed the connection during the TLS handshake"
        } else {
            "may not connect"
        };
        machine.expect(&folder.daemon(), says, "not the address that may connect");
        // from there
        let mut machine = Machine::new(|config| {
            config.peer = Some([127, 0, 0, 1].into());
            config.identity.clone_from(&identity);
        });
        folder.machine_file(&machine.address(), tls);
        let _daemon = folder.daemon();
        machine.control.wait_for_daemon(PATIENCE).unwrap();
    }
}

#[test]
fn no_log_and_no_answer_shows_a_key() {
    let folder = Folder::new();
    let mut machine = secure(&folder);
    folder.machine_file(&machine.address(), TLS);
    let mut said = String::new();
    let mut daemon = folder.daemon();
    machine.control.wait_for_daemon(PATIENCE).unwrap_or_else(|e| panic!("{e}\n{}", daemon.log()));
    assert!(machine.until_corrected());
    for arguments in [
        &["status", "--config", "machine.toml"][..],
        &["status", "--json", "--config", "machine.toml"],
        &["check", "machine.toml"],
        &["check", "--json", "machine.toml"],
    ] {
        let out = folder.volcomp(arguments);
        said += &String::from_utf8_lossy(&[out.stdout, out.stderr].concat());
    }
    drop(machine);
    daemon.terminate();
    daemon.wait();
    // what cannot be used is not quoted either
    let key = folder.text("daemon.key");
    std::fs::write(folder.path("daemon.key"), key.replace("-----END", "-----FIN")).unwrap();
    said += &String::from_utf8_lossy(&folder.volcomp(&["check", "machine.toml"]).stderr);
    std::fs::write(folder.path("daemon.key"), key.replacen("-----\n", "-----\n!", 1)).unwrap();
    said += &String::from_utf8_lossy(&folder.volcomp(&["check", "machine.toml"]).stderr);
    assert_eq!(folder.daemon().wait(), Some(78));
    std::fs::write(folder.path("daemon.key"), key).unwrap();
    let debug = format!("{:?}", folder.control_identity());
    said += &debug;
    // everything that the daemon has written: log, audit log, recordings, counters, models
    let (keys, others) = keys_and_others(folder.dir.path());
    assert_eq!(keys.len(), 3);
    let recorded = |name: &str| others.iter().any(|p| p.to_string_lossy().contains(name));
    assert!(recorded("audit") && recorded(".vcrec") && recorded("/log"), "{others:?}");
    for file in &others {
        said += &String::from_utf8_lossy(&std::fs::read(file).unwrap());
    }
    assert!(said.contains("no private key in it") && said.contains("tls=true"), "{said}");
    for file in keys {
        let text = std::fs::read_to_string(&file).unwrap();
        // bytes 36 to 68 are the secret; what follows is the public key, which stands in the certificate, too
        let lines: Vec<&str> = text.lines().filter(|l| !l.starts_with("-----")).collect();
        let written = [&lines[0][48..64], &lines[1][..16]];
        let der = rustls::pki_types::PrivateKeyDer::from_pem_slice(text.as_bytes()).unwrap();
        let bytes = &der.secret_der()[40..56];
        let hex: String = bytes.iter().map(|b| format!("{b:02x}")).collect();
        let list = bytes.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ");
        for secret in written.map(str::to_owned).into_iter().chain([hex, list]) {
            assert!(!said.contains(&secret), "{}", file.display());
        }
    }
}

/// `check` and the daemon refuse the same files with the same words.
#[track_caller]
fn refused(folder: &Folder, code: i32, says: &[&str]) {
    let out = folder.volcomp(&["check", "machine.toml"]);
    let checked = String::from_utf8_lossy(&out.stderr).into_owned();
    assert_eq!(out.status.code(), Some(code), "{checked}");
    let mut daemon = folder.daemon();
    assert_eq!(daemon.wait(), Some(code), "{}", daemon.log());
    for part in says {
        assert!(checked.contains(part), "check: expected {part}\n{checked}");
        assert!(daemon.log().contains(part), "daemon: expected {part}\n{}", daemon.log());
    }
    assert!(checked.contains("machine.toml:"), "no place in the machine file:\n{checked}");
    std::fs::remove_file(folder.path("log")).unwrap();
}

#[test]
fn files_that_cannot_be_used_are_named_with_a_remedy() {
    let folder = Folder::new();
    folder.machine_file("127.0.0.1:9", TLS);
    let restore = |folder: &Folder, stem: &str, role| {
        folder.keep(stem, &folder.issue(role, "127.0.0.1", Validity::days(1)));
    };

    for mode in [0o644, 0o604, 0o660, 0o622] {
        folder.mode("daemon.key", mode);
        let found = format!("its mode is {mode:04o}, so others may read or change the private key");
        refused(&folder, 78, &["link.tls.key", "daemon.key", &found, "chmod 06"]);
    }
    restore(&folder, "daemon", Role::Daemon);

    std::fs::remove_file(folder.path("daemon.key")).unwrap();
    refused(&folder, 74, &["link.tls.key", "daemon.key", "No such file"]);
    restore(&folder, "daemon", Role::Daemon);

    std::fs::copy(folder.path("daemon.pem"), folder.path("daemon.key")).unwrap();
    folder.mode("daemon.key", 0o600);
    refused(&folder, 78, &["no private key in it", "BEGIN PRIVATE KEY", "with a password cannot be used"]);
    restore(&folder, "daemon", Role::Daemon);

    folder.keep("other", &folder.issue(Role::Daemon, "volcompd", Validity::days(1)));
    std::fs::copy(folder.path("other.key"), folder.path("daemon.key")).unwrap();
    refused(&folder, 78, &["this is not the key of the certificate", "made together"]);
    restore(&folder, "daemon", Role::Daemon);

    for (file, key) in [("ca.pem", "link.tls.ca"), ("daemon.pem", "link.tls.certificate")] {
        let good = folder.text(file);
        std::fs::write(folder.path(file), "nothing\n").unwrap();
        refused(&folder, 78, &[key, file, "no certificate in it", "BEGIN CERTIFICATE"]);
        let junk = "-----BEGIN CERTIFICATE-----\nAAAA\n-----END CERTIFICATE-----\n";
        std::fs::write(folder.path(file), junk).unwrap();
        refused(&folder, 78, &[key, file, "use certificates of version 3"]);
        std::fs::write(folder.path(file), good).unwrap();
    }
    let fine = folder.volcomp(&["check", "machine.toml"]);
    let text = String::from_utf8_lossy(&fine.stdout).into_owned();
    assert!(fine.status.success() && text.contains("over TLS as \"127.0.0.1\""), "{text}");
}

#[test]
fn a_plain_link_to_elsewhere_is_checked_with_a_note() {
    let folder = Folder::new();
    let file = folder.machine_file("192.0.2.1:7878", "");
    refused(&folder, 78, &["is on another computer", "add [link.tls]; or plain-remote = true"]);
    let text = std::fs::read_to_string(&file).unwrap();
    std::fs::write(&file, text.replace("[link]\n", "[link]\nplain-remote = true\n")).unwrap();
    let out = folder.volcomp(&["check", "machine.toml"]);
    let said = String::from_utf8_lossy(&out.stdout).into_owned();
    assert!(
        out.status.success() && said.contains("note: plain-remote: the link to 192.0.2.1:7878"),
        "{said}"
    );
    let mut machine = Machine::new(|_| {});
    machine.expect(&folder.daemon(), "plain-remote: the link leaves this computer without", "");
}

#[test]
fn a_control_needs_files_that_fit() {
    let folder = Folder::new();
    let from = |ca: &str, certificate: &str, key: &str| {
        ControlIdentity::from_files(&folder.path(ca), &folder.path(certificate), &folder.path(key))
            .map(drop)
            .map_err(|e| e.to_string())
    };
    assert_eq!(from("ca.pem", "control.pem", "control.key"), Ok(()));
    let lost = from("lost.pem", "control.pem", "control.key").unwrap_err();
    assert!(lost.contains("lost.pem") && lost.contains("No such file"), "{lost}");
    let mixed = from("ca.pem", "control.pem", "daemon.key").unwrap_err();
    assert!(mixed.contains("control.pem") && mixed.contains("cncsim dev certificates"), "{mixed}");
    let swapped = from("ca.pem", "control.key", "control.key").unwrap_err();
    assert!(swapped.contains("no certificate in it"), "{swapped}");
    let swapped = from("ca.pem", "control.pem", "control.pem").unwrap_err();
    assert!(swapped.contains("no private key in it"), "{swapped}");
}
