//! Units of parameters: each name ends in its own.

/// Ends of names, longest first, and the units as a person writes them.
const UNITS: [(&str, &str); 21] = [
    ("_um_per_m_per_s2_per_m", "µm per m/s² and m"),
    ("_arcsec_per_m_per_s2", "″ per m/s²"),
    ("_um_per_1000rpm_to_the_power", "µm per (1000 rpm)^p"),
    ("_um_per_n_to_the_power", "µm/N^p"),
    ("_um_per_m_per_s2", "µm per m/s²"),
    ("_um_per_1000rpm", "µm per 1000 rpm"),
    ("_ppm_per_k", "µm/(m K)"),
    ("_um_per_k", "µm/K"),
    ("_um_per_m", "µm/m"),
    ("_um_per_n", "µm/N"),
    ("_arcsec", "″"),
    ("_per_s", "1/s"),
    ("_degc", "°C"),
    ("_deg", "°"),
    ("_ppm", "µm/m"),
    ("_um", "µm"),
    ("_mm", "mm"),
    ("_ms", "ms"),
    ("_hz", "Hz"),
    ("_s", "s"),
    ("_1", ""),
];

/// Acceleration bends what has a first natural frequency f by 1/(2 pi f)^2; machine tools have theirs from 20 Hz on. As a turn it
/// is taken at a lever of one metre. µm per m/s^2.
const BEND_UM_PER_M_PER_S2: f64 = 63.0;
/// Prior standard deviations of coefficients that mechanics or the control bound: position loops follow within some 0.1 s
/// (velocity gains from 0.6 m/min per mm).
const PRIOR_SD: [(&str, f64); 4] = [
    ("_um_per_m_per_s2_per_m", BEND_UM_PER_M_PER_S2),
    ("_um_per_m_per_s2", BEND_UM_PER_M_PER_S2),
    ("_arcsec_per_m_per_s2", BEND_UM_PER_M_PER_S2 / crate::shape::UM_PER_ARCSEC_MM * 1e-3),
    ("lag_ms", 100.0),
];

/// Prior standard deviation of a parameter in its own unit; `None` where nothing bounds its size.
#[must_use]
pub fn prior_sd(name: &str) -> Option<f64> {
    PRIOR_SD.iter().find_map(|(end, sd)| name.ends_with(end).then_some(*sd))
}

/// Name of a parameter without its unit, and the unit; `None` for a name without one.
#[must_use]
pub fn unit_of(name: &str) -> Option<(&str, &'static str)> {
    UNITS.iter().find_map(|(end, unit)| Some((name.strip_suffix(end)?, *unit)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn acceleration_bends_and_turns_by_the_same_at_one_metre() {
        let bend = prior_sd("compliance_um_per_m_per_s2").unwrap();
        let first_hz = (1e6 / bend).sqrt() / core::f64::consts::TAU;
        assert!((first_hz - 20.0).abs() < 0.5, "{first_hz}");
        let turn = prior_sd("tilt_y_arcsec_per_m_per_s2").unwrap();
        assert!((turn * crate::shape::UM_PER_ARCSEC_MM * 1000.0 - bend).abs() < 1e-9);
        assert_eq!(prior_sd("width_um"), None);
    }
}
