//! `volcomp identify threepoint --plan`: points and runs for a wanted uncertainty.

use super::{Args, read};
use crate::identify::prelude::*;
use volcomp_identify::threepoint::{Plan, PlanRequest, PlanRow, plan as make};

/// The three angular error motions.
const ANGLES: [&str; 3] = ["ea", "eb", "ec"];

/// Numbers of a plan.
#[derive(Debug, clap::Args)]
pub(super) struct PlanArgs {
    /// Plan the measurement instead of evaluating one: the best of --points and the runs they need for --target-arcsec.
    #[arg(long, conflicts_with_all = ["data", "input", "rigidity"], requires_all = ["points", "axis", "travel_mm", "tracker_mm", "target_arcsec"])]
    pub(super) plan: bool,
    /// Bound of the error of an angle.
    #[arg(long, value_name = "ARCSEC", value_parser = above_zero, requires = "plan")]
    target_arcsec: Option<f64>,
    /// Probability with which all positions together keep it.
    #[arg(long, value_name = "P", default_value_t = 95.0, value_parser = confidence)]
    confidence_percent: f64,
    /// Angles that must reach it.
    #[arg(long, value_name = "ANGLES", value_delimiter = ',', value_parser = ANGLES, default_value = "ea,eb,ec")]
    angles: Vec<String>,
    /// Travel that is measured.
    #[arg(long, value_name = "LOW,HIGH", value_parser = range, requires = "plan", allow_hyphen_values = true)]
    travel_mm: Option<[f64; 2]>,
    /// Stops over the travel, ends included.
    #[arg(long, value_name = "N", default_value_t = 21, value_parser = clap::value_parser!(u32).range(2..=1000))]
    stops: u32,
    /// Standard deviation of the part of the angles that is the same in every run (encoder, refraction).
    #[arg(long, value_name = "ARCSEC", default_value = "0", value_parser = not_negative)]
    systematic_angle_arcsec: f64,
}

/// `0,850`.
fn range(text: &str) -> Result<[f64; 2], String> {
    numbers(text).filter(|[low, high]| low < high).ok_or_else(|| {
        format!("invalid range '{text}'; expected two numbers, the smaller first, such as 0,850")
    })
}

fn confidence(text: &str) -> Result<f64, String> {
    let percent = text.parse().ok().filter(|p| (50.0..=99.9999).contains(p));
    percent.ok_or_else(|| format!("invalid confidence '{text}'; expected 50 to 99.9999"))
}

pub(super) fn run(args: &Args) -> Result<Box<dyn Found + '_>> {
    let p = &args.plan;
    let (Some(points), Some(axis), Some([low, high]), Some(station), Some(target)) =
        (&args.points, args.axis, p.travel_mm, args.tracker.tracker_mm, p.target_arcsec)
    else {
        return Err(usage!("--plan needs --points, --axis, --travel-mm, --tracker-mm and --target-arcsec"));
    };
    let Some(noise) = args.tracker.stated_noise() else {
        return Err(usage!("--plan needs --sigma-range-um and --sigma-angle-arcsec"));
    };
    let base = args.curves.model.base(|| default_chain([axis]))?;
    let named = read::points(points)?;
    let step = (high - low) / f64::from(p.stops - 1);
    let request = PlanRequest {
        points: named.iter().map(|n| n.1).collect(),
        origin: args.origin_mm,
        axis,
        workpiece_side: base.spec.is_workpiece_side(axis),
        positions: (0..p.stops).map(|i| low + step * f64::from(i)).collect(),
        station,
        noise,
        systematic_angle: rad_from_arcsec(p.systematic_angle_arcsec),
        target: rad_from_arcsec(target),
        confidence: p.confidence_percent / 100.0,
        wanted: ANGLES.map(|a| p.angles.iter().any(|w| w == a)),
    };
    let plan = make(&request).map_err(|e| Failure::data(points, e))?;
    let names: Vec<String> = named.into_iter().map(|n| n.0).collect();
    Ok(printed(as_json(&plan, &request, &names), move || print(&plan, &request, &names, p)))
}

fn chosen<'a>(row: &'a PlanRow, names: &'a [String]) -> Vec<&'a str> {
    row.chosen.iter().map(|i| names[*i].as_str()).collect()
}

fn as_json(plan: &Plan, request: &PlanRequest, names: &[String]) -> Value {
    let row = |r: &PlanRow| {
        json!({
            "points": chosen(r, names),
            "single_std": r.single,
            "floor_std": r.floor,
            "runs": r.runs,
            "runs_for_angles": r.runs_for(&request.wanted),
            "condition_centroid": r.geometry.condition_centroid,
        })
    };
    let best = plan.best.map(|i| &plan.rows[i]);
    json!({
        "coverage": plan.coverage,
        "positions": request.positions.len(),
        "rows": plan.rows.iter().map(row).collect::<Vec<_>>(),
        "best": best.map(|r| json!({"points": chosen(r, names), "runs": r.runs_for(&request.wanted)})),
    })
}

fn print(plan: &Plan, request: &PlanRequest, names: &[String], asked: &PlanArgs) {
    let target = asked.target_arcsec.unwrap_or_default();
    let count = request.positions.len();
    let [first, last] =
        [request.positions[0], request.positions[count - 1]].map(|q| request.distance(q) / 1e3);
    let (near, far) = (first.min(last), first.max(last));
    let (axis, confidence, k) = (request.axis, asked.confidence_percent, plan.coverage);
    say!(
        "{axis} at {count} positions, tracker {near:.1} to {far:.1} m away; target {target} arcsec at every position ({confidence} %, k = {k:.2})"
    );
    say!();
    let angles = ANGLES.map(|a| format!("{}{axis}", a.to_uppercase()));
    let [a, b, c] = angles.each_ref().map(|name| format!("std {name}"));
    say!("points  {a:>9}{b:>9}{c:>9}     runs   runs   runs  points");
    for r in &plan.rows {
        let [sa, sb, sc] = r.single.map(arcsec_from_rad);
        let [na, nb, nc] = r.runs.map(|runs| or_dash(runs.map(f64::from), 0));
        let (n, points) = (r.chosen.len(), chosen(r, names).join(" "));
        say!("{n:>6}  {sa:>9.2}{sb:>9.2}{sc:>9.2}  {na:>7}{nb:>7}{nc:>7}  {points}");
    }
    say!();
    say!(
        "std: one reading of every point, largest over the travel, arcsec; runs: there and back; -: not reachable"
    );
    let wanted =
        angles.iter().zip(request.wanted).filter(|(_, wanted)| *wanted).map(|(name, _)| name.as_str());
    let wanted = wanted.joined(" ");
    match plan.best.map(|i| &plan.rows[i]) {
        Some(row) => {
            let (runs, n) = (row.runs_for(&request.wanted).unwrap_or(1), row.chosen.len());
            let readings = 2 * u64::from(runs) * n as u64 * count as u64;
            let points = chosen(row, names).join(" ");
            say!("fewest readings for {wanted}: {n} points ({points}), {runs} runs, {readings} readings");
        }
        None => note!(
            "warning: {wanted} cannot reach {target} arcsec with these points and this station; place points further apart across the beam, \
             move the tracker into the line of the axis (the range then carries pitch and yaw), or use another instrument"
        ),
    }
    if request.systematic_angle == 0.0 {
        note!(
            "note: runs average noise only; state what is the same in every run with --systematic-angle-arcsec"
        );
    }
}
