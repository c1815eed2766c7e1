//! Names of the parameters; each ends in its unit.

use super::shape::Shape;
use crate::machine_state::{Signal, Source};

fn per(source: &Source) -> &'static str {
    match source {
        Source::Spindle => "um_per_1000rpm",
        Source::Temperature(_) => "um_per_k",
    }
}

fn seconds(signal: &Signal) -> String {
    if signal.tau_s > 0.0 { format!("_after_{:.0}s", signal.tau_s) } else { String::new() }
}

impl Shape {
    /// The name of each parameter.
    #[must_use]
    pub fn parameters(&self) -> Vec<String> {
        let plain = |names: &[&str]| names.iter().map(|n| (*n).to_owned()).collect::<Vec<_>>();
        match self {
            Self::Squareness { .. } => plain(&["angle_arcsec"]),
            Self::Scale { .. } => plain(&["scale_ppm"]),
            Self::Polynomial { low, high, .. } => (*low..=*high).map(|k| format!("p{k}_um")).collect(),
            Self::Reverse { high, reverse, .. } => (2..=*high)
                .map(|k| format!("p{k}_um"))
                .chain((0..=*reverse).map(|k| format!("reversal_p{k}_um")))
                .collect(),
            Self::Angular { degree, .. } => (1..=*degree).map(|k| format!("e{k}_arcsec")).collect(),
            Self::Thermal { with_offset: false, .. } => plain(&["expansion_ppm_per_k"]),
            Self::Thermal { .. } => plain(&["expansion_ppm_per_k", "shift_um_per_k"]),
            Self::Growth { signals, along, .. } => signals
                .iter()
                .flat_map(|s| {
                    along.iter().map(move |a| format!("growth_{a}{}_{}", seconds(s), per(&s.source)))
                })
                .collect(),
            Self::Backlash { along, slope, .. } => {
                let mut names = Vec::new();
                for a in along {
                    let stem = if along.len() > 1 { format!("width_{a}") } else { "width".to_owned() };
                    names.push(format!("{stem}_um"));
                    if *slope {
                        names.push(format!("{stem}_slope_um_per_m"));
                    }
                }
                names
            }
            Self::Spike { slope: false, .. } => plain(&["height_um"]),
            Self::Spike { .. } => plain(&["height_um", "height_slope_um_per_m"]),
            Self::Cyclic { harmonics, .. } => {
                (1..=*harmonics).flat_map(|n| [format!("cos{n}_um"), format!("sin{n}_um")]).collect()
            }
            Self::Lag { .. } => plain(&["lag_ms"]),
            Self::Friction { .. } => plain(&["friction_um"]),
            Self::Inertial { slope: false, .. } => plain(&["compliance_um_per_m_per_s2"]),
            Self::Inertial { .. } => {
                plain(&["compliance_um_per_m_per_s2", "compliance_slope_um_per_m_per_s2_per_m"])
            }
            Self::InertialTilt { about, .. } => {
                about.iter().map(|b| format!("tilt_{b}_arcsec_per_m_per_s2")).collect()
            }
            Self::Sag { tool: false, .. } => plain(&["sag_um"]),
            Self::Sag { .. } => plain(&["sag_um", "tip_slope_um"]),
            Self::Ram { moment: false, .. } => plain(&["sag_of_end_weight_um", "sag_of_own_weight_um"]),
            Self::Ram { .. } => {
                plain(&["sag_of_end_weight_um", "sag_of_own_weight_um", "sag_of_end_moment_um"])
            }
            Self::SpindleTilt => plain(&["tilt_x_arcsec", "tilt_y_arcsec"]),
            Self::ToolLength => plain(&["tool_length_ppm"]),
            Self::DeadPath { .. } => plain(&["refraction_ppm_per_k", "dead_path_um_per_k"]),
            Self::TrackerScale { signal: None, zero: false } => plain(&["range_scale_ppm"]),
            Self::TrackerScale { signal: None, .. } => plain(&["range_scale_ppm", "range_zero_um"]),
            Self::TrackerScale { .. } => plain(&["range_scale_ppm_per_k"]),
            Self::ClockSkew { files, drift, .. } => files
                .iter()
                .flat_map(|f| {
                    let mut names = vec![format!("delay_{}_ms", f + 1)];
                    if *drift {
                        names.push(format!("delay_gain_{}_ms", f + 1));
                    }
                    names
                })
                .collect(),
            Self::Wear { .. } => plain(&["height_um"]),
            Self::Step { .. } => plain(&["step_x_um", "step_y_um", "step_z_um"]),
            Self::Load { power, .. } if (*power - 1.0).abs() < 1e-12 => plain(&["compliance_um_per_n"]),
            Self::Load { .. } => plain(&["compliance_um_per_n_to_the_power"]),
            Self::RotaryLocation { .. }
            | Self::RotaryMotion { .. }
            | Self::RotaryEccentricity { .. }
            | Self::RotaryBacklash { .. }
            | Self::RotaryLag { .. }
            | Self::RotaryScale { .. } => self.rotary_parameters(),
        }
    }

    fn rotary_parameters(&self) -> Vec<String> {
        const LETTERS: [&str; 3] = ["x", "y", "z"];
        match self {
            Self::RotaryLocation { frame, .. } => {
                let a = frame.axis.direction();
                let (b, c) = (LETTERS[(a + 1) % 3], LETTERS[(a + 2) % 3]);
                let all = [
                    format!("shift_{b}_um"),
                    format!("shift_{c}_um"),
                    format!("tilt_{b}_arcsec"),
                    format!("tilt_{c}_arcsec"),
                ];
                all[4 - self.width()..].to_vec()
            }
            Self::RotaryMotion { along, low, high, .. } => along
                .iter()
                .flat_map(|a| {
                    (*low..=*high).flat_map(move |n| [format!("cos{n}_{a}_um"), format!("sin{n}_{a}_um")])
                })
                .collect(),
            Self::RotaryEccentricity { harmonics, .. } => (1..=*harmonics)
                .map(|n| if n == 1 { String::new() } else { n.to_string() })
                .flat_map(|n| [format!("cos{n}_arcsec"), format!("sin{n}_arcsec")])
                .collect(),
            Self::RotaryLag { .. } => vec!["lag_ms".to_owned()],
            Self::RotaryScale { .. } => vec!["scale_ppm".to_owned()],
            _ => vec!["width_arcsec".to_owned()],
        }
    }

    /// The non-linear parameters, for a person to read.
    #[must_use]
    pub fn fixed(&self) -> Vec<(String, f64)> {
        let one = |name: &str, v: f64| vec![(name.to_owned(), v)];
        let tau = |s: &Signal| if s.tau_s > 0.0 { one("time_constant_s", s.tau_s) } else { Vec::new() };
        match self {
            Self::Thermal { signal, reference_degc, .. } => {
                let mut fixed = one("reference_degc", *reference_degc);
                fixed.extend(tau(signal));
                fixed
            }
            Self::Growth { signals, .. } => signals
                .iter()
                .enumerate()
                .filter(|(_, s)| s.tau_s > 0.0)
                .map(|(i, s)| (format!("time_constant_{}_s", i + 1), s.tau_s))
                .collect(),
            Self::Backlash { length_mm, .. } if *length_mm > 0.0 => one("transition_length_mm", *length_mm),
            Self::Spike { rise_s, fall_s, .. } => {
                vec![("rise_time_s".to_owned(), *rise_s), ("fall_time_s".to_owned(), *fall_s)]
            }
            Self::Cyclic { pitch_mm, .. } => one("pitch_mm", *pitch_mm),
            Self::Lag { tie_ms, .. } if *tie_ms > 0.0 => one("filter_ms", *tie_ms),
            Self::Sag { length_mm, start_mm, .. } => {
                vec![("length_mm".to_owned(), *length_mm), ("start_mm".to_owned(), *start_mm)]
            }
            Self::Wear { centre_mm, width_mm, power, order, .. } => {
                [("centre_mm", Some(centre_mm)), ("width_mm", Some(width_mm)), ("exponent_1", Some(power))]
                    .into_iter()
                    .chain([("order_1", order.as_ref())])
                    .filter_map(|(name, v)| Some((name.to_owned(), *v?)))
                    .collect()
            }
            Self::Load { power, .. } => one("exponent_1", *power),
            Self::Step { after_s, .. } => one("after_s", *after_s),
            _ => Vec::new(),
        }
    }
}
