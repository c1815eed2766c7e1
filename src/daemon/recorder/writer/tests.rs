//! Disks that fail in every way: what was safe stays, everything else is counted, and recording comes back.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::rc::Rc;

use proptest::prelude::*;

use super::*;
use volcomp_protocol::record::reader::hashed;
use volcomp_protocol::record::{BlockKind, Item, LIVE_MAX, Meta, Note, Recording, meta};

/// What a disk does with the next call.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Mood {
    Fine,
    /// Takes half of the bytes, then is full.
    Half,
    /// Takes all, but cannot sync.
    NoSync,
    /// Cannot begin a file.
    NoFile,
    /// Takes half, and cannot even take it off again.
    Stuck,
}

#[derive(Debug, Clone, Default)]
struct Shelf(Rc<RefCell<Inside>>);

#[derive(Debug, Default)]
struct Inside {
    files: BTreeMap<String, Vec<u8>>,
    begun: usize,
    mood: Option<Mood>,
}

struct Sheet {
    shelf: Shelf,
    name: String,
}

impl Shelf {
    fn set(&self, mood: Mood) {
        self.0.borrow_mut().mood = Some(mood);
    }

    fn mood(&self) -> Mood {
        self.0.borrow().mood.unwrap_or(Mood::Fine)
    }

    fn full() -> io::Error {
        io::Error::new(io::ErrorKind::StorageFull, "no space left on device")
    }
}

impl Disk for Shelf {
    type File = Sheet;

    fn begin(&mut self, first_record: u64, continues: &str) -> io::Result<NewFile<Sheet>> {
        if self.mood() != Mood::Fine {
            return Err(Self::full());
        }
        let meta = Meta {
            format: meta::FORMAT.to_owned(),
            first_record,
            continues: continues.to_owned(),
            ..Meta::default()
        };
        let mut bytes = block::file_header().to_vec();
        let text = meta.to_text().expect("text");
        bytes.extend(block::seal(BlockKind::Meta, 0, 0, 0, text.as_bytes()).expect("short"));
        let name = {
            let mut inside = self.0.borrow_mut();
            inside.begun += 1;
            format!("{:03}", inside.begun - 1)
        };
        let length = bytes.len() as u64;
        self.0.borrow_mut().files.insert(name.clone(), bytes);
        Ok(NewFile { file: Sheet { shelf: self.clone(), name: name.clone() }, name, length })
    }

    fn switch(&mut self, hash: &[u8; 32]) -> Option<Vec<u8>> {
        block::seal(BlockKind::Model, 0, 0, 0, &hashed(hash, "text"))
    }
}

impl DiskFile for Sheet {
    fn append(&mut self, bytes: &[u8]) -> io::Result<()> {
        let mood = self.shelf.mood();
        let taken = if matches!(mood, Mood::Half | Mood::Stuck) { bytes.len() / 2 } else { bytes.len() };
        let mut inside = self.shelf.0.borrow_mut();
        // a deleted file takes everything
        inside.files.entry(self.name.clone()).and_modify(|file| file.extend(&bytes[..taken]));
        if taken == bytes.len() { Ok(()) } else { Err(Shelf::full()) }
    }

    fn sync(&mut self) -> io::Result<()> {
        if self.shelf.mood() == Mood::NoSync { Err(io::Error::other("input/output error")) } else { Ok(()) }
    }

    fn is_deleted(&self) -> io::Result<bool> {
        Ok(!self.shelf.0.borrow().files.contains_key(&self.name))
    }

    fn cut(&mut self, length: u64) -> io::Result<()> {
        if self.shelf.mood() == Mood::Stuck {
            return Err(Shelf::full());
        }
        let length = usize::try_from(length).expect("small");
        self.shelf.0.borrow_mut().files.entry(self.name.clone()).and_modify(|file| file.truncate(length));
        Ok(())
    }
}

const LIMITS: Limits = Limits { flush_s: 0.5, file_bytes: 4000, file_s: 60.0 };

fn entry(k: u64) -> Entry {
    let mut values = [0.0; LIVE_MAX];
    values[1] = k as f64;
    // one that nobody can predict, so that files grow
    values[2] = k.wrapping_mul(0x9e37_79b9_7f4a_7c15) as f64;
    Entry::Live { now: MonoTime::from_ns(k.cast_signed() * 1_000_000), told: 0b110, values }
}

/// Everything in all files in their order: the values, the number of missing ones, the notes.
fn contents(shelf: &Shelf) -> (Vec<f64>, u64, Vec<Note>) {
    let (mut values, mut missing, mut notes, mut expected) = (Vec::new(), 0, Vec::new(), 0);
    for bytes in shelf.0.borrow().files.values() {
        let recording = Recording::parse(bytes).expect("a recording");
        let mut reader = recording.reader(expected);
        for item in reader.by_ref() {
            match item {
                Item::Entry { entry: Entry::Live { values: [_, value, ..], .. }, .. } => values.push(value),
                Item::Gap { dropped, .. } => missing += dropped,
                other => panic!("{other:?}"),
            }
        }
        expected = reader.next_record();
        notes.extend(recording.notes.iter().chain(&reader.notes).copied());
    }
    (values, missing, notes)
}

#[test]
fn blocks_are_safe_within_the_interval_and_files_change_at_their_size() {
    let (shelf, stats) = (Shelf::default(), Arc::new(Stats::default()));
    let mut writer = Writer::new(shelf.clone(), LIMITS, Arc::clone(&stats));
    let mut worst = 0;
    for k in 0..10_000 {
        let now = entry(k).now();
        writer.take(&entry(k), now);
        writer.tick(now);
        // what a power loss would cost at this moment
        worst = worst.max(k + 1 - stats.records.load(Relaxed));
    }
    assert!(worst <= 501, "{worst} records not safe at 1 kHz and half a second");
    writer.finish(entry(10_000).now());
    let (values, missing, notes) = contents(&shelf);
    assert_eq!((values.len(), missing, notes), (10_000, 0, Vec::new()));
    let files = &shelf.0.borrow().files;
    assert!(files.len() > 3, "{} files", files.len());
    for bytes in files.values() {
        assert!(bytes.len() <= 4400, "{} bytes", bytes.len());
        assert!(Recording::parse(bytes).expect("a recording").closed);
    }
}

#[test]
fn a_full_disk_costs_records_that_are_counted_and_nothing_that_was_there() {
    for mood in [Mood::Half, Mood::NoSync, Mood::NoFile, Mood::Stuck] {
        let (shelf, stats) = (Shelf::default(), Arc::new(Stats::default()));
        let mut writer = Writer::new(shelf.clone(), LIMITS, Arc::clone(&stats));
        for k in 0..30_000 {
            match k {
                5_000 => shelf.set(mood),
                20_000 => shelf.set(Mood::Fine),
                _ => {}
            }
            let now = entry(k).now();
            writer.take(&entry(k), now);
            writer.tick(now);
            if k == 15_000 {
                assert!(stats.status().error.is_some(), "{mood:?}: the status tells");
            }
        }
        writer.finish(entry(30_000).now());
        let (values, missing, notes) = contents(&shelf);
        let dropped = stats.dropped.load(Relaxed);
        assert!((14_000..=17_000).contains(&dropped), "{mood:?}: {dropped} dropped of 15000 while full");
        assert_eq!(values.len() as u64 + dropped, 30_000, "{mood:?}: every record is safe or counted");
        assert_eq!(missing, dropped, "{mood:?}: the files tell what is missing");
        assert!(values[..4_500].iter().enumerate().all(|(k, v)| *v == k as f64), "{mood:?}");
        assert!(values.ends_with(&[29_998.0, 29_999.0]), "{mood:?}: back when there is room");
        assert!(stats.status().error.is_none(), "{mood:?}");
        let torn = notes.iter().filter(|n| matches!(n, Note::Torn { .. })).count();
        assert_eq!(torn, notes.len(), "{mood:?}: {notes:?}");
        assert!(torn == 0 || mood == Mood::Stuck, "{mood:?}: {notes:?}");
    }
}

#[test]
fn a_recording_that_is_deleted_is_told_counted_and_begun_anew() {
    let (shelf, stats) = (Shelf::default(), Arc::new(Stats::default()));
    let limits = Limits { file_bytes: 1 << 20, ..LIMITS };
    let mut writer = Writer::new(shelf.clone(), limits, Arc::clone(&stats));
    for k in 0..10_000 {
        if k == 5_000 {
            shelf.0.borrow_mut().files.clear();
        }
        let now = entry(k).now();
        writer.take(&entry(k), now);
        writer.tick(now);
        if k == 6_000 {
            let status = stats.status();
            assert!(status.error.expect("told").contains("000 was deleted"), "{:?}", status.file);
            assert_eq!(status.file, None);
        }
    }
    writer.finish(entry(10_000).now());
    let dropped = stats.dropped.load(Relaxed);
    assert!(
        (1_000..=2_000).contains(&dropped),
        "{dropped} dropped: one block and a second until the next attempt"
    );
    assert_eq!(stats.records.load(Relaxed) + dropped, 10_000, "every record was safe once or is counted");
    let bytes = &shelf.0.borrow().files["001"];
    let recording = Recording::parse(bytes).expect("a recording");
    assert_eq!(recording.meta.continues, "000");
    assert!(recording.meta.first_record > 5_000 && recording.closed && stats.status().error.is_none());
}

#[test]
fn the_text_of_another_model_stands_in_the_file_before_the_engine_uses_it() {
    // the disk is full for a while, too: the text must not be lost with the records
    let limits = Limits { file_bytes: 1 << 20, ..LIMITS };
    for full in [false, true] {
        let (shelf, stats) = (Shelf::default(), Arc::new(Stats::default()));
        let mut writer = Writer::new(shelf.clone(), limits, Arc::clone(&stats));
        for k in 0..3_000 {
            let now = entry(k).now();
            if k == 100 {
                writer.take(&Entry::Model { now, hash: [7; 32] }, now);
                shelf.set(if full { Mood::Half } else { Mood::Fine });
            }
            if k == 800 {
                shelf.set(Mood::Fine);
            }
            writer.take(&entry(k), now);
            writer.tick(now);
        }
        // a power loss: what is in the file at this moment is all there is
        let files = &shelf.0.borrow().files;
        let file = Recording::parse(&files["000"]).expect("a recording");
        assert_eq!(file.models, [([7; 32], "text".to_owned())], "full: {full}");
        let before: Vec<Item> = file.reader(0).take(100).collect();
        assert!(before.iter().all(|i| matches!(i, Item::Entry { entry: Entry::Live { .. }, .. })));
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]
    #[test]
    fn whatever_the_disk_does_every_record_is_safe_or_counted(moods in proptest::collection::vec(0..5u8, 1..40)) {
        let (shelf, stats) = (Shelf::default(), Arc::new(Stats::default()));
        let mut writer = Writer::new(shelf.clone(), LIMITS, Arc::clone(&stats));
        let mut k = 0;
        for mood in moods {
            shelf.set([Mood::Fine, Mood::Half, Mood::NoSync, Mood::NoFile, Mood::Stuck][usize::from(mood)]);
            for _ in 0..700 {
                let now = entry(k).now();
                writer.take(&entry(k), now);
                writer.tick(now);
                k += 1;
            }
        }
        shelf.set(Mood::Fine);
        writer.finish(entry(k).now());
        let (values, missing, notes) = contents(&shelf);
        let dropped = stats.dropped.load(Relaxed);
        prop_assert_eq!(values.len() as u64 + dropped, k);
        prop_assert!(missing <= dropped, "losses at the very end leave no gap to be seen");
        prop_assert!(notes.iter().all(|n| matches!(n, Note::Torn { .. })), "{:?}", notes);
        prop_assert!(values.windows(2).all(|w| w[0] < w[1]));
    }
}
