//! The threat model names a test for each mitigation: they exist.

#![expect(clippy::disallowed_methods, reason = "a test reads files")]

use std::path::{Path, PathBuf};

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

fn read(path: &Path) -> String {
    std::fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

/// Every `file.rs::test` in backticks, with its line.
fn proofs(text: &str) -> Vec<(usize, &str, &str)> {
    text.lines()
        .enumerate()
        .flat_map(|(i, row)| row.split('`').skip(1).step_by(2).map(move |word| (i + 1, word)))
        .filter_map(|(line, word)| {
            let (file, test) = word.split_once(".rs::")?;
            Some((line, file, test))
        })
        .collect()
}

#[test]
fn every_proof_of_the_threat_model_exists() {
    let text = read(&root().join("docs/explanation/threat-model.md"));
    let found = proofs(&text);
    assert!(found.len() > 40, "{} proofs", found.len());
    for (line, file, test) in found {
        let source = read(&root().join(format!("{file}.rs")));
        let at = source.find(&format!("fn {test}(")).map(|at| source[..at].trim_end().ends_with("#[test]"));
        assert_eq!(at, Some(true), "docs/explanation/threat-model.md:{line}: {file}.rs has no test {test}");
    }
}

#[test]
fn every_threat_has_a_proof() {
    let text = read(&root().join("docs/explanation/threat-model.md"));
    let threats = text.split("\n## Threats").nth(1).and_then(|t| t.split("\n## ").next()).expect("section");
    let rows: Vec<&str> = threats.lines().filter(|l| l.starts_with("| ") && !l.starts_with("| |")).collect();
    assert!(rows.len() > 20, "{} threats", rows.len());
    for row in rows {
        let proof = row.trim_end_matches(" |").rsplit(" | ").next().expect("column");
        assert!(proof.starts_with('`'), "no proof: {row}");
    }
}

#[test]
fn files_that_the_security_pages_name_exist() {
    for page in ["SECURITY.md", "docs/explanation/threat-model.md", "docs/how-to/tls.md", "README.md"] {
        let text = read(&root().join(page));
        let folder = root().join(page).parent().expect("folder").to_path_buf();
        for target in text.split("](").skip(1).filter_map(|t| t.split([')', '#']).next()) {
            let local = !target.is_empty() && !target.contains("://");
            assert!(!local || folder.join(target).exists(), "{page}: {target}");
        }
    }
}
