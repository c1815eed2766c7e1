//! The banner and the events of the page, by node with a minimal document: what stands first, and what is over.

#![allow(clippy::expect_used, clippy::disallowed_methods, reason = "a test program: it fails by panicking")]

use std::io::Write;
use std::path::Path;
use std::process::{Command, Stdio};

use serde_json::{Value, json};
use volcomp_engine::fault::CATALOGUE;

/// A status with what the banner reads of it.
fn status(state: &str, health: &Value, warnings: &Value, faults: &Value) -> Value {
    let events = json!([
        { "time": "2026-05-03T08:00:00Z", "last_time": "2026-05-03T08:00:40Z", "code": "VC-6002", "severity": "warning",
            "name": "link-lost", "count": 2 },
        { "time": "2026-05-03T08:00:00Z", "code": "VC-4001", "severity": "fault", "name": "read-back", "count": 1 },
    ]);
    json!({
        "state": state, "machine": "m", "gain": 1.0, "state_since_s": 3.0, "health": health, "faults": faults,
        "recent": { "warnings": warnings }, "events": events,
    })
}

/// What the page shows for each of these statuses.
fn shown(statuses: &[Value]) -> Vec<Value> {
    let page = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/daemon/http/page");
    let folder = tempfile::tempdir().expect("directory");
    for name in ["common.js", "sections.js"] {
        let text = std::fs::read_to_string(page.join(name)).expect("a script of the page");
        std::fs::write(folder.path().join(name), text.replace("\"/common.js\"", "\"./common.js\""))
            .expect("written");
    }
    std::fs::write(folder.path().join("package.json"), "{\"type\": \"module\"}").expect("written");
    std::fs::write(folder.path().join("run.mjs"), include_str!("page_banner.mjs")).expect("written");
    let mut node = Command::new("node")
        .arg("run.mjs")
        .current_dir(folder.path())
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .expect("node runs");
    let codes: Vec<Value> = CATALOGUE
        .iter()
        .map(|e| json!({ "code": e.code.to_string(), "text": e.text, "reaction": e.reaction, "remedy": e.remedy }))
        .collect();
    let input = json!({ "codes": codes, "statuses": statuses }).to_string();
    node.stdin.take().expect("piped").write_all(input.as_bytes()).expect("sent");
    let output = node.wait_with_output().expect("ends");
    assert!(output.status.success(), "{output:?}");
    serde_json::from_slice(&output.stdout).expect("JSON")
}

#[test]
#[cfg_attr(not(tool_node), ignore = "needs node")]
fn a_warning_is_not_green_and_what_is_over_says_so() {
    let lost = json!({ "code": "VC-6002", "text": "the link to the control has ended", "count": 2, "age_s": 30.4, "present": false });
    let limited = json!({ "code": "VC-4005", "text": "an offset is limited", "count": 7, "age_s": 0.1, "present": true });
    let warning =
        |code: &str, cause: &str| json!({ "verdict": "warning", "code": code, "cause": cause, "remedy": "" });
    let ok = json!({ "verdict": "ok", "code": null, "cause": "", "remedy": "" });
    let held = json!({ "verdict": "held", "code": "VC-2001", "cause": "compensation waits: not all axes are homed", "remedy": "home the machine" });
    let fault = json!([{ "code": "VC-4001", "age_s": 2.0 }]);
    let faulted = json!({ "verdict": "faulted", "code": "VC-4001", "cause": "another offset: x: 60 um, limit 0.5 um",
        "remedy": CATALOGUE.iter().find(|e| e.name == "read-back").expect("known").remedy });
    let none = json!([]);
    let all = shown(&[
        status("active", &ok, &none, &none),
        status("active", &warning("VC-4005", "an offset is limited"), &json!([limited, lost]), &none),
        status(
            "active",
            &warning("VC-6002", "the link to the control has ended (over)"),
            &json!([lost]),
            &none,
        ),
        status("armed", &held, &none, &none),
        status("faulted", &faulted, &none, &fault),
    ]);
    let colours: Vec<&str> = all.iter().filter_map(|shown| shown["colour"].as_str()).collect();
    assert_eq!(colours, ["active", "held", "held", "held", "bad"]);
    assert_eq!(all[1]["cause"], "VC-4005 an offset is limited");
    assert_eq!(all[1]["warnings"], json!(["VC-6002 the link to the control has ended × 2 (30 s ago, over)"]));
    assert_eq!(all[2]["cause"], "VC-6002 the link to the control has ended (30 s ago, over)");
    assert_eq!(
        all[2]["announce"], "COMPENSATING, VC-6002",
        "what is read aloud does not change every second"
    );
    assert_eq!(all[3]["cause"], "VC-2001 compensation waits: not all axes are homed");
    let remedy = all[4]["remedy"].as_str().expect("text");
    assert!(remedy.contains("`volcomp enable --clear-fault`"), "{remedy}");
    assert!(
        all[4]["cause"].as_str().is_some_and(|cause| cause.contains("60 µm, limit 0.5 µm")),
        "{}",
        all[4]
    );
    let first = all[1]["events"][0].as_str().expect("text");
    assert!(first.starts_with("08:00:00 to 08:00:40 UTC VC-6002"), "{first}");
    let over = |shown: &Value| -> Vec<bool> {
        let events = shown["events"].as_array().expect("events");
        events.iter().map(|event| event.as_str().is_some_and(|text| text.contains(" over"))).collect()
    };
    assert_eq!((over(&all[1]), over(&all[4])), (vec![true, true], vec![true, false]), "{all:?}");
}
