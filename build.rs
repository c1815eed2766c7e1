//! Names to the tests the sets of real data that are present: `data_<set>` for each folder below `../shared/data`, or below
//! the folder that `VOLCOMP_DATA` names (relative to the workspace).
//!
//! Licence or size keeps these sets out of the repository. A test of a missing set is ignored, with its reason. With
//! `VOLCOMP_DATA_REQUIRED=1` a missing set is an error of the build. `VOLCOMP_DATA_FOLDER` is the folder for `env!`.
//!
//! Names the programs that some tests need and that are installed: `tool_<program>`. A test of a missing one is ignored.
//!
//! A missing folder is not watched, because cargo would then run this script, and compile the package, in every build:
//! `tests/repository/data_sets.rs` reports a set that has appeared since.

#![expect(clippy::disallowed_methods, reason = "a build script reads its environment")]

use std::env;
use std::path::{Path, PathBuf};

const SETS: [&str; 5] = [
    "cnc_drilled_plates",
    "iso230_2_linear_axes",
    "laser_tracker_3smr_robot",
    "real_sessions",
    "sinumerik_edge_capture",
];

/// Programs that tests start where they are installed.
const TOOLS: [&str; 4] = ["chromium", "node", "pdftotext", "promtool"];

fn main() {
    for tool in TOOLS {
        look_for(tool);
    }
    println!("cargo::rerun-if-env-changed=VOLCOMP_DATA");
    println!("cargo::rerun-if-env-changed=VOLCOMP_DATA_REQUIRED");
    let package = env::var_os("CARGO_MANIFEST_DIR").map(PathBuf::from).unwrap_or_default();
    let workspace = package.ancestors().find(|folder| folder.join("Cargo.lock").is_file());
    let named = env::var_os("VOLCOMP_DATA").map_or_else(|| PathBuf::from("../shared/data"), PathBuf::from);
    let data = workspace.unwrap_or(&package).join(named);
    println!("cargo::rustc-env=VOLCOMP_DATA_FOLDER={}", data.display());
    for set in SETS {
        println!("cargo::rustc-check-cfg=cfg(data_{set})");
        announce(set, &data.join(set));
    }
}

fn look_for(tool: &str) {
    println!("cargo::rustc-check-cfg=cfg(tool_{tool})");
    let path = env::var_os("PATH").unwrap_or_default();
    if let Some(found) = env::split_paths(&path).map(|folder| folder.join(tool)).find(|file| file.is_file()) {
        println!("cargo::rerun-if-changed={}", found.display());
        println!("cargo::rustc-cfg=tool_{tool}");
    }
}

fn announce(set: &str, folder: &Path) {
    if folder.is_dir() {
        println!("cargo::rerun-if-changed={}", folder.display());
        println!("cargo::rustc-cfg=data_{set}");
    } else if env::var_os("VOLCOMP_DATA_REQUIRED").is_some_and(|v| v == "1") {
        println!(
            "cargo::error=VOLCOMP_DATA_REQUIRED=1, but the data set {} is missing; name its parent folder in VOLCOMP_DATA",
            folder.display()
        );
    }
}
