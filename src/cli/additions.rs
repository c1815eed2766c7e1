//! Additions of `volcomp diagnose` for `volcomp predict`: their columns, row by row.

use super::input::read_text;
use super::table::Table;
use crate::prelude::*;
use volcomp_effects::addition::{Addition, Evaluator, FORMAT};
use volcomp_effects::machine_state::{Axis, Field, Machine, MachineState, Source};
use volcomp_effects::prediction::{machine_of, workpiece_to_machine};

/// Additions bound to the columns of a table.
pub(super) struct Additions {
    evaluator: Evaluator,
    machine: Machine,
    fields: Vec<(usize, Field)>,
    /// Column and factor of each source, in the order of the evaluator.
    sources: Vec<(usize, f64)>,
    /// True where some effect depends on the length of the tool: then the column is of use beside any model.
    pub(super) takes_length: bool,
}

/// Reads an addition.
pub(crate) fn read_addition(path: &Path) -> Result<Addition> {
    let text = read_text(path, InputKind::Model)?;
    if text.trim_start().starts_with('{') {
        let what =
            format!("JSON, not {FORMAT} (TOML); a diagnosis writes addition.toml beside its report.json");
        return Err(Failure::mistake(path, what));
    }
    let format = volcomp_config::text_at(&text, &["format"]);
    if let Some(other) = format.filter(|f| f != FORMAT) {
        return Err(mistake!(
            path,
            "{other} file, not an addition ({FORMAT}); a diagnosis writes addition.toml into its --out folder"
        ));
    }
    Addition::parse(&text).map_err(|e| mistake!(path, "{e}"))
}

impl Additions {
    /// Reads the files; `None` without one.
    pub(super) fn read(
        paths: &[PathBuf],
        (spec, model, hash): (&ModelSpec, &Model, &str),
        table: &Table,
    ) -> Result<Option<Self>> {
        if paths.is_empty() {
            return Ok(None);
        }
        let mut all: Vec<Addition> = Vec::with_capacity(paths.len());
        for path in paths {
            let addition = read_addition(path)?;
            is_of(path, &addition, (model, hash))?;
            addition
                .require(&|column| table.find(column).is_some() || is_still(column, table))
                .map_err(|e| Failure::data(table.file(), e))?;
            all.push(addition);
        }
        let evaluator = Evaluator::new(&all);
        let source = |s: Source| {
            let factor = if s == Source::Spindle { 1e-3 } else { 1.0 };
            Ok((table.require(&s.to_string())?, factor))
        };
        let sources = evaluator.sources().into_iter().map(source).collect::<Result<_>>()?;
        let mut effects = all.iter().flat_map(Addition::machine_effects);
        let takes_length = effects.any(|e| e.columns().iter().any(|c| c == "tool_length_mm"));
        let machine = machine_of(spec, model);
        let known = MachineState::fields().into_iter();
        let fields = known.filter_map(|(name, field)| Some((table.find(&name)?, field))).collect();
        Ok(Some(Self { evaluator, machine, fields, sources, takes_length }))
    }

    /// What the additions say at the current row: deviation in W, mm.
    pub(super) fn next(&mut self, table: &Table, model: &Model) -> Result<Vec3> {
        let mut m = MachineState::default();
        for (column, field) in &self.fields {
            // an empty field is not known (docs/reference/session-files.md 1)
            if let Some(value) = table.number_if_known(*column)? {
                field(&mut m, value);
            }
        }
        m.head = self.machine.head(&m.position);
        let source = |(column, factor): &(usize, f64)| Ok(table.number(*column)? * factor);
        let sources = self.sources.iter().map(source).collect::<Result<Vec<_>>>()?;
        let machine = self.evaluator.next(&mut m, &sources);
        if machine.iter().any(|v| !v.is_finite())
            && let Some(lack) = self.evaluator.lacks(&m)
        {
            return Err(table.fail_row(lack));
        }
        Ok(workpiece_to_machine(model, &m).transpose() * machine.map(mm_from_um))
    }
}

/// An addition belongs to the machine beside whose model it was found; one that was found beside none may be looked at beside
/// any. Another model of the same machine, told by its hash, may hold it already: that is noted.
pub(super) fn is_of(path: &Path, addition: &Addition, (model, hash): (&Model, &str)) -> Result<()> {
    if addition.machine.is_empty() {
        return Ok(());
    }
    addition.is_of(model.machine()).map_err(|e| mistake!(path, "{e}"))?;
    if let Err(twice) = addition.is_beside(hash) {
        note!("note: {}: {twice}", path.display());
    }
    Ok(())
}

/// Positions of axes that the points lack are zero (`docs/reference/tables.md` 1).
fn is_still(column: &str, table: &Table) -> bool {
    Axis::ALL.iter().any(|a| a.column() == column) && table.find(column).is_none()
}
