//! The folder of recordings: names, the first blocks of a file, sizes, and what to delete.

use std::fs::{self, File};
use std::io::{self, Write};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::SystemTime;

use tracing::warn;
use volcomp_state::utc;

use super::super::clock::Clock;
use super::super::load::Loaded;
use super::super::models::Prepared;
use super::model_texts::ModelTexts;
use super::writer::{Disk, DiskFile, NewFile};
use volcomp_config::{RecordingConfig, WhenFull};
use volcomp_protocol::record::{BlockKind, EXTENSION, Meta, block, meta, reader};

/// Files that may be begun within one second.
const SAME_SECOND_MAX: u32 = 1000;

/// What every file of this run begins with.
#[derive(Debug, Clone)]
pub(super) struct Description {
    meta: Meta,
    model: Vec<u8>,
    machine: Vec<u8>,
}

impl Description {
    /// `model`: the one in use at the start, which need not be the one that the machine file names.
    pub(super) fn new(config_path: &Path, loaded: &Loaded, model: &Prepared) -> Self {
        let run = format!("{}-{}", utc::stamp(SystemTime::now()), std::process::id());
        let config_hash = blake3::hash(loaded.config_text.as_bytes());
        let model_hash = blake3::hash(model.text.as_bytes());
        Self {
            meta: Meta {
                format: meta::FORMAT.to_owned(),
                software: concat!("volcompd ", env!("CARGO_PKG_VERSION")).to_owned(),
                machine: loaded.config.machine.clone(),
                config: config_path.display().to_string(),
                config_hash: config_hash.to_hex().to_string(),
                model: model.origin.clone(),
                model_hash: model.hash.clone(),
                run,
                ..Meta::default()
            },
            model: reader::hashed(model_hash.as_bytes(), &model.text),
            machine: reader::hashed(config_hash.as_bytes(), &loaded.config_text),
        }
    }

    fn bytes(&self, meta: &Meta) -> io::Result<Vec<u8>> {
        let mut out = block::file_header().to_vec();
        let text = meta.to_text().map_err(io::Error::other)?;
        let blocks = [
            (BlockKind::Meta, text.as_bytes()),
            (BlockKind::Model, &self.model),
            (BlockKind::Machine, &self.machine),
        ];
        for (kind, content) in blocks {
            let sealed = block::seal(kind, 0, 0, 0, content);
            out.extend(sealed.ok_or_else(|| io::Error::other("a model or machine file above 8 MiB"))?);
        }
        Ok(out)
    }
}

/// The folder.
#[derive(Debug)]
pub(super) struct Folder {
    path: PathBuf,
    description: Description,
    models: Arc<ModelTexts>,
    file_bytes: u64,
    total_bytes: u64,
    when_full: WhenFull,
    clock: Clock,
}

impl Folder {
    pub(super) fn new(
        path: PathBuf,
        description: Description,
        models: Arc<ModelTexts>,
        config: &RecordingConfig,
        clock: Clock,
    ) -> Self {
        let &RecordingConfig { file_bytes, total_bytes, when_full, .. } = config;
        Self { path, description, models, file_bytes, total_bytes, when_full, clock }
    }

    /// Makes sure that one more whole file keeps within the total.
    fn make_room(&self) -> io::Result<()> {
        let mut found = recordings(&self.path)?;
        let mut sum: u64 = found.iter().map(|r| r.length).sum();
        found.sort_by(|a, b| (a.modified, &a.path).cmp(&(b.modified, &b.path)));
        // what another machine has recorded takes room, but is not this one's to delete
        let own = format!("{}-", self.machine());
        for oldest in found {
            if sum.saturating_add(self.file_bytes) <= self.total_bytes {
                return Ok(());
            }
            if self.when_full == WhenFull::Stop {
                break;
            }
            if !oldest.path.file_name().is_some_and(|name| name.to_string_lossy().starts_with(&own)) {
                continue;
            }
            fs::remove_file(&oldest.path)?;
            warn!(file = %oldest.path.display(), "oldest recording deleted: total-max-mb is reached");
            sum = sum.saturating_sub(oldest.length);
        }
        if sum.saturating_add(self.file_bytes) <= self.total_bytes {
            return Ok(());
        }
        Err(io::Error::new(
            io::ErrorKind::StorageFull,
            format!(
                "recordings in {} take {sum} bytes, with one more file above total-max-mb ({} bytes); \
                 move some away",
                self.path.display(),
                self.total_bytes
            ),
        ))
    }

    /// The machine's name, as it begins every name of a file.
    fn machine(&self) -> String {
        let name = self.description.meta.machine.chars();
        name.map(|c| if c.is_ascii_alphanumeric() || "-_.".contains(c) { c } else { '_' }).collect()
    }

    /// A file that did not exist before.
    fn create(&self, stamp: &str) -> io::Result<(File, PathBuf)> {
        let machine = self.machine();
        for k in 0..SAME_SECOND_MAX {
            let path = self.path.join(format!("{machine}-{stamp}-{k:03}.{EXTENSION}"));
            match File::options().append(true).create_new(true).open(&path) {
                Ok(file) => return Ok((file, path)),
                Err(e) if e.kind() == io::ErrorKind::AlreadyExists => {}
                Err(e) => return Err(e),
            }
        }
        Err(io::Error::new(io::ErrorKind::AlreadyExists, "too many recordings of the same second"))
    }
}

struct Found {
    path: PathBuf,
    length: u64,
    modified: SystemTime,
}

/// Every recording in a folder.
fn recordings(path: &Path) -> io::Result<Vec<Found>> {
    let mut found = Vec::new();
    for entry in fs::read_dir(path)? {
        let path = entry?.path();
        if path.extension().is_some_and(|e| e == EXTENSION) {
            // one that is gone meanwhile takes no room
            if let Ok(about) = fs::metadata(&path) {
                let modified = about.modified().unwrap_or(SystemTime::UNIX_EPOCH);
                found.push(Found { path, length: about.len(), modified });
            }
        }
    }
    Ok(found)
}

impl Disk for Folder {
    type File = File;

    fn switch(&mut self, hash: &[u8; 32]) -> Option<Vec<u8>> {
        let Some(found) = self.models.find(hash) else {
            let hash = blake3::Hash::from(*hash).to_hex();
            warn!(%hash, "the recording goes on with a model whose text it was not given; it cannot be replayed");
            return None;
        };
        // a file stands alone: those that are begun from now on begin with this model
        let description = &mut self.description;
        description.model = reader::hashed(&found.hash, &found.text);
        description.meta.model_hash = blake3::Hash::from(found.hash).to_hex().to_string();
        description.meta.model = found.path;
        block::seal(BlockKind::Model, 0, 0, 0, &description.model)
    }

    fn begin(&mut self, first_record: u64, continues: &str) -> io::Result<NewFile<File>> {
        let named = |e: io::Error| io::Error::new(e.kind(), format!("{}: {e}", self.path.display()));
        fs::create_dir_all(&self.path).map_err(named)?;
        self.make_room()?;
        let time = SystemTime::now();
        let meta = Meta {
            begun: utc::text(time),
            begun_ns: self.clock.now().ns,
            first_record,
            continues: continues.to_owned(),
            ..self.description.meta.clone()
        };
        let bytes = self.description.bytes(&meta)?;
        let (mut file, path) = self.create(&utc::stamp(time)).map_err(named)?;
        let written = file.write_all(&bytes).and_then(|()| file.sync_all());
        // the name itself must survive a power loss, too
        let written = written.and_then(|()| File::open(&self.path)?.sync_all());
        if let Err(e) = written {
            // nothing was ever safe in it
            let _ = fs::remove_file(&path);
            return Err(named(e));
        }
        Ok(NewFile { file, name: path.display().to_string(), length: bytes.len() as u64 })
    }
}

impl DiskFile for File {
    fn append(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.write_all(bytes)
    }

    fn sync(&mut self) -> io::Result<()> {
        self.sync_data()
    }

    fn cut(&mut self, length: u64) -> io::Result<()> {
        self.set_len(length).and_then(|()| self.sync_data())
    }

    fn is_deleted(&self) -> io::Result<bool> {
        Ok(self.metadata()?.nlink() == 0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn folder(path: &Path, when_full: WhenFull) -> Folder {
        let config = RecordingConfig {
            directory: None,
            file_bytes: 1000,
            file_s: 1.0,
            total_bytes: 3000,
            when_full,
            flush_s: 0.1,
        };
        let meta = Meta { format: meta::FORMAT.to_owned(), machine: "a/b".to_owned(), ..Meta::default() };
        let description = Description { meta, model: reader::hashed(&[0; 32], "m"), machine: Vec::new() };
        Folder::new(path.to_owned(), description, Arc::default(), &config, Clock::start())
    }

    #[test]
    fn the_total_is_kept_by_stopping_or_by_deleting_the_oldest() {
        let dir = tempfile::tempdir().expect("directory");
        for (k, name) in ["other-oldest", "a_b-old", "a_b-middle"].iter().enumerate() {
            let path = dir.path().join(format!("{name}.{EXTENSION}"));
            fs::write(&path, [0; 900]).expect("written");
            let file = File::options().write(true).open(&path).expect("open");
            let age = std::time::Duration::from_secs(1000 - k as u64);
            file.set_modified(SystemTime::now() - age).expect("time set");
        }
        fs::write(dir.path().join("notes.txt"), [0; 9000]).expect("written");
        let full = folder(dir.path(), WhenFull::Stop).begin(0, "").expect_err("no room");
        assert_eq!(full.kind(), io::ErrorKind::StorageFull);
        assert!(full.to_string().contains("2700 bytes"), "{full}");
        assert_eq!(fs::read_dir(dir.path()).expect("folder").count(), 4, "nothing deleted");

        let begun = folder(dir.path(), WhenFull::DeleteOldest).begin(7, "before").expect("room made");
        assert!(!dir.path().join(format!("a_b-old.{EXTENSION}")).exists());
        assert!(dir.path().join(format!("a_b-middle.{EXTENSION}")).exists());
        assert!(
            dir.path().join(format!("other-oldest.{EXTENSION}")).exists(),
            "not this machine's to delete"
        );
        assert!(dir.path().join("notes.txt").exists(), "only recordings are deleted");
        assert!(begun.name.contains("a_b-"), "{}", begun.name);
        let bytes = fs::read(&begun.name).expect("there");
        assert_eq!(bytes.len() as u64, begun.length);
        let found = volcomp_protocol::record::Recording::parse(&bytes).expect("a recording");
        assert_eq!((found.meta.first_record, found.meta.continues.as_str()), (7, "before"));
    }

    #[test]
    fn after_a_switch_files_begin_with_the_new_model() {
        let dir = tempfile::tempdir().expect("directory");
        let mut folder = folder(dir.path(), WhenFull::Stop);
        assert_eq!(folder.switch(&[9; 32]), None, "nobody has announced it");
        let hash = folder.models.put("new.toml", "the new model");
        let block = folder.switch(&hash).expect("announced");
        let begun = folder.begin(0, "").expect("room");
        let bytes = fs::read(&begun.name).expect("there");
        let found = volcomp_protocol::record::Recording::parse(&bytes).expect("a recording");
        assert_eq!(found.models, [(hash, "the new model".to_owned())]);
        assert_eq!(found.meta.model, "new.toml");
        assert_eq!(found.meta.model_hash, blake3::Hash::from(hash).to_hex().as_str());
        // the same block is for the file that is open
        let both = [&bytes[..], &block].concat();
        assert_eq!(volcomp_protocol::record::Recording::parse(&both).expect("sound").models.len(), 2);
    }

    #[test]
    fn a_deleted_file_is_noticed() {
        let dir = tempfile::tempdir().expect("directory");
        let recordings = dir.path().join("recordings");
        let begun = folder(&recordings, WhenFull::Stop).begin(0, "").expect("room");
        assert!(!begun.file.is_deleted().expect("known"));
        fs::remove_dir_all(&recordings).expect("removed");
        assert!(begun.file.is_deleted().expect("known"));
        let again = folder(&recordings, WhenFull::Stop).begin(0, "").expect("the folder is made again");
        assert!(!again.file.is_deleted().expect("known"));
    }
}
