//! A machine for a seed: a shipped truth with other sizes, signs and phases of its errors.

use anyhow::Context;

use crate::truth::TruthMachine;
use crate::twin::Dice;

/// The truth of a shipped file with every error size scaled by 0.6 to 1.4 and of either sign, other phases, and another
/// random waviness. The same seed gives the same machine.
///
/// # Errors
/// The text is no truth file.
pub fn varied(text: &str, seed: u64) -> anyhow::Result<TruthMachine> {
    Ok(TruthMachine::from_toml(&varied_text(text, seed, |_, _| {})?)?)
}

/// The same as text, after `change` has had the table.
///
/// # Errors
/// The text is no TOML.
pub fn varied_text(
    text: &str,
    seed: u64,
    change: impl FnOnce(&mut toml::Table, &mut Dice),
) -> anyhow::Result<String> {
    let mut file: toml::Table = text.parse().context("truth file")?;
    let mut dice = Dice::new(seed, "machine of a paper");
    for section in ["squareness", "location", "errors"] {
        if let Some(value) = file.get_mut(section) {
            vary(value, &mut dice);
        }
    }
    file.insert("seed".into(), toml::Value::Integer((seed % (1 << 62)) as i64));
    change(&mut file, &mut dice);
    Ok(toml::to_string(&file)?)
}

/// Scales sizes, which are the keys that end in `-um` or `-arcsec`, and draws phases.
fn vary(value: &mut toml::Value, dice: &mut Dice) {
    match value {
        toml::Value::Table(table) => {
            for (key, entry) in table.iter_mut() {
                let number = entry.as_float().or_else(|| entry.as_integer().map(|i| i as f64));
                match number {
                    Some(v) if key == "rms-um" || key == "rms-arcsec" => {
                        *entry = toml::Value::Float(v * dice.between(0.6, 1.4));
                    }
                    Some(v) if key.ends_with("-um") || key.ends_with("-arcsec") => {
                        *entry = toml::Value::Float(v * dice.sign() * dice.between(0.6, 1.4));
                    }
                    Some(_) if key == "phase-deg" => {
                        *entry = toml::Value::Float(dice.between(0.0, 360.0));
                    }
                    Some(_) => {}
                    None => vary(entry, dice),
                }
            }
        }
        toml::Value::Array(list) => list.iter_mut().for_each(|v| vary(v, dice)),
        _ => {}
    }
}

/// Drives of a machine in use: lost motion of 0.5 to 2 um, friction peaks of 0.3 to 1.5 um behind a reversal, and
/// repeatability of 0.3 um, on every linear axis; without peaks and wander where only the lost motion is wanted.
pub fn used_drives(file: &mut toml::Table, seed: u64, peaks: bool) {
    let wander = if peaks { 1.0 } else { 0.0 };
    let mut dice = Dice::new(seed, "drives of a paper");
    let entries = file.get_mut("axes").and_then(toml::Value::as_array_mut).into_iter().flatten();
    let linear = entries.filter_map(toml::Value::as_table_mut).filter(|e| e.contains_key("travel-mm"));
    for entry in linear {
        let number = toml::Value::Float;
        entry.insert("backlash-um".into(), number(dice.between(0.5, 2.0)));
        entry.insert("repeatability-um".into(), number(0.3 * wander));
        let mut structure = toml::Table::new();
        structure.insert("peak-um".into(), number(wander * dice.between(0.3, 1.5)));
        structure.insert("rise-ms".into(), number(30.0));
        structure.insert("fall-ms".into(), number(150.0));
        entry.insert("structure".into(), toml::Value::Table(structure));
    }
}

/// Travels of X, Y, Z; zero where the machine lacks the axis.
#[must_use]
pub fn travels(machine: &TruthMachine) -> [[f64; 2]; 3] {
    use volcomp_units::axes::AxisName;
    [AxisName::X, AxisName::Y, AxisName::Z]
        .map(|a| machine.index_of(a).map_or([0.0; 2], |k| machine.travel(k)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::truth::{GANTRY_5AX, GRINDER_AB, VMC_850};

    #[test]
    fn every_shipped_machine_can_be_varied_and_differs_between_seeds() {
        for text in [VMC_850, GANTRY_5AX, GRINDER_AB] {
            let [one, again, other] = [1, 1, 2].map(|s| varied(text, s).unwrap());
            let at = |m: &TruthMachine| m.true_motion(0, 120.0, 1);
            assert_eq!(at(&one), at(&again));
            assert_ne!(at(&one), at(&other));
        }
    }
}
