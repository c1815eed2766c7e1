//! What the measurements of one axis share: machine, axis, positions, files.

use std::path::{Path, PathBuf};

use crate::cli::serve::built_in_or_file;
use crate::cli::{EX_IOERR, EX_USAGE, Failure};
use crate::instruments::{Stop, there_and_back};
use crate::truth::TruthMachine;
use volcomp_units::axes::{AxisKind, AxisName};

/// A linear axis, its stops and where the files go.
#[derive(Debug, clap::Args)]
pub(super) struct AxisPlan {
    /// The machine: a truth file, or one of the built-in vmc-850, gantry-5ax, grinder-ab.
    #[arg(long, value_name = "FILE", default_value = "vmc-850")]
    pub(super) machine: PathBuf,
    /// The axis that moves.
    #[arg(long, value_name = "LETTER", default_value = "x")]
    pub(super) axis: String,
    /// Stops over the travel, ends included.
    #[arg(long, default_value = "21", value_parser = clap::value_parser!(u32).range(2..=10_000))]
    pub(super) stops: u32,
    /// Runs; each goes there and back.
    #[arg(long, default_value = "3", value_parser = clap::value_parser!(u32).range(1..=1000))]
    pub(super) runs: u32,
    /// Seed of the noise.
    #[arg(long, default_value = "1")]
    pub(super) seed: u64,
    /// Folder for the files; made where it is missing.
    #[arg(long, value_name = "DIR", default_value = ".")]
    pub(super) out: PathBuf,
}

impl AxisPlan {
    /// The machine, the axis and its wire index.
    pub(super) fn open(&self) -> Result<(TruthMachine, AxisName, usize), Failure> {
        let machine = built_in_or_file(&self.machine)?;
        let mut letters = self.axis.chars();
        let axis = letters
            .next()
            .filter(|_| letters.next().is_none())
            .and_then(AxisName::from_letter)
            .filter(|a| a.kind() == AxisKind::Linear)
            .ok_or_else(|| Failure::new(EX_USAGE, format_args!("invalid linear axis '{}'", self.axis)))?;
        let k = machine.index_of(axis).ok_or_else(|| {
            Failure::new(EX_USAGE, format_args!("machine {} has no axis {axis}", machine.machine()))
        })?;
        Ok((machine, axis, k))
    }

    /// There and back, run by run.
    pub(super) fn stops(&self, travel: [f64; 2]) -> Vec<Stop> {
        let [low, high] = travel;
        let step = (high - low) / f64::from(self.stops - 1);
        // whole micrometres, as a program would have them
        let positions: Vec<f64> =
            (0..self.stops).map(|i| ((low + step * f64::from(i)) * 1e3).round() / 1e3).collect();
        there_and_back(&positions, self.runs)
    }

    /// Writes a file into the folder.
    pub(super) fn write(&self, name: &str, text: &str) -> Result<(), Failure> {
        write(&self.out, name, text)
    }

    /// `--out` for a printed command line.
    pub(super) fn file(&self, name: &str) -> String {
        self.out.join(name).display().to_string()
    }
}

/// Writes a file into a folder, which is made where it is missing.
pub(super) fn write(folder: &Path, name: &str, text: &str) -> Result<(), Failure> {
    crate::cli::make_folder(folder).map_err(|e| Failure::in_file(EX_IOERR, folder, e))?;
    let path = folder.join(name);
    crate::cli::write_file(&path, text).map_err(|e| Failure::in_file(EX_IOERR, &path, e))?;
    note!("written: {}", path.display());
    Ok(())
}

pub(super) fn not_negative(text: &str) -> Result<f64, String> {
    match text.trim().parse::<f64>() {
        Ok(v) if v.is_finite() && v >= 0.0 => Ok(v),
        _ => Err("must be a finite number from 0 up".to_owned()),
    }
}
