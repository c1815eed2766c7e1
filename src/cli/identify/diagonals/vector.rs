//! A case of the reference vectors: displacements in mm, the axis errors at the ends of the box, squareness in rad.

use super::{Args, by_name};
use crate::identify::prelude::*;
use volcomp_identify::diagonals::{DiagonalsError, SQUARENESS, Setup};
use volcomp_model::curve::{Interpolation, Table};

#[derive(Deserialize)]
struct Case {
    chain: String,
    #[serde(rename = "box")]
    cuboid: [f64; 3],
    #[serde(default)]
    tool_tip: [f64; 3],
    axis_errors_at_box_ends: Option<Errors>,
    displacement: Displacement,
}

/// By axis.
type Errors = BTreeMap<String, Ends>;

#[derive(Deserialize)]
struct Ends {
    at_0: [f64; 6],
    at_travel: [f64; 6],
}

#[derive(Deserialize)]
struct Displacement {
    ppp: f64,
    npp: f64,
    pnp: f64,
    ppn: f64,
}

/// What the errors of a case hold.
#[derive(Clone, Copy, Default)]
struct Holds {
    angles: bool,
    straightness: bool,
}

pub(super) fn run(args: &Args, file: CaseFile<'_>) -> Result<Box<dyn Found>> {
    let case: Case = file.read()?;
    let bad = |e: DiagonalsError| file.bad(e);
    let chain = Chain::parse(&case.chain).map_err(|e| file.bad(format_args!("chain: {e}")))?;
    let setup = Setup::new(&chain, [0.0; 3], case.cuboid, Vec3::from(case.tool_tip)).map_err(bad)?;
    let d = &case.displacement;
    let measured = [d.ppp, d.npp, d.pnp, d.ppn];
    let (mut json, mut corrected) = (json!({}), measured);
    // end-to-end values know the end-point lines only, whatever lines the straightness refers to
    let mut end_points = None;
    let less = |model: [f64; 4]| core::array::from_fn(|i| measured[i] - model[i]);
    match &case.axis_errors_at_box_ends {
        Some(errors) => {
            let (mut spec, holds) = case_model(&chain, case.cuboid, errors).map_err(|e| file.bad(e))?;
            if holds.angles {
                let model = setup.displacements(&spec, Travel::Forward).map_err(bad)?;
                corrected = less(model);
                let biased = setup.squareness(&measured, &[0.0; 4]).map_err(bad)?;
                json["model_displacement_without_squareness_first_order"] = by_name(model);
                json["squareness_without_subtraction"] = squareness_object(biased.value);
            }
            if holds.straightness {
                spec.errors.retain(|(symbol, _)| is_angle(symbol));
                end_points = Some(less(setup.displacements(&spec, Travel::Forward).map_err(bad)?));
            }
        }
        None if args.accept_bias_arcsec.is_none() => {
            return Err(file.bad(
                "no axis_errors_at_box_ends: squareness needs the angular errors of all axes, or a bound with --accept-bias-arcsec",
            ));
        }
        None => {}
    }
    let found = setup.squareness(&corrected, &[0.0; 4]).map_err(bad)?;
    json["squareness"] = squareness_object(found.value);
    json["common"] = json!(found.common);
    let per_um = setup.sensitivity().map(|s| s * mm_from_um(1.0));
    json["sigma_squareness_per_sigma_1um"] = squareness_object(per_um);
    if let Some(displacement) = end_points {
        let lines = setup.squareness(&displacement, &[0.0; 4]).map_err(bad)?;
        json["squareness_of_end_point_lines_first_order"] = squareness_object(lines.value);
    }
    if let Some(bound) = args.accept_bias_arcsec {
        json["bias_bound_arcsec"] = json!(bound);
    }
    Ok(printed(json, move || {
        for (symbol, value) in SQUARENESS.into_iter().zip(found.value) {
            say!("{symbol:<6}{:>12.3} arcsec", arcsec_from_rad(value));
        }
    }))
}

/// True for an angular error motion.
fn is_angle(symbol: &ErrorSymbol) -> bool {
    matches!(symbol, ErrorSymbol::Motion { component, .. } if component.is_angle())
}

fn squareness_object(values: [f64; 3]) -> Value {
    json!({ "C0Y": values[0], "B0Z": values[1], "A0Z": values[2] })
}

/// The errors at the ends of the box as a model, and which kinds of error it has.
fn case_model(chain: &Chain, cuboid: [f64; 3], errors: &Errors) -> Result<(ModelSpec, Holds), String> {
    let mut spec = ModelSpec::new("case", chain.clone());
    let mut holds = Holds::default();
    if let Some(missing) = ["X", "Y", "Z"].into_iter().find(|name| !errors.contains_key(*name)) {
        return Err(format!(
            "axis_errors_at_box_ends: no {missing}; an axis without angular data biases squareness"
        ));
    }
    for (name, ends) in errors {
        let mut letters = name.chars();
        let axis = match (letters.next().and_then(AxisName::from_letter), letters.next()) {
            (Some(axis @ (AxisName::X | AxisName::Y | AxisName::Z)), None) => axis,
            _ => return Err(format!("axis_errors_at_box_ends: '{name}' is none of X Y Z")),
        };
        for component in Component::ALL {
            let i = component.index();
            let values = vec![ends.at_0[i], ends.at_travel[i]];
            if values.iter().all(|v| *v == 0.0) {
                continue;
            }
            holds.angles |= component.is_angle();
            holds.straightness |= !component.is_angle() && i != axis.direction();
            let table = Table::new(vec![0.0, cuboid[axis.direction()]], values, None, Interpolation::Linear)
                .map_err(|e| e.to_string())?;
            let function = ErrorFunction::single(Curve::Table(table));
            spec.errors.push((ErrorSymbol::Motion { component, axis }, function));
        }
    }
    spec.validate().map_err(|e| e.to_string())?;
    Ok((spec, holds))
}
