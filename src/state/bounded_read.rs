//! Reading files of a bounded size: the limit is checked before the content is read, and again while it is read.
//!
//! The length that the file system states is not enough: devices and pipes state 0 and go on for ever.

use std::fs::{File, Metadata};
use std::io::{self, ErrorKind, Read};
use std::os::unix::fs::{FileTypeExt, OpenOptionsExt};
use std::path::Path;

/// Largest model file, bytes.
pub const MODEL_BYTES_MAX: u64 = 4 << 20;
/// Largest machine file, bytes.
pub const MACHINE_BYTES_MAX: u64 = 1 << 20;

/// Reads a whole file of at most `limit_bytes` bytes.
///
/// Regular files, pipes and character devices are read; memory use is bounded by the limit.
///
/// # Errors
/// The system refuses; [`ErrorKind::FileTooLarge`] above the limit; [`ErrorKind::InvalidInput`] for directories, sockets
/// and block devices.
pub fn read_bounded(path: &Path, limit_bytes: u64) -> io::Result<Vec<u8>> {
    read_open(&File::open(path)?, limit_bytes)
}

/// Reads the rest of an open file of at most `limit_bytes` bytes; see [`read_bounded`].
///
/// # Errors
/// As [`read_bounded`].
pub fn read_open(file: &File, limit_bytes: u64) -> io::Result<Vec<u8>> {
    let about = file.metadata()?;
    let kind = about.file_type();
    if kind.is_dir() || kind.is_block_device() || kind.is_socket() {
        return Err(io::Error::new(ErrorKind::InvalidInput, "not a file that can be read as a whole"));
    }
    read_limited(file, &about, limit_bytes)
}

/// Reads a whole regular file of at most `limit_bytes` bytes. Never waits for another process: a pipe is refused.
///
/// # Errors
/// As [`read_bounded`]; [`ErrorKind::InvalidInput`] for everything that is not a regular file.
pub fn read_regular(path: &Path, limit_bytes: u64) -> io::Result<Vec<u8>> {
    // without O_NONBLOCK opening a pipe waits for its writer
    let file = File::options().read(true).custom_flags(NONBLOCK).open(path)?;
    let about = file.metadata()?;
    if !about.is_file() {
        return Err(io::Error::new(ErrorKind::InvalidInput, "not a regular file"));
    }
    read_limited(&file, &about, limit_bytes)
}

/// `O_NONBLOCK`, which a regular file ignores.
const NONBLOCK: i32 = rustix::fs::OFlags::NONBLOCK.bits() as i32;

/// Why a file cannot be read or written, with the remedy.
#[must_use]
pub fn in_words(path: &Path, error: &io::Error) -> String {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    match (error.kind(), folder) {
        (ErrorKind::NotFound, Some(folder)) if !folder.exists() => {
            format!("folder {} does not exist; create it or correct the path", folder.display())
        }
        (ErrorKind::NotFound, _) => "no such file; check its name and the current folder".to_owned(),
        (ErrorKind::PermissionDenied, _) => {
            "permission denied; change the permissions or the user".to_owned()
        }
        (ErrorKind::IsADirectory, _) => "is a folder; name a file".to_owned(),
        (ErrorKind::NotADirectory, Some(folder)) => {
            format!("{} is not a folder; correct the path", folder.display())
        }
        _ => plain(error),
    }
}

/// The text of an error without the number of the operating system.
fn plain(error: &io::Error) -> String {
    let text = error.to_string();
    text.find(" (os error ").map_or_else(|| text.clone(), |at| text[..at].to_owned())
}

fn read_limited(file: &File, about: &Metadata, limit_bytes: u64) -> io::Result<Vec<u8>> {
    let refused = |found: String| {
        let text = format!("{found}, the limit is {limit_bytes} bytes ({})", binary(limit_bytes));
        io::Error::new(ErrorKind::FileTooLarge, text)
    };
    if about.len() > limit_bytes {
        return Err(refused(format!("{} bytes", about.len())));
    }
    let mut bytes = Vec::with_capacity(usize::try_from(about.len()).unwrap_or(0));
    file.take(limit_bytes.saturating_add(1)).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > limit_bytes {
        return Err(refused(format!("more than {limit_bytes} bytes")));
    }
    Ok(bytes)
}

/// A size in the largest binary unit that it is a multiple of.
fn binary(bytes: u64) -> String {
    let units = ["B", "KiB", "MiB", "GiB"];
    let mut value = bytes;
    let mut unit = 0;
    while value > 0 && value.is_multiple_of(1024) && unit + 1 < units.len() {
        value /= 1024;
        unit += 1;
    }
    format!("{value} {}", units[unit])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn up_to_the_limit_everything_is_read_and_one_byte_more_is_refused() {
        let dir = tempfile::tempdir().expect("directory");
        let path = dir.path().join("file");
        for (length, limit, fits) in
            [(0, 0, true), (1, 0, false), (1024, 1024, true), (1025, 1024, false), (7, u64::MAX, true)]
        {
            std::fs::write(&path, vec![b'x'; length]).expect("written");
            for found in [read_bounded(&path, limit), read_regular(&path, limit)] {
                match found {
                    Ok(bytes) => assert!(fits && bytes == vec![b'x'; length], "{length} {limit}"),
                    Err(e) => assert!(!fits && e.kind() == ErrorKind::FileTooLarge, "{length} {limit}: {e}"),
                }
            }
        }
        let message = read_bounded(&path, 2).expect_err("refused").to_string();
        assert_eq!(message, "7 bytes, the limit is 2 bytes (2 B)");
    }

    #[test]
    fn a_device_without_end_is_refused_at_the_limit() {
        let error = read_bounded(Path::new("/dev/zero"), 1 << 20).expect_err("endless");
        assert_eq!(error.kind(), ErrorKind::FileTooLarge);
        assert!(error.to_string().contains("more than 1048576 bytes") && error.to_string().contains("1 MiB"));
        assert_eq!(read_bounded(Path::new("/dev/null"), 10).expect("empty"), b"");
        let error = read_regular(Path::new("/dev/zero"), 1 << 20).expect_err("a device");
        assert_eq!(error.kind(), ErrorKind::InvalidInput);
    }

    #[test]
    fn pipes_are_read_where_they_may_be_and_never_waited_for_where_not() {
        let dir = tempfile::tempdir().expect("directory");
        let path = dir.path().join("pipe");
        let made = std::process::Command::new("mkfifo").arg(&path).status().expect("mkfifo runs");
        assert!(made.success());
        assert_eq!(read_regular(&path, 10).expect_err("refused").kind(), ErrorKind::InvalidInput);
        let writer = path.clone();
        let writer = std::thread::spawn(move || std::fs::write(writer, "0123456789"));
        assert_eq!(read_bounded(&path, 10).expect("read"), b"0123456789");
        writer.join().expect("writer").expect("written");
    }

    #[test]
    fn folders_and_missing_files_are_refused() {
        let dir = tempfile::tempdir().expect("directory");
        assert!(read_bounded(dir.path(), 10).is_err() && read_regular(dir.path(), 10).is_err());
        let missing = dir.path().join("missing");
        assert_eq!(read_bounded(&missing, 10).expect_err("missing").kind(), ErrorKind::NotFound);
    }

    #[test]
    fn what_cannot_be_read_as_a_whole_is_refused_by_its_kind() {
        let dir = tempfile::tempdir().expect("directory");
        let folder = File::open(dir.path()).expect("opens");
        let (socket, other_end) = std::os::unix::net::UnixStream::pair().expect("made");
        // reading would end at once, and not wait
        drop(other_end);
        let socket = File::from(std::os::fd::OwnedFd::from(socket));
        for file in [folder, socket] {
            assert_eq!(read_open(&file, 10).expect_err("refused").kind(), ErrorKind::InvalidInput);
        }
    }

    #[test]
    fn the_largest_files_are_those_of_the_documentation() {
        assert_eq!((binary(MODEL_BYTES_MAX), binary(MACHINE_BYTES_MAX)), ("4 MiB".into(), "1 MiB".into()));
    }

    #[test]
    fn sizes_are_told_in_binary_units() {
        for (bytes, text) in
            [(0, "0 B"), (1000, "1000 B"), (1024, "1 KiB"), (8 << 20, "8 MiB"), (3 << 40, "3072 GiB")]
        {
            assert_eq!(binary(bytes), text);
        }
    }
}
