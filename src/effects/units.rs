//! Units of parameters: each name ends in its own.

/// Ends of names, longest first, and the units as a person writes them.
const UNITS: [(&str, &str); 18] = [
    ("_um_per_m_per_s2_per_m", "µm per m/s² and m"),
    ("_arcsec_per_m_per_s2", "″ per m/s²"),
    ("_um_per_n_to_the_power", "µm/N^p"),
    ("_um_per_m_per_s2", "µm per m/s²"),
    ("_um_per_1000rpm", "µm per 1000 rpm"),
    ("_ppm_per_k", "µm/(m K)"),
    ("_um_per_k", "µm/K"),
    ("_um_per_m", "µm/m"),
    ("_um_per_n", "µm/N"),
    ("_arcsec", "″"),
    ("_degc", "°C"),
    ("_ppm", "µm/m"),
    ("_um", "µm"),
    ("_mm", "mm"),
    ("_ms", "ms"),
    ("_hz", "Hz"),
    ("_s", "s"),
    ("_1", ""),
];

/// Name of a parameter without its unit, and the unit; `None` for a name without one.
#[must_use]
pub fn unit_of(name: &str) -> Option<(&str, &'static str)> {
    UNITS.iter().find_map(|(end, unit)| Some((name.strip_suffix(end)?, *unit)))
}
