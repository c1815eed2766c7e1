//! May this model be used, and in place of that one?

use std::time::SystemTime;

use volcomp_state::utc;

use volcomp_config::{GuardConfig, Policy};
use volcomp_engine::fault::Code;
use volcomp_estimate::{Thermal, largest_change};
use volcomp_model::compare::{Change, Comparison, compare};
use volcomp_model::{ModelError, ModelSpec};
use volcomp_units::{arcsec_from_rad, um_from_mm};

/// By how much two models differ in the working volume.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Size {
    /// Largest difference of the tip that was found, um.
    pub largest_um: f64,
    /// Largest difference of the tool's direction that was found, arcsec.
    pub largest_arcsec: f64,
    /// The tip differs nowhere by more, um; `None` where the geometry changed, too.
    pub bound_um: Option<f64>,
    /// The direction differs nowhere by more, arcsec.
    pub bound_arcsec: Option<f64>,
    /// The chains have other axes: nothing can be compared.
    pub other_axes: bool,
}

/// Why another model needs a confirmation.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum TooDifferent {
    /// It has other axes.
    #[error("the models have different axes, so by how much they differ cannot be said")]
    OtherAxes,
    /// It moves something too far.
    #[error(
        "the {what} changes by {found:.1} {unit} somewhere in the working volume, the limit is {limit:.1} {unit}"
    )]
    Far {
        /// What.
        what: &'static str,
        /// By how much.
        found: f64,
        /// Limit.
        limit: f64,
        /// Unit of both.
        unit: &'static str,
    },
    /// It may move something too far.
    #[error(
        "the {what} changes by {found:.1} {unit} as far as was looked, but up to {bound:.1} {unit} cannot be ruled out; \
         the limit is {limit:.1} {unit}"
    )]
    PerhapsFar {
        /// What.
        what: &'static str,
        /// Largest change found.
        found: f64,
        /// It is no larger than this.
        bound: f64,
        /// Limit.
        limit: f64,
        /// Unit of all.
        unit: &'static str,
    },
}

/// Compares two models and their thermal displacements, old and new; takes up to seconds.
///
/// # Errors
/// One of them breaks a rule.
pub fn size(specs: [&ModelSpec; 2], thermals: [&[Thermal]; 2]) -> Result<Size, ModelError> {
    let found = compare(specs[0], specs[1], |_, _| {})?;
    Ok(size_of(&found, largest_change(specs, thermals)))
}

/// By how much two models differ that have been compared; `thermal` is what their thermal displacements may differ by, mm.
#[must_use]
pub fn size_of(found: &Comparison, thermal: f64) -> Size {
    let harmless = |c: &Change| matches!(c, Change::Travel { .. } | Change::CorrectionLimit { .. });
    let geometry = !found.changes.iter().all(harmless);
    match &found.volume {
        None => Size {
            largest_um: f64::INFINITY,
            largest_arcsec: f64::INFINITY,
            bound_um: None,
            bound_arcsec: None,
            other_axes: true,
        },
        Some(volume) => {
            // terms that follow motion, sensors and temperatures count with all that they may add
            let [shift, angle] = found.unsearched;
            let shift = shift + thermal;
            Size {
                largest_um: um_from_mm(volume.position.position.norm() + shift),
                largest_arcsec: arcsec_from_rad(volume.rotation.rotation.norm() + angle),
                bound_um: volume.bound_position.filter(|_| !geometry).map(|b| um_from_mm(b + shift)),
                bound_arcsec: volume.bound_rotation.filter(|_| !geometry).map(|b| arcsec_from_rad(b + angle)),
                other_axes: false,
            }
        }
    }
}

/// Whether a change of this size needs no confirmation.
///
/// # Errors
/// It does: why.
pub fn judge(size: &Size, guard: &GuardConfig) -> Result<(), TooDifferent> {
    if size.other_axes {
        return Err(TooDifferent::OtherAxes);
    }
    let tip = (size.largest_um, size.bound_um, um_from_mm(guard.change_limit));
    let tool = (size.largest_arcsec, size.bound_arcsec, arcsec_from_rad(guard.change_limit_angle));
    for (what, unit, (found, bound, limit)) in [("tip", "um", tip), ("direction of the tool", "arcsec", tool)]
    {
        if found > limit {
            return Err(TooDifferent::Far { what, found, limit, unit });
        }
        if let Some(bound) = bound.filter(|bound| *bound > limit) {
            return Err(TooDifferent::PerhapsFar { what, found, bound, limit, unit });
        }
    }
    Ok(())
}

/// Something that speaks against compensating now.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Hindrance {
    /// The model is too old.
    #[error(
        "{}: the model expired on {expiry}; measure again, or enable with --accept-expired and --reason",
        Code::MODEL_EXPIRED
    )]
    Expired {
        /// Its last day.
        expiry: String,
    },
    /// Nobody told the temperature.
    #[error(
        "{}: the model holds from {low} to {high} degC, and the machine's temperature is not known; \
         tell it with --temperature-degc",
        Code::TEMPERATURE_ENVELOPE
    )]
    TemperatureUnknown {
        /// Lowest.
        low: f64,
        /// Highest.
        high: f64,
    },
    /// Too cold or too warm.
    #[error(
        "{}: the machine is at {found} degC, the model holds from {low} to {high} degC; wait, or measure at this \
         temperature",
        Code::TEMPERATURE_ENVELOPE
    )]
    Temperature {
        /// As told.
        found: f64,
        /// Lowest.
        low: f64,
        /// Highest.
        high: f64,
    },
}

/// Everything that speaks against compensating, with what is to follow. `temperature` is that of the machine and its
/// age, s.
pub fn hindrances(
    guard: &GuardConfig,
    expiry: Option<&str>,
    now: SystemTime,
    temperature: Option<(f64, f64)>,
) -> Vec<(Hindrance, Policy)> {
    let mut found = Vec::new();
    if let Some(expiry) = expiry.filter(|e| is_expired(e, now)) {
        found.push((Hindrance::Expired { expiry: expiry.to_owned() }, guard.expired));
    }
    if let Some([low, high]) = guard.temperature_degc {
        let fresh = temperature.filter(|(_, age_s)| *age_s <= guard.temperature_max_age_s);
        let hindrance = match fresh {
            None => Some(Hindrance::TemperatureUnknown { low, high }),
            Some((found, _)) => {
                (!(low..=high).contains(&found)).then_some(Hindrance::Temperature { found, low, high })
            }
        };
        found.extend(hindrance.map(|h| (h, guard.outside_temperature)));
    }
    found
}

/// True after the last day of a model, which is one of UTC.
#[must_use]
pub fn is_expired(expiry: &str, now: SystemTime) -> bool {
    let today = utc::text(now);
    match (expiry.get(..10), today.get(..10)) {
        (Some(last), Some(today)) => today > last,
        _ => false,
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;
    use volcomp_units::{mm_from_um, rad_from_arcsec};

    fn guard() -> GuardConfig {
        GuardConfig {
            change_limit: mm_from_um(50.0),
            change_limit_angle: rad_from_arcsec(20.0),
            hash: None,
            expired: Policy::Refuse,
            temperature_degc: Some([16.0, 26.0]),
            temperature_max_age_s: 3600.0,
            outside_temperature: Policy::RampOut,
        }
    }

    fn spec(scale_um: f64) -> ModelSpec {
        let text = format!(
            "format = \"volcomp-model/1\"\nmachine = \"m\"\nchain = \"[w X' b Y Z t]\"\n[axes.x]\ntravel-mm = [0, 400]\n\
             [axes.y]\ntravel-mm = [0, 300]\n[axes.z]\ntravel-mm = [-300, 0]\n\
             [errors.exx.table]\nposition-mm = [0, 400]\nvalue-um = [0, {scale_um}]\n"
        );
        volcomp_config::model::parse("model.toml", &text).expect("valid")
    }

    fn change(old: &ModelSpec, new: &ModelSpec) -> Size {
        size([old, new], [&[], &[]]).expect("valid")
    }

    #[test]
    fn live_values_and_thermal_displacements_count_by_what_they_may_add() {
        let file = |limit_um: f64, growth: f64| {
            let text = format!(
                "format = \"volcomp-model/1\"\nmachine = \"m\"\nchain = \"[w b X Z t]\"\n[axes.z]\ntravel-mm = [-300, 0]\n\
                 [errors.ezz.live]\nsensor = \"g\"\nlimit-um = {limit_um}\n\
                 [thermal.g]\n[[thermal.g.input]]\nsensor = \"t\"\nrange-degc = [15, 40]\ngrowth-um-per-k = [{growth}]\n"
            );
            volcomp_config::model::parse_file("model.toml", &text).expect("valid")
        };
        let base = file(80.0, 3.0);
        for (new, expected) in [
            (file(80.0, 3.0), 0.0),
            (file(80.0, 4.0), 20.0),
            (file(10.0, 3.0), 70.0),
            // 27 um/K over 20 K, but no more than both limits
            (file(80.0, 30.0), 160.0),
        ] {
            let found = size([&base.spec, &new.spec], [&base.thermal, &new.thermal]).expect("valid");
            assert!((found.largest_um - expected).abs() < 1e-9, "{found:?} instead of {expected}");
            assert_eq!(judge(&found, &guard()).is_ok(), expected <= 50.0);
        }
    }

    #[test]
    fn a_model_without_travel_is_judged_over_the_range_of_its_data() {
        let without = |scale_um| {
            let spec = spec(scale_um);
            ModelSpec { axes: Vec::new(), ..spec }
        };
        let found = change(&without(10.0), &without(75.0));
        assert!(judge(&found, &guard()).is_err(), "{found:?}");
    }

    #[test]
    fn small_changes_pass_large_ones_are_told_with_their_size() {
        let found = change(&spec(10.0), &spec(40.0));
        assert!((found.largest_um - 30.0).abs() < 1e-6, "{found:?}");
        assert_eq!(judge(&found, &guard()), Ok(()));
        let found = change(&spec(10.0), &spec(75.0));
        let error = judge(&found, &guard()).expect_err("65 um");
        assert!(
            matches!(error, TooDifferent::Far { found, limit: 50.0, .. } if (found - 65.0).abs() < 1e-6),
            "{error}"
        );
        let unsure = Size { largest_um: 49.0, bound_um: Some(51.0), ..found };
        assert!(matches!(judge(&unsure, &guard()), Err(TooDifferent::PerhapsFar { .. })));
        assert_eq!(
            judge(
                &change(&spec(10.0), &spec(10.0)),
                &GuardConfig { change_limit: 0.0, change_limit_angle: 0.0, ..guard() }
            ),
            Ok(())
        );
    }

    #[test]
    fn other_axes_always_need_a_confirmation() {
        let mut other = spec(10.0);
        other.chain = volcomp_model::Chain::parse("[w X' b Y t]").expect("a chain");
        other.axes.retain(|a| a.name != volcomp_units::axes::AxisName::Z);
        let found = change(&spec(10.0), &other);
        assert_eq!(judge(&found, &guard()), Err(TooDifferent::OtherAxes));
    }

    #[test]
    fn expiry_is_the_last_good_day_and_temperatures_must_be_fresh() {
        // 2026-11-21T12:00Z
        let now = SystemTime::UNIX_EPOCH + Duration::from_secs(1_795_262_400);
        let of = |expiry: &str, t| hindrances(&guard(), Some(expiry), now, t);
        let warm = Some((20.0, 10.0));
        assert_eq!(of("2026-11-21", warm), []);
        assert_eq!(
            of("2026-11-20", warm),
            [(Hindrance::Expired { expiry: "2026-11-20".to_owned() }, Policy::Refuse)]
        );
        let (low, high) = (16.0, 26.0);
        let unknown = (Hindrance::TemperatureUnknown { low, high }, Policy::RampOut);
        for (told, expected) in [
            (None, Some(unknown.clone())),
            (Some((20.0, 3601.0)), Some(unknown)),
            (Some((26.1, 0.0)), Some((Hindrance::Temperature { found: 26.1, low, high }, Policy::RampOut))),
            (Some((f64::NAN, 0.0)), None),
            (Some((26.0, 0.0)), None),
        ] {
            let found = of("2030-01-01", told);
            if told.is_some_and(|(t, _)| t.is_nan()) {
                assert_eq!(found.len(), 1);
                continue;
            }
            assert_eq!(found, expected.into_iter().collect::<Vec<_>>());
        }
    }
}
