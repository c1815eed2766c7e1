//! The file operations behind the state directory, behind a trait so that tests can make each of them fail.

use std::fs::{self, File};
use std::io::{self, ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::SystemTime;

use crate::bounded_read::read_regular;
use crate::utc;

/// A disk.
pub trait Disk: core::fmt::Debug + Send + Sync {
    /// Reads a regular file of at most `limit_bytes` bytes.
    ///
    /// # Errors
    /// The disk refuses, or the file is too large or no regular file.
    fn read(&self, path: &Path, limit_bytes: u64) -> io::Result<Vec<u8>>;

    /// Creates or truncates a file, writes it and makes its content durable.
    ///
    /// # Errors
    /// The disk refuses; the file may then hold any part of `bytes`.
    fn write(&self, path: &Path, bytes: &[u8]) -> io::Result<()>;

    /// Renames a file, replacing what has the new name.
    ///
    /// # Errors
    /// The disk refuses.
    fn rename(&self, from: &Path, to: &Path) -> io::Result<()>;

    /// Makes the names in a folder durable.
    ///
    /// # Errors
    /// The disk refuses.
    fn sync_folder(&self, folder: &Path) -> io::Result<()>;

    /// Creates a folder and those above it.
    ///
    /// # Errors
    /// The disk refuses.
    fn create_folder(&self, folder: &Path) -> io::Result<()>;

    /// Names in a folder.
    ///
    /// # Errors
    /// The disk refuses, or there is no such folder.
    fn list(&self, folder: &Path) -> io::Result<Vec<String>>;

    /// Opens a file to append to it, and creates it where it does not exist.
    ///
    /// # Errors
    /// The disk refuses.
    fn open_append(&self, path: &Path) -> io::Result<Box<dyn Append>>;

    /// BLAKE3 of a whole file of any size, in hex.
    ///
    /// # Errors
    /// The disk refuses.
    fn hash(&self, path: &Path) -> io::Result<String>;
}

/// A file that grows at its end.
pub trait Append: core::fmt::Debug + Send {
    /// Present length, bytes.
    ///
    /// # Errors
    /// The disk refuses.
    fn length(&self) -> io::Result<u64>;

    /// Appends bytes and makes them durable.
    ///
    /// # Errors
    /// The disk refuses; any part of `bytes` may have been written.
    fn append(&mut self, bytes: &[u8]) -> io::Result<()>;

    /// Cuts the file off behind `length` bytes.
    ///
    /// # Errors
    /// The disk refuses.
    fn cut(&mut self, length: u64) -> io::Result<()>;
}

/// The disk of this computer.
#[derive(Debug, Clone, Copy, Default)]
pub struct RealDisk;

/// A shared [`RealDisk`].
#[must_use]
pub fn real() -> Arc<dyn Disk> {
    Arc::new(RealDisk)
}

impl Disk for RealDisk {
    fn read(&self, path: &Path, limit_bytes: u64) -> io::Result<Vec<u8>> {
        read_regular(path, limit_bytes)
    }

    fn write(&self, path: &Path, bytes: &[u8]) -> io::Result<()> {
        let mut file = File::create(path)?;
        file.write_all(bytes)?;
        file.sync_all()
    }

    fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        fs::rename(from, to)
    }

    fn sync_folder(&self, folder: &Path) -> io::Result<()> {
        File::open(folder)?.sync_all()
    }

    fn create_folder(&self, folder: &Path) -> io::Result<()> {
        fs::create_dir_all(folder)
    }

    fn list(&self, folder: &Path) -> io::Result<Vec<String>> {
        fs::read_dir(folder)?.map(|entry| Ok(entry?.file_name().to_string_lossy().into_owned())).collect()
    }

    fn open_append(&self, path: &Path) -> io::Result<Box<dyn Append>> {
        Ok(Box::new(File::options().create(true).append(true).open(path)?))
    }

    fn hash(&self, path: &Path) -> io::Result<String> {
        let mut hasher = blake3::Hasher::new();
        hasher.update_reader(File::open(path)?)?;
        Ok(hasher.finalize().to_hex().to_string())
    }
}

impl Append for File {
    fn length(&self) -> io::Result<u64> {
        Ok(self.metadata()?.len())
    }

    fn append(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.write_all(bytes)?;
        self.sync_data()
    }

    fn cut(&mut self, length: u64) -> io::Result<()> {
        self.set_len(length)
    }
}

/// Puts `bytes` in place of a file, so that after a power loss either the old or the new content is there.
///
/// # Errors
/// The disk refuses; the file then has its old content, or the new one that may not be durable.
pub fn replace(disk: &dyn Disk, path: &Path, bytes: &[u8]) -> io::Result<()> {
    let mut name = path.file_name().unwrap_or_default().to_owned();
    name.push(".tmp");
    let temporary = path.with_file_name(name);
    disk.write(&temporary, bytes)?;
    disk.rename(&temporary, path)?;
    match path.parent().filter(|p| !p.as_os_str().is_empty()) {
        Some(folder) => disk.sync_folder(folder),
        None => Ok(()),
    }
}

/// Renames a file to a name that says why and when; returns that name.
///
/// # Errors
/// The disk refuses.
pub fn set_aside(disk: &dyn Disk, path: &Path, why: &str) -> io::Result<PathBuf> {
    let file = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or_else(|| Path::new("."));
    let taken = match disk.list(folder) {
        Ok(names) => names,
        Err(e) if e.kind() == ErrorKind::NotFound => Vec::new(),
        Err(e) => return Err(e),
    };
    let first = format!("{file}.{why}-{}", utc::stamp(SystemTime::now()));
    let mut name = first.clone();
    let mut k = 1_u32;
    while taken.contains(&name) {
        name = format!("{first}-{k}");
        k += 1;
    }
    let aside = path.with_file_name(name);
    disk.rename(path, &aside)?;
    Ok(aside)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::memory_disk::{MemoryDisk, Operation};

    #[test]
    fn a_real_file_grows_at_its_end_and_is_cut_off() {
        let dir = tempfile::tempdir().expect("directory");
        let path = dir.path().join("file");
        let mut file = RealDisk.open_append(&path).expect("opens");
        assert_eq!(file.length().expect("told"), 0);
        file.append(b"first second").expect("written");
        assert_eq!(file.length().expect("told"), 12);
        file.cut(5).expect("cut");
        assert_eq!((file.length().expect("told"), fs::read(&path).expect("there")), (5, b"first".to_vec()));
    }

    #[test]
    fn a_folder_that_is_not_there_cannot_be_made_durable() {
        let dir = tempfile::tempdir().expect("directory");
        assert!(RealDisk.sync_folder(dir.path()).is_ok());
        let error = RealDisk.sync_folder(&dir.path().join("missing")).expect_err("missing");
        assert_eq!(error.kind(), ErrorKind::NotFound);
    }

    #[test]
    fn a_file_is_replaced_only_once_its_name_is_durable() {
        let disk = MemoryDisk::new();
        disk.refuse(Operation::SyncFolder, Path::new("/state"), ErrorKind::Other);
        // a bare name has no folder to make durable
        disk.refuse(Operation::SyncFolder, Path::new(""), ErrorKind::Other);
        assert!(replace(&disk, Path::new("/state/file"), b"x").is_err());
        assert!(replace(&disk, Path::new("/other/file"), b"x").is_ok());
        assert!(replace(&disk, Path::new("file"), b"x").is_ok());
    }

    #[test]
    fn every_file_set_aside_is_kept_under_a_name_of_its_own() {
        let disk = MemoryDisk::new();
        let path = Path::new("/state/file");
        for k in 0..5_u8 {
            disk.write(path, &[k]).expect("written");
            set_aside(&disk, path, "damaged").expect("set aside");
        }
        let mut kept: Vec<Vec<u8>> = disk.files().into_values().collect();
        kept.sort();
        assert_eq!(kept, [[0], [1], [2], [3], [4]]);
    }

    #[test]
    fn a_folder_that_cannot_be_listed_keeps_a_file_from_being_set_aside_unless_it_is_missing() {
        let path = Path::new("/state/file");
        for (kind, refused) in [(ErrorKind::PermissionDenied, true), (ErrorKind::NotFound, false)] {
            let disk = MemoryDisk::new();
            disk.write(path, b"x").expect("written");
            disk.refuse(Operation::List, Path::new("/state"), kind);
            let error = set_aside(&disk, path, "damaged").err().map(|e| e.kind());
            assert_eq!(error, refused.then_some(kind));
            // a name that is taken would be overwritten
            assert_eq!(disk.files().contains_key(path), refused);
        }
    }
}
