//! The calibration of a 5-DOF laser from a log of the resting carriage.

use super::head_file::HeadFile;
use super::{Args, channel_columns, read_channels};
use crate::identify::prelude::*;
use volcomp_identify::fivedof::resting::{Calibration, Estimate, RestingReading, calibrate};
use volcomp_identify::fivedof::{Detector, lateral};

/// Calibrates the head of the file with a log, and writes it where wanted.
pub(super) fn calibrated(
    args: &Args,
    axis: AxisName,
    path: &Path,
    file: &mut HeadFile,
) -> Result<Calibration> {
    let mut table = table::open(path)?;
    let distance = table.column("distance_mm")?;
    let channels = channel_columns(&mut table, axis)?;
    let push = lateral(axis).map(|letter| table.find_column(&format!("push_{letter}_um")));
    table.find_column("t_s");
    table.only_known()?;
    let log = table.some_rows(|row| {
        Ok(RestingReading {
            push: [row.value_or(push[0], 0.0)?, row.value_or(push[1], 0.0)?],
            distance: row.value(distance)?,
            channels: read_channels(row, &channels)?,
        })
    })?;
    let calibration = calibrate(&file.head, &log).map_err(|e| Failure::data(path, e))?;
    file.head = calibration.head;
    let name = file_name(path);
    file.calibrated_from = Some(match input::hash(path, InputKind::Table) {
        Some(hash) => format!("{name}, blake3 {hash}"),
        None => name,
    });
    if let Some(out) = &args.write_calibration {
        continue_text(args.calibration.as_deref(), out, &file.text(Some(&calibration)))?;
        note!("calibration written: {}", out.display());
    }
    Ok(calibration)
}

pub(super) fn json_of(c: &Calibration) -> Value {
    let signs: Value =
        Detector::ALL.iter().zip(c.head.signs).map(|(d, s)| (d.name().to_owned(), json!(s))).collect();
    let mut json = json!({
        "signs": signs,
        "drift_arcsec": c.drift.map(|d| d.map(arcsec_from_rad)),
        "linearity_chi2": c.linearity.0,
        "linearity_dof": c.linearity.1,
        "distances_mm": c.distances,
    });
    let mut put = |name: &str, unit: &str, pair: &[Estimate; 2]| {
        json[format!("{name}{unit}")] = json!(pair.map(|e| e.value));
        json[format!("{name}_std{unit}")] = json!(pair.map(|e| e.std));
    };
    put("angle_gain", "", &c.angle_gain);
    for beam in 0..2 {
        put(&format!("gain_beam_{}", beam + 1), "", &c.gain[beam]);
        put(&format!("path_beam_{}", beam + 1), "_mm", &c.path[beam]);
    }
    json
}

pub(super) fn print(axis: AxisName, c: &Calibration) {
    let letters = lateral(axis);
    say!("resting carriage     drift rms       gain of d theta         path beyond d");
    for beam in 0..2 {
        for (i, letter) in letters.iter().enumerate() {
            let drift = arcsec_from_rad(c.drift[beam][i]);
            let (Estimate { value: g, std: gs }, Estimate { value: p, std: ps }) =
                (c.gain[beam][i], c.path[beam][i]);
            let beam = beam + 1;
            say!("beam {beam} {letter:<11}{drift:>7.2} arcsec{g:>12.4} +- {gs:<7.4}{p:>10.1} +- {ps:.1} mm");
        }
    }
    for (letter, k) in letters.iter().zip(c.angle_gain) {
        say!("psd1 {letter}: pointing enters with {:.4} +- {:.4} (nominal 1)", k.value, k.std);
    }
    let excluded = c.halved_gain_excluded();
    say!("the halved gain (d theta/2, as printed in paper 002) lies {excluded:.0} standard deviations away");
    for (d, [a, b]) in Detector::ALL.iter().zip(c.head.signs) {
        say!("signs of {:<5}{a:>3}{b:>3}", d.name());
    }
    for (_, letter) in c.pushed.iter().zip(letters).filter(|(pushed, _)| !**pushed) {
        note!(
            "note: signs of the quadrant detectors in {letter} are those of the instrument file; pushes of known size in the log would prove them"
        );
    }
    let ((chi2, dof), distances) = (c.linearity, c.distances.len());
    if dof > 0 {
        let verdict = if c.is_straight() { "straight" } else { "NOT straight" };
        say!(
            "over {distances} distances the gain is {verdict}: chi^2 {chi2:.1} with {dof} degrees of freedom"
        );
    }
}
