//! Which model is in use and which was before, kept over restarts: `models.json` and the files in `models/`.
//!
//! A model file is written under its hash before the book names it, and the book is replaced as a whole, so that a
//! power loss leaves the old choice or the new one.

use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use crate::bounded_read::MODEL_BYTES_MAX;
use crate::disk::{Disk, replace, set_aside};

/// The book's format.
const FORMAT: &str = "volcomp-models/1";
/// Its name in the state directory.
pub const FILE: &str = "models.json";
const FOLDER: &str = "models";
/// Largest `models.json`, bytes.
pub const BYTES_MAX: u64 = 1 << 20;

/// A model that was chosen.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Choice {
    /// BLAKE3 of its file, in hex.
    pub hash: String,
    /// Where it came from: a path as it was given.
    pub origin: String,
    /// Since when, RFC 3339 in UTC.
    pub since: String,
    /// Who chose it.
    pub who: Option<String>,
    /// Why.
    pub why: Option<String>,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Book {
    format: String,
    machine: String,
    /// Hash of the model that the machine file named when the choice was made.
    configured: String,
    active: Choice,
    previous: Option<Choice>,
}

/// The models of one daemon on the disk.
#[derive(Debug, Clone)]
pub struct Store {
    disk: Arc<dyn Disk>,
    directory: PathBuf,
    machine: String,
    book: Option<Book>,
}

impl Store {
    /// Reads the book, where there is one; a damaged one is kept aside, and the reason given.
    pub fn open(disk: Arc<dyn Disk>, directory: &Path, machine: &str) -> (Self, Option<String>) {
        let path = directory.join(FILE);
        let (directory, machine) = (directory.to_owned(), machine.to_owned());
        let mut store = Self { disk, directory, machine, book: None };
        let problem = match store.disk.read(&path, BYTES_MAX) {
            Err(e) if e.kind() == ErrorKind::NotFound => return (store, None),
            Err(e) => e.to_string(),
            Ok(bytes) => match parse(&bytes, &store.machine) {
                Ok(book) => {
                    store.book = Some(book);
                    return (store, None);
                }
                Err(why) => match set_aside(&*store.disk, &path, "damaged") {
                    Ok(aside) => format!("{why}; kept as {}", aside.display()),
                    Err(e) => format!("{why}; it could not be set aside: {e}"),
                },
            },
        };
        (store, Some(format!("{}: {problem}", path.display())))
    }

    /// The model in use, as far as the book knows.
    #[must_use]
    pub fn active(&self) -> Option<&Choice> {
        self.book.as_ref().map(|b| &b.active)
    }

    /// The model before it.
    #[must_use]
    pub fn previous(&self) -> Option<&Choice> {
        self.book.as_ref()?.previous.as_ref()
    }

    /// Hash of the model that the machine file named when the choice was made.
    #[must_use]
    pub fn configured(&self) -> Option<&str> {
        self.book.as_ref().map(|b| b.configured.as_str())
    }

    /// The text of a chosen model.
    ///
    /// # Errors
    /// The file cannot be read, or is not the one that was written.
    pub fn text(&self, choice: &Choice) -> io::Result<String> {
        let path = self.file_of(&choice.hash);
        let bytes = self
            .disk
            .read(&path, MODEL_BYTES_MAX)
            .map_err(|e| io::Error::new(e.kind(), format!("{}: {e}", path.display())))?;
        if blake3::hash(&bytes).to_hex().as_str() != choice.hash {
            let why = format!("{}: its content does not have the hash of its name", path.display());
            return Err(io::Error::new(ErrorKind::InvalidData, why));
        }
        String::from_utf8(bytes).map_err(|e| io::Error::new(ErrorKind::InvalidData, e))
    }

    /// Makes `choice` the model in use; the one in use becomes the previous one. `configured` is the hash of the
    /// machine file's model.
    ///
    /// # Errors
    /// The disk refuses; the book is then as it was.
    pub fn choose(&mut self, choice: Choice, text: &str, configured: &str) -> io::Result<()> {
        self.write_text(&choice.hash, text)?;
        let previous = match &self.book {
            Some(book) if book.active.hash == choice.hash => book.previous.clone(),
            Some(book) => Some(book.active.clone()),
            None => None,
        };
        self.put(choice, previous, configured)
    }

    /// The previous model becomes the one in use, and the other way round, so that a second time undoes the first.
    ///
    /// # Errors
    /// The disk refuses; the book is then as it was.
    pub fn swap(&mut self, now_active: Choice) -> io::Result<()> {
        let Some(book) = &self.book else { return Ok(()) };
        let (before, configured) = (book.active.clone(), book.configured.clone());
        self.put(now_active, Some(before), &configured)
    }

    /// Keeps the text of a model that is in use without having been loaded, so that one can come back to it.
    ///
    /// # Errors
    /// The disk refuses.
    pub fn write_text(&self, hash: &str, text: &str) -> io::Result<()> {
        self.disk.create_folder(&self.directory.join(FOLDER))?;
        let path = self.file_of(hash);
        if self.disk.read(&path, MODEL_BYTES_MAX).is_ok_and(|found| found == text.as_bytes()) {
            return Ok(());
        }
        replace(&*self.disk, &path, text.as_bytes())
    }

    fn put(&mut self, active: Choice, previous: Option<Choice>, configured: &str) -> io::Result<()> {
        let configured = configured.to_owned();
        let book =
            Book { format: FORMAT.to_owned(), machine: self.machine.clone(), configured, active, previous };
        let mut bytes = serde_json::to_vec_pretty(&book)?;
        bytes.push(b'\n');
        replace(&*self.disk, &self.directory.join(FILE), &bytes)?;
        self.book = Some(book);
        Ok(())
    }

    fn file_of(&self, hash: &str) -> PathBuf {
        self.directory.join(FOLDER).join(format!("{hash}.toml"))
    }
}

/// Whether the text of a book would be believed.
///
/// # Errors
/// What is wrong with it, in words.
pub fn check(bytes: &[u8], machine: &str) -> Result<(), String> {
    parse(bytes, machine).map(|_| ())
}

fn parse(bytes: &[u8], machine: &str) -> Result<Book, String> {
    let book: Book = serde_json::from_slice(bytes).map_err(|e| e.to_string())?;
    if book.format != FORMAT {
        return Err(format!("format is \"{}\", not \"{FORMAT}\"", book.format));
    }
    if book.machine != machine {
        return Err(format!("of machine \"{}\", this one is \"{machine}\"", book.machine));
    }
    let hashes = [Some(&book.active), book.previous.as_ref()];
    if hashes
        .into_iter()
        .flatten()
        .any(|c| c.hash.len() != 64 || !c.hash.bytes().all(|b| b.is_ascii_hexdigit()))
    {
        return Err("a hash has not 64 hexadecimal digits".to_owned());
    }
    Ok(book)
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;
    use crate::disk::real;
    use crate::memory_disk::{MemoryDisk, Operation};

    fn choice(text: &str, why: &str) -> Choice {
        Choice {
            hash: blake3::hash(text.as_bytes()).to_hex().to_string(),
            origin: format!("{why}.toml"),
            since: "2026-11-21T00:00:00.000Z".to_owned(),
            who: Some("eve".to_owned()),
            why: Some(why.to_owned()),
        }
    }

    #[test]
    fn the_choice_and_the_one_before_survive() {
        let dir = tempfile::tempdir().expect("directory");
        let (mut store, problem) = Store::open(real(), dir.path(), "m");
        assert_eq!((problem, store.active()), (None, None));
        let (a, b) = (choice("first", "a"), choice("second", "b"));
        store.choose(a.clone(), "first", "0").expect("kept");
        store.choose(b.clone(), "second", "0").expect("kept");
        let (mut store, problem) = Store::open(real(), dir.path(), "m");
        assert_eq!((problem, store.active(), store.previous()), (None, Some(&b), Some(&a)));
        assert_eq!(store.text(&a).expect("there"), "first");
        store.swap(a.clone()).expect("kept");
        assert_eq!((store.active(), store.previous()), (Some(&a), Some(&b)));
        // choosing what is in use does not forget the one before
        store.choose(a.clone(), "first", "1").expect("kept");
        assert_eq!((store.previous(), store.configured()), (Some(&b), Some("1")));
    }

    #[test]
    fn a_store_that_cannot_be_read_is_told_and_not_taken_for_an_empty_one() {
        let disk = MemoryDisk::new();
        let open = || Store::open(Arc::new(disk.clone()), Path::new("/state"), "m");
        assert_eq!(open().1, None, "there is none");
        open().0.choose(choice("first", "a"), "first", "0").expect("kept");
        disk.refuse(Operation::Read, &Path::new("/state").join(FILE), ErrorKind::PermissionDenied);
        let (store, problem) = open();
        assert!(problem.expect("told").contains(FILE) && store.active().is_none());
    }

    #[test]
    fn the_text_of_a_model_is_written_where_it_is_not_there_yet_and_only_there() {
        let disk = MemoryDisk::new();
        let (store, _) = Store::open(Arc::new(disk.clone()), Path::new("/state"), "m");
        let a = choice("first", "a");
        store.write_text(&a.hash, "first").expect("kept");
        let written = disk.changes().len();
        store.write_text(&a.hash, "first").expect("is there");
        assert_eq!(disk.changes().len(), written);
        disk.write(&store.file_of(&a.hash), b"meddled").expect("written");
        store.write_text(&a.hash, "first").expect("kept");
        assert_eq!(store.text(&a).expect("there"), "first");
    }

    #[test]
    fn a_book_is_believed_where_its_hashes_are_hashes() {
        let dir = tempfile::tempdir().expect("directory");
        let (mut store, _) = Store::open(real(), dir.path(), "m");
        let a = choice("first", "a");
        store.choose(a.clone(), "first", "0").expect("kept");
        let text = fs::read_to_string(dir.path().join(FILE)).expect("there");
        assert_eq!(check(text.as_bytes(), "m"), Ok(()));
        for hash in [&a.hash[1..], &format!("{}0", a.hash), &"/".repeat(64), "../x", ""] {
            let bad = text.replace(&a.hash, hash);
            assert!(check(bad.as_bytes(), "m").expect_err("refused").contains("64"), "{hash}");
        }
    }

    #[test]
    fn what_was_changed_by_somebody_else_is_not_used() {
        let dir = tempfile::tempdir().expect("directory");
        let (mut store, _) = Store::open(real(), dir.path(), "m");
        let a = choice("first", "a");
        store.choose(a.clone(), "first", "0").expect("kept");
        let file = dir.path().join(FOLDER).join(format!("{}.toml", a.hash));
        fs::write(&file, "meddled").expect("written");
        assert!(store.text(&a).expect_err("refused").to_string().contains("hash"));
        let (store, problem) = Store::open(real(), dir.path(), "other");
        assert!(problem.expect("told").contains("machine"), "of another machine");
        assert_eq!(store.active(), None);
        fs::write(dir.path().join(FILE), "{").expect("written");
        let (_, problem) = Store::open(real(), dir.path(), "m");
        assert!(problem.expect("told").contains("kept as"));
    }
}
