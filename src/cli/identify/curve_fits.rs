//! Curves through readings into a model: fits, notes, comments and the table of the fits, whatever measured.

use crate::fit::basis::Auto;
use crate::fit::report::{Fitted, print_notes, table};
use crate::prelude::*;
use volcomp_identify::curve::{self, Basis, CurveFit, Request};

/// Curves of a model, and what they were fitted to.
pub(super) struct CurveFits<'a> {
    pub(super) model: ModelFile,
    pub(super) fitted: Vec<Fitted>,
    pub(super) sources: Sources,
    files: &'a [PathBuf],
}

impl<'a> CurveFits<'a> {
    pub(super) fn new(model: ModelFile, files: &'a [PathBuf]) -> Self {
        Self { model, fitted: Vec::new(), sources: Sources::of(files), files }
    }

    /// Fits an error and puts it into the model; `std` gives the standard uncertainty (k = 1) of the curve.
    pub(super) fn add(
        &mut self,
        symbol: ErrorSymbol,
        readings: Vec<Reading>,
        basis: Auto<Basis>,
        std: impl FnOnce(&CurveFit) -> Option<f64>,
        from: Provenance,
    ) -> Result<()> {
        let fit = curve::fit(&readings, &Request { basis, ..Request::default() })
            .map_err(|e| data_error(self.files, format_args!("{symbol}: {e}")))?;
        let function = ErrorFunction { std: std(&fit), ..ErrorFunction::single(fit.curve.clone()) };
        self.model.put(symbol, function, from);
        self.fitted.push(Fitted::new(symbol, readings.into(), fit));
        Ok(())
    }

    /// Writes the model; returns the table of the fits.
    pub(super) fn write(&self, writer: &ModelWriter, comment: &[String]) -> Result<String> {
        print_notes(&self.fitted);
        writer.write(&self.model, comment, self.files)?;
        Ok(table(&self.fitted))
    }
}
