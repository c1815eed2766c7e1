//! Packages: what their parts say of each other. That they install and run is tried by `packaging/try`, in the nightly run.

#![expect(
    clippy::expect_used,
    clippy::disallowed_methods,
    reason = "a test reads files, and stops where its own set-up is wrong"
)]

use std::fs;
use std::path::Path;

use toml::{Table, Value};

fn read(path: &str) -> String {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join(path);
    fs::read_to_string(&file).unwrap_or_else(|e| panic!("{path}: {e}"))
}

fn manifest(path: &str) -> Table {
    read(path).parse().expect("TOML")
}

/// `[package.metadata.deb]` of a manifest.
fn deb(manifest: &Table) -> &Value {
    &manifest["package"]["metadata"]["deb"]
}

fn assets(of: &Value) -> Vec<[String; 3]> {
    let part = |asset: &Value, k: usize| asset[k].as_str().expect("text").to_owned();
    let all = of["assets"].as_array().expect("assets");
    all.iter().map(|asset| [0, 1, 2].map(|k| part(asset, k))).collect()
}

#[test]
fn every_unit_is_in_a_package() {
    let (main, opcua) = (manifest("Cargo.toml"), manifest("adapters/opcua/Cargo.toml"));
    let sources: Vec<String> =
        assets(deb(&main)).into_iter().chain(assets(deb(&opcua))).map(|[source, ..]| source).collect();
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("systemd");
    for entry in fs::read_dir(folder).expect("units") {
        let name = entry.expect("entry").file_name().into_string().expect("name");
        let fits = |source: &String| {
            let (head, tail) =
                source.rsplit('/').next().and_then(|last| last.split_once('*')).unwrap_or((source, ""));
            source.ends_with(&format!("systemd/{name}"))
                || (source.contains("systemd/")
                    && source.contains('*')
                    && name.starts_with(head)
                    && name.ends_with(tail))
        };
        assert!(name.ends_with(".sh") || sources.iter().any(fits), "systemd/{name} is in no package");
    }
}

/// One version: of the workspace, the programs beside it, and the Debian changelogs, which have their packages' names.
#[test]
fn versions_are_the_same_everywhere() {
    let main = manifest("Cargo.toml");
    let version = main["workspace"]["package"]["version"].as_str().expect("version");
    assert_eq!(manifest("adapters/opcua/Cargo.toml")["package"]["version"].as_str(), Some(version));
    assert!(read("adapters/linuxcnc/volcomp_bridge.1").contains(&format!("\"volcomp {version}\"")));
    for (file, package) in [
        ("changelog", "volcomp"),
        ("changelog.linuxcnc", "volcomp-linuxcnc"),
        ("changelog.opcua", "volcomp-opcua"),
    ] {
        let text = read(&format!("packaging/debian/{file}"));
        assert!(text.starts_with(&format!("{package} ({version}) ")), "packaging/debian/{file}: {text}");
    }
}

/// What a person has changed is kept by an upgrade, and an upgrade does not end the compensation of a part.
#[test]
fn configuration_is_kept_and_an_upgrade_leaves_the_daemon_alone() {
    let main = manifest("Cargo.toml");
    let files: Vec<&str> =
        deb(&main)["conf-files"].as_array().expect("list").iter().filter_map(Value::as_str).collect();
    assert_eq!(files, ["/etc/volcomp/machine.toml", "/etc/volcomp/model.toml"]);
    let units = deb(&main)["systemd-units"].as_array().expect("units");
    let daemon = units.iter().find(|unit| unit["unit-name"].as_str() == Some("volcompd")).expect("volcompd");
    for key in ["restart-after-upgrade", "stop-on-upgrade"] {
        assert_eq!(daemon[key].as_bool(), Some(false), "{key}");
    }
    // everything else that is started is asked for by a person
    for unit in units.iter().filter(|unit| unit["unit-name"].as_str() != Some("volcompd")) {
        assert_eq!((unit["enable"].as_bool(), unit["start"].as_bool()), (Some(false), Some(false)), "{unit}");
    }
}

#[test]
fn the_container_file_installs_the_package_and_is_not_root() {
    let text = read("packaging/Containerfile");
    let lines = text.replace("\\\n", " ");
    let steps: Vec<(&str, &str)> = lines
        .lines()
        .filter(|line| !line.starts_with('#') && !line.is_empty())
        .map(|line| line.split_once(' ').expect("instruction and argument"))
        .collect();
    let known = ["FROM", "COPY", "RUN", "USER", "WORKDIR", "ENTRYPOINT", "CMD"];
    assert!(steps.iter().all(|(step, _)| known.contains(step)), "{steps:?}");
    assert_eq!(steps[0].0, "FROM");
    let of = |name: &str| {
        steps.iter().filter(|(step, _)| *step == name).map(|(_, what)| *what).collect::<Vec<_>>()
    };
    assert_eq!(of("COPY"), ["volcomp_*_amd64.deb /tmp/"]);
    assert!(of("RUN")[0].contains("/tmp/volcomp_*_amd64.deb"));
    assert_eq!(of("USER"), ["volcomp"]);
    for form in ["ENTRYPOINT", "CMD"] {
        let list: Vec<String> = serde_json::from_str(of(form)[0]).expect("the form without a shell");
        assert!(!list.is_empty());
    }
}
