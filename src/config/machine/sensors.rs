//! Sensors and maps: `[sensors]`, `[[sensor]]`, `[[map]]`.

use crate::prelude::*;

use super::is_this_computer;
use super::read::within;
use volcomp_estimate::fivedof::Head;
use volcomp_estimate::live::{LaserAlignment, LiveSpec, MapSpec, SensorKind, SensorSpec};

/// Live estimation.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SensorsConfig {
    /// Where sensors connect to; `None`: nowhere.
    pub listen: Option<SocketAddr>,
    /// Connections from other computers are taken without protection.
    pub plain_remote: bool,
    /// Interval at which what was learned is kept, s.
    pub keep_s: f64,
    /// A connection that says nothing for so long is closed, s.
    pub idle_s: f64,
    /// The estimator keeps the control's time and each frame waits for it; for a simulated control.
    pub lock_step: bool,
    /// The sensors and maps.
    pub spec: LiveSpec,
}

/// Longest name of a sensor or map, bytes.
const NAME_MAX: usize = 32;
/// Most sensors.
const SENSORS_MAX: usize = 64;
const DEFAULT_KEEP_S: f64 = 60.0;
const DEFAULT_IDLE_S: f64 = 600.0;
/// Where sensors connect to, where any are listed and nothing is written.
const DEFAULT_LISTEN: &str = "127.0.0.1:7979";

/// Keys that only a 5-DOF laser has.
const FIVE_DOF_KEYS: [&str; 13] = [
    "axis",
    "smooth-s",
    "rest-smooth-s",
    "reference-share",
    "alignment",
    "roll-rise-arcsec",
    "focal-mm",
    "beam-1-mm",
    "beam-2-mm",
    "signs",
    "angle-gain",
    "drift-gain",
    "dead-path-mm",
];

pub(super) fn read_sensors(top: &Section<'_>) -> SensorsConfig {
    let maps: Vec<MapSpec> = top.read_all("map", read_map).into_iter().flatten().collect();
    let sections = top.sections("sensor");
    if let Some(extra) = sections.get(SENSORS_MAX) {
        extra.report_here(format!("more than {SENSORS_MAX} sensors"), "take some out");
    }
    let sensors: Vec<SensorSpec> = sections.iter().filter_map(|s| read_sensor(s, &maps)).collect();
    for (k, sensor) in sensors.iter().enumerate() {
        let twice =
            sensors[..k].iter().any(|s| s.name == sensor.name) || maps.iter().any(|m| m.name == sensor.name);
        if twice && let Some(section) = sections.get(k) {
            let message = format!("two sensors or maps are called \"{}\"", sensor.name);
            section.report_here(message, "give each its own name");
        }
    }
    let general = top.section("sensors");
    let listen = read_listen(&general, !sensors.is_empty());
    let plain_remote = general.flag("plain-remote").unwrap_or(false);
    if let Some(listen) = listen.as_ref().filter(|l| !(plain_remote || is_this_computer(l.value.ip()))) {
        general.report_at(
            listen.place.clone(),
            format!("sensors.listen {} accepts connections from other computers, and anyone there could send live values", listen.value),
            "listen on 127.0.0.1 and forward by ssh; or plain-remote = true where that wire connects the sensors with this computer and with nothing else",
        );
    }
    let keep_s = number(&general, "keep-s", within(1.0, 86_400.0), DEFAULT_KEEP_S);
    let idle_s = number(&general, "idle-s", within(1.0, 86_400.0), DEFAULT_IDLE_S);
    let lock_step = general.choice("time", &[("computer", false), ("control", true)]) == Some(true);
    general.finish();
    let spec = LiveSpec { sensors, maps };
    SensorsConfig { listen: listen.map(|l| l.value), plain_remote, keep_s, idle_s, lock_step, spec }
}

fn read_listen(general: &Section<'_>, wanted: bool) -> Option<Placed<SocketAddr>> {
    let Some(text) = general.text("listen") else {
        let default = DEFAULT_LISTEN.parse().ok().filter(|_| wanted)?;
        return Some(Placed::new(default, 0..0));
    };
    if text.value.is_empty() {
        return None;
    }
    match text.value.parse::<SocketAddr>() {
        Ok(address) => Some(Placed::new(address, text.place)),
        Err(_) => general.refuse(
            text.place,
            format!("sensors.listen \"{}\" is not an address with port", text.value),
            "write a number of this computer and a port, for example \"127.0.0.1:7979\"; \"\" listens nowhere",
        ),
    }
}

const fn up_to(high: f64) -> Allowed {
    Allowed::Positive { high }
}

fn number(section: &Section<'_>, key: &'static str, allowed: Allowed, default: f64) -> f64 {
    section.number(key, allowed).map_or(default, |n| n.value)
}

/// A length in um and an angle in arcsec, inside mm and rad; `default` in mm and rad.
fn pair(section: &Section<'_>, keys: [&'static str; 2], highest: [f64; 2], default: [f64; 2]) -> [f64; 2] {
    let length = section.number(keys[0], up_to(highest[0])).map(|n| mm_from_um(n.value));
    let angle = section.number(keys[1], up_to(highest[1])).map(|n| rad_from_arcsec(n.value));
    [length.unwrap_or(default[0]), angle.unwrap_or(default[1])]
}

/// A name without dots: a dot parts it from the symbol in the names of live values.
fn read_name(section: &Section<'_>, what: &str) -> Option<String> {
    section.require("name", &format!("add name = \"...\", by which the {what} is known"))?;
    let name = section.text("name")?;
    let good = !name.value.is_empty()
        && name.value.len() <= NAME_MAX
        && name.value.chars().all(|c| c.is_ascii_alphanumeric() || c == '-' || c == '_');
    if !good {
        section.report_at(
            name.place,
            format!("name \"{}\" of a {what}", name.value),
            format!("write 1 to {NAME_MAX} letters, digits, - or _"),
        );
    }
    good.then(|| name.value.to_owned())
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Kind {
    Tool,
    FiveDof,
    Value,
    Temperature,
    Speed,
}

fn read_sensor(section: &Section<'_>, maps: &[MapSpec]) -> Option<SensorSpec> {
    let name = read_name(section, "sensor");
    let remedy = "add kind = \"tool\", \"five-dof\", \"value\", \"temperature\" or \"speed\"";
    section.require("kind", remedy);
    let kinds = [
        ("tool", Kind::Tool),
        ("five-dof", Kind::FiveDof),
        ("value", Kind::Value),
        ("temperature", Kind::Temperature),
        ("speed", Kind::Speed),
    ];
    let kind = section.choice("kind", &kinds);
    let map = section.text("map");
    let laser = read_laser(section);
    let of_kind = kind.and_then(|kind| match kind {
        Kind::Tool => find_map(section, map.as_ref(), maps).map(|map| SensorKind::Tool { map }),
        Kind::FiveDof => laser,
        Kind::Value => Some(SensorKind::Value),
        Kind::Temperature => Some(SensorKind::Temperature),
        Kind::Speed => Some(SensorKind::Speed),
    });
    let foreign = FIVE_DOF_KEYS.iter().find(|k| section.value(k).is_some() && kind != Some(Kind::FiveDof));
    if let Some(key) = foreign.filter(|_| kind.is_some()) {
        section
            .report_here(format!("{key} is a key of kind = \"five-dof\""), "take it out or correct the kind");
    }
    let base =
        SensorSpec::new(name.as_deref().unwrap_or_default(), of_kind.unwrap_or(SensorKind::Temperature));
    let spec = read_trust(section, base, kind);
    section.finish();
    (name.is_some() && of_kind.is_some()).then_some(spec)
}

/// How far a sensor is believed.
fn read_trust(section: &Section<'_>, base: SensorSpec, kind: Option<Kind>) -> SensorSpec {
    let [std_mm, std_rad] = pair(section, ["std-um", "std-arcsec"], [1e4, 1e4], [base.std_mm, base.std_rad]);
    let mut range = pair(section, ["range-um", "range-arcsec"], [1e5, 1e5], base.range);
    let mut jump = pair(section, ["jump-um", "jump-arcsec"], [1e5, 1e5], base.jump);
    let mut rate = pair(section, ["rate-um-per-s", "rate-arcsec-per-s"], [1e9, 1e9], base.rate);
    let degc = section.number("range-degc", up_to(1000.0)).map_or(200.0, |n| n.value);
    let jump_degc = section.number("jump-degc", up_to(1000.0)).map_or(5.0, |n| n.value);
    let frozen_given = section.number("frozen-s", within(0.0, 1e6)).map(|n| n.value);
    let mut frozen_s = frozen_given.unwrap_or(base.frozen_s);
    let age = section.number("age-limit-ms", within(1.0, 3_600_000.0)).map(|n| n.value / 1e3);
    let mut age_limit_s = age.unwrap_or(base.age_limit_s);
    let rpm = section.number("range-rpm", up_to(1e6)).map_or(200_000.0, |n| n.value);
    if matches!(kind, Some(Kind::Temperature | Kind::Speed)) {
        (range, jump, rate) = match kind {
            Some(Kind::Speed) => ([rpm; 2], [f64::INFINITY; 2], [f64::INFINITY; 2]),
            _ => ([degc; 2], [jump_degc; 2], [f64::INFINITY; 2]),
        };
        // a thermometer of tenths of a degree may well stay the same for an hour, and is read seldom
        frozen_s = frozen_given.unwrap_or(f64::INFINITY);
        age_limit_s = age.unwrap_or(60.0);
    }
    SensorSpec {
        std_mm,
        std_rad,
        range,
        jump,
        rate,
        frozen_s: if frozen_s == 0.0 { f64::INFINITY } else { frozen_s },
        age_limit_s,
        adapt: section.flag("adapt").unwrap_or(base.adapt),
        initialisation: section
            .whole("acquaintance", 3, 10_000)
            .map_or(base.initialisation, |n| n.value as usize),
        latency_s: number(section, "latency-ms", within(0.0, 10_000.0), 0.0) / 1e3,
        quality_min: number(section, "quality-min", within(0.0, 1.0), base.quality_min),
        return_s: number(section, "return-s", within(0.0, 1e5), base.return_s),
        ..base
    }
}

/// The map that a sensor of the tool feeds: the one named, or the only one.
fn find_map(section: &Section<'_>, named: Option<&Placed<&str>>, maps: &[MapSpec]) -> Option<usize> {
    let known: Vec<&str> = maps.iter().map(|m| m.name.as_str()).collect();
    match named {
        Some(name) => known.iter().position(|m| *m == name.value).or_else(|| {
            section.refuse(
                name.place.clone(),
                format!("no map is called \"{}\"", name.value),
                format!("maps are: {}; or add a [[map]] of this name", known.join(", ")),
            )
        }),
        None if maps.len() == 1 => Some(0),
        None => {
            let remedy = if maps.is_empty() {
                "add a [[map]] with the nodes on which the readings are learned".to_owned()
            } else {
                format!("add map = \"...\", one of {}", known.join(", "))
            };
            section.report_here("a sensor of the tool feeds a map, and none is named", remedy);
            None
        }
    }
}

fn read_laser(section: &Section<'_>) -> Option<SensorKind> {
    let axis = section.text("axis");
    let smooth_s = number(section, "smooth-s", within(0.0, 3600.0), 1.0);
    let rest_smooth_s = number(section, "rest-smooth-s", within(0.0, 3600.0), smooth_s);
    let reference_share = number(section, "reference-share", within(0.1, 1.0), 0.8);
    let is_end_point =
        section.choice("alignment", &[("stored-curves", false), ("end-point", true)]) == Some(true);
    let roll_rise = section.number("roll-rise-arcsec", within(-1e3, 1e3));
    if let Some(rise) = roll_rise.as_ref().filter(|_| !is_end_point) {
        section.report_at(
            rise.place.clone(),
            "roll-rise-arcsec belongs to alignment = \"end-point\"",
            "take it out: with the stored curves roll is aligned to theirs",
        );
    }
    let alignment = if is_end_point {
        LaserAlignment::EndPoint { roll_rise: roll_rise.map_or(0.0, |n| rad_from_arcsec(n.value)) }
    } else {
        LaserAlignment::StoredCurves
    };
    let focal = section.fixed::<3>("focal-mm", "focal lengths of PSD1, PSD2, PSD3");
    let beams = [("beam-1-mm", "y and z of beam 1"), ("beam-2-mm", "y and z of beam 2")]
        .map(|(k, w)| section.fixed::<2>(k, w));
    let signs = section.fixed::<10>("signs", "1 or -1 for both directions of PSD1, PSD2, PSD3, QD1, QD2");
    let angle_gain = section.fixed::<2>("angle-gain", "gain of the pointing in PSD1, both directions");
    let drift_gain = section.fixed::<4>("drift-gain", "beam 1, then beam 2, both directions");
    let dead_path = section.fixed::<4>("dead-path-mm", "beam 1, then beam 2, both directions");
    let head = match (focal, beams) {
        (None, [None, None]) => None,
        (Some(focal), [Some(one), Some(two)]) => {
            let place = focal.place.clone();
            let pairs = |list: [f64; 4]| [[list[0], list[1]], [list[2], list[3]]];
            let made = Head::nominal(focal.value, [one.value, two.value]).and_then(|nominal| {
                let head = Head {
                    signs: signs.map_or(nominal.signs, |s| {
                        core::array::from_fn(|d| [s.value[2 * d], s.value[2 * d + 1]])
                    }),
                    angle_gain: angle_gain.map_or(nominal.angle_gain, |g| g.value),
                    gain: drift_gain.map_or(nominal.gain, |g| pairs(g.value)),
                    path: dead_path.map_or(nominal.path, |p| pairs(p.value)),
                    ..nominal
                };
                head.check().map(|()| head)
            });
            match made {
                Ok(head) => Some(head),
                Err(e) => {
                    let remedy = "see docs/how-to/sensors.md: the instrument of raw readings";
                    return section.refuse(place, e.to_string(), remedy);
                }
            }
        }
        _ => {
            section.report_here(
                "an instrument needs focal-mm, beam-1-mm and beam-2-mm",
                "give all three, or none where the laser tells reduced readings",
            );
            return None;
        }
    };
    let Some(axis) = axis else {
        if section.text("kind").is_some_and(|kind| kind.value == "five-dof") {
            section.missing("axis", "add axis = \"x\", the axis that the laser watches");
        }
        return None;
    };
    let mut letters = axis.value.chars();
    let name = letters.next().and_then(AxisName::from_letter).filter(|_| letters.next().is_none());
    let Some(name) = name.filter(|name| name.kind() == AxisKind::Linear) else {
        let message = format!("axis \"{}\" is not a linear axis", axis.value);
        return section.refuse(axis.place, message, "write x, y or z");
    };
    Some(SensorKind::FiveDof { axis: name, head, smooth_s, rest_smooth_s, reference_share, alignment })
}

fn read_map(section: &Section<'_>) -> Option<MapSpec> {
    let name = read_name(section, "map");
    let nodes = ["x-mm", "y-mm", "z-mm"].map(|key| read_nodes(section, key));
    let base = MapSpec::new("", [Vec::new(), Vec::new(), Vec::new()]);
    let std = pair(section, ["std-um", "std-arcsec"], [1e4, 1e4], base.std);
    let drift = pair(section, ["drift-um-per-h", "drift-arcsec-per-h"], [1e4, 1e4], base.drift_per_h);
    let limit = pair(section, ["limit-um", "limit-arcsec"], [5e3, 2e3], base.limit);
    let correlation_mm = number(section, "correlation-mm", within(0.0, 1e5), base.correlation_mm);
    let return_s = section.number("return-min", up_to(1e6)).map(|n| 60.0 * n.value);
    let rejections = section.whole("alarm-rejections", 1, 1000).map_or(base.rejections_to_alarm, |n| n.value);
    let alarm_hold_s = number(section, "alarm-hold-s", within(0.0, 1e5), base.alarm_hold_s);
    let gate = number(section, "gate", within(1.0, 1e6), base.gate);
    let [x, y, z] = nodes;
    Some(MapSpec {
        name: name?,
        nodes: [x?, y?, z?],
        std,
        drift_per_h: drift,
        limit,
        correlation_mm,
        return_s,
        rejections_to_alarm: rejections,
        alarm_hold_s,
        gate,
    })
}

fn read_nodes(section: &Section<'_>, key: &'static str) -> Option<Vec<f64>> {
    section.require(key, &format!("add {key} = [lowest, .., highest], the coordinates of the nodes"))?;
    let list = section.numbers(key)?;
    let values: Vec<f64> = list.value.iter().map(|n| n.value).collect();
    if values.len() < 2 || values.windows(2).any(|w| w[0] >= w[1]) {
        return section.refuse(
            list.place,
            format!("{} has {} positions or they do not increase", section.named_key(key), values.len()),
            "write at least two positions, each above the one before",
        );
    }
    Some(values)
}

#[cfg(test)]
mod tests {
    use crate::MachineConfig;
    use volcomp_estimate::live::{LaserAlignment, SensorKind};

    const BASE: &str = "format = \"volcomp-machine/1\"\nmachine = \"m\"\nmodel = \"model.toml\"\n\
        [axes.x]\nlimit-um = 50\nrate-um-per-s = 100\nacceleration-um-per-s2 = 1000\n";
    const MAP: &str = "[[map]]\nname = \"ram\"\nx-mm = [0, 500]\ny-mm = [0, 500]\nz-mm = [0, 300]\nlimit-um = 30\ndrift-arcsec-per-h = 2\n";

    fn read(text: &str) -> Result<MachineConfig, String> {
        MachineConfig::parse("m.toml", &format!("{BASE}{text}")).map_err(|e| e.to_string())
    }

    #[test]
    fn sensors_and_maps_arrive_in_mm_and_rad() {
        let none = read("").unwrap().sensors;
        assert!(none.listen.is_none() && none.spec.sensors.is_empty());
        let text = format!(
            "{MAP}[[sensor]]\nname = \"tracker\"\nkind = \"tool\"\nstd-um = 5\njump-arcsec = 3\nage-limit-ms = 250\n\
             [[sensor]]\nname = \"laser-x\"\nkind = \"five-dof\"\naxis = \"x\"\nfocal-mm = [230, 250, 210]\n\
             beam-1-mm = [-35, 8]\nbeam-2-mm = [33, 8]\nsigns = [1, 1, -1, 1, 1, 1, 1, 1, 1, 1]\n\
             [[sensor]]\nname = \"air\"\nkind = \"temperature\"\n\
             [[sensor]]\nname = \"spindle\"\nkind = \"speed\"\nrange-rpm = 12000\n"
        );
        let sensors = read(&text).unwrap().sensors;
        assert_eq!(sensors.listen.unwrap().to_string(), "127.0.0.1:7979");
        let [tracker, laser, air, spindle] = sensors.spec.sensors.as_slice() else { panic!("four") };
        assert_eq!((spindle.kind, spindle.range[0]), (SensorKind::Speed, 12_000.0));
        assert!(spindle.frozen_s.is_infinite() && spindle.jump[0].is_infinite());
        assert_eq!(tracker.kind, SensorKind::Tool { map: 0 });
        assert!((tracker.std_mm - 5e-3).abs() < 1e-15 && (tracker.age_limit_s - 0.25).abs() < 1e-15);
        assert!((tracker.jump[1] - 3.0 * 4.848_136_811e-6).abs() < 1e-12);
        let SensorKind::FiveDof { head: Some(head), .. } = laser.kind else { panic!("an instrument") };
        assert_eq!((head.signs[1], head.beams[1]), ([-1.0, 1.0], [33.0, 8.0]));
        let SensorKind::FiveDof { alignment, .. } = laser.kind else { panic!("a laser") };
        assert_eq!(alignment, LaserAlignment::StoredCurves);
        let text = "[[sensor]]\nname = \"l\"\nkind = \"five-dof\"\naxis = \"x\"\nalignment = \"end-point\"\nroll-rise-arcsec = 2\n";
        let absolute = read(text).unwrap().sensors.spec.sensors[0].kind;
        let SensorKind::FiveDof { alignment: LaserAlignment::EndPoint { roll_rise }, .. } = absolute else {
            panic!("{absolute:?}")
        };
        assert!((roll_rise - 2.0 * 4.848_136_811e-6).abs() < 1e-12);
        assert!(air.frozen_s.is_infinite() && air.range == [200.0; 2]);
        let map = &sensors.spec.maps[0];
        assert!((map.limit[0] - 0.03).abs() < 1e-15 && (map.drift_per_h[1] - 2.0 * 4.848e-6).abs() < 1e-9);
    }

    #[test]
    fn mistakes_name_the_key_and_the_remedy() {
        for (text, words) in [
            ("[[sensor]]\nkind = \"value\"\n", "add name ="),
            ("[[sensor]]\nname = \"a\"\n", "kind is missing"),
            ("[[sensor]]\nname = \"a.b\"\nkind = \"value\"\n", "letters, digits"),
            ("[[sensor]]\nname = \"a\"\nkind = \"tool\"\n", "add a [[map]]"),
            ("[[sensor]]\nname = \"a\"\nkind = \"five-dof\"\n", "add axis ="),
            ("[[sensor]]\nname = \"a\"\nkind = \"five-dof\"\naxis = \"c\"\n", "not a linear axis"),
            (
                "[[sensor]]\nname = \"a\"\nkind = \"five-dof\"\naxis = \"x\"\nroll-rise-arcsec = 3\n",
                "belongs to alignment = \"end-point\"",
            ),
            ("[[sensor]]\nname = \"a\"\nkind = \"value\"\naxis = \"x\"\n", "key of kind = \"five-dof\""),
            ("[[sensor]]\nname = \"a\"\nkind = \"value\"\nstd-mm = 1\n", "write std-um"),
            (
                "[[sensor]]\nname = \"a\"\nkind = \"five-dof\"\naxis = \"x\"\nfocal-mm = [1, 2, 3]\n",
                "beam-1-mm",
            ),
            ("[sensors]\nlisten = \"0.0.0.0:7979\"\n", "plain-remote"),
            ("[sensors]\nlisten = \"here\"\n", "not an address with port"),
            ("[[map]]\nname = \"r\"\nx-mm = [0, 1]\ny-mm = [1, 1]\nz-mm = [0, 1]\n", "do not increase"),
            ("[[map]]\nname = \"r\"\nx-mm = [0, 1]\ny-mm = [1, 2]\n", "add z-mm"),
        ] {
            let error = read(text).expect_err(text);
            assert!(error.contains(words), "{text}: {error}");
        }
        let two = format!("{MAP}[[sensor]]\nname = \"ram\"\nkind = \"value\"\n");
        assert!(read(&two).unwrap_err().contains("give each its own name"));
        let other = format!("{MAP}[[sensor]]\nname = \"t\"\nkind = \"tool\"\nmap = \"rom\"\n");
        assert!(read(&other).unwrap_err().contains("maps are: ram"));
    }
}
