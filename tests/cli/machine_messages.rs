//! Every message of the machine file about axes, link and engine: the bad text, and the lines it must give.

use volcomp::config::{Interface, MachineConfig};

use crate::config_messages::{machine, machine_shows};

#[test]
fn limits_of_axes() {
    let axis =
        |text: &str| format!("format = \"volcomp-machine/1\"\nmachine = \"m\"\nmodel = \"n.toml\"\n{text}\n");
    machine_shows(
        &axis(""),
        &["no axis has limits, so nothing could be corrected", "add [axes.x] with limit-um"],
    );
    machine_shows(&axis("[axes]"), &["no axis has limits", "machine.toml:4:2"]);
    machine_shows(
        &axis("[axes.x]\nrate-um-per-s = 1\nacceleration-um-per-s2 = 1"),
        &["axes.x.limit-um is missing", "machine.toml:4:7", "an axis without all its limits is never offset"],
    );
    let with = |text: &str| machine(&format!("{text}\n"));
    machine_shows(
        &with("warning-um = 60"),
        &["axes.x.warning-um is 60 um, above limit-um (50 um)", "machine.toml:8:14"],
    );
    machine_shows(
        &machine("").replace("limit-um = 50", "limit-um = 0"),
        &["axes.x.limit-um is 0 um", "above 0 up to 5000 um", "machine.toml:5:12"],
    );
    machine_shows(
        &machine("").replace("limit-um = 50", "limit-um = 50000"),
        &["axes.x.limit-um is 50000 um", "up to 5000 um"],
    );
    machine_shows(&machine("").replace("per-s = 100", "per-s = -1"), &["rate-um-per-s is -1 um/s"]);
    machine_shows(
        &machine("").replace("s2 = 1000", "s2 = nan"),
        &["acceleration-um-per-s2 is not a finite number"],
    );
    machine_shows(&with("jump-mm = 0"), &["jump-mm is 0 mm"]);
    machine_shows(&with("reversal-deadband-um = -1"), &["reversal-deadband-um is -1 um"]);
    machine_shows(&with("read-back-tolerance-um = 0"), &["read-back-tolerance-um is 0 um"]);
    machine_shows(
        &with("read-back-tolerance-um = 500"),
        &[
            "axes.x.read-back-tolerance-um is 500 um, not below limit-um (50 um)",
            "machine.toml:8:26",
            "tolerate less than the limit",
        ],
    );
    machine_shows(
        &with(
            "[axes.c]\nlimit-arcsec = 20\nrate-arcsec-per-s = 9\nacceleration-arcsec-per-s2 = 9\nread-back-tolerance-arcsec = 20",
        ),
        &[
            "axes.c.read-back-tolerance-arcsec is 20 arcsec, not below limit-arcsec (20 arcsec)",
            "machine.toml:12:30",
        ],
    );
    machine_shows(
        &with("soft-limit-mm = [1e308, 5]"),
        &["axes.x.soft-limit-mm is [1e308, 5]: the lower end"],
    );
    machine_shows(&with("[axes.s]"), &["the spindle is never offset", "machine.toml:8:7"]);
    machine_shows(&with("[axes.Y]"), &["unknown axis axes.Y", "write [axes.y]"]);
    let nine: String = "yzuvwabc".chars().map(|c| format!("[axes.{c}]\n")).collect();
    machine_shows(&with(&nine), &["9 axes, but the link carries 8"]);
}

#[test]
fn controls_that_are_read_and_written_by_calls() {
    let link = |more: &str| machine(&format!("[link]\naddress = \"127.0.0.1:7878\"\ncycle-ms = 4\n{more}\n"));
    let interface = |more: &str| MachineConfig::parse("m", &link(more)).expect("right").link.interface;
    assert_eq!(interface(""), Interface::Frames);
    assert_eq!(interface("interface = \"read-write\""), Interface::ReadWrite { poll_s: 0.004 });
    assert_eq!(interface("interface = \"read-write\"\npoll-ms = 0"), Interface::ReadWrite { poll_s: 0.0 });
    machine_shows(
        &link("interface = \"i5os\""),
        &["link.interface does not know \"i5os\"", "write one of: frames, read-write"],
    );
    machine_shows(&link("interface = \"read-write\"\npoll-ms = 101"), &["link.poll-ms", "0 to 100"]);
    machine_shows(&link("poll-ms = 4"), &["read and written by calls", "add interface = \"read-write\""]);
}

#[test]
fn links_that_leave_this_computer() {
    let link = |more: &str| machine(&format!("[link]\naddress = \"192.168.0.10:7878\"\n{more}\n"));
    machine_shows(
        &link(""),
        &[
            "link.address 192.168.0.10:7878 is on another computer, and the link has neither authentication nor",
            "machine.toml:9:11",
            "add [link.tls]; or plain-remote = true to [link]",
        ],
    );
    machine_shows(&link("plain-remote = false"), &["is on another computer"]);
    machine_shows(&link("plain-remote = 1"), &["link.plain-remote must be true or false"]);
    let permitted = MachineConfig::parse("m", &link("plain-remote = true")).expect("permitted");
    assert!(permitted.link.is_exposed() && permitted.link.tls.is_none());
    for inside in ["127.0.0.1", "127.8.8.8", "[::1]", "[::ffff:127.0.0.1]"] {
        let text = machine(&format!("[link]\naddress = \"{inside}:7878\"\n"));
        assert!(!MachineConfig::parse("m", &text).expect("loopback").link.is_exposed(), "{inside}");
    }
    for outside in ["0.0.0.0:7878", "[2001:db8::1]:7878", "[::]:1"] {
        let text = machine(&format!("[link]\naddress = \"{outside}\"\n"));
        machine_shows(&text, &["is on another computer"]);
    }
}

#[test]
fn whom_the_link_trusts() {
    let tls = |keys: &str| machine(&format!("[link]\naddress = \"192.168.0.10:7878\"\n[link.tls]\n{keys}\n"));
    let files = "ca = \"ca.pem\"\ncertificate = \"d.pem\"\nkey = \"d.key\"";
    machine_shows(
        &tls(""),
        &[
            "link.tls.ca is missing",
            "link.tls.certificate is missing",
            "link.tls.key is missing",
            "machine.toml:10:7",
            "add key = \"...\", the private key of that certificate, a path seen from this file",
        ],
    );
    machine_shows(&tls(&files.replace("d.key", " ")), &["link.tls.key is empty", "machine.toml:13:7"]);
    machine_shows(
        &tls(&files.replace("ca =", "cert-authority =")),
        &["link.tls.ca is missing", "unknown key `cert-authority` in [link.tls]"],
    );
    machine_shows(
        &tls(&format!("{files}\nserver-name = \"cnc 1\"")),
        &["link.tls.server-name \"cnc 1\" is not a name of a host", "stands in the control's certificate"],
    );
    let read = |text: &str| MachineConfig::parse("m", text).expect("right").link;
    let plain_name = read(&tls(files));
    assert!(!plain_name.is_exposed());
    assert_eq!(plain_name.tls.expect("written").server_name, "192.168.0.10", "the address is the default");
    let named = read(&tls(&format!("{files}\nserver-name = \"cnc-1.shop\"")));
    assert_eq!(named.tls.expect("written").server_name, "cnc-1.shop");
    assert_eq!(read(&machine("")).tls, None, "plain TCP on loopback is the default");
}

#[test]
fn link_engine_and_the_rest() {
    let shows = |text: &str, expected: &[&str]| machine_shows(&machine(&format!("{text}\n")), expected);
    for address in ["localhost:7878", "127.0.0.1", "127.0.0.1:0", "1.2.3.4:99999"] {
        shows(
            &format!("[link]\naddress = \"{address}\""),
            &["is not an address with port", "machine.toml:9:11", "192.168.0.10:7878"],
        );
    }
    shows(
        "[link]\ncycle-ms = 0.1",
        &["link.cycle-ms is 0.1 ms", "allowed is 0.25 to 10 ms", "machine.toml:9:12"],
    );
    shows(
        "[link]\ncycle-ms = \"1\"",
        &["link.cycle-ms must be a number, found a text", "write 1 without quotes"],
    );
    shows("[link]\nreconnect-min-s = 20", &["link.reconnect-max-s is 10, below reconnect-min-s (20)"]);
    shows("[link]\nheartbeat-s = 2", &["link.silence-s is 3, below twice heartbeat-s (4)"]);
    shows("[link]\nconnect-timeout-s = 0", &["connect-timeout-s is 0 s", "0.1 to 300 s"]);
    shows("[engine]\nramp-s = 0", &["engine.ramp-s is 0 s", "machine.toml:9:10"]);
    shows("[engine]\ngain = 1.01", &["engine.gain is 1.01", "allowed is 0 to 1"]);
    shows("[engine]\nhold-s = -1", &["engine.hold-s is -1 s"]);
    shows("[engine]\nstale-ms = 1.5", &["engine.stale-ms is 1.5, below two cycles (2)"]);
    shows(
        "[engine]\nstart = \"always\"",
        &["start does not know \"always\"", "write one of: on-command, on-connect"],
    );
    shows("[engine]\nposition-source = \"actul\"", &["did you mean actual?"]);
    shows("[engine]\nout-of-travel = \"ramp\"", &["out-of-travel does not know \"ramp\""]);
    shows("[engine]\nrest = \"keep\"", &["rest does not know \"keep\""]);
    shows("[engine]\nread-back-cycles = 0", &["read-back-cycles is 0", "allowed is 1 to 10000"]);
    shows("[engine]\nread-back-cycles = 2.5", &["read-back-cycles must be a whole number"]);
    shows("[realtime]\npriority = 100", &["realtime.priority is 100", "allowed is 0 to 99"]);
    shows("[realtime]\ncpu = -1", &["realtime.cpu is -1", "allowed is 0 to 1023"]);
    shows("[realtime]\nlock-memory = 1", &["realtime.lock-memory must be true or false, found a number"]);
    shows("[realtime]\nbusy-poll-us = 1e6", &["busy-poll-us is 1000000 us"]);
    shows("[status]\nsocket = 1", &["status.socket must be a text"]);
    shows("[log]\ntarget = \"syslog\"", &["log.target does not know \"syslog\""]);
    shows(
        "[log]\nlevel = \"loud\"",
        &["log.level \"loud\" is not a filter", "error, warn, info, debug, trace"],
    );
    machine_shows(
        &machine("").replace("[axes.x]", "link = 1\n[axes.x]"),
        &["link must be a table, found a number", "machine.toml:4:1", "write a heading [link]"],
    );
    machine_shows(&machine("").replace("\"model.toml\"", "\"\""), &["model is empty", "machine.toml:3:9"]);
}
