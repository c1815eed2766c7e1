//! What is put together: model files and tables of motions, each with its hash.

use super::Args;
use crate::files::read_model_file;
use crate::fit::input::{BySymbol, Direction, Format, read};
use crate::prelude::*;
use volcomp_identify::assemble::Source;
use volcomp_identify::curve::{self, Request};
use volcomp_model::spec::{ReferenceBody, ReferencePoint};

/// One input.
pub(super) struct Loaded {
    pub(super) source: Source,
    path: PathBuf,
    pub(super) hash: String,
    pub(super) is_table: bool,
    /// What the file says about itself.
    pub(super) file: Provenance,
    pub(super) of_errors: Vec<(ErrorSymbol, Provenance)>,
}

impl Loaded {
    /// True where the user means this input.
    pub(super) fn is_named(&self, name: &str) -> bool {
        self.path == Path::new(name) || self.source.name == name
    }

    /// Its name and hash.
    pub(super) fn entry(&self) -> SourceEntry {
        SourceEntry {
            source: Some(self.source.name.clone()),
            source_hash: Some(format!("blake3:{}", self.hash)),
            ..SourceEntry::default()
        }
    }

    /// Hashes of the data that the file says it was made from.
    fn made_from(&self) -> impl Iterator<Item = Option<&str>> {
        let all = core::iter::once(&self.file).chain(self.of_errors.iter().map(|(_, p)| p));
        let hashes = all
            .flat_map(|p| core::iter::once(&p.source_hash).chain(p.sources.iter().map(|s| &s.source_hash)));
        hashes.filter(|h| h.is_some()).map(Option::as_deref)
    }
}

/// `z=z-axis.csv`.
pub(super) fn motion(text: &str) -> Result<(AxisName, PathBuf), String> {
    let (axis, file) = text.split_once('=').ok_or("write axis and file, such as z=z-axis.csv")?;
    match axis_letter(axis) {
        Ok(axis) if !file.is_empty() => Ok((axis, PathBuf::from(file))),
        _ => Err(format!("invalid axis and file '{text}'; write for example z=z-axis.csv")),
    }
}

/// `z-axis.csv=400,250,-100`.
pub(super) fn place(text: &str) -> Result<(PathBuf, [f64; 3]), String> {
    let bad = || format!("invalid file and point '{text}'; write for example z-axis.csv=400,250,-100");
    let (file, point) = text.rsplit_once('=').ok_or_else(bad)?;
    numbers(point).map(|at| (PathBuf::from(file), at)).ok_or_else(bad)
}

/// Reads all inputs.
pub(super) fn load(args: &Args) -> Result<Vec<Loaded>> {
    if args.models.is_empty() && args.motion.is_empty() {
        return Err(Failure::usage("nothing to assemble; give model files, or --motion AXIS=FILE"));
    }
    let models = args.models.iter().map(|path| model(path, args.absolute.contains(path)));
    let mut out = models.collect::<Result<Vec<_>, _>>()?;
    if let Some(wanted) = args.absolute.iter().find(|p| !args.models.contains(p)) {
        return Err(usage!("--absolute {}: no such input", wanted.display()));
    }
    if let Some((missing, _)) =
        args.measured_at.iter().find(|(p, _)| !args.motion.iter().any(|(_, m)| m == p))
    {
        return Err(usage!("--measured-at {}: no such --motion", missing.display()));
    }
    let base = match (&args.base, out.first()) {
        (Some(path), _) => Some(read_model_file(path)?.spec),
        (None, Some(first)) => Some(first.source.spec.clone()),
        (None, None) => None,
    };
    for (axis, path) in &args.motion {
        let Some(base) = &base else {
            return Err(Failure::usage(
                "tables of motions do not say what machine they belong to; give --base or a model file",
            ));
        };
        let at = args.measured_at.iter().find(|(p, _)| p == path).map(|(_, at)| *at);
        out.push(table(*axis, path, at, base)?);
    }
    name_apart(&mut out);
    note_common_data(&out);
    Ok(out)
}

/// Files of one name in several folders are called by their paths.
fn name_apart(list: &mut [Loaded]) {
    let names: Vec<String> = list.iter().map(|l| l.source.name.clone()).collect();
    for l in list {
        if names.iter().filter(|n| **n == l.source.name).count() > 1 {
            l.source.name = l.path.display().to_string();
        }
    }
}

/// Says which inputs are not independent: one was made from the other, or both from the same data.
fn note_common_data(list: &[Loaded]) {
    for (i, a) in list.iter().enumerate() {
        for b in &list[..i] {
            for (whole, part) in [(a, b), (b, a)] {
                if whole.made_from().any(|h| h == part.entry().source_hash.as_deref()) {
                    let (whole, part) = (&whole.source.name, &part.source.name);
                    note!("note: {whole} was made from {part}; they are not independent");
                }
            }
            let common = a.made_from().flatten().find(|h| b.made_from().any(|other| other == Some(h)));
            if let Some(hash) = common {
                let (a, b) = (&a.source.name, &b.source.name);
                note!("note: {a} and {b} were both made from the data {hash}; they are not independent");
            }
        }
    }
}

fn model(path: &Path, absolute: bool) -> Result<Loaded> {
    let (file, hash) = read_hashed_model_file(path)?;
    Ok(Loaded {
        source: Source { name: file_name(path), spec: file.spec, absolute },
        path: path.to_owned(),
        hash,
        is_table: false,
        file: file.provenance,
        of_errors: file.of_errors,
    })
}

/// A table of motions, fitted as `volcomp fit` does by default, on the axis of the base.
fn table(axis: AxisName, path: &Path, at: Option<[f64; 3]>, base: &ModelSpec) -> Result<Loaded> {
    let Some(hash) = input::hash(path, InputKind::Table) else {
        // opening it says what is wrong with it, where something is
        input::open(path, InputKind::Table)?;
        return Err(Failure::data(path, "is read twice; name a regular file"));
    };
    if base.chain.index_of(axis).is_none() {
        let (letter, path, chain) = (axis.lower(), path.display(), &base.chain);
        return Err(usage!("--motion {letter}={path}: the chain {chain} has no such axis"));
    }
    let mut by_symbol = BySymbol::new();
    read(path, axis, Format::Auto, None, Direction::Both, &mut by_symbol)?;
    let mut entry = AxisSpec { travel: None, ..base.axis(axis) };
    if let Some([x, y, z]) = at {
        let point = ReferencePoint { point: Vec3::new(x, y, z), body: ReferenceBody::Carriage };
        entry.reference_points = [point; 3];
    }
    if base.is_mirrored(axis) {
        note!(
            "note: {}: axis {axis} of the base is in the carriage sense; the table is taken as the carriage's own motion over its own displacement",
            path.display()
        );
    }
    let mut spec = ModelSpec { errors: Vec::new(), axes: vec![entry], ..base.clone() };
    for (symbol, readings) in by_symbol {
        let fit = curve::fit(&readings.readings, &Request::default())
            .map_err(|e| data!(path, "{symbol}: {}", e.in_units_of(axis.kind())))?;
        let std = fit.standard_uncertainty();
        spec.errors.push((symbol, ErrorFunction { std, ..ErrorFunction::single(fit.curve) }));
    }
    Ok(Loaded {
        source: Source { name: file_name(path), spec, absolute: false },
        path: path.to_owned(),
        hash,
        is_table: true,
        file: Provenance::default(),
        of_errors: Vec::new(),
    })
}
