//! Every command of `docs/tutorial`, in the order of the page.

#![expect(clippy::unwrap_used, clippy::expect_used, reason = "a test fails by panicking")]
#![expect(clippy::disallowed_methods, reason = "the test reads pages and files")]

use crate::first_run::{Clone, root};

/// Runs the `sh` blocks of a page; returns what the last command of each printed, and the clone.
fn follow(page: &str) -> (Vec<String>, Clone) {
    let text = std::fs::read_to_string(root().join("docs/tutorial").join(page)).unwrap();
    let blocks: Vec<&str> =
        text.split("```sh\n").skip(1).map(|b| b.split("```").next().expect("an end")).collect();
    assert!(blocks.len() >= 4, "{page}: {} blocks", blocks.len());
    let clone = Clone::new();
    let mut said = Vec::new();
    for block in blocks {
        let output = clone.run(&format!("set -e\n{block}"));
        said.push(String::from_utf8(output.stdout).unwrap());
        if block.contains("cp config/examples") {
            clone.move_port("mill/machine.toml");
        }
    }
    (said, clone)
}

#[test]
fn a_compensated_simulated_machine() {
    let _processors = crate::processors();
    let (said, clone) = follow("compensated-machine.md");
    let range = |text: &str| -> Vec<f64> {
        let line = text.lines().find(|l| l.starts_with("range of the mean deviations")).expect("the range");
        line.split_whitespace().filter_map(|w| w.parse().ok()).collect()
    };
    // before, its uncertainty, after, its uncertainty, reduction, its uncertainty
    for text in &said[said.len() - 2..] {
        assert!(range(text)[4] > 90.0, "{text}");
    }
    for page in ["model.html", "x-axis.html", "diagonals.html"] {
        assert!(clone.folder.path().join(page).exists(), "{page}");
    }
}

#[test]
fn from_an_iso_230_2_test_to_a_report() {
    let (said, clone) = follow("positioning-report.md");
    assert!(said[1].contains("repeatability R") && said[2].contains("measurement"), "{said:?}");
    assert!(clone.folder.path().join("x-axis.html").exists());
    assert!(clone.folder.path().join("diagnosis/report.html").exists());
}

#[test]
fn from_a_session_to_a_named_cause() {
    let (said, _) = follow("named-cause.md");
    assert!(said[1].starts_with("explained: ") && said[1].contains("(backlash:x)"), "{}", said[1]);
    assert!(said[1].contains("(squareness:xy)"), "{}", said[1]);
    assert!(said[2].contains("backlash:x: in the model") && said[2].contains("squareness:xy: in the model"));
    assert!(said[3].contains("\nno gap: "), "{}", said[3]);
}
