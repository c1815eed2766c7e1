//! Every command of `docs/tutorial`, in the order of the page.

#![expect(clippy::unwrap_used, clippy::expect_used, reason = "a test fails by panicking")]
#![expect(clippy::disallowed_methods, reason = "the test reads pages and files")]

use crate::first_run::{Clone, root};

/// Runs the `sh` blocks of a page, whose `text` blocks must be what the block before prints; returns what each printed,
/// and the clone.
fn follow(page: &str) -> (Vec<String>, Clone) {
    let text = std::fs::read_to_string(root().join("docs/tutorial").join(page)).unwrap();
    let clone = Clone::new();
    let mut said: Vec<String> = Vec::new();
    for block in text.split("```").skip(1).step_by(2) {
        if let Some(block) = block.strip_prefix("sh\n") {
            let output = clone.run(&format!("set -e\n{block}"));
            said.push(String::from_utf8(output.stdout).unwrap());
        } else if let Some(block) = block.strip_prefix("text\n") {
            let printed = said.last().expect("a command above");
            for line in block.lines() {
                assert!(
                    printed.lines().any(|p| is_shown(line, p)),
                    "{page}: {line}\nis not printed:\n{printed}"
                );
            }
        }
    }
    assert!(said.len() >= 4, "{page}: {} blocks", said.len());
    (said, clone)
}

/// True where a page's line is a printed one: the same words, numbers to 2 %, up to the `..` that leaves the rest out.
fn is_shown(page: &str, printed: &str) -> bool {
    let open = page.trim_end().ends_with("..");
    let shown: Vec<&str> = page.trim_end().trim_end_matches("..").split_whitespace().collect();
    let printed: Vec<&str> = printed.split_whitespace().collect();
    let bare = |word: &str| word.trim_matches(['(', ')', ',', ';']).to_owned();
    let same = |(a, b): (&&str, &&str)| match (bare(a).parse::<f64>(), bare(b).parse::<f64>()) {
        (Ok(x), Ok(y)) => {
            (x - y).abs() <= 0.02 * y.abs() + 0.011 && a.replace(&bare(a), "") == b.replace(&bare(b), "")
        }
        _ => a == b,
    };
    (if open { shown.len() <= printed.len() } else { shown.len() == printed.len() })
        && shown.iter().zip(&printed).all(same)
}

#[test]
fn shown_numbers_agree_to_two_percent_in_the_same_brackets() {
    for (page, is_alike) in
        [("5.6 mm (26.9 um)", true), ("5.6 mm (28 um)", false), ("5.6 mm 26.9 um)", false)]
    {
        assert_eq!(is_shown(page, "5.55 mm (26.91 um)"), is_alike, "{page}");
    }
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
    assert!(clone.folder.path().join("positioning-x.html").exists());
    assert!(clone.folder.path().join("positioning-x-causes/report.html").exists());
}

#[test]
fn from_a_ballbar_test_to_a_verified_correction() {
    let _processors = crate::processors();
    let (said, clone) = follow("ballbar.md");
    let line = |text: &str, name: &str| -> Vec<f64> {
        let line = text.lines().find(|l| l.starts_with(name)).expect("the figure");
        line.split_whitespace().filter_map(|w| w.parse().ok()).collect()
    };
    // before, after, reduction
    let both = line(&said[said.len() - 1], "bidirectional circular error G(b)");
    assert!(both[2] > 70.0, "{both:?}");
    // what the correction was expected to leave, of both feeds
    let ideal = line(&said[3], "circular error G after an ideal correction");
    assert!((ideal[0] - both[1]).abs() < 1.5, "{ideal:?} {both:?}");
    for page in ["circle.html", "both.html"] {
        assert!(clone.folder.path().join(page).exists(), "{page}");
    }
}

#[test]
fn from_a_session_to_a_named_cause() {
    let (said, _) = follow("named-cause.md");
    assert!(said[1].starts_with("explained: ") && said[1].contains("(backlash:x)"), "{}", said[1]);
    assert!(said[1].contains("(squareness:xy)") && said[1].contains("the squareness EC0Y"), "{}", said[1]);
    assert!(said[2].contains("backlash:x: in the model") && said[2].contains("squareness:xy: in the model"));
    assert!(said[3].contains("\nno gap: "), "{}", said[3]);
}
