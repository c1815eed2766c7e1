//! Reading, section by section.

use std::collections::HashMap;

use super::{Deviation, Entry, Note, Rtl};
use crate::prelude::*;

/// Most targets and runs taken for real.
const TARGETS_MAX: usize = 100_000;
const RUNS_MAX: u32 = 10_000;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Section {
    Header,
    TargetData,
    UserText,
    Runs,
    Deviations,
    Equipment,
    Environment,
    Other,
    Eof,
}

/// True where the beginning of a file looks like this format.
#[must_use]
pub fn recognises(text: &str) -> bool {
    let mut found = lines(text).map(|l| l.text);
    found.any(|l| l == "TARGET DATA::" || l == "DEVIATIONS::")
}

/// Reads a file.
///
/// # Errors
/// The first mistake, with its line and column.
pub fn parse(text: &str) -> Result<(Rtl, Vec<Note>), FormatError> {
    let mut reader = Reader::default();
    for line in lines(text) {
        if !line.text.is_empty() {
            reader.line(line)?;
        }
        reader.last_line = line.line;
    }
    reader.finish()
}

#[derive(Default)]
struct Reader<'a> {
    rtl: Rtl,
    section: Option<Section>,
    /// Inside the list of targets or the rows of deviations.
    in_list: bool,
    target_count: Option<(Word<'a>, u32)>,
    run_count: Option<Word<'a>>,
    targets_seen: bool,
    /// Line on which a run and target stood.
    seen: HashMap<(u32, u32), usize>,
    last_line: usize,
}

impl<'a> Reader<'a> {
    fn line(&mut self, line: Word<'a>) -> Result<(), FormatError> {
        // a text that somebody typed may end in colons, too: the name of a section is capitals only
        let is_name =
            |n: &str| n.chars().all(|c| c.is_ascii_uppercase() || c.is_ascii_digit() || " -".contains(c));
        if let Some(name) = line.text.strip_suffix("::").filter(|n| is_name(n)) {
            return self.open(line, name);
        }
        match self.section {
            None => Err(line.unexpected("HEADER::")),
            Some(Section::TargetData) => self.target_data(line),
            Some(Section::Runs) => self.runs(line),
            Some(Section::Deviations) => self.deviation(line),
            Some(Section::Header) => entry(line, &mut self.rtl.header),
            // free text: whatever people typed is kept
            Some(Section::UserText) => entry(line, &mut self.rtl.user_text),
            Some(Section::Equipment) => entry(line, &mut self.rtl.equipment),
            Some(Section::Environment) => entry(line, &mut self.rtl.environment),
            Some(Section::Other | Section::Eof) => Ok(()),
        }
    }

    fn open(&mut self, line: Word<'a>, name: &str) -> Result<(), FormatError> {
        if self.section.is_none() && name.trim() != "HEADER" && name.trim() != "TARGET DATA" {
            return Err(line.unexpected("HEADER::"));
        }
        self.in_list = false;
        self.section = Some(match name.trim() {
            "HEADER" => Section::Header,
            "TARGET DATA" => Section::TargetData,
            "USER-TEXT" => Section::UserText,
            "RUNS" => Section::Runs,
            "DEVIATIONS" => Section::Deviations,
            "EQUIPMENT" => Section::Equipment,
            "ENVIRONMENT" => Section::Environment,
            "EOF" => Section::Eof,
            _ => Section::Other,
        });
        Ok(())
    }

    fn target_data(&mut self, line: Word<'a>) -> Result<(), FormatError> {
        let Some((key, text)) = key_and_text(line) else {
            if !self.in_list {
                return Err(line.unexpected("a key such as 'Target-count:' or 'Targets :'"));
            }
            return self.targets(line);
        };
        self.in_list = false;
        match key {
            "Filetype" => self.rtl.filetype = text.text.to_owned(),
            "Target-count" => {
                let count = text.whole("a number of targets", 1, TARGETS_MAX as u32)?;
                self.target_count = Some((text, count));
            }
            "Targets" => {
                self.in_list = true;
                self.targets_seen = true;
                self.targets(text)?;
            }
            "Flags" => {
                for word in words(text) {
                    let flag = word.text.parse().map_err(|_| word.unexpected("a whole number as a flag"))?;
                    self.rtl.flags.push(flag);
                }
            }
            _ => {}
        }
        Ok(())
    }

    fn targets(&mut self, line: Word<'a>) -> Result<(), FormatError> {
        for word in words(line) {
            if self.rtl.targets.len() == TARGETS_MAX {
                return Err(word.too_many("targets", TARGETS_MAX + 1, TARGETS_MAX));
            }
            self.rtl.targets.push(word.number("a target in mm or deg")?);
        }
        Ok(())
    }

    fn runs(&mut self, line: Word<'a>) -> Result<(), FormatError> {
        if let Some(("Run-count", text)) = key_and_text(line) {
            self.rtl.run_count = text.whole("a number of runs", 1, RUNS_MAX)?;
            self.run_count = Some(text);
        }
        Ok(())
    }

    fn deviation(&mut self, line: Word<'a>) -> Result<(), FormatError> {
        if let Some((key, _)) = key_and_text(line) {
            self.in_list |= key.starts_with("Run Target Data");
            return Ok(());
        }
        if !self.in_list {
            return Err(line.unexpected("'Run Target Data:'"));
        }
        let mut parts = words(line);
        let (Some(run), Some(target), Some(value), None) =
            (parts.next(), parts.next(), parts.next(), parts.next())
        else {
            return Err(line.unexpected("a row of three: run, target, deviation"));
        };
        // where a section comes late, its limit is checked at the end
        let targets = if self.targets_seen { self.rtl.targets.len() } else { TARGETS_MAX };
        let runs = if self.run_count.is_some() { self.rtl.run_count } else { RUNS_MAX };
        let run_number = run.whole("a run", 1, runs)?;
        let target_number = target.whole("the index of a target", 1, targets.max(1) as u32)?;
        let value = value.number("a deviation")?;
        if let Some(first) = self.seen.insert((run_number, target_number), line.line) {
            return Err(line.twice(format!("run {run_number}, target {target_number}"), first));
        }
        let line = line.line as u64;
        self.rtl.deviations.push(Deviation { run: run_number, target: target_number, value, line });
        Ok(())
    }

    fn finish(self) -> Result<(Rtl, Vec<Note>), FormatError> {
        let Self { mut rtl, section, target_count, targets_seen, run_count, last_line, seen, .. } = self;
        let missing = |what, remedy| Err(FormatError::missing(last_line, what, remedy));
        if !targets_seen || rtl.targets.is_empty() {
            return missing(
                "the list 'Targets :' of TARGET DATA::",
                "is this an .rtl file of a static test?",
            );
        }
        if let Some((word, announced)) = target_count
            && announced as usize != rtl.targets.len()
        {
            return Err(word.count("targets", announced as usize, rtl.targets.len()));
        }
        if rtl.deviations.is_empty() {
            return missing("the rows of DEVIATIONS::", "the file holds targets but no readings");
        }
        if run_count.is_none() {
            rtl.run_count = rtl.runs().last().copied().unwrap_or(0);
        }
        let limits = (f64::from(rtl.run_count), rtl.targets.len() as f64);
        for d in &rtl.deviations {
            let line = seen.get(&(d.run, d.target)).copied().unwrap_or(last_line);
            for (what, value, high) in [
                ("a run", f64::from(d.run), limits.0),
                ("the index of a target", f64::from(d.target), limits.1),
            ] {
                if value > high {
                    let kind = FormatErrorKind::Range { what, value, low: 1.0, high };
                    return Err(FormatError::at(line, 1, kind));
                }
            }
        }
        let announced =
            if run_count.is_some() { u64::from(rtl.run_count) * rtl.targets.len() as u64 } else { 0 };
        let found = rtl.deviations.len() as u64;
        // nothing behind the rows and rows missing: the file was cut off while it was written or copied
        if section == Some(Section::Deviations) && found < announced {
            let kind = FormatErrorKind::Count { what: "readings", announced, found };
            return Err(FormatError::at(last_line, 1, kind));
        }
        let mut notes = Vec::new();
        if section != Some(Section::Eof) {
            notes.push(Note::NoEof);
        }
        Ok((rtl, notes))
    }
}

/// `key : text`, where the key is words and the colon stands outside of any number.
fn key_and_text<'a>(line: Word<'a>) -> Option<(&'a str, Word<'a>)> {
    let colon = line.text.find(':')?;
    let key = line.text[..colon].trim_end();
    key.starts_with(|c: char| c.is_alphabetic()).then(|| (key, line.tail(colon + 1)))
}

/// Keeps a line of keys; a line without a colon continues the text above.
fn entry(line: Word<'_>, into: &mut Vec<Entry>) -> Result<(), FormatError> {
    match (line.text.split_once(':'), into.last_mut()) {
        (Some((key, text)), _) => {
            into.push(Entry { key: key.trim().to_owned(), text: text.trim().to_owned() });
        }
        (None, Some(last)) => {
            if !last.text.is_empty() {
                last.text.push(' ');
            }
            last.text.push_str(line.text);
        }
        (None, None) => return Err(line.unexpected("a line 'key : text'")),
    }
    Ok(())
}
