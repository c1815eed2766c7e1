//! The instrument as a file, `volcomp-fivedof/1` (TOML): optics as built, signs and gains as calibrated.

use crate::prelude::*;
use volcomp_identify::fivedof::resting::{Calibration, Estimate};
use volcomp_identify::fivedof::{Channels, Detector, Head};

/// The `format` of an instrument file.
const FORMAT: &str = "volcomp-fivedof/1";

#[derive(Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
struct FileWire {
    format: String,
    instrument: Option<String>,
    focal_mm: FocalWire,
    beam_1_mm: [f64; 2],
    beam_2_mm: [f64; 2],
    #[serde(default)]
    signs: PairsWire,
    #[serde(default)]
    drift: Option<DriftWire>,
    #[serde(default)]
    noise_um: PairsWire,
    #[serde(default)]
    calibrated_from: Option<String>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct FocalWire {
    psd1: f64,
    psd2: f64,
    psd3: f64,
}

#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields)]
struct PairsWire {
    psd1: Option<[f64; 2]>,
    psd2: Option<[f64; 2]>,
    psd3: Option<[f64; 2]>,
    qd1: Option<[f64; 2]>,
    qd2: Option<[f64; 2]>,
}

impl PairsWire {
    fn or(self, default: f64) -> Channels {
        [self.psd1, self.psd2, self.psd3, self.qd1, self.qd2].map(|p| p.unwrap_or([default; 2]))
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
struct DriftWire {
    angle_gain: [f64; 2],
    gain_beam_1: [f64; 2],
    gain_beam_2: [f64; 2],
    path_beam_1_mm: [f64; 2],
    path_beam_2_mm: [f64; 2],
}

/// An instrument file.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct HeadFile {
    pub(super) instrument: Option<String>,
    pub(super) head: Head,
    /// The resting log behind signs and gains.
    pub(super) calibrated_from: Option<String>,
}

impl HeadFile {
    pub(super) fn read(path: &Path) -> Result<Self> {
        Self::parse(path, &input::read_text(path, InputKind::Description)?)
    }

    fn parse(path: &Path, text: &str) -> Result<Self> {
        let wire: FileWire = from_toml(path, text)?;
        if wire.format != FORMAT {
            return Err(mistake!(path, "format is \"{}\", expected \"{FORMAT}\"", wire.format));
        }
        let focal = [wire.focal_mm.psd1, wire.focal_mm.psd2, wire.focal_mm.psd3];
        let mut head =
            Head::nominal(focal, [wire.beam_1_mm, wire.beam_2_mm]).map_err(|e| mistake!(path, "{e}"))?;
        head.signs = wire.signs.or(1.0);
        head.noise = wire.noise_um.or(0.0).map(|pair| pair.map(mm_from_um));
        if let Some(d) = wire.drift {
            head.angle_gain = d.angle_gain;
            head.gain = [d.gain_beam_1, d.gain_beam_2];
            head.path = [d.path_beam_1_mm, d.path_beam_2_mm];
        }
        head.check().map_err(|e| mistake!(path, "{e}"))?;
        Ok(Self { instrument: wire.instrument, head, calibrated_from: wire.calibrated_from })
    }

    /// The file; with a calibration its uncertainties stand behind the numbers.
    pub(super) fn text(&self, calibration: Option<&Calibration>) -> String {
        let h = &self.head;
        let mut text = format!("format = \"{FORMAT}\"\n");
        if let Some(instrument) = &self.instrument {
            text.push_str(&format!("instrument = {instrument:?}\n"));
        }
        if let Some(from) = &self.calibrated_from {
            text.push_str(&format!("calibrated-from = {from:?}\n"));
        }
        let [f1, f2, f3] = h.focal;
        text.push_str(&format!("focal-mm = {{ psd1 = {f1}, psd2 = {f2}, psd3 = {f3} }}\n"));
        for (name, [y, z]) in ["beam-1-mm", "beam-2-mm"].iter().zip(h.beams) {
            text.push_str(&format!("{name} = [{y}, {z}]\n"));
        }
        text.push_str("\n[signs]\n");
        for (d, [y, z]) in Detector::ALL.into_iter().zip(h.signs) {
            text.push_str(&format!("{} = [{y}, {z}]\n", d.name()));
        }
        text.push_str("\n[drift]\n");
        let comment = |e: Option<[Estimate; 2]>| {
            e.map_or_else(String::new, |[a, b]| format!("   # +- {:.4}, {:.4} (k = 1)", a.std, b.std))
        };
        let mut line = |name: &str, [a, b]: [f64; 2], e: Option<[Estimate; 2]>| {
            text.push_str(&format!("{name} = [{a:.6}, {b:.6}]{}\n", comment(e)));
        };
        line("angle-gain", h.angle_gain, calibration.map(|c| c.angle_gain));
        for beam in 0..2 {
            line(&format!("gain-beam-{}", beam + 1), h.gain[beam], calibration.map(|c| c.gain[beam]));
        }
        for beam in 0..2 {
            line(&format!("path-beam-{}-mm", beam + 1), h.path[beam], calibration.map(|c| c.path[beam]));
        }
        if h.noise.as_flattened().iter().any(|v| *v > 0.0) {
            text.push_str("\n[noise-um]\n");
            for (d, pair) in Detector::ALL.into_iter().zip(h.noise) {
                let [y, z] = pair.map(um_from_mm);
                text.push_str(&format!("{} = [{y:.5}, {z:.5}]\n", d.name()));
            }
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::EX_CONFIG;

    const BARE: &str = "format = \"volcomp-fivedof/1\"\nfocal-mm = { psd1 = 230, psd2 = 250, psd3 = 210 }\n\
        beam-1-mm = [-35, 8]\nbeam-2-mm = [33.5, 8]\n";

    fn parse(text: &str) -> Result<HeadFile, String> {
        HeadFile::parse(Path::new("h.toml"), text).map_err(|f| {
            assert_eq!(f.code, EX_CONFIG);
            f.message
        })
    }

    #[test]
    fn a_file_reads_back() {
        let mut file = parse(BARE).unwrap();
        assert_eq!(file.head.gain, [[1.0; 2]; 2]);
        file.head.signs[2] = [-1.0, 1.0];
        file.head.path = [[120.5, 119.0], [0.0, -3.25]];
        file.head.noise = [[0.25e-3; 2]; 5];
        file.instrument = Some("no \"7\"".into());
        file.calibrated_from = Some("rest.csv".into());
        let back = parse(&file.text(None)).unwrap();
        assert_eq!((back.head.signs, back.head.path), (file.head.signs, file.head.path));
        assert_eq!((&back.instrument, &back.calibrated_from), (&file.instrument, &file.calibrated_from));
        assert!((back.head.noise[4][1] - 0.25e-3).abs() < 1e-12);
    }

    #[test]
    fn mistakes_are_named() {
        for (from, to, message) in [
            ("fivedof/1", "fivedof/2", "expected \"volcomp-fivedof/1\""),
            ("psd2 = 250", "psd2 = -250", "focal length of psd2 is -250 mm"),
            ("[33.5, 8]", "[-35, 8]", "the beams are 0.000 mm apart"),
            ("beam-1-mm", "beam-one-mm", "unknown field"),
        ] {
            let error = parse(&BARE.replace(from, to)).unwrap_err();
            assert!(error.contains(message), "{error}");
        }
        let error = parse(&format!("{BARE}[signs]\nqd1 = [1, 2]\n")).unwrap_err();
        assert!(error.contains("sign of qd1 is 2; write 1 or -1"), "{error}");
    }
}
