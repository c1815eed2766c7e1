//! The size of an effect as the quantity that a measurement states, by the keys and signs of the diagnosis.

use super::file::Effect;

/// What 1 um of an effect's size is in a quantity of metrology.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Quantity {
    /// Its key in the truth file, ending in its unit.
    pub key: &'static str,
    /// Its unit in text.
    pub unit: &'static str,
    /// Its name, with the symbol of the standard.
    pub name: &'static str,
    /// Quantity per um of size; the sign is the diagnosis'.
    pub per_um: f64,
}

/// Size of 1 um over 300 mm, arcsec.
const ANGLE: f64 = 1e-3 / 300.0 * 3600.0 * 180.0 / std::f64::consts::PI;

impl Quantity {
    /// The quantity of an effect, where its size is one.
    #[must_use]
    pub fn of(name: &str, subject: &str) -> Option<Self> {
        let (key, unit, name, per_um) = match (name, subject) {
            ("backlash", _) => ("width-um", "µm", "width, the reversal error B of ISO 230-2", 2.0),
            // d_x = angle y, so against the rotation of Y about Z
            ("squareness", "xy") => ("angle-arcsec", "″", "angle, -EC0Y of ISO 230-1", -ANGLE),
            ("squareness", "yz") => ("angle-arcsec", "″", "angle, -EA0Z of ISO 230-1", -ANGLE),
            ("squareness", "zx") => ("angle-arcsec", "″", "angle, EB0Z of ISO 230-1", ANGLE),
            _ => return None,
        };
        Some(Self { key, unit, name, per_um })
    }

    /// An effect of a truth file in its quantity, else its size: one line.
    #[must_use]
    pub fn line(e: &Effect) -> String {
        let (value, unit, name) = Self::of(&e.name, &e.subject)
            .map_or((e.size_um, "µm", "typical size over the volume"), |q| {
                (q.per_um * e.size_um, q.unit, q.name)
            });
        format!("{:<18} {value:>8.2} {unit:<2} {name}", e.label())
    }
}

#[cfg(test)]
mod tests {
    use super::super::file::TwinTruth;
    use super::*;

    fn read(keys: &str) -> Result<f64, String> {
        let text = format!("format = \"volcomp-twin/1\"\n[[effect]]\n{keys}\n");
        TwinTruth::read(&text).map(|t| t.effects[0].size_um).map_err(|e| e.to_string())
    }

    #[test]
    fn a_size_is_given_once_in_um_or_in_its_quantity() {
        let squareness = "name = \"squareness\"\nsubject = \"xy\"";
        let backlash = "name = \"backlash\"\nsubject = \"x\"";
        assert_eq!(read(&format!("{backlash}\nsize-um = 6.0")), Ok(6.0));
        assert_eq!(read(&format!("{backlash}\nwidth-um = 12.0")), Ok(6.0));
        let size = read(&format!("{squareness}\nangle-arcsec = -5.5")).unwrap();
        assert!((size - 8.0).abs() < 0.01, "{size}");
        for wrong in [
            backlash.to_owned(),
            format!("{backlash}\nwidth-um = 12.0\nsize-um = 6.0"),
            format!("{backlash}\nangle-arcsec = 1.0"),
        ] {
            let message = read(&wrong).unwrap_err();
            assert!(message.contains("size once, as size-um, or width-um"), "{message}");
        }
        assert_eq!(
            Quantity::line(&Effect::new("backlash", "x", 6.0)),
            "backlash:x            12.00 µm width, the reversal error B of ISO 230-2"
        );
    }
}
