//! The audit file and its proof.
//!
//! One JSON object per line; each carries the BLAKE3 of the line before, so nothing can be changed, taken out or put
//! in without every later line telling. What the chain cannot tell by itself, that lines are missing at the end, the
//! head file beside it (`audit.head`: number and hash of the last line) tells. Who may rewrite both can forge both:
//! the journal has the hash of every line as well, and is the witness from outside.
//!
//! A file that is broken when the daemon starts is set aside as it is, and a new one begins with a line that names
//! it: its last good number and hash, the line where it breaks, and the hash of all its bytes.

use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::SystemTime;

use serde::{Deserialize, Serialize};

use super::{AuditEntry, Who};
use crate::disk::{Append, Disk, replace, set_aside};
use crate::utc;

/// What the first line carries where there is no line before.
const NO_LINE: &str = "0000000000000000000000000000000000000000000000000000000000000000";
/// What the first line of a file that follows a broken one says in `what`.
const SEGMENT: &str = "segment";
/// Largest log that is read, bytes; one that has grown beyond is set aside at the next start and a new one begun.
pub const BYTES_MAX: u64 = 64 << 20;
/// Largest head file, bytes.
const HEAD_BYTES_MAX: u64 = 4096;

/// One line.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Line {
    /// Number of the line, from 1.
    pub seq: u64,
    /// When, UTC.
    pub time: String,
    /// Who.
    pub who: Who,
    /// What.
    pub what: String,
    /// Why.
    pub why: Option<String>,
    /// Hash of the model before.
    pub old_model: Option<String>,
    /// Hash of the model afterwards.
    pub new_model: Option<String>,
    /// What came of it.
    pub result: String,
    /// Anything else.
    pub detail: Option<String>,
    /// BLAKE3 of the line before, without its line feed.
    pub previous: String,
}

/// The last line, kept beside the file.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
struct Head {
    seq: u64,
    hash: String,
}

/// What an intact file holds.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Summary {
    /// Lines.
    pub lines: u64,
    /// Hash of the last line; 64 zeros where there is none.
    pub hash: String,
    /// Hash of the model named last.
    pub model: Option<String>,
    /// Whether a head file vouches for the end.
    pub head: bool,
}

/// Where a file is not what was written, and why.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("line {line}: {fault}")]
pub struct Broken {
    /// The first line that cannot be relied upon.
    pub line: u64,
    /// What is wrong with it.
    pub fault: Fault,
    /// Number of the last good line, and its hash.
    pub good: (u64, String),
}

/// What is wrong with a line.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum Fault {
    /// It does not end.
    #[error("the line has no end (power loss while writing, or cut)")]
    Torn,
    /// It is no line of an audit log.
    #[error("not a line of an audit log: {0}")]
    NotALine(String),
    /// A number that does not follow.
    #[error("number {found} where {expected} is due: lines were taken out or put in")]
    Number {
        /// Number due.
        expected: u64,
        /// Number found.
        found: u64,
    },
    /// The hash of the line before is not that of the line before.
    #[error("it does not follow from the line before it: one of the two was changed")]
    Chain,
    /// Lines are missing at the end.
    #[error("the head file says that the log goes to line {0}: lines were cut off at the end")]
    CutOff(u64),
    /// The last line is not the one that was written.
    #[error("the head file has another hash for this line: it was changed")]
    Head,
    /// The head file is no head file.
    #[error("the head file beside the log is not understood")]
    HeadFile,
    /// It cannot be read as a whole.
    #[error("the log is too large to be checked: {0}")]
    TooLarge(String),
}

/// Checks the text of an audit log, without its head file.
///
/// # Errors
/// The first line that cannot be relied upon.
pub fn verify(text: &[u8]) -> Result<Summary, Broken> {
    check(text, |_, _| Ok(()))
}

fn verify_on(disk: &dyn Disk, path: &Path) -> io::Result<Result<Summary, Broken>> {
    let text = disk.read(path, BYTES_MAX)?;
    let head = match disk.read(&head_path(path), HEAD_BYTES_MAX) {
        Ok(head) => Some(head),
        Err(e) if e.kind() == ErrorKind::NotFound => None,
        Err(e) => return Err(e),
    };
    Ok(verify_with(&text, head.as_deref()))
}

/// Checks the text of an audit log against that of its head file, where there is one.
///
/// # Errors
/// The first line that cannot be relied upon.
pub fn verify_with(text: &[u8], head: Option<&[u8]>) -> Result<Summary, Broken> {
    let Some(head) = head else { return verify(text) };
    let head: Option<Head> = serde_json::from_slice(head).ok();
    let summary = check(text, |seq, hash| match &head {
        Some(head) if head.seq == seq && head.hash != hash => Err(Fault::Head),
        _ => Ok(()),
    })?;
    let broken = |line, fault| Broken { line, fault, good: (summary.lines, summary.hash.clone()) };
    match head {
        None => Err(broken(summary.lines.max(1), Fault::HeadFile)),
        Some(head) if head.seq > summary.lines => Err(broken(summary.lines + 1, Fault::CutOff(head.seq))),
        Some(_) => Ok(Summary { head: true, ..summary }),
    }
}

/// Goes through the lines; `each` gets the number and hash of every good one.
fn check(text: &[u8], mut each: impl FnMut(u64, &str) -> Result<(), Fault>) -> Result<Summary, Broken> {
    let mut summary = Summary { lines: 0, hash: NO_LINE.to_owned(), model: None, head: false };
    for line in text.split_inclusive(|b| *b == b'\n') {
        let number = summary.lines + 1;
        let broken = |fault| Broken { line: number, fault, good: (summary.lines, summary.hash.clone()) };
        let Some(line) = line.strip_suffix(b"\n") else { return Err(broken(Fault::Torn)) };
        let parsed: Line =
            serde_json::from_slice(line).map_err(|e| broken(Fault::NotALine(e.to_string())))?;
        if parsed.seq != number {
            return Err(broken(Fault::Number { expected: number, found: parsed.seq }));
        }
        let begins = number == 1 && parsed.what == SEGMENT;
        if parsed.previous != summary.hash && !begins {
            return Err(broken(Fault::Chain));
        }
        let hash = blake3::hash(line).to_hex().to_string();
        each(number, &hash).map_err(broken)?;
        summary.lines = number;
        summary.hash = hash;
        summary.model = parsed.new_model.or_else(|| summary.model.take());
    }
    Ok(summary)
}

/// The head file beside a log: number and hash of its last line.
#[must_use]
pub fn head_path(path: &Path) -> PathBuf {
    path.with_extension("head")
}

/// An audit log being written.
#[derive(Debug)]
pub struct AuditFile {
    disk: Arc<dyn Disk>,
    path: PathBuf,
    file: Box<dyn Append>,
    length: u64,
    lines: u64,
    hash: String,
    model: Option<String>,
}

impl AuditFile {
    /// Opens a log to append to it. A broken one is set aside, told, and followed by a new one that names it.
    ///
    /// # Errors
    /// The file system refuses.
    pub fn open(disk: Arc<dyn Disk>, path: &Path) -> io::Result<(Self, Option<Broken>)> {
        let verdict = match verify_on(&*disk, path) {
            Ok(verdict) => verdict,
            Err(e) if e.kind() == ErrorKind::NotFound => {
                // a head without its log: the whole log was taken away
                let head = disk.read(&head_path(path), HEAD_BYTES_MAX).ok();
                verify_with(b"", head.as_deref())
            }
            Err(e) if e.kind() == ErrorKind::FileTooLarge => {
                let good = (0, NO_LINE.to_owned());
                Err(Broken { line: 1, fault: Fault::TooLarge(e.to_string()), good })
            }
            Err(e) => return Err(e),
        };
        match verdict {
            Ok(summary) => Ok((Self::append_to(disk, path, summary)?, None)),
            Err(broken) => {
                let detail = Self::retire(&*disk, path, &broken)?;
                let empty = Summary { lines: 0, hash: broken.good.1.clone(), model: None, head: false };
                let mut file = Self::append_to(disk, path, empty)?;
                file.write(&AuditEntry {
                    who: Who::daemon(),
                    what: SEGMENT.to_owned(),
                    result: "the log before this one is broken".to_owned(),
                    detail: Some(detail),
                    ..AuditEntry::default()
                })?;
                Ok((file, Some(broken)))
            }
        }
    }

    fn append_to(disk: Arc<dyn Disk>, path: &Path, summary: Summary) -> io::Result<Self> {
        let file = disk.open_append(path)?;
        let length = file.length()?;
        let Summary { lines, hash, model, .. } = summary;
        Ok(Self { disk, path: path.to_owned(), file, length, lines, hash, model })
    }

    /// Sets a broken log and its head aside; says in words what they were.
    fn retire(disk: &dyn Disk, path: &Path, broken: &Broken) -> io::Result<String> {
        let whole = disk.hash(path);
        let aside = match set_aside(disk, path, "broken") {
            Ok(aside) => aside.display().to_string(),
            Err(e) if e.kind() == ErrorKind::NotFound => "nowhere: the log is gone".to_owned(),
            Err(e) => return Err(e),
        };
        match set_aside(disk, &head_path(path), "broken") {
            Err(e) if e.kind() != ErrorKind::NotFound => return Err(e),
            _ => {}
        }
        let (good, hash) = &broken.good;
        Ok(format!(
            "{broken}; last good line {good} with hash {hash}; kept as {aside}, hash of all its bytes {}",
            whole.unwrap_or_else(|_| "unknown".to_owned())
        ))
    }

    /// Appends a line and makes it safe; gives its number and hash.
    ///
    /// # Errors
    /// The file system refuses; the file is then as it was before.
    pub fn write(&mut self, entry: &AuditEntry) -> io::Result<(u64, String)> {
        let line = Line {
            seq: self.lines + 1,
            time: utc::text(SystemTime::now()),
            who: entry.who.clone(),
            what: entry.what.clone(),
            why: entry.why.clone(),
            old_model: entry.old_model.clone(),
            new_model: entry.new_model.clone(),
            result: entry.result.clone(),
            detail: entry.detail.clone(),
            previous: self.hash.clone(),
        };
        let mut bytes = serde_json::to_vec(&line)?;
        let hash = blake3::hash(&bytes).to_hex().to_string();
        bytes.push(b'\n');
        if let Err(e) = self.file.append(&bytes) {
            // half a line would break the chain for everything after it
            let _ = self.file.cut(self.length);
            return Err(e);
        }
        self.length += bytes.len() as u64;
        self.lines = line.seq;
        self.hash.clone_from(&hash);
        if line.new_model.is_some() {
            self.model = line.new_model;
        }
        let head = serde_json::to_vec(&Head { seq: self.lines, hash: hash.clone() })?;
        replace(&*self.disk, &head_path(&self.path), &head)?;
        Ok((self.lines, hash))
    }

    /// Hash of the model named last.
    #[must_use]
    pub fn model(&self) -> Option<&str> {
        self.model.as_deref()
    }
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::sync::atomic::{AtomicBool, Ordering::Relaxed};

    use super::*;
    use crate::disk::RealDisk;
    use crate::disk::real;
    use crate::memory_disk::{Health, MemoryDisk, Operation};

    fn entry(what: &str) -> AuditEntry {
        AuditEntry {
            who: Who::client(Some(0), Some(1)),
            what: what.to_owned(),
            why: Some("a \"test\"\n".to_owned()),
            new_model: Some("abc".to_owned()),
            result: "armed".to_owned(),
            ..AuditEntry::default()
        }
    }

    fn log(lines: u64) -> (tempfile::TempDir, PathBuf) {
        let dir = tempfile::tempdir().expect("directory");
        let path = dir.path().join("audit.jsonl");
        let (mut file, broken) = AuditFile::open(real(), &path).expect("opens");
        assert_eq!(broken, None);
        for k in 0..lines {
            assert_eq!(file.write(&entry("enable")).expect("written").0, k + 1);
        }
        (dir, path)
    }

    fn text(path: &Path) -> Vec<u8> {
        fs::read(path).expect("there")
    }

    #[test]
    fn a_log_goes_on_over_restarts_and_proves_itself() {
        let (_dir, path) = log(3);
        let (mut again, broken) = AuditFile::open(real(), &path).expect("opens");
        assert_eq!(broken, None);
        assert_eq!(again.model(), Some("abc"));
        let (seq, hash) = again.write(&entry("disable")).expect("written");
        let summary = verify_on(&RealDisk, &path).expect("readable").expect("intact");
        assert_eq!((seq, summary.lines, summary.head), (4, 4, true));
        assert_eq!(summary.hash, hash);
        let text = text(&path);
        let first = text.split(|b| *b == b'\n').next().expect("a line");
        let line: Line = serde_json::from_slice(first).expect("a line");
        assert_eq!((line.who.uid, line.why.as_deref()), (Some(0), Some("a \"test\"\n")));
        assert_eq!(line.previous, NO_LINE);
    }

    #[test]
    fn every_byte_counts() {
        let (_dir, path) = log(4);
        let good = text(&path);
        let head = fs::read(head_path(&path)).expect("there");
        for at in 0..good.len() {
            let mut bad = good.clone();
            bad[at] ^= 1;
            let broken = verify_with(&bad, Some(&head)).expect_err("seen");
            let line = good[..at].iter().filter(|b| **b == b'\n').count() as u64 + 1;
            // a change shows in the line itself, or in the next one, which has its hash
            assert!((line..=line + 1).contains(&broken.line), "byte {at} of line {line}: {broken}");
        }
    }

    #[test]
    fn lines_taken_out_put_in_exchanged_or_cut_off_are_found_by_number() {
        let (_dir, path) = log(5);
        let good = text(&path);
        let head = fs::read(head_path(&path)).expect("there");
        let lines: Vec<&[u8]> = good.split_inclusive(|b| *b == b'\n').collect();
        let of = |order: &[usize]| order.iter().flat_map(|k| lines[*k].to_vec()).collect::<Vec<_>>();
        for (order, expected) in [
            (vec![0, 1, 3, 4], 3),
            (vec![0, 1, 1, 2, 3, 4], 3),
            (vec![0, 2, 1, 3, 4], 2),
            (vec![1, 2, 3, 4], 1),
            (vec![0, 1, 2], 4),
            (vec![], 1),
        ] {
            let broken = verify_with(&of(&order), Some(&head)).expect_err("seen");
            assert_eq!(broken.line, expected, "{order:?}: {broken}");
        }
        let cut = verify_with(&of(&[0, 1, 2]), Some(&head)).expect_err("seen");
        assert!(cut.to_string().contains("goes to line 5"), "{cut}");
        assert!(verify(&of(&[0, 1, 2])).is_ok(), "without the head the end cannot be told");
        let torn = verify_with(&good[..good.len() - 3], Some(&head)).expect_err("seen");
        assert_eq!((torn.line, &torn.fault), (5, &Fault::Torn));
        // the head may lag by the line that a power loss came after
        let lagging =
            Head { seq: 4, hash: blake3::hash(&lines[3][..lines[3].len() - 1]).to_hex().to_string() };
        assert!(verify_with(&good, Some(&serde_json::to_vec(&lagging).expect("text"))).is_ok());
    }

    #[test]
    fn a_broken_log_is_kept_and_the_next_one_names_it() {
        for damage in [0, 1, 2] {
            let (dir, path) = log(3);
            let mut bytes = text(&path);
            match damage {
                0 => bytes[200] ^= 1,
                1 => bytes.truncate(bytes.len() - 5),
                _ => bytes.clear(),
            }
            fs::write(&path, &bytes).expect("written");
            let (mut file, broken) = AuditFile::open(real(), &path).expect("opens");
            let broken = broken.expect("reported");
            file.write(&entry("enable")).expect("written");
            let summary = verify_on(&RealDisk, &path).expect("readable").expect("the new one is intact");
            assert_eq!(summary.lines, 2);
            let first: Line =
                serde_json::from_slice(text(&path).split(|b| *b == b'\n').next().expect("line"))
                    .expect("line");
            assert_eq!((first.what.as_str(), &first.previous), (SEGMENT, &broken.good.1));
            assert_eq!((&first.who, first.result.contains("broken")), (&Who::daemon(), true));
            assert!(first.detail.expect("named").contains(&blake3::hash(&bytes).to_hex().to_string()));
            let kept = fs::read_dir(dir.path()).expect("folder").filter_map(Result::ok).map(|e| e.path());
            let kept: Vec<_> = kept.filter(|p| p.to_string_lossy().contains("audit.jsonl.broken-")).collect();
            assert_eq!(kept.len(), 1);
            assert_eq!(text(&kept[0]), bytes, "not one byte is changed");
        }
    }

    /// A log of some lines in memory, `/state/audit.jsonl`.
    fn in_memory(lines: usize) -> (MemoryDisk, &'static Path) {
        let (disk, path) = (MemoryDisk::new(), Path::new("/state/audit.jsonl"));
        let (mut file, _) = open(&disk, path).expect("opens");
        (0..lines).for_each(|_| assert!(file.write(&entry("enable")).is_ok()));
        (disk, path)
    }

    fn open(disk: &MemoryDisk, path: &Path) -> io::Result<(AuditFile, Option<Broken>)> {
        AuditFile::open(Arc::new(disk.clone()), path)
    }

    #[test]
    fn a_log_or_head_that_cannot_be_read_is_neither_missing_nor_broken() {
        for refused in [PathBuf::from("/state/audit.jsonl"), PathBuf::from("/state/audit.head")] {
            let (disk, path) = in_memory(2);
            let before = disk.files();
            disk.refuse(Operation::Read, &refused, ErrorKind::PermissionDenied);
            let error = open(&disk, path).map(|_| ()).expect_err("refused");
            assert_eq!(error.kind(), ErrorKind::PermissionDenied, "{refused:?}");
            assert_eq!(disk.files(), before, "nothing is set aside");
        }
    }

    #[test]
    fn a_log_that_has_grown_too_large_is_set_aside() {
        let (disk, path) = in_memory(2);
        disk.refuse(Operation::Read, path, ErrorKind::FileTooLarge);
        let (_, broken) = open(&disk, path).expect("opens");
        assert!(matches!(broken.expect("told").fault, Fault::TooLarge(_)));
        let names = disk.list(Path::new("/state")).expect("listed");
        assert!(names.iter().any(|name| name.starts_with("audit.jsonl.broken-")), "{names:?}");
    }

    #[test]
    fn a_log_that_was_taken_away_is_told_by_its_head() {
        let (disk, path) = in_memory(2);
        disk.rename(path, Path::new("/elsewhere")).expect("renamed");
        let (_, broken) = open(&disk, path).expect("opens");
        assert_eq!(broken.expect("told").fault, Fault::CutOff(2));
        let text = disk.read(path, BYTES_MAX).expect("a new one");
        assert!(String::from_utf8_lossy(&text).contains("nowhere: the log is gone"));
    }

    #[test]
    fn a_broken_log_or_head_that_cannot_be_set_aside_is_not_written_over() {
        for refused in [PathBuf::from("/state/audit.jsonl"), PathBuf::from("/state/audit.head")] {
            let (disk, path) = in_memory(2);
            disk.open_append(path).expect("opens").append(b"x").expect("written");
            disk.refuse(Operation::Rename, &refused, ErrorKind::PermissionDenied);
            let kept = disk.files()[&refused].clone();
            let error = open(&disk, path).map(|_| ()).expect_err("refused");
            assert_eq!(error.kind(), ErrorKind::PermissionDenied, "{refused:?}");
            assert_eq!(disk.files()[&refused], kept);
        }
    }

    #[test]
    fn half_a_line_is_cut_off_again() {
        let (disk, path) = in_memory(2);
        let torn = Arc::new(AtomicBool::new(false));
        let failing = Arc::clone(&torn);
        let gated = disk.behind(move || match failing.swap(false, Relaxed) {
            true => Health::Torn(9),
            false => Health::Well,
        });
        let (mut file, _) = open(&gated, path).expect("opens");
        file.write(&entry("enable")).expect("written");
        let before = disk.files();
        torn.store(true, Relaxed);
        assert!(file.write(&entry("disable")).is_err());
        assert_eq!(disk.files(), before, "as it was");
        assert_eq!(file.write(&entry("disable")).expect("written").0, 4);
    }

    #[test]
    fn only_the_first_line_may_follow_from_another_log_and_only_where_it_says_so() {
        let line = |seq, what: &str, previous: &str| {
            let line = Line {
                seq,
                time: String::new(),
                who: Who::default(),
                what: what.to_owned(),
                why: None,
                old_model: None,
                new_model: None,
                result: String::new(),
                detail: None,
                previous: previous.to_owned(),
            };
            serde_json::to_string(&line).expect("text") + "\n"
        };
        let other = "1".repeat(64);
        let lines = |text: String| verify(text.as_bytes()).map(|s| s.lines).map_err(|b| (b.line, b.fault));
        assert_eq!(lines(line(1, SEGMENT, &other)), Ok(1));
        assert_eq!(lines(line(1, "start", &other)), Err((1, Fault::Chain)));
        let begun = line(1, "start", NO_LINE);
        assert_eq!(lines(begun.clone() + &line(2, SEGMENT, &other)), Err((2, Fault::Chain)));
        let hash = blake3::hash(begun.trim_end().as_bytes()).to_hex();
        assert_eq!(lines(begun + &line(2, SEGMENT, &hash)), Ok(2));
    }
}
