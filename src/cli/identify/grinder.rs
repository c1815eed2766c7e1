//! `volcomp identify grinder`: a chain axis by axis, each corrected before the next one is measured.

use std::io::Write;
use std::path::{Path, PathBuf};

use serde_json::{Map, Value, json};

use super::case;
use crate::files::Output;
use crate::input::{self, InputKind};
use crate::model_writer::{ModelWriter, Sources, put};
use crate::table::{self, nearest};
use crate::{EX_CONFIG, EX_USAGE, Failure};
use volcomp_config as config;
use volcomp_config::ModelFile;
use volcomp_identify::grinder::{Chain, Curves, Found, Measured, Request, Row, SetUp, plan};
use volcomp_model::{Component, ErrorSymbol, Model, ModelSpec, Pose};
use volcomp_units::axes::{AxisArray, AxisKind, AxisName, MAX_AXES};
use volcomp_units::{arcsec_from_rad, deg_from_rad, mm_from_um, rad_from_arcsec, rad_from_deg, um_from_mm};

/// The error motions of a chain, measured axis by axis: each axis is corrected before the next one is measured.
///
/// Made for a gear grinder ([w A' b X Y B t], in the order A, B, X, Y), right for any chain. One file per step holds
/// deviations of the tool tip relative to the workpiece at known poses, with three or more tips (styli) that do not
/// lie on a line. The axis of the step goes through its positions; axes of earlier steps may move, too, corrected by
/// what was found; axes of later steps stand still. The report shows how the uncertainty grows from step to step.
///
/// Start from the drawing as a model without errors (--drawing); it gives chain, travels, points and reference points.
/// --next AXIS=FILE writes the poses to measure next, with the corrections to add to each.
///
/// Columns of a step: one per axis (a_deg, x_mm ..; a missing axis stands at 0), tool_x_mm tool_y_mm tool_z_mm (tip in M
/// at home; default: that of the model), dx_um dy_um dz_um (actual minus nominal in W; leave out what is not
/// measured), and where corrections were added to the axes: ca_arcsec, cx_um ..
///
/// Example, first and second step:
///
/// volcomp identify grinder --drawing drawing.toml --next a=poses-a.csv
///
/// volcomp identify grinder --drawing drawing.toml --step a=a.csv --next b=poses-b.csv --out model.toml
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// The machine as a model file, which stays as it is; its errors of axes that are not measured are taken as known.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["into", "chain"])]
    drawing: Option<PathBuf>,
    /// A measured step; once per axis, in the order in which they were measured.
    #[arg(long, value_name = "AXIS=CSV", value_parser = assignment)]
    step: Vec<(AxisName, PathBuf)>,
    /// Write the poses at which to measure this axis next, with the corrections to add.
    #[arg(long, value_name = "AXIS=CSV", value_parser = assignment)]
    next: Option<(AxisName, PathBuf)>,
    /// Positions of the next step over the travel of its axis.
    #[arg(long, value_name = "N", default_value_t = 25)]
    positions: usize,
    /// Distance of the tips of the next step.
    #[arg(long, value_name = "MM", default_value_t = 60.0)]
    lever_mm: f64,
    /// Error motions to find, the others being zero: all, or letters such as x,a (EX. and EA. of each axis).
    #[arg(long, value_name = "LETTERS", default_value = "all", value_parser = components)]
    motions: Components,
    /// Noise of a reading (standard deviation), where known: the rigidity of the tips is then tested against it.
    #[arg(long, value_name = "UM")]
    noise_um: Option<f64>,
    /// How the values at the positions become curves, in the model and in the corrections of --next.
    #[arg(long, value_enum, default_value = "table")]
    basis: BasisArg,
    #[command(flatten)]
    out: ModelWriter,
    /// One JSON object on stdout.
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum BasisArg {
    /// Straight lines between the positions: noise of a position stays.
    Table,
    /// The curve that volcomp fit chooses: noise averages over the positions.
    Auto,
}

/// The motions asked for.
#[derive(Debug, Clone)]
struct Components(Vec<Component>);

fn components(text: &str) -> Result<Components, String> {
    if text == "all" {
        return Ok(Components(Component::ALL.to_vec()));
    }
    let one = |word: &str| {
        let mut letters = word.trim().chars();
        match (letters.next().and_then(Component::from_letter), letters.next()) {
            (Some(c), None) => Ok(c),
            _ => Err(format!("invalid direction '{word}'; write letters of x y z a b c, such as x,b")),
        }
    };
    let mut list = text.split(',').map(one).collect::<Result<Vec<_>, _>>()?;
    list.sort_unstable();
    list.dedup();
    Ok(Components(list))
}

fn assignment(text: &str) -> Result<(AxisName, PathBuf), String> {
    let (axis, path) = text.split_once('=').ok_or("write for example a=a.csv")?;
    let mut letters = axis.chars();
    match (letters.next().and_then(AxisName::from_letter), letters.next()) {
        (Some(name), None) if !path.is_empty() => Ok((name, PathBuf::from(path))),
        _ => Err(format!("'{text}' names no axis and file; write for example a=a.csv")),
    }
}

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    if args.step.is_empty() && args.next.is_none() {
        return Err(Failure::usage("nothing to do; give --step for data, --next for the poses to measure"));
    }
    if args.step.is_empty() && args.out.out.is_some() {
        return Err(Failure::usage("--out needs a --step; without one there is nothing to write"));
    }
    let file = drawing(args)?;
    let mut chain = Chain::new(file.spec.clone());
    let request = Request {
        components: args.motions.0.clone(),
        sigma: args.noise_um.map(mm_from_um),
        curves: match args.basis {
            BasisArg::Table => Curves::Lines,
            BasisArg::Auto => Curves::Fitted,
        },
    };
    for (axis, path) in &args.step {
        let rows = read(path, chain.spec())?;
        chain.identify(&Measured { axis: *axis, rows }, &request).map_err(|e| Failure::data(path, e))?;
    }
    if let Some((axis, path)) = &args.next {
        write_poses(&chain, *axis, path, args)?;
    }
    if !args.step.is_empty() && args.out.target().is_some() {
        write_model(args, file, &chain)?;
    }
    if args.step.is_empty() || args.out.takes_stdout() {
        return Ok(());
    }
    if args.json {
        case::print_json(&as_json(&chain));
    } else {
        print(&chain);
    }
    Ok(())
}

/// The drawing, the model of --into, or a bare chain.
fn drawing(args: &Args) -> Result<ModelFile, Failure> {
    let Some(path) = &args.drawing else {
        return args.out.base(|| "[w A' b X Y B t]".to_owned());
    };
    config::model::parse_file(&path.display().to_string(), &input::read_text(path, InputKind::Model)?)
        .map_err(|e| Failure::new(EX_CONFIG, e))
}

/// A column of an axis and the unit of its coordinate or correction.
struct Column {
    index: usize,
    axis: usize,
    to_inner: fn(f64) -> f64,
}

/// Reads the rows of a step.
fn read(path: &Path, spec: &ModelSpec) -> Result<Vec<Row>, Failure> {
    let mut table = table::open(path)?;
    let keep = |v: f64| v;
    let (mut positions, mut corrections, mut known) = (Vec::new(), Vec::new(), Vec::new());
    for (axis, a) in spec.chain.axes().iter().enumerate() {
        let letter = a.name.lower();
        type Named = (String, fn(f64) -> f64);
        let (position, correction): (Named, Named) = match a.name.kind() {
            AxisKind::Linear => ((format!("{letter}_mm"), keep), (format!("c{letter}_um"), mm_from_um)),
            AxisKind::Rotary => {
                ((format!("{letter}_deg"), rad_from_deg), (format!("c{letter}_arcsec"), rad_from_arcsec))
            }
        };
        for ((name, to_inner), list) in [(position, &mut positions), (correction, &mut corrections)] {
            list.extend(table.find(&name).map(|index| Column { index, axis, to_inner }));
            known.push(name);
        }
    }
    let tool = ["tool_x_mm", "tool_y_mm", "tool_z_mm"].map(|n| (n, table.find(n)));
    let seen = ["dx_um", "dy_um", "dz_um"].map(|n| (n, table.find(n)));
    known.extend(tool.iter().chain(&seen).map(|(n, _)| (*n).to_owned()));
    if let Some(i) = table.columns().iter().position(|c| !known.contains(c)) {
        let near = nearest(&table.columns()[i], known.iter().map(String::as_str));
        let hint =
            near.map_or_else(|| format!("columns are {}", known.join(", ")), |n| format!("is {n} meant?"));
        return Err(table.fail(i, format_args!("unknown column; {hint}")));
    }
    let given = tool.iter().filter(|(_, i)| i.is_some()).count();
    if given != 0 && given != 3 {
        return Err(Failure::data(path, "give all of tool_x_mm, tool_y_mm, tool_z_mm, or none"));
    }
    if seen.iter().all(|(_, i)| i.is_none()) {
        return Err(Failure::data(path, "no column with a deviation: dx_um, dy_um or dz_um"));
    }
    let mut rows = Vec::new();
    while table.advance()? {
        let number = |c: &Column| table.number(c.index).map(c.to_inner);
        let mut row = Row {
            position: [0.0; MAX_AXES],
            correction: [0.0; MAX_AXES],
            tip: spec.tool_tip,
            deviation: [None; 3],
        };
        for c in &positions {
            row.position[c.axis] = number(c)?;
        }
        for c in &corrections {
            row.correction[c.axis] = number(c)?;
        }
        for (i, (_, column)) in tool.iter().enumerate() {
            if let Some(column) = column {
                row.tip[i] = table.number(*column)?;
            }
        }
        for (i, (_, column)) in seen.iter().enumerate() {
            if let Some(column) = column {
                row.deviation[i] = Some(mm_from_um(table.number(*column)?));
            }
        }
        rows.push(row);
    }
    Ok(rows)
}

/// The poses to measure next, with the corrections that the model so far asks for.
fn write_poses(chain: &Chain, axis: AxisName, path: &Path, args: &Args) -> Result<(), Failure> {
    let spec = chain.spec();
    let planned = plan(chain, axis, args.positions, args.lever_mm)
        .map_err(|e| Failure::new(EX_USAGE, format_args!("error: --next: {e}")))?;
    let model = Model::new(spec).map_err(|e| Failure::new(EX_CONFIG, format_args!("error: {e}")))?;
    let axes: Vec<AxisName> = spec.chain.axes().iter().map(|a| a.name).collect();
    let (mut header, mut tail) = (Vec::new(), Vec::new());
    for a in &axes {
        let (unit, small) = if a.kind() == AxisKind::Linear { ("mm", "um") } else { ("deg", "arcsec") };
        header.push(format!("{}_{unit}", a.lower()));
        tail.push(format!("c{}_{small}", a.lower()));
    }
    header.extend(["tool_x_mm", "tool_y_mm", "tool_z_mm"].map(str::to_owned));
    header.extend(tail);
    let mut text = header.join(",") + "\n";
    for p in &planned {
        let pose = Pose { tool_tip: Some(p.tip), ..Pose::at(p.position) };
        let correction = model.correct(&pose).1.offset;
        let both = |values: &AxisArray, linear: fn(f64) -> f64, rotary: fn(f64) -> f64| {
            let one = |(k, a): (usize, &AxisName)| {
                if a.kind() == AxisKind::Linear { linear(values[k]) } else { rotary(values[k]) }
            };
            axes.iter().enumerate().map(one).collect::<Vec<f64>>()
        };
        let mut fields = both(&p.position, |v| v, deg_from_rad);
        fields.extend(p.tip.iter());
        fields.extend(both(&correction, um_from_mm, arcsec_from_rad));
        let words: Vec<String> = fields.iter().map(|v| short(*v)).collect();
        text.push_str(&words.join(","));
        text.push('\n');
    }
    let mut output = Output::create(path)?;
    output.write_all(text.as_bytes()).map_err(|e| Failure::io(path, &e))?;
    output.finish()?;
    note!("poses written: {} ({} for axis {axis})", path.display(), planned.len());
    Ok(())
}

/// A number with a resolution of 1e-9 and no trailing zeros.
fn short(value: f64) -> String {
    let text = format!("{value:.9}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" { "0".to_owned() } else { text.to_owned() }
}

fn write_model(args: &Args, mut file: ModelFile, chain: &Chain) -> Result<(), Failure> {
    let files: Vec<PathBuf> = args.step.iter().map(|(_, p)| p.clone()).collect();
    let sources = Sources::of(&files);
    for (step, found) in chain.steps().iter().enumerate() {
        let from = sources.only(|i| i == step).provenance();
        let locations = found.locations.iter().map(|(s, ..)| *s);
        for symbol in found.motions.iter().map(|m| m.symbol).chain(locations) {
            if let Some((_, function)) = chain.spec().errors.iter().find(|(s, _)| *s == symbol) {
                put(&mut file, symbol, function.clone(), from.clone());
            }
        }
        // what the model held of this axis before was replaced
        file.spec
            .errors
            .retain(|(s, _)| s.axis() != found.axis || chain.spec().errors.iter().any(|(kept, _)| kept == s));
    }
    if let Some(machine) = &args.out.machine {
        file.spec.machine.clone_from(machine);
    }
    let names: Vec<String> = files.iter().map(|p| p.display().to_string()).collect();
    args.out.write(&file, &sources.comments(), &names.join(", "))
}

fn set_up(found: &Found) -> &'static str {
    match found.set_up {
        SetUp::Rigid => "rigid",
        SetUp::ShiftOnly => "shift-only",
    }
}

/// Lengths in um, angles in arcsec.
fn as_json(chain: &Chain) -> Value {
    let steps: Vec<Value> = chain.steps().iter().map(step_json).collect();
    json!({"chain": chain.spec().chain.to_string(), "steps": steps})
}

fn step_json(found: &Found) -> Value {
    let known = found.sigma.is_some();
    let um = |v: f64| known.then(|| um_from_mm(v));
    let position = |q: &f64| if found.axis.kind() == AxisKind::Rotary { deg_from_rad(*q) } else { *q };
    let mut motions = Map::new();
    for m in &found.motions {
        let (unit, scale) = unit_of(m.symbol);
        let name = m.symbol.to_string().to_lowercase();
        let part = |f: &dyn Fn(&volcomp_identify::grinder::Shares) -> f64| -> Option<Vec<f64>> {
            known.then(|| m.std.iter().map(|s| scale(f(s))).collect())
        };
        motions.insert(
            name,
            json!({
                format!("value_{unit}"): m.values.iter().map(|v| scale(*v)).collect::<Vec<f64>>(),
                format!("own_{unit}"): part(&|s| s.own),
                format!("inherited_{unit}"): part(&|s| s.inherited),
            }),
        );
    }
    let locations: Map<String, Value> = found
        .locations
        .iter()
        .map(|(s, value, std)| {
            let (unit, scale) = unit_of(*s);
            let entry = json!({"value": scale(*value), "std": known.then(|| scale(*std)), "unit": unit});
            (s.to_string().to_lowercase(), entry)
        })
        .collect();
    let unit = if found.axis.kind() == AxisKind::Rotary { "deg" } else { "mm" };
    json!({
        "axis": found.axis.lower().to_string(),
        format!("position_{unit}"): found.positions.iter().map(position).collect::<Vec<f64>>(),
        "reference": found.reference,
        "motions": motions,
        "locations": locations,
        "set_up": set_up(found),
        "readings": found.readings,
        "dof": found.dof,
        "noise_um": found.sigma.map(um_from_mm),
        "rms_um": um_from_mm(found.rms),
        "expected_rms_um": found.expected_rms.map(um_from_mm),
        "p_value": found.p_value,
        "own_um": um(found.tip.own),
        "inherited_um": um(found.tip.inherited),
        "total_um": um(found.tip.total()),
        "chain_um": um(found.chain),
        "condition": found.condition,
    })
}

fn unit_of(symbol: ErrorSymbol) -> (&'static str, fn(f64) -> f64) {
    if symbol.is_angle() { ("arcsec", arcsec_from_rad) } else { ("um", um_from_mm) }
}

fn print(chain: &Chain) {
    say!(
        "{}, measured in the order of the rows. Uncertainty of the tool tip (k = 1) in um:",
        chain.spec().chain
    );
    say!(
        "{:<5}{:>10}{:>9}{:>9}{:>9}{:>11}{:>9}{:>14}{:>9}{:>11}",
        "step",
        "positions",
        "readings",
        "noise",
        "own",
        "inherited",
        "total",
        "chain so far",
        "rms",
        "expected"
    );
    for found in chain.steps() {
        let show = |v: f64| found.sigma.map_or_else(|| "-".to_owned(), |_| format!("{:.3}", um_from_mm(v)));
        say!(
            "{:<5}{:>10}{:>9}{:>9}{:>9}{:>11}{:>9}{:>14}{:>9.3}{:>11}",
            found.axis.to_string(),
            found.positions.len(),
            found.readings,
            show(found.sigma.unwrap_or(0.0)),
            show(found.tip.own),
            show(found.tip.inherited),
            show(found.tip.total()),
            show(found.chain),
            um_from_mm(found.rms),
            found.expected_rms.map_or_else(|| "-".to_owned(), |v| format!("{:.3}", um_from_mm(v))),
        );
    }
    for found in chain.steps() {
        say!();
        print_step(found);
    }
    say!();
    say!(
        "Assumed: axes not yet measured stand still; the artefact is rigid and lies anywhere (one set-up per file);"
    );
    say!("all motions are zero at the reference position; straight lines between positions; tips as stated.");
}

fn print_step(found: &Found) {
    let reference = found.positions[found.reference];
    let reference = match found.axis.kind() {
        AxisKind::Linear => format!("{reference:.3} mm"),
        AxisKind::Rotary => format!("{:.3} deg", deg_from_rad(reference)),
    };
    say!("axis {}: zero at {reference}, condition {:.1}", found.axis, found.condition);
    for m in &found.motions {
        let (unit, scale) = unit_of(m.symbol);
        let (low, high) =
            m.values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(*v), h.max(*v)));
        let worst = m.std.iter().map(|s| s.total()).fold(0.0, f64::max);
        let std = found.sigma.map_or_else(String::new, |_| format!("  +- {:.3}", scale(worst)));
        say!("  {:<6}{:>10.3} to {:>9.3} {unit:<7}{std}", m.symbol.to_string(), scale(low), scale(high));
    }
    for (symbol, value, std) in &found.locations {
        let (unit, scale) = unit_of(*symbol);
        let std = found.sigma.map_or_else(String::new, |_| format!("  +- {:.3}", scale(*std)));
        say!("  {:<6}{:>10.3}              {unit:<7}{std}", symbol.to_string(), scale(*value));
    }
    if found.set_up == SetUp::ShiftOnly {
        say!("  the artefact is taken to lie parallel to the axes: the readings cannot show its turn");
    }
    if let Some(p) = found.p_value {
        let verdict =
            if p < 0.01 { "the tips of a pose disagree by more than the stated noise" } else { "rigid" };
        say!("  rigidity: probability {p:.3}, {verdict}");
    }
    if let Some(expected) = found.expected_rms.filter(|e| found.rms > 2.0 * e) {
        say!(
            "  left over {:.2} um against {:.2} um expected: earlier axes are not as well known as stated, or do not repeat",
            um_from_mm(found.rms),
            um_from_mm(expected)
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_and_motions_are_read() {
        assert_eq!(assignment("a=x/a.csv"), Ok((AxisName::A, PathBuf::from("x/a.csv"))));
        for wrong in ["a", "q=f", "ab=f", "a="] {
            assert!(assignment(wrong).is_err(), "{wrong}");
        }
        assert_eq!(components("all").unwrap().0.len(), 6);
        assert_eq!(components("b,x").unwrap().0, [Component::X, Component::B]);
        assert!(components("x,q").is_err());
    }

    #[test]
    fn numbers_are_short() {
        assert_eq!([short(-0.0), short(1.5), short(1e-9), short(-3.0)], ["0", "1.5", "0.000000001", "-3"]);
    }
}
