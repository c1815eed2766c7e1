//! Model and machine file of the daemon for both modes.

use std::fmt::Write as _;

use anyhow::Context;
use toml::Value;

use super::super::{Setting, scales};
use super::{AXES, Mode, World};

/// Errors that stay stored in the mode of the paper.
const STORED: [&str; 6] = ["exx", "eyy", "ezz", "ec0y", "eb0z", "ea0z"];

/// Writes the model of a mode and returns the machine file.
pub(super) fn machine(
    setting: &Setting,
    control: &str,
    sensors: std::net::SocketAddr,
    mode: Mode,
    world: &World,
) -> anyhow::Result<String> {
    let model = format!("model-{}.toml", mode.name());
    setting.write(&model, &model_of(setting, mode, world)?)?;
    let mut text = format!(
        "format = \"volcomp-machine/1\"\nmachine = \"{}\"\nmodel = \"{model}\"\n[link]\naddress = \"{control}\"\n\
         cycle-ms = 10.0\ninterface = \"read-write\"\npoll-ms = 0\nsilence-s = 60.0\n[engine]\nstart = \"on-connect\"\nramp-s = 0.5\nstale-ms = 10000.0\nlive-max-age-ms = 20000.0\n\
         [realtime]\npriority = 0\nlock-memory = false\n[status]\nsocket = \"\"\n[log]\ntarget = \"stderr\"\n\
         [sensors]\nlisten = \"{sensors}\"\ntime = \"control\"\n{}",
        world.test.machine(),
        scales::SENSORS
    );
    for axis in AXES {
        let letter = axis.lower();
        let head: toml::Table =
            std::fs::read_to_string(setting.path(&format!("head-{letter}.toml")))?.parse()?;
        let list = |section: &str, keys: &[&str]| -> anyhow::Result<String> {
            let table = head.get(section).and_then(Value::as_table).with_context(|| section.to_owned())?;
            let mut numbers = Vec::new();
            for key in keys {
                let list = table.get(*key).and_then(Value::as_array).with_context(|| (*key).to_owned())?;
                numbers.extend(list.iter().map(ToString::to_string));
            }
            Ok(format!("[{}]", numbers.join(", ")))
        };
        let focal = head.get("focal-mm").and_then(Value::as_table).context("focal-mm")?;
        let focal: Vec<String> =
            ["psd1", "psd2", "psd3"].iter().filter_map(|k| focal.get(*k)).map(ToString::to_string).collect();
        let beam = |key: &str| head.get(key).map(ToString::to_string).with_context(|| key.to_owned());
        let _ = write!(
            text,
            "[[sensor]]\nname = \"laser-{letter}\"\nkind = \"five-dof\"\naxis = \"{letter}\"\nsmooth-s = 0.5\nrest-smooth-s = 20\n\
             age-limit-ms = 20000\nreference-share = 1.0\nfocal-mm = [{}]\nbeam-1-mm = {}\nbeam-2-mm = {}\nsigns = {}\nangle-gain = {}\n\
             drift-gain = {}\ndead-path-mm = {}\nrange-um = 3000\nrange-arcsec = 400\njump-um = 400\njump-arcsec = 80\n",
            focal.join(", "),
            beam("beam-1-mm")?,
            beam("beam-2-mm")?,
            list("signs", &["psd1", "psd2", "psd3", "qd1", "qd2"])?,
            list("drift", &["angle-gain"])?,
            list("drift", &["gain-beam-1", "gain-beam-2"])?,
            list("drift", &["path-beam-1-mm", "path-beam-2-mm"])?
        );
        if mode == Mode::Absolute {
            let _ = write!(
                text,
                "alignment = \"end-point\"\nroll-rise-arcsec = {:.4}\n",
                level_rise(setting, letter)?
            );
        }
    }
    for axis in AXES {
        let _ = write!(
            text,
            "[axes.{}]\nlimit-um = 1000.0\nrate-um-per-s = 5000.0\nacceleration-um-per-s2 = 100000.0\n",
            axis.lower()
        );
    }
    Ok(text)
}

/// The level of the survey: mean reading at the upper end minus that at the lower end.
fn level_rise(setting: &Setting, letter: char) -> anyhow::Result<f64> {
    let text = std::fs::read_to_string(setting.path(&format!("run-{letter}.csv")))?;
    let mut rows: Vec<(f64, f64)> = Vec::new();
    let mut lines = text.lines();
    let header: Vec<&str> = lines.next().context("no header")?.split(',').collect();
    let column = |name: &str| header.iter().position(|h| *h == name).with_context(|| name.to_owned());
    let (position, level) = (column("position_mm")?, column("level_arcsec")?);
    for line in lines {
        let cells: Vec<&str> = line.split(',').collect();
        if let Ok(value) = cells[level].parse() {
            rows.push((cells[position].parse()?, value));
        }
    }
    let low = rows.iter().map(|r| r.0).fold(f64::INFINITY, f64::min);
    let high = rows.iter().map(|r| r.0).fold(f64::NEG_INFINITY, f64::max);
    let mean = |q: f64| {
        let (n, sum) = rows.iter().filter(|r| r.0 == q).fold((0.0, 0.0), |(n, s), r| (n + 1.0, s + r.1));
        sum / n
    };
    Ok(mean(high) - mean(low))
}

/// The surveyed model with live values: of what the lasers see and of the temperatures of the scales.
fn model_of(setting: &Setting, mode: Mode, world: &World) -> anyhow::Result<String> {
    let mut file: toml::Table = std::fs::read_to_string(setting.path("model.toml"))?.parse()?;
    let errors = file.get_mut("errors").and_then(Value::as_table_mut).context("errors")?;
    if mode == Mode::Absolute {
        errors.retain(|symbol, _| STORED.contains(&symbol));
    }
    let mut live = |symbol: &str, sensor: String| {
        let is_angle = "abc".contains(symbol.chars().nth(1).unwrap_or(' '));
        let mut entry = toml::Table::new();
        entry.insert("sensor".into(), sensor.into());
        let (key, limit) = if is_angle { ("limit-arcsec", 60.0) } else { ("limit-um", 300.0) };
        entry.insert(key.into(), limit.into());
        let of = errors.entry(symbol).or_insert_with(|| toml::Table::new().into());
        if let Some(table) = of.as_table_mut() {
            table.insert("live".into(), entry.into());
        }
    };
    for axis in AXES {
        let letter = axis.lower();
        let d = axis.direction();
        let letters = ['x', 'y', 'z'];
        let seen = [letters[(d + 1) % 3], letters[(d + 2) % 3], 'a', 'b', 'c'];
        for component in seen {
            let symbol = format!("e{component}{letter}");
            live(&symbol, format!("laser-{letter}.{symbol}"));
        }
    }
    scales::add_to_model(&toml::to_string(&file)?, &world.test, &world.scales)
}
