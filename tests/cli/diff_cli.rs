//! `volcomp diff`: whatever differs in content is listed, and a tolerance holds for all of it.

#![expect(clippy::disallowed_methods, reason = "the test writes files and starts programs")]

use std::process::Command;

const HEAD: &str = "format = \"volcomp-model/1\"\nmachine = \"m\"\nchain = \"[w b X Y Z C (S) t]\"\n\
    [axes.x]\ntravel-mm = [0, 500]\n[axes.z]\ntravel-mm = [-300, 0]\n[axes.c]\npoint-mm = [0, 0, 0]\n";

#[test]
fn terms_of_motion_sensors_and_temperature_are_differences() {
    let folder = tempfile::tempdir().unwrap();
    let live = |limit: u32| format!("[errors.ezz.live]\nsensor = \"g\"\nlimit-um = {limit}\n");
    let thermal = |growth: u32, high: u32| {
        let input = format!("sensor = \"t\"\nrange-degc = [15, {high}]\ngrowth-um-per-k = [{growth}]\n");
        format!("{}[thermal.g]\n[[thermal.g.input]]\n{input}", live(80))
    };
    let velocity = |gain: u32| format!("[errors.exx.velocity]\ngain-um-s-per-mm = {gain}\nlimit-um = 150\n");
    let limit = |arcsec: u32| format!("correction-limit-arcsec = {arcsec}\n");
    for (a, b, said, within) in [
        (live(80), live(8), "up to 72.000 um more", false),
        (thermal(3, 40), thermal(30, 40), "thermal displacement g: changed", false),
        (thermal(3, 40), thermal(3, 30), "thermal displacement g: changed", false),
        (velocity(4), velocity(40), "up to 300.000 um more", false),
        (String::new(), velocity(4), "up to 150.000 um more", false),
        (limit(60), limit(3), "correction limit of C: 60 arcsec -> 3 arcsec", true),
    ] {
        for (name, text) in [("a.toml", &a), ("b.toml", &b)] {
            std::fs::write(folder.path().join(name), format!("{HEAD}{text}")).unwrap();
        }
        let diff = |more: &[&str]| {
            let args = [&["diff", "a.toml", "b.toml"], more].concat();
            let out =
                Command::new(env!("CARGO_BIN_EXE_volcomp")).args(args).current_dir(folder.path()).output();
            let out = out.unwrap();
            (out.status.code(), String::from_utf8(out.stdout).unwrap().replace(" µm", " um"))
        };
        let (code, text) = diff(&[]);
        assert!(code == Some(1) && text.contains(said), "{a}{b}: {text}");
        assert_eq!(diff(&["--tolerance-um", "10"]).0, Some(i32::from(!within)), "{a}{b}");
        let json: serde_json::Value = serde_json::from_str(&diff(&["--json"]).1).unwrap();
        assert!(
            json["same"] == false && (within || json["unsearched_um"].as_f64().unwrap() > 10.0),
            "{json}"
        );
    }
}
