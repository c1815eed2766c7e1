//! `volcomp identify grinder`: a chain axis by axis, each corrected before the next one is measured.

use crate::identify::prelude::*;
use volcomp_identify::grinder::{
    Chain, Consistency, Curves, Found as Step, Measured, Request, Row, SetUp, Shares, plan,
};
use volcomp_model::Pose;
use volcomp_units::axes::MAX_AXES;

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
pub(crate) struct Args {
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
    #[arg(long, value_name = "UM", value_parser = above_zero)]
    noise_um: Option<f64>,
    /// How the values at the positions become curves, in the model and in the corrections of --next.
    #[arg(long, value_parser = one_of(BASES), default_value = "table")]
    basis: Curves,
    #[command(flatten)]
    out: ModelWriter,
    /// One JSON object on stdout.
    #[arg(long)]
    json: bool,
}

const BASES: &[(&str, &str, Curves)] = &[
    ("table", "Straight lines between the positions: noise of a position stays", Curves::Lines),
    ("auto", "The curve that volcomp fit chooses: noise averages over the positions", Curves::Fitted),
];

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
    match axis_letter(axis) {
        Ok(name) if !path.is_empty() => Ok((name, PathBuf::from(path))),
        _ => Err(format!("'{text}' names no axis and file; write for example a=a.csv")),
    }
}

impl Method for Args {
    fn front(&self) -> Front<'_> {
        Front { file: None, json: self.json, model: Some(&self.out), writes_more: false, case_writes: false }
    }

    fn of_data(&self) -> Result<Option<Box<dyn Found + '_>>> {
        if self.step.is_empty() && self.next.is_none() {
            return Err(usage!("nothing to do; give --step for data, --next for the poses to measure"));
        }
        if self.step.is_empty() && self.out.out.is_some() {
            return Err(usage!("--out needs a --step; without one there is nothing to write"));
        }
        let file = drawing(self)?;
        let mut chain = Chain::new(file.spec.clone());
        let sigma = self.noise_um.map(mm_from_um);
        let request = Request { components: self.motions.0.clone(), sigma, curves: self.basis };
        let mut lines = Vec::new();
        for (axis, path) in &self.step {
            let (of_rows, rows) = read(path, chain.spec())?.into_iter().unzip();
            lines.push(of_rows);
            chain.identify(&Measured { axis: *axis, rows }, &request).map_err(|e| Failure::data(path, e))?;
        }
        if let Some((axis, path)) = &self.next {
            write_poses(&chain, *axis, path, self)?;
        }
        Ok((!self.step.is_empty()).then(|| Box::new(Outcome { args: self, file, chain, lines }) as _))
    }
}

/// The drawing, the model of --into, or a bare chain.
fn drawing(args: &Args) -> Result<ModelFile> {
    match &args.drawing {
        Some(path) => read_model_file(path),
        None => args.out.base(|| "[w A' b X Y B t]".to_owned()),
    }
}

/// Names of the columns of an axis: its coordinate, and the correction added to it.
fn axis_columns(axis: AxisName) -> [String; 2] {
    let (axis, kind) = (axis.lower(), axis.kind());
    [format!("{axis}_{}", kind.position_unit()), format!("c{axis}_{}", kind.offset_unit())]
}

/// Columns of the deviations, without their unit.
const DEVIATIONS: [&str; 3] = ["dx", "dy", "dz"];

/// Columns of the tip.
const TOOL: [&str; 3] = ["tool_x_mm", "tool_y_mm", "tool_z_mm"];

/// Reads the rows of a step, each with its line.
fn read(path: &Path, spec: &ModelSpec) -> Result<Vec<(u64, Row)>> {
    let mut table = table::open(path)?;
    let axes = spec.chain.axes().iter().map(|a| axis_columns(a.name).map(|name| table.find_column(&name)));
    let axes: Vec<[Option<Column>; 2]> = axes.collect();
    let tool = TOOL.map(|n| table.find_column(n));
    let seen = ["dx_um", "dy_um", "dz_um"].map(|n| table.find_column(n));
    table.only_known()?;
    if !matches!(tool.iter().flatten().count(), 0 | 3) {
        return Err(data!(path, "give all of tool_x_mm, tool_y_mm, tool_z_mm, or none"));
    }
    if seen.iter().all(Option::is_none) {
        return Err(data!(path, "no column with a deviation: dx_um, dy_um or dz_um"));
    }
    table.rows(|table| {
        let mut row = Row {
            position: [0.0; MAX_AXES],
            correction: [0.0; MAX_AXES],
            tip: spec.tool_tip,
            deviation: [None; 3],
        };
        for (axis, [position, correction]) in axes.iter().enumerate() {
            row.position[axis] = table.value_or(*position, 0.0)?;
            row.correction[axis] = table.value_or(*correction, 0.0)?;
        }
        for i in 0..3 {
            row.tip[i] = table.value_or(tool[i], row.tip[i])?;
            row.deviation[i] = seen[i].map(|column| table.deviation(column)).transpose()?;
        }
        Ok((table.line(), row))
    })
}

/// The poses to measure next, with the corrections that the model so far asks for.
fn write_poses(chain: &Chain, axis: AxisName, path: &Path, args: &Args) -> Result<()> {
    let spec = chain.spec();
    let planned = plan(chain, axis, args.positions, args.lever_mm).map_err(|e| usage!("--next: {e}"))?;
    let model = Model::new(spec).map_err(|e| failure!(EX_CONFIG, "{e}"))?;
    let axes: Vec<AxisName> = spec.chain.axes().iter().map(|a| a.name).collect();
    let (mut header, tail): (Vec<String>, Vec<String>) =
        axes.iter().map(|a| axis_columns(*a)).map(|[position, correction]| (position, correction)).unzip();
    header.extend(TOOL.map(str::to_owned).into_iter().chain(tail));
    let mut text = header.join(",") + "\n";
    for p in &planned {
        let pose = Pose { tool_tip: Some(p.tip), ..Pose::at(p.position) };
        let correction = model.correct(&pose).1.offset;
        let kinds = || axes.iter().map(|a| a.kind());
        let mut fields: Vec<f64> = kinds().zip(p.position).map(|(kind, v)| kind.position_out(v)).collect();
        fields.extend(p.tip.iter());
        fields.extend(kinds().zip(correction).map(|(kind, v)| kind.offset_out(v)));
        let words = fields.into_iter().map(short).joined(",");
        text.push_str(&(words + "\n"));
    }
    write_text(path, &text)?;
    note!("poses written: {} ({} for axis {axis})", path.display(), planned.len());
    Ok(())
}

/// A number with a resolution of 1e-9 and no trailing zeros.
fn short(value: f64) -> String {
    let text = format!("{value:.9}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" { "0".to_owned() } else { text.to_owned() }
}

/// The chain as far as it was measured.
struct Outcome<'a> {
    args: &'a Args,
    /// The model before.
    file: ModelFile,
    chain: Chain,
    /// Lines of the rows of every step.
    lines: Vec<Vec<u64>>,
}

impl Outcome<'_> {
    /// What needs attention in a step.
    fn warn_of(&self, step: usize, found: &Step) {
        let Some(test) = found.consistency.filter(|c| c.p_value < SIGNIFICANT) else { return };
        let path = self.args.step[step].1.display();
        let [rms, expected, worst] =
            [found.rms, found.expected_rms.unwrap_or(0.0), found.worst.residual].map(um_from_mm);
        let before: Vec<String> = self.chain.steps()[..step].iter().map(|s| s.axis.to_string()).collect();
        let cause = if found.p_value.is_some_and(|p| p < SIGNIFICANT) {
            "the tips of a pose disagree by more than the stated noise; is a tip misplaced, or --noise-um too small?".to_owned()
        } else if before.is_empty() {
            "is a reading wrong, or --noise-um too small?".to_owned()
        } else {
            let basis = if self.args.basis == Curves::Fitted {
                ", or the fitted curve of one leaves out part of its motion (--basis table)"
            } else {
                ""
            };
            format!(
                "the step contradicts those before it ({}): a sign or a correction of one of them is wrong, or an axis does not \
                 repeat{basis}",
                before.join(" ")
            )
        };
        let Consistency { factor, enlarged, p_value, .. } = test;
        let (axis, p, line) = (found.axis, small(p_value), self.lines[step][found.worst.row]);
        let direction = DEVIATIONS[found.worst.direction];
        note!(
            "warning: {path}: step of axis {axis}: residuals of {rms:.2} um rms, {factor:.1} times the {expected:.2} um expected \
             (p {p}), the largest in line {line}: {direction} {worst:+.2} um; {cause}"
        );
        let others = if before.is_empty() { "" } else { " and of the axes before that move in this step" };
        note!("note: the uncertainties of axis {axis}{others} are enlarged by {enlarged:.1}");
    }
}

impl Found for Outcome<'_> {
    fn warn(&self) {
        self.chain.steps().iter().enumerate().for_each(|(i, found)| self.warn_of(i, found));
    }

    /// Lengths in um, angles in arcsec.
    fn json(&self) -> Value {
        let steps = self.chain.steps().iter().zip(&self.lines);
        let steps: Value = steps.map(|(found, lines)| step_json(found, lines)).collect();
        json!({"chain": self.chain.spec().chain.to_string(), "steps": steps})
    }

    fn print(&self) {
        let chain = &self.chain;
        let axes = &chain.spec().chain;
        say_text!("{axes}, measured in the order of the rows. Uncertainty of the tool tip (k = 1) in um:");
        say!(
            "step  positions readings    noise      own  inherited    total  chain so far      rms   expected"
        );
        for found in chain.steps() {
            let show = |v: f64| or_dash(found.sigma.map(|_| um_from_mm(v)), 3);
            let [noise, own, inherited, total, so_far] = [
                found.sigma.unwrap_or(0.0),
                found.tip.own,
                found.tip.inherited,
                found.tip.total(),
                found.chain,
            ]
            .map(show);
            let (axis, positions, readings) = (found.axis.to_string(), found.positions.len(), found.readings);
            let rms = um_from_mm(found.rms);
            let expected = or_dash(found.expected_rms.map(um_from_mm), 3);
            say!(
                "{axis:<5}{positions:>10}{readings:>9}{noise:>9}{own:>9}{inherited:>11}{total:>9}{so_far:>14}{rms:>9.3}{expected:>11}"
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
        say!(
            "all motions are zero at the reference position; straight lines between positions; tips as stated."
        );
    }

    fn write(&self, _end: &mut String) -> Result<()> {
        let (args, chain, mut file) = (self.args, &self.chain, self.file.clone());
        let files: Vec<PathBuf> = args.step.iter().map(|(_, p)| p.clone()).collect();
        let sources = Sources::of(&files);
        for (step, found) in chain.steps().iter().enumerate() {
            let from = sources.only(|i| i == step).provenance();
            let locations = found.locations.iter().map(|(s, ..)| *s);
            for symbol in found.motions.iter().map(|m| m.symbol).chain(locations) {
                if let Some(function) = chain.spec().error(symbol) {
                    file.put(symbol, function.clone(), from.clone());
                }
            }
            // what the model held of this axis before was replaced
            file.spec.errors.retain(|(s, _)| {
                s.axis() != found.axis || chain.spec().errors.iter().any(|(kept, _)| kept == s)
            });
        }
        if let Some(machine) = &args.out.machine {
            file.spec.machine.clone_from(machine);
        }
        args.out.write_from(Some(&self.file.spec), &file, &sources.comments(), &files)
    }
}

/// The reference position or another of a step, in mm or deg.
fn position(found: &Step, q: f64) -> f64 {
    found.axis.kind().position_out(q)
}

fn step_json(found: &Step, lines: &[u64]) -> Value {
    let known = found.sigma.is_some();
    let um = |v: f64| known.then(|| um_from_mm(v));
    let (mut motions, mut locations) = (json!({}), json!({}));
    for m in &found.motions {
        let units = Units::of(m.symbol);
        let part = |f: fn(&Shares) -> f64| -> Option<Vec<f64>> {
            known.then(|| m.std.iter().map(|s| (units.of_value)(f(s))).collect())
        };
        motions[key(m.symbol)] = json!({
            format!("value_{}", units.value): units.values(&m.values),
            format!("own_{}", units.value): part(|s| s.own),
            format!("inherited_{}", units.value): part(|s| s.inherited),
        });
    }
    for (symbol, value, std) in &found.locations {
        let Units { value: unit, of_value, .. } = Units::of(*symbol);
        let std = known.then(|| of_value(*std));
        locations[key(*symbol)] = json!({"value": of_value(*value), "std": std, "unit": unit});
    }
    let unit = found.axis.kind().position_unit();
    fields!(found; reference, readings, dof, p_value, condition;
        "axis": found.axis.lower().to_string(),
        "consistent": found.consistency.is_none_or(|c| c.p_value >= SIGNIFICANT),
        format!("position_{unit}"): found.positions.iter().map(|q| position(found, *q)).collect::<Vec<_>>(),
        "motions": motions,
        "locations": locations,
        "set_up": if found.set_up == SetUp::Rigid { "rigid" } else { "shift-only" },
        "noise_um": found.sigma.map(um_from_mm),
        "rms_um": um_from_mm(found.rms),
        "expected_rms_um": found.expected_rms.map(um_from_mm),
        "consistency": found.consistency.map(|c| {
            fields!(c; p_value, factor, enlarged; "passed": c.p_value >= SIGNIFICANT)
        }),
        "worst": json!({
            "line": lines[found.worst.row],
            "direction": DEVIATIONS[found.worst.direction],
            "residual_um": um_from_mm(found.worst.residual),
        }),
        "own_um": um(found.tip.own),
        "inherited_um": um(found.tip.inherited),
        "total_um": um(found.tip.total()),
        "chain_um": um(found.chain),
    )
}

fn print_step(found: &Step) {
    let unit = found.axis.kind().position_unit();
    let reference = position(found, found.positions[found.reference]);
    say_text!("axis {}: zero at {reference:.3} {unit}, condition {:.1}", found.axis, found.condition);
    let plus_minus = |v: f64| found.sigma.map_or_else(String::new, |_| format!("  +- {v:.3}"));
    for m in &found.motions {
        let Units { value: unit, of_value, .. } = Units::of(m.symbol);
        let worst = m.std.iter().map(Shares::total).fold(0.0, f64::max);
        let ([low, high], std) = (hull(m.values.iter().copied()).map(of_value), plus_minus(of_value(worst)));
        say_text!("  {:<6}{low:>10.3} to {high:>9.3} {unit:<7}{std}", m.symbol);
    }
    for (symbol, value, std) in &found.locations {
        let Units { value: unit, of_value, .. } = Units::of(*symbol);
        say_text!(
            "  {symbol:<6}{:>10.3}              {unit:<7}{}",
            of_value(*value),
            plus_minus(of_value(*std))
        );
    }
    if found.set_up == SetUp::ShiftOnly {
        say!("  the artefact is taken to lie parallel to the axes: the readings cannot show its turn");
    }
    if let Some(p) = found.p_value {
        let verdict =
            if p < 0.01 { "the tips of a pose disagree by more than the stated noise" } else { "rigid" };
        say!("  rigidity: probability {p:.3}, {verdict}");
    }
    if let Some(Consistency { p_value: p, factor, .. }) = found.consistency {
        let verdict = if p < SIGNIFICANT { "FAILED" } else { "passed" };
        say!("  consistency: probability {p:.3}, rms {factor:.2} times the expected one: {verdict}");
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
