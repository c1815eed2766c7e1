//! What a method is to `volcomp identify`, and the runner that does the reading, printing and writing of all of them.

use crate::identify::prelude::*;

/// The options that every method has.
pub(super) struct Front<'a> {
    /// The case, where one is given instead of data.
    pub(super) file: Option<CaseFile<'a>>,
    /// One JSON object instead of a report.
    pub(super) json: bool,
    /// The model to write.
    pub(super) model: Option<&'a ModelWriter>,
    /// Files other than the model are to be written.
    pub(super) writes_more: bool,
    /// A case holds all that a model needs.
    pub(super) case_writes: bool,
}

/// A method: its command line, and what it finds in a case or in data.
pub(super) trait Method {
    fn front(&self) -> Front<'_>;

    /// What a case of the reference vectors gives, where the method takes cases.
    fn of_case(&self, file: CaseFile<'_>) -> Result<Box<dyn Found + '_>> {
        Err(file.bad("this method takes no cases"))
    }

    /// What the files of the instrument give; `None` where there is nothing to print.
    fn of_data(&self) -> Result<Option<Box<dyn Found + '_>>>;
}

/// What a method found.
pub(super) trait Found {
    /// One object for machines.
    fn json(&self) -> Value;

    /// The report for people.
    fn print(&self);

    /// Notes that stand beside either.
    fn warn(&self) {}

    /// Writes the model and what else was asked for; what it adds to `end` ends the report.
    fn write(&self, _end: &mut String) -> Result<()> {
        Ok(())
    }
}

/// A result that is only printed.
impl<P: Fn()> Found for (Value, P) {
    fn json(&self) -> Value {
        self.0.clone()
    }

    fn print(&self) {
        (self.1)();
    }
}

/// A result that is only printed.
pub(super) fn printed<'a>(json: Value, print: impl Fn() + 'a) -> Box<dyn Found + 'a> {
    Box::new((json, print))
}

/// Reads, solves, writes, and prints last: a failure leaves nothing on stdout.
pub(super) fn run(method: &impl core::ops::Deref<Target: Method>) -> Result<()> {
    let Front { file, json, model, writes_more, case_writes } = method.front();
    let writes = writes_more || model.is_some_and(|m| m.target().is_some());
    let found = match file {
        Some(file) => {
            file.writes_no_model(writes && !case_writes)?;
            Some(method.of_case(file)?)
        }
        None => method.of_data()?,
    };
    let Some(found) = found else { return Ok(()) };
    found.warn();
    let mut end = String::new();
    if writes {
        found.write(&mut end)?;
    }
    if model.is_some_and(ModelWriter::takes_stdout) {
        return Ok(());
    }
    if json {
        say!("{:#}", found.json());
    } else {
        found.print();
        if !end.is_empty() {
            say_text!("{}", end.trim_end());
        }
    }
    Ok(())
}
