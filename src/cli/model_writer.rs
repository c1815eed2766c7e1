//! Writer of the model file of `fit` and `identify`: a new one, or an existing one with some errors replaced.

use super::targets;
use crate::prelude::*;

/// Where the model goes and what it starts from.
#[derive(Debug, clap::Args)]
pub(super) struct ModelWriter {
    /// The model file to write; without it the file of --into is replaced. - is stdout.
    #[arg(long, value_name = "FILE")]
    pub(super) out: Option<PathBuf>,
    /// An existing model file to start from; the errors found here replace those in it.
    #[arg(long, value_name = "FILE")]
    pub(super) into: Option<PathBuf>,
    /// Machine id of the model.
    #[arg(long, value_name = "ID")]
    pub(super) machine: Option<String>,
    /// Kinematic chain of the model, such as "[w X' b Y Z t]".
    #[arg(long, conflicts_with = "into")]
    pub(super) chain: Option<String>,
}

impl ModelWriter {
    /// The file to write, where one is wanted.
    pub(super) fn target(&self) -> Option<&Path> {
        self.out.as_deref().or(self.into.as_deref())
    }

    /// True where the model goes to stdout, which then belongs to it.
    pub(super) fn takes_stdout(&self) -> bool {
        self.target().is_some_and(|p| p.as_os_str() == "-")
    }

    /// Reads --into and looks at the target before any work is done.
    pub(super) fn check(&self) -> Result<Option<ModelFile>> {
        self.target().map_or(Ok(()), targets::check_model)?;
        self.into.as_ref().map(|path| read_model_file(path)).transpose()
    }

    /// The model before anything was found: that of --into with its provenance, or an empty one with the chain of
    /// --chain, else `default_chain`.
    pub(super) fn base(&self, default_chain: impl FnOnce() -> String) -> Result<ModelFile> {
        let mut file = match &self.into {
            Some(path) => read_model_file(path)?,
            None => {
                let text = self.chain.clone().unwrap_or_else(|| {
                    let chain = default_chain();
                    note!("note: no --chain given, {chain} written; lever arms depend on it");
                    chain
                });
                let chain = Chain::parse(&text).map_err(|e| usage!("--chain \"{text}\": {e}"))?;
                ModelFile::new(ModelSpec::new("unnamed", chain))
            }
        };
        self.name(&mut file);
        Ok(file)
    }

    /// The same without --into and --chain, where another model tells the chain.
    pub(super) fn base_with(&self, chain: Chain) -> ModelFile {
        let mut file = ModelFile::new(ModelSpec::new("unnamed", chain));
        self.name(&mut file);
        file
    }

    fn name(&self, file: &mut ModelFile) {
        if let Some(machine) = &self.machine {
            file.spec.machine.clone_from(machine);
        }
    }

    /// Checks the model and writes it to [`target`](Self::target); `comment` says where it came from, `files` are named in
    /// errors. Names the points of rotary axes that nobody stated.
    pub(super) fn write(&self, model: &ModelFile, comment: &[String], files: &[PathBuf]) -> Result<()> {
        // an axis of the model before has the point that was written there
        let before = self.into.as_ref().map(|path| read_model_file(path)).transpose()?;
        self.write_from(before.as_ref().map(|file| &file.spec), model, comment, files)
    }

    /// The same, where `before` is the model in which the user stated the geometry.
    pub(super) fn write_from(
        &self,
        before: Option<&ModelSpec>,
        model: &ModelFile,
        comment: &[String],
        files: &[PathBuf],
    ) -> Result<()> {
        Model::new(&model.spec).map_err(|e| data_error(files, e))?;
        let out = self.target().ok_or_else(|| usage!("neither --out nor --into is given"))?;
        warn_of_axis_points(before, &model.spec, out);
        write_model(out, &config::model::write_file(model, comment))?;
        note!("model written: {}", out.display());
        Ok(())
    }
}

/// Says that the place of a rotary axis is not known where nobody stated it.
fn warn_of_axis_points(before: Option<&ModelSpec>, spec: &ModelSpec, out: &Path) {
    let rotary = spec.chain.axes().iter().filter(|a| a.kind() == AxisKind::Rotary && !a.spindle);
    for name in rotary.map(|a| a.name) {
        let has_entry = |spec: &ModelSpec| spec.axes.iter().any(|a| a.name == name);
        let is_used = has_entry(spec) || spec.errors.iter().any(|(s, _)| s.axis() == name);
        if !is_used || spec.axis(name).point != Vec3::zeros() || before.is_some_and(has_entry) {
            continue;
        }
        let letter = name.lower();
        note!(
            "note: {}: [axes.{letter}] point-mm = [0, 0, 0] is an assumption: set it to a point on axis {name} (M at home); each 100 mm \
             beside the axis cost 0.48 um per arcsec of ea{letter}, eb{letter}, ec{letter}",
            out.display()
        );
    }
}

/// Bad data in one of several files.
pub(super) fn data_error(files: &[PathBuf], what: impl core::fmt::Display) -> Failure {
    let names = files.iter().map(|p| p.display()).joined(", ");
    failure!(EX_DATAERR, "{names}: {what}")
}

/// Three linear axes on the tool side, and whatever else was measured behind them.
pub(super) fn default_chain(measured: impl IntoIterator<Item = AxisName>) -> String {
    let mut axes = vec![AxisName::X, AxisName::Y, AxisName::Z];
    for axis in measured {
        if !axes.contains(&axis) {
            axes.push(axis);
        }
    }
    // the spindle is the last axis and stands in parentheses
    axes.sort_by_key(|a| *a == AxisName::S);
    let words =
        axes.iter().map(|a| if *a == AxisName::S { "(S)".to_owned() } else { a.to_string() }).joined(" ");
    format!("[w b {words} t]")
}

/// The data that errors are made from: names and hashes of the contents.
#[derive(Debug, Clone)]
pub(super) struct Sources(Vec<SourceEntry>);

impl Sources {
    /// Reads what the hashes need.
    pub(super) fn of(files: &[PathBuf]) -> Self {
        let entry = |path: &PathBuf| {
            // stdin cannot be read twice
            let hash = input::hash(path, InputKind::Stream).map(|hash| format!("blake3:{hash}"));
            SourceEntry { source: Some(file_name(path)), source_hash: hash, ..SourceEntry::default() }
        };
        Self(files.iter().map(entry).collect())
    }

    /// Those of the files that `keep` accepts by their place in the list.
    pub(super) fn only(&self, keep: impl Fn(usize) -> bool) -> Self {
        Self(self.0.iter().enumerate().filter(|(i, _)| keep(*i)).map(|(_, s)| s.clone()).collect())
    }

    /// The comment of a model: what wrote it, and one line per file.
    pub(super) fn heading(&self, command: &str) -> Vec<String> {
        let first = format!("written by volcomp {command} {}", env!("CARGO_PKG_VERSION"));
        [vec![first], self.comments()].concat()
    }

    /// One comment line per file.
    pub(super) fn comments(&self) -> Vec<String> {
        let line = |s: &SourceEntry| {
            let name = s.source.as_deref().unwrap_or("-");
            match s.source_hash.as_deref().and_then(|h| h.strip_prefix("blake3:")) {
                Some(hash) => format!("from {name}, blake3 {hash}"),
                None => format!("from {name}"),
            }
        };
        self.0.iter().map(line).collect()
    }

    /// What the model file says about an error made from them.
    pub(super) fn provenance(&self) -> Provenance {
        match &self.0[..] {
            [one] => Provenance {
                source: one.source.clone(),
                source_hash: one.source_hash.clone(),
                ..Provenance::default()
            },
            several => Provenance { sources: several.to_vec(), ..Provenance::default() },
        }
    }
}
