//! `evaluate gear`: profile and helix (lead) deviations of an involute gear.

use super::page;
use super::picture::gear::{self as drawing, Panel};
use super::{Output, change, percent, show};
use crate::prelude::*;
use volcomp_evaluate::gear::{
    CLASSES, Deviations, Direction, Flank, Gear, GearTrace, OfFlank, Quantity, class, class_of, flanks,
    tolerance_um,
};

/// Involute gear by ISO 1328-1: profile and helix (lead) deviations and their tolerance classes
///
/// Deviations are those of the flank, normal to it in the transverse plane, plus = excess of material. Positions are roll
/// lengths from the base circle (profile) or distances from the datum face (lead). Readings of several passes at one
/// position are averaged; every tooth is evaluated by itself; the figures are means over the teeth, slopes with their sign.
#[derive(Debug, clap::Parser)]
pub(crate) struct Args {
    /// CSV with direction (profile or lead), flank (left or right), tooth, position_mm, deviation_um and optional pass; - is stdin.
    #[arg(long, value_name = "FILE", required_unless_present = "file")]
    data: Option<PathBuf>,
    /// The same gear measured at an earlier time, to compare with.
    #[arg(long, value_name = "FILE")]
    before: Option<PathBuf>,
    /// Number of teeth z.
    #[arg(long, value_name = "Z")]
    teeth: u32,
    /// Normal module.
    #[arg(long, value_name = "MM", value_parser = above_zero)]
    module_mm: f64,
    /// Normal pressure angle.
    #[arg(long, value_name = "DEG", default_value_t = 20.0, value_parser = above_zero)]
    pressure_angle_deg: f64,
    /// Helix angle at the reference diameter.
    #[arg(long, value_name = "DEG", default_value_t = 0.0, value_parser = number, allow_hyphen_values = true)]
    helix_angle_deg: f64,
    /// Face width.
    #[arg(long, value_name = "MM", value_parser = above_zero)]
    face_width_mm: f64,
    /// Tip diameter.
    #[arg(long, value_name = "MM", value_parser = above_zero)]
    tip_diameter_mm: f64,
    /// Profile control diameter: where the functional profile begins.
    #[arg(long, value_name = "MM", value_parser = above_zero)]
    control_diameter_mm: f64,
    #[command(flatten)]
    output: Output,
}

/// Quantities: beginning of the key, beginning of the symbol.
const QUANTITIES: [(Quantity, &str, &str); 3] =
    [(Quantity::Total, "f", "F"), (Quantity::Form, "ff", "f_f"), (Quantity::Slope, "fh", "f_H")];

fn gear(args: &Args) -> Result<Gear> {
    let gear = Gear {
        teeth: args.teeth,
        module_mm: args.module_mm,
        pressure_angle: rad_from_deg(args.pressure_angle_deg),
        helix_angle: rad_from_deg(args.helix_angle_deg),
        face_width_mm: args.face_width_mm,
        tip_diameter_mm: args.tip_diameter_mm,
        control_diameter_mm: args.control_diameter_mm,
    };
    gear.check().map_err(Failure::usage)?;
    Ok(gear)
}

/// All flanks of a file, profiles first.
fn read(gear: &Gear, path: &Path) -> Result<Vec<OfFlank>> {
    let mut table = table::open(path)?;
    let [direction, flank, tooth] =
        [table.require("direction")?, table.require("flank")?, table.require("tooth")?];
    let [position, deviation] = [table.require("position_mm")?, table.require("deviation_um")?];
    table.only(&["direction", "flank", "tooth", "pass", "position_mm", "deviation_um"])?;
    let readings = table.some_rows(|table| {
        let (word, side) = (table.word(direction), table.word(flank));
        let along = Direction::ALL.into_iter().find(|d| d.name() == word);
        let along = along
            .ok_or_else(|| table.fail(direction, format_args!("'{word}' is neither profile nor lead")))?;
        let of = Flank::ALL.into_iter().find(|f| f.name() == side);
        let of = of.ok_or_else(|| table.fail(flank, format_args!("'{side}' is neither left nor right")))?;
        Ok((along, of, table.count(tooth)?, table.number(position)?, table.number(deviation)?))
    })?;
    flanks(gear, &readings).map_err(|(direction, e)| data!(path, "{}: {e}", direction.name()))
}

pub(super) fn run(args: &Args) -> Result<()> {
    let acceptance = Acceptance::load(&args.output.head, "", &[])?;
    let judged = Judged { acceptance, figures: Vec::new() };
    let gear = gear(args)?;
    let after = read(&gear, args.output.data(&args.data))?;
    let before = args.before.as_deref().map(|path| read(&gear, path)).transpose()?;
    let title = args.output.title("Gear inspection");
    let panels = |flanks: &[OfFlank]| flanks.iter().map(|f| panel(&gear, f)).collect::<Vec<_>>();
    let shown: Vec<(&str, Vec<Panel>)> = match &before {
        Some(before) => vec![("before", panels(before)), ("after", panels(&after))],
        None => vec![("", panels(&after))],
    };
    let old = before.as_ref().map(|b| lines(&gear, b));
    let table = figures(&lines(&gear, &after), old.as_deref());
    args.output.deliver(
        &judged,
        || drawing::whole(title, &shown, drawing::step_um(&shown)),
        || report(args, title, &judged, &gear, &table, &shown),
        || (as_json(&gear, &after), before.as_ref().map(|before| as_json(&gear, before))),
        || {
            let traces: usize = after.iter().map(|f| f.teeth.len()).sum();
            let file = args.output.data(&args.data).display();
            say!("ISO 1328-1 of {file}: {traces} traces, means over the teeth");
            table.print();
            for direction in Direction::ALL {
                if let Some(class) = class_of(&gear, &after, direction) {
                    say!("{} class {}", direction.name(), class_text(class));
                }
            }
        },
    )
}

fn panel(gear: &Gear, of: &OfFlank) -> Panel {
    Panel {
        name: format!("{}, {} flank", of.direction.name(), of.flank.name()),
        position: match of.direction {
            Direction::Profile => "roll length / mm",
            Direction::Helix => "face width / mm",
        },
        evaluation: gear.part(of.direction).evaluation,
        traces: of.teeth.iter().map(|(t, d)| (t.tooth, t.readings.clone(), d.mean_line)).collect(),
    }
}

/// A row of the result: symbol, flank, value, tolerance class and its tolerance.
struct Line {
    symbol: String,
    key: String,
    flank: &'static str,
    value_um: f64,
    class: Option<u8>,
    tolerance_um: Option<f64>,
}

fn lines(gear: &Gear, flanks: &[OfFlank]) -> Vec<Line> {
    let of_flank = |f: &OfFlank| {
        let (letter, flank) = (f.direction.letter(), f.flank.name());
        QUANTITIES.map(|(q, key, symbol)| {
            let class = class(gear, f.direction, q, f.mean.of(q));
            Line {
                symbol: if q == Quantity::Total {
                    format!("{symbol}_{letter}")
                } else {
                    format!("{symbol}{letter}")
                },
                key: format!("{flank}_{key}_{letter}_um"),
                flank,
                value_um: f.mean.of(q),
                class,
                tolerance_um: class.map(|c| tolerance_um(gear, f.direction, q, c)),
            }
        })
    };
    flanks.iter().flat_map(of_flank).collect()
}

fn as_json(gear: &Gear, flanks: &[OfFlank]) -> Map<String, Value> {
    let mut out = Map::new();
    for direction in Direction::ALL {
        if let Some(class) = class_of(gear, flanks, direction) {
            out.insert(format!("{}_class", direction.name()), json!(class));
        }
    }
    for line in lines(gear, flanks) {
        out.insert(line.key.replace("_um", "_class"), json!(line.class));
        out.insert(line.key, json!(line.value_um));
    }
    let trace = |f: &OfFlank, (t, d): &(GearTrace, Deviations)| {
        json!({
            "direction": f.direction.name(), "flank": f.flank.name(), "tooth": t.tooth,
            "total_um": d.total_um, "form_um": d.form_um, "slope_um": d.slope_um,
        })
    };
    let traces: Vec<Value> = flanks.iter().flat_map(|f| f.teeth.iter().map(move |t| trace(f, t))).collect();
    out.insert("traces".to_owned(), json!(traces));
    out
}

fn class_text(class: Option<u8>) -> String {
    class.map_or_else(|| format!("> {}", CLASSES[1]), |c| c.to_string())
}

/// The figures with class and tolerance, with those before where there are.
fn figures(after: &[Line], before: Option<&[Line]>) -> Table {
    let mut heads = vec!["deviation", "flank"];
    heads.extend(before.map(|_| [">before / um", ">class"]).into_iter().flatten());
    heads.extend([">um", ">class", ">tolerance / um"]);
    heads.extend(before.map(|_| ">change"));
    let rows = after.iter().map(|line| {
        let mut row = vec![line.symbol.clone(), line.flank.to_owned()];
        let was = before.and_then(|b| b.iter().find(|l| l.key == line.key));
        if before.is_some() {
            let class = was.map_or_else(String::new, |l| class_text(l.class));
            row.extend([show(was.map(|l| l.value_um)), class]);
        }
        let tolerance = line.tolerance_um.map_or_else(|| "-".to_owned(), |t| format!("{t:.1}"));
        row.extend([format!("{:.2}", line.value_um), class_text(line.class), tolerance]);
        let share = || percent(change(was.map(|l| l.value_um.abs()), Some(line.value_um.abs())));
        row.extend(before.map(|_| share()));
        row
    });
    Table::new(heads).rows(rows)
}

fn report(
    args: &Args,
    title: &str,
    judged: &Judged,
    gear: &Gear,
    figures: &Table,
    shown: &[(&'static str, Vec<Panel>)],
) -> Result<String> {
    let [profile, lead] = [Direction::Profile, Direction::Helix].map(|d| gear.part(d).evaluation);
    let Gear { teeth, module_mm, face_width_mm, tip_diameter_mm, control_diameter_mm, .. } = gear;
    let Args { pressure_angle_deg, helix_angle_deg, .. } = args;
    let about = format!(
        "z {teeth}, module {module_mm} mm, pressure angle {pressure_angle_deg} deg, helix angle {helix_angle_deg} deg, \
         face width {face_width_mm} mm, tip diameter {tip_diameter_mm} mm"
    );
    let evaluation = format!(
        "roll length {:.2} to {:.2} mm (control diameter {control_diameter_mm} mm), face width {} to {} mm",
        profile[0], profile[1], lead[0], lead[1]
    );
    let facts = [("gear", about), ("evaluation", evaluation)];
    let standard = "Flank deviations of an involute gear, ISO 1328-1:2013";
    let mut page = args.output.page([&args.data, &args.before], (title, standard), judged, &facts);
    figures.put(&mut page);
    let caption = "Deviation of each tooth (number at the left), excess of material upwards, with its mean line over the \
                   evaluation length (dashed ends). Figures are means over the teeth.";
    let step = drawing::step_um(shown);
    let plot =
        |(heading, panels): &(&'static str, Vec<Panel>)| Ok((*heading, drawing::single(panels, step)?));
    page.plots(&shown.iter().map(plot).collect::<Result<Vec<_>>>()?, caption);
    Ok(page::finish(page, judged))
}
