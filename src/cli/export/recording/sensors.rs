//! Columns of live values: one for every sensor that a model of the recording names.

use crate::prelude::*;
use crate::recordings::Inside;
use volcomp_protocol::record::LIVE_MAX;

/// A sensor, and what it last told.
#[derive(Debug, Clone, PartialEq)]
struct Sensor {
    name: String,
    angle: bool,
    told: Option<f64>,
}

/// The sensors of all models, and which of them the channels of the present model are.
#[derive(Debug, Clone, Default)]
pub(super) struct Sensors {
    all: Vec<Sensor>,
    /// Per model: its hash, and the place of each channel in `all`.
    models: Vec<([u8; 32], Vec<usize>)>,
    present: usize,
}

impl Sensors {
    pub(super) fn new(models: &[Inside]) -> Self {
        let mut sensors = Self::default();
        for Inside { hash, spec, model } in models {
            let places = model.sensors().iter().map(|name| {
                let is_live = |f: &ErrorFunction| f.live.iter().any(|live| live.sensor == *name);
                let mut errors = spec.errors.iter().filter(|(_, f)| is_live(f)).peekable();
                // one that tells lengths, too, is taken for one of lengths
                let angle = errors.peek().is_some() && errors.all(|(symbol, _)| symbol.is_angle());
                let sensor = Sensor { name: column_part(name), angle, told: None };
                sensors.all.iter().position(|known| *known == sensor).unwrap_or_else(|| {
                    sensors.all.push(sensor);
                    sensors.all.len() - 1
                })
            });
            let places = places.collect();
            sensors.models.push((*hash, places));
        }
        sensors
    }

    /// The engine goes on with this model; `None`: with the first.
    pub(super) fn switch(&mut self, model: Option<[u8; 32]>) {
        let found = model.and_then(|hash| self.models.iter().position(|(known, _)| *known == hash));
        self.present = found.unwrap_or(0);
        // what was told does not go on
        self.all.iter_mut().for_each(|sensor| sensor.told = None);
    }

    /// Values by channel, mm or rad.
    pub(super) fn update(&mut self, told: u32, values: &[f64; LIVE_MAX]) {
        let Some((_, places)) = self.models.get(self.present) else { return };
        for (channel, (place, value)) in places.iter().zip(values).enumerate() {
            if told >> channel & 1 == 1
                && let Some(sensor) = self.all.get_mut(*place)
            {
                sensor.told = Some(if sensor.angle { arcsec_from_rad(*value) } else { um_from_mm(*value) });
            }
        }
    }

    /// Every sensor with its unit and what it told last.
    pub(super) fn values(&self) -> impl Iterator<Item = (&str, &'static str, Option<f64>)> {
        self.all.iter().map(|s| (s.name.as_str(), if s.angle { "arcsec" } else { "um" }, s.told))
    }
}

/// A name that needs no quotes in a header.
fn column_part(name: &str) -> String {
    name.chars().map(|c| if c.is_ascii_alphanumeric() { c.to_ascii_lowercase() } else { '_' }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use volcomp_config as config;
    use volcomp_model::Model;

    fn inside(hash: u8, errors: &str) -> Inside {
        let text = format!(
            "format = \"volcomp-model/1\"\nmachine = \"m\"\nchain = \"[w X' b Y Z t]\"\n\
             [frame]\nworkpiece-origin-mm = [0, 0, 0]\ntool-tip-mm = [0, 0, 0]\n{errors}"
        );
        let spec = config::model::parse("m", &text).expect("a model");
        let model = Model::new(&spec).expect("a model");
        Inside { hash: [hash; 32], spec, model }
    }

    #[test]
    fn channels_follow_the_model_and_a_sensor_keeps_its_column() {
        let mut sensors = Sensors::new(&[
            inside(1, "[errors.exx.live]\nsensor = \"Ram 1\"\nlimit-um = 50\n"),
            inside(
                2,
                "[errors.eax.live]\nsensor = \"tilt\"\nlimit-arcsec = 50\n\
                 [errors.exx.live]\nsensor = \"Ram 1\"\nlimit-um = 50\n",
            ),
        ]);
        let columns: Vec<_> = sensors.values().map(|(name, unit, _)| (name.to_owned(), unit)).collect();
        assert_eq!(columns, [("ram_1".to_owned(), "um"), ("tilt".to_owned(), "arcsec")]);
        let mut values = [0.0; LIVE_MAX];
        values[0] = 0.004;
        sensors.update(1, &values);
        let told = |s: &Sensors| s.values().map(|(.., told)| told).collect::<Vec<_>>();
        assert_eq!(told(&sensors), [Some(4.0), None]);
        sensors.switch(Some([2; 32]));
        assert_eq!(told(&sensors), [None, None]);
        let ram = sensors.models[1].1.iter().position(|place| *place == 0).expect("in both models");
        values[ram] = 0.002;
        sensors.update(1 << ram, &values);
        assert_eq!(told(&sensors), [Some(2.0), None]);
    }
}
