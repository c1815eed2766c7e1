//! Which model a daemon starts with.

use std::path::Path;

use super::*;
use crate::load;

const MACHINE: &str = "format = \"volcomp-machine/1\"\nmachine = \"m\"\nmodel = \"model.toml\"\n\
    [axes.x]\nlimit-um = 200\nrate-um-per-s = 1000\nacceleration-um-per-s2 = 10000\n";

/// EXX grows to `size_um` over the travel.
fn text(size_um: f64) -> String {
    format!(
        "format = \"volcomp-model/1\"\nmachine = \"m\"\nchain = \"[w X' b Y Z t]\"\n\
         [axes.x]\ntravel-mm = [0, 400]\n[axes.y]\ntravel-mm = [0, 300]\n[axes.z]\ntravel-mm = [-300, 0]\n\
         [errors.exx.table]\nposition-mm = [0, 400]\nvalue-um = [0, {size_um}]\n"
    )
}

/// The daemon starts with a model file of this size.
fn start(folder: &Path, size_um: f64) -> Models {
    std::fs::write(folder.join("machine.toml"), MACHINE).expect("written");
    std::fs::write(folder.join("model.toml"), text(size_um)).expect("written");
    let loaded = load(&folder.join("machine.toml")).expect("loads");
    let state = folder.join("state");
    let first = !state.exists();
    std::fs::create_dir_all(&state).expect("made");
    Models::at_start(Some((volcomp_state::disk::real(), &state)), first, &loaded, |_| Ok(()))
}

fn prepared(folder: &Path, size_um: f64) -> Arc<Prepared> {
    let config = load(&folder.join("machine.toml")).expect("loads").config;
    Arc::new(Prepared::read("loaded.toml", text(size_um), &config).expect("valid"))
}

fn size_of(models: &Models) -> f64 {
    models.active.model.deviation(&at_the_end()).position.x * 1e3
}

fn at_the_end() -> volcomp_model::Pose {
    let mut position = [0.0; volcomp_units::axes::MAX_AXES];
    position[0] = 400.0;
    volcomp_model::Pose::at(position)
}

#[test]
fn a_file_that_changed_a_little_is_taken_one_that_changed_much_is_not() {
    let dir = tempfile::tempdir().expect("directory");
    assert!((size_of(&start(dir.path(), 10.0)) - 10.0).abs() < 1e-9);
    // 30 um: within the limit of 50
    let models = start(dir.path(), 40.0);
    assert!((size_of(&models) - 40.0).abs() < 1e-9 && models.notes.is_empty(), "{:?}", models.notes);
    assert!(models.previous.is_some());
    // 110 um more: held back, again and again
    for _ in 0..2 {
        let models = start(dir.path(), 150.0);
        assert!((size_of(&models) - 40.0).abs() < 1e-9);
        assert!(
            models.notes[0].starts_with("VC-5006") && models.notes[0].contains("--confirm"),
            "{:?}",
            models.notes
        );
    }
    // confirmed: from now on it is the one in use
    let mut models = start(dir.path(), 150.0);
    let new = prepared(dir.path(), 150.0);
    assert_eq!(models.switched(new, Some("eve".to_owned()), Some("new screw".to_owned())).write(), None);
    let models = start(dir.path(), 150.0);
    assert!((size_of(&models) - 150.0).abs() < 1e-9 && models.notes.is_empty());
    assert_eq!(models.choice.who.as_deref(), Some("eve"));
}

#[test]
fn what_was_loaded_stays_after_a_restart_and_so_does_the_way_back() {
    let dir = tempfile::tempdir().expect("directory");
    let mut models = start(dir.path(), 10.0);
    let _ = models.switched(prepared(dir.path(), 25.0), Some("eve".to_owned()), None).write();
    let mut models = start(dir.path(), 10.0);
    assert!((size_of(&models) - 25.0).abs() < 1e-9);
    let back = models.previous.clone().expect("the one before");
    let _ = models.switched(back, Some("eve".to_owned()), Some("worse".to_owned())).write();
    let models = start(dir.path(), 10.0);
    assert!((size_of(&models) - 10.0).abs() < 1e-9);
    let again = models.previous.clone().expect("a second rollback undoes the first");
    assert_eq!(again.text, text(25.0));
}

#[test]
fn a_model_that_was_meddled_with_is_not_used() {
    let dir = tempfile::tempdir().expect("directory");
    let mut models = start(dir.path(), 10.0);
    let new = prepared(dir.path(), 25.0);
    let _ = models.switched(Arc::clone(&new), None, None).write();
    let file = dir.path().join("state/models").join(format!("{}.toml", new.hash));
    std::fs::write(file, text(26.0)).expect("written");
    let models = start(dir.path(), 10.0);
    assert!((size_of(&models) - 10.0).abs() < 1e-9, "the machine file's model instead");
    assert!(models.notes[0].contains("hash"), "{:?}", models.notes);
    assert!(models.unknown.expect("held").contains("loaded.toml"));
}

#[test]
fn models_of_another_machine_and_other_content_than_pinned_are_refused() {
    let dir = tempfile::tempdir().expect("directory");
    let _ = start(dir.path(), 10.0);
    let config = load(&dir.path().join("machine.toml")).expect("loads").config;
    let foreign = text(1.0).replace("machine = \"m\"", "machine = \"n\"");
    assert!(Prepared::read("f.toml", foreign, &config).expect_err("refused").contains("machine"));
    let pinned = format!("{MACHINE}[guard]\nhash = \"{}\"\n", "0".repeat(64));
    std::fs::write(dir.path().join("machine.toml"), pinned).expect("written");
    let error = load(&dir.path().join("machine.toml")).expect_err("refused");
    assert!(error.to_string().contains("VC-5005"), "{error}");
    assert!(!error.is_io());
}

#[test]
fn a_lost_or_damaged_choice_is_an_unknown_state_and_a_first_start_is_not() {
    let dir = tempfile::tempdir().expect("directory");
    assert_eq!(start(dir.path(), 10.0).unknown, None);
    assert_eq!(start(dir.path(), 10.0).unknown, None);
    let book = dir.path().join("state/models.json");
    for damage in [None, Some(""), Some("{"), Some("\0\0\0\0")] {
        match damage {
            Some(text) => std::fs::write(&book, text).expect("written"),
            None => std::fs::remove_file(&book).expect("removed"),
        }
        let models = start(dir.path(), 10.0);
        assert!(models.unknown.expect("held").contains("models.json"), "{damage:?}");
    }
}

#[test]
fn a_store_is_not_mended_before_the_unknown_state_is_durable() {
    let dir = tempfile::tempdir().expect("directory");
    let _ = start(dir.path(), 10.0);
    let (state, book) = (dir.path().join("state"), dir.path().join("state/models.json"));
    std::fs::remove_file(&book).expect("removed");
    let loaded = load(&dir.path().join("machine.toml")).expect("loads");
    let place = || Some((volcomp_state::disk::real(), state.as_path()));
    let refuse = |_: &str| Err(io::Error::other("full"));
    assert!(Models::at_start(place(), false, &loaded, refuse).unknown.is_some());
    assert!(!book.exists(), "the next start must see it as well");
    let models = Models::at_start(place(), false, &loaded, |_| {
        assert!(!book.exists(), "first the word, then the store");
        Ok(())
    });
    assert!(models.unknown.is_some() && book.exists());
}
