//! Before the cut: survey of the axes and of the head, circle following for the ram, and the model made of both.

use volcomp_units::axes::{AxisArray, AxisName, MAX_AXES};

use anyhow::Context;
use nalgebra::Vector3;

use super::super::{Setting, words};
use super::World;
use super::trackers::{ANGLE_ARCSEC, Followers, RANGE_UM};
use crate::demo::survey::survey_to;
use crate::instruments::survey::SurveyPlan;
use crate::instruments::tracker::on_tool;

/// Stops of the ram, and the poses C, A of the head at each.
const STOPS_MM: [f64; 9] = [-1000.0, -875.0, -750.0, -625.0, -500.0, -375.0, -250.0, -125.0, 0.0];
const POSES_DEG: [[f64; 2]; 6] =
    [[0.0, 30.0], [90.0, -40.0], [180.0, 45.0], [-90.0, -20.0], [45.0, 60.0], [135.0, -60.0]];
/// The rod: radius of the targets, heights above the tip, mm; points per circle.
const RADIUS_MM: f64 = 60.0;
const HEIGHTS_MM: [f64; 2] = [240.0, 40.0];
const POINTS: u32 = 72;

/// Takes the survey and writes `model.toml`.
pub(super) fn take(setting: &Setting, world: &World) -> anyhow::Result<()> {
    let machine = &world.survey;
    let plan = SurveyPlan {
        step_mm: 100.0,
        step_deg: 10.0,
        noise_um: 0.7,
        noise_arcsec: 0.3,
        seed: setting.seed,
        ..SurveyPlan::default()
    };
    let files = survey_to(machine, &plan, &setting.folder)?;
    let mut fit = words(&["fit"]);
    for (axis, table) in files.tables.iter().filter(|(axis, _)| *axis != AxisName::Z) {
        let table = table.display().to_string();
        fit.extend(words(&["--errors", &table, "--axis", &axis.lower().to_string()]));
    }
    fit.extend(words(&["--squareness", &files.squareness, "--into", &setting.arg("geometry.toml")]));
    fit.extend(words(&["--out", &setting.arg("axes.toml")]));
    setting.volcomp(&fit)?;
    circles(setting, world)?;
    ram(setting, world)
}

/// Circle following: two trackers, a rod in the turning spindle, poses of the head at stops of the ram.
fn circles(setting: &Setting, world: &World) -> anyhow::Result<()> {
    let machine = &world.survey;
    let mut followers = Followers::new(world);
    let registrations = ["registration-1.csv", "registration-2.csv"];
    for (name, text) in registrations.iter().zip(&followers.registrations) {
        setting.write(name, text)?;
    }
    if setting.path("poses.csv").exists() {
        std::fs::remove_file(setting.path("poses.csv"))?;
    }
    let index = |name| machine.index_of(name).context("axis");
    let (z, c, a) = (index(AxisName::Z)?, index(AxisName::C)?, index(AxisName::A)?);
    for stop in STOPS_MM {
        for [c_deg, a_deg] in POSES_DEG {
            let mut q = AxisArray::default();
            (q[z], q[c], q[a]) = (stop, c_deg, a_deg);
            for (n, height) in HEIGHTS_MM.into_iter().enumerate() {
                let on_rod: Vec<[f64; 3]> = (0..POINTS)
                    .map(|i| {
                        let turn = f64::from(i) * std::f64::consts::TAU / f64::from(POINTS);
                        [RADIUS_MM * turn.cos(), RADIUS_MM * turn.sin(), height]
                    })
                    .collect();
                let points = on_tool(machine, &q, &[0; MAX_AXES], &on_rod);
                setting.write(&format!("circle-{}.csv", n + 1), &followers.circle(n, &points))?;
            }
            let nominal = machine.nominal(&q);
            let tip = Vector3::from(nominal.tip_mm) + Vector3::from(machine.workpiece_origin_mm());
            let list = |v: [f64; 3]| v.map(|x| format!("{x:.9}")).join(",");
            let mut args = words(&["identify", "circles", "--data", &setting.arg("circle-1.csv")]);
            args.extend(words(&["--registration", &setting.arg(registrations[0])]));
            args.extend(words(&["--data-2", &setting.arg("circle-2.csv")]));
            args.extend(words(&["--registration-2", &setting.arg(registrations[1])]));
            args.extend(words(&["--sigma-range-um", &RANGE_UM.to_string()]));
            args.extend(words(&["--sigma-angle-arcsec", &ANGLE_ARCSEC.to_string()]));
            args.extend(words(&["--tip-beyond-mm", &HEIGHTS_MM[1].to_string()]));
            args.push(format!("--nominal-axis={}", list(nominal.direction)));
            args.push(format!("--nominal-tip-mm={}", list(tip.into())));
            args.extend([format!("--c-deg={c_deg}"), format!("--a-deg={a_deg}"), format!("--z-mm={stop}")]);
            args.extend(words(&["--add-pose", &setting.arg("poses.csv")]));
            setting.volcomp(&args)?;
        }
    }
    Ok(())
}

/// Largest correction of C: its second order moves a tip 40 mm off the axis by 0.2 um.
const CORRECTION_LIMIT_ARCSEC: f64 = 600.0;

/// The ram from the poses, with the head taken off, and the model of all.
fn ram(setting: &Setting, world: &World) -> anyhow::Result<()> {
    let machine = &world.survey;
    let a = machine.index_of(AxisName::A).and_then(|k| machine.drawing(k)).context("axis A")?.point_mm;
    let tip = machine.tool_tip_mm();
    let mut args = words(&["identify", "ram", "--axis", "z", "--poses", &setting.arg("poses.csv")]);
    args.push(format!("--a-axis-mm={},{},{}", a[0], a[1], a[2]));
    args.extend(words(&["--tool-length-mm", &(a[2] - tip[2]).to_string()]));
    args.extend(words(&["--sigma-position-um", "5", "--sigma-direction-arcsec", "3"]));
    args.extend(words(&["--head", &setting.arg("axes.toml")]));
    args.extend(words(&["--chain", machine.chain().text(), "--machine", machine.machine()]));
    args.extend(words(&["--out", &setting.arg("ram.toml")]));
    setting.volcomp(&args)?;
    let mut args = words(&["model", "assemble", &setting.arg("axes.toml"), &setting.arg("ram.toml")]);
    args.extend(words(&["--base", &setting.arg("axes.toml"), "--out", &setting.arg("model.toml")]));
    setting.volcomp(&args)?;
    // the cone comes within 5 deg of the pole, where a tilt of the tool takes ten times as much of C
    let mut model: toml::Table = std::fs::read_to_string(setting.path("model.toml"))?.parse()?;
    let axes = model.get_mut("axes").and_then(toml::Value::as_table_mut).context("axes")?;
    let c = axes.get_mut("c").and_then(toml::Value::as_table_mut).context("axis C")?;
    c.insert("correction-limit-arcsec".to_owned(), CORRECTION_LIMIT_ARCSEC.into());
    setting.write("model.toml", &toml::to_string(&model)?)
}
