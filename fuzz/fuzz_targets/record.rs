//! Bytes to a recording: never a panic, never more items than the bytes can hold, and bytes of a sound block of
//! entries pack to the same entries again.

#![no_main]
#![expect(clippy::disallowed_methods, reason = "the macro of libFuzzer reads its input file")]

use libfuzzer_sys::fuzz_target;
use volcomp::protocol::record::{BlockKind, Decoded, Decoder, Encoder, Item, Meta, Recording, block};

fuzz_target!(|data: &[u8]| {
    // as a file, torn and damaged as it is
    check(data);
    // behind the check sums: as the content of a block of entries, in a file that is otherwise sound
    let mut file = block::file_header().to_vec();
    let meta = Meta { format: "volcomp-recording/1".to_owned(), ..Meta::default() };
    if let Some(block) =
        meta.to_text().ok().and_then(|text| block::seal(BlockKind::Meta, 0, 0, 0, text.as_bytes()))
    {
        file.extend(block);
    }
    if let Some(block) = block::seal(BlockKind::Entries, 0, 3, 0, data) {
        file.extend(block);
    }
    check(&file);
    entries(data);
});

fn check(bytes: &[u8]) {
    let Ok(recording) = Recording::parse(bytes) else { return };
    let mut reader = recording.reader(0);
    let mut entries = 0_u64;
    for item in reader.by_ref() {
        entries += u64::from(matches!(item, Item::Entry { .. }));
    }
    let _ = (entries, reader.next_record(), block::read_index(bytes));
    for note in recording.notes.iter().chain(&reader.notes) {
        let _ = note.to_string();
    }
}

/// Whatever entries the bytes give, they survive being packed once more.
fn entries(content: &[u8]) {
    let Ok(mut decoder) = Decoder::new(content.to_vec()) else { return };
    let mut encoder = Encoder::new();
    let mut found = Vec::new();
    while let Ok(Some(decoded)) = decoder.next_entry() {
        let Decoded::Entry(entry) = decoded else { continue };
        if found.is_empty() {
            // the context in front of the bytes is not that of a new encoder: an entry with none of its own is skipped
            encoder.skip(&entry);
        } else {
            encoder.push(&entry);
        }
        found.push(entry);
    }
    let Some(sealed) = encoder.seal() else { return };
    let block::Found::Block(block, _) = block::look(&sealed) else { panic!("a sealed block is found") };
    let content = block.content().expect("a sealed block unpacks");
    let mut again = Decoder::new(content).expect("a sealed block is read");
    for entry in &found[1..] {
        let Ok(Some(Decoded::Entry(found))) = again.next_entry() else { panic!("{entry:?} is lost") };
        // NaN is equal to nothing: compared as text, which tells every other number apart
        assert_eq!(format!("{found:?}"), format!("{entry:?}"));
    }
}
