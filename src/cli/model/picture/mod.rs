//! The pictures of a model: the six error motions of every axis, and the distorted volume. Lines are distinguished by
//! blue and vermillion, which colour-blind readers and grey prints keep apart.

mod panel;
mod volume;

pub(super) use panel::meaning;

use crate::prelude::*;
use crate::report::plot::{Area, Drawn, Part, Svg, TITLE, WIDTH, stacked, svg};

const AXIS_HEIGHT: u32 = TITLE + 2 * 230;
const VOLUME_HEIGHT: u32 = 640;

/// The axes that have error motions in the model.
pub(super) fn axes_with_errors(spec: &ModelSpec) -> Vec<AxisName> {
    let has = |name: AxisName| spec.errors.iter().any(|(s, _)| !s.is_constant() && s.axis() == name);
    spec.chain.axes().iter().map(|a| a.name).filter(|name| has(*name)).collect()
}

/// The six panels of one axis.
///
/// # Errors
/// The drawing library could not draw it.
pub(super) fn axis(spec: &ModelSpec, name: AxisName) -> Svg {
    svg(AXIS_HEIGHT, |area| panel::draw_axis(area, spec, name))
}

/// The distorted volume; `None` where fewer than two of X, Y, Z have a travel.
///
/// # Errors
/// The drawing library could not draw it.
pub(super) fn distorted(spec: &ModelSpec, model: &Model) -> Drawn<Option<String>> {
    if !volume::exists(spec) {
        return Ok(None);
    }
    svg(VOLUME_HEIGHT, |area| volume::draw(area, spec, model)).map(Some)
}

/// Everything in one picture.
///
/// # Errors
/// The drawing library could not draw it.
pub(super) fn whole(spec: &ModelSpec, model: &Model) -> Svg {
    let names = axes_with_errors(spec);
    let draw: Vec<_> =
        names.iter().map(|name| move |area: &Area<'_>| panel::draw_axis(area, spec, *name)).collect();
    let mut parts: Vec<Part<'_>> = draw.iter().map(|draw| ("", AXIS_HEIGHT, draw as _)).collect();
    let volume = |area: &Area<'_>| volume::draw(area, spec, model);
    if volume::exists(spec) {
        parts.push(("", VOLUME_HEIGHT, &volume));
    }
    stacked(WIDTH, &format!("{}  {}", spec.machine, spec.chain), &parts)
}

#[cfg(test)]
mod tests {
    use super::*;
    use volcomp_model::curve::{Curve, ErrorFunction, Grid, Interpolation, Table};
    use volcomp_model::{AxisSpec, Chain, ErrorSymbol};

    fn spec(chain: &str) -> ModelSpec {
        let mut spec = ModelSpec::new("m", Chain::parse(chain).unwrap());
        for axis in spec.chain.clone().axes() {
            spec.axes.push(AxisSpec { travel: Some([0.0, 2.0]), ..AxisSpec::new(axis.name) });
        }
        spec
    }

    fn add(spec: &mut ModelSpec, symbol: &str, function: ErrorFunction) {
        spec.errors.push((ErrorSymbol::parse(symbol).unwrap(), function));
    }

    #[test]
    fn both_directions_of_a_table_are_drawn() {
        let mut spec = spec("[w b X Y Z t]");
        let table = Table::new(vec![0.0, 2.0], vec![0.0, 0.01], Some(vec![0.0, 0.02]), Interpolation::Linear);
        add(&mut spec, "exx", ErrorFunction::single(Curve::Table(table.unwrap())));
        let text = axis(&spec, AxisName::X).unwrap();
        assert!(text.starts_with("<svg") && text.contains("#0072B2") && text.contains("#D55E00"));
        for symbol in ["EXX", "EYX", "EZX", "EAX", "EBX", "ECX"] {
            assert!(text.contains(symbol), "{symbol}");
        }
        let whole = whole(&spec, &Model::new(&spec).unwrap()).unwrap();
        assert!(whole.contains("magnified") && whole.contains("EXX"));
    }

    #[test]
    fn models_of_every_shape_can_be_drawn() {
        for chain in ["[w b X t]", "[w X' b Z t]", "[w C' b (S) t]", "[w A' b X Y B t]", "[w b U V W t]"] {
            let spec = spec(chain);
            let model = Model::new(&spec).unwrap();
            assert!(whole(&spec, &model).unwrap().starts_with("<svg"), "{chain}");
        }
        // one axis makes no volume
        for chain in ["[w C' b (S) t]", "[w b X t]"] {
            let spec = spec(chain);
            assert!(distorted(&spec, &Model::new(&spec).unwrap()).unwrap().is_none(), "{chain}");
        }
    }

    #[test]
    fn a_grid_is_drawn_for_several_places_of_the_other_axis() {
        let mut spec = spec("[w b X Y Z t]");
        let axes = vec![(AxisName::X, vec![0.0, 2.0]), (AxisName::Y, vec![0.0, 2.0])];
        let grid = Grid::new(axes, vec![0.0, 0.001, 0.0, 0.004]).unwrap();
        add(&mut spec, "ezx", ErrorFunction { grids: vec![grid], ..Default::default() });
        let text = axis(&spec, AxisName::X).unwrap();
        assert!(text.contains("other axes at their lower end, middle, upper end"), "{text}");
    }
}
