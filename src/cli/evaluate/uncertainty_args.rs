//! What the user states about the uncertainty of a positioning measurement.

use crate::prelude::*;
use volcomp_evaluate::Conditions;

/// What is known about the measurement; gives expanded uncertainties (k = 2).
#[derive(Debug, Default, clap::Args)]
#[command(next_help_heading = "Uncertainty of the measurement (figures are given with k = 2)")]
pub(super) struct UncertaintyArgs {
    /// Expanded uncertainty (k = 2) of the instrument, as on its certificate.
    #[arg(long, value_name = "UM")]
    u_device_um: Option<f64>,
    /// Expanded uncertainty (k = 2) of the instrument on a rotary axis.
    #[arg(long, value_name = "ARCSEC", conflicts_with = "u_device_um")]
    u_device_arcsec: Option<f64>,
    /// Expanded uncertainty (k = 2) of the instrument that grows with length, um per metre.
    #[arg(long, value_name = "UM")]
    u_device_um_per_m: Option<f64>,
    /// Largest offset between beam and axis over the travel.
    #[arg(long, value_name = "MM")]
    misalignment_mm: Option<f64>,
    /// Expanded uncertainty (k = 2) of the material temperature; needs --expansion-um-per-m-degc.
    #[arg(long, value_name = "DEGC", requires = "expansion_um_per_m_degc")]
    u_temperature_degc: Option<f64>,
    /// Coefficient of thermal expansion of the scale, um/(m degC).
    #[arg(long, value_name = "ALPHA")]
    expansion_um_per_m_degc: Option<f64>,
    /// Expanded uncertainty (k = 2) of that coefficient, um/(m degC); needs --temperature-degc.
    #[arg(long, value_name = "ALPHA", requires = "temperature_degc")]
    u_expansion_um_per_m_degc: Option<f64>,
    /// Temperature of the material during the test.
    #[arg(long, value_name = "DEGC")]
    temperature_degc: Option<f64>,
    /// Range (largest minus smallest) of the reading of a resting axis over the time of the test.
    #[arg(long, value_name = "UM")]
    drift_um: Option<f64>,
    /// The same for a rotary axis, arcsec.
    #[arg(long, value_name = "ARCSEC", conflicts_with = "drift_um")]
    drift_arcsec: Option<f64>,
}

impl UncertaintyArgs {
    /// The conditions for an axis of this kind.
    pub(super) fn conditions(&self, kind: AxisKind) -> Result<Conditions> {
        let of_length = self.u_device_um_per_m.or(self.misalignment_mm);
        let of_length = of_length.or(self.u_temperature_degc).or(self.u_expansion_um_per_m_degc);
        let (device, drift, foreign, wanted) = match kind {
            AxisKind::Linear => {
                (self.u_device_um, self.drift_um, self.u_device_arcsec.or(self.drift_arcsec), "um")
            }
            AxisKind::Rotary => {
                let foreign = self.u_device_um.or(self.drift_um).or(of_length);
                (self.u_device_arcsec, self.drift_arcsec, foreign, "arcsec, for instrument and drift only")
            }
        };
        if foreign.is_some() {
            return Err(usage!("the unit of an uncertainty does not suit the test; give it in {wanted}"));
        }
        Ok(Conditions {
            device,
            device_per_m: self.u_device_um_per_m,
            misalignment_mm: self.misalignment_mm,
            temperature_degc: self.u_temperature_degc,
            expansion_um_per_m_degc: self.expansion_um_per_m_degc,
            expansion_uncertainty_um_per_m_degc: self.u_expansion_um_per_m_degc,
            from_20_degc: self.temperature_degc.map(|t| t - 20.0),
            drift,
        })
    }
}
