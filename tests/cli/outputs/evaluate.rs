//! `volcomp evaluate`.

use super::check;

#[test]
fn positioning() {
    check("evaluate-iso230-2", &["evaluate", "iso230-2", "tests/formats/sessions/stage.dat"]);
    check("evaluate-iso230-2-json", &["evaluate", "iso230-2", "tests/formats/sessions/stage.dat", "--json"]);
}
