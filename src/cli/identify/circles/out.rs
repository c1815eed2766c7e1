//! What becomes of a tool axis: a pose for the ram, or the location of the spindle.

use super::Args;
use crate::prelude::*;
use volcomp_identify::circles::ToolAxis;

/// The header of a file of poses.
pub(in crate::identify) const POSES: &str =
    "z_mm,c_deg,a_deg,tip_x_um,tip_y_um,tip_z_um,dir_x_arcsec,dir_y_arcsec,dir_z_arcsec";

/// Adds a row; a new file gets its header.
pub(super) fn add_pose(path: &Path, args: &Args, found: &ToolAxis) -> Result<()> {
    let (Some(tip), Some(c), Some(a)) = (args.nominal_tip_mm, args.c_deg, args.a_deg) else {
        return Err(usage!("--add-pose needs --nominal-tip-mm, --c-deg and --a-deg"));
    };
    let mut text =
        if path.exists() { input::read_text(path, InputKind::Table)? } else { format!("{POSES}\n") };
    if !text.lines().any(|l| l == POSES) {
        return Err(usage!("{} is not a file of poses; its header must be {POSES}", path.display()));
    }
    if !text.ends_with('\n') {
        text.push('\n');
    }
    let dp = (found.tip - tip).map(um_from_mm);
    // actual minus nominal direction; the axis given may not be of unit length
    let da = (found.direction - args.nominal_axis.normalize()).map(arcsec_from_rad);
    text.push_str(&format!(
        "{},{c},{a},{:.4},{:.4},{:.4},{:.5},{:.5},{:.5}\n",
        args.z_mm, dp.x, dp.y, dp.z, da.x, da.y, da.z
    ));
    continue_text(Some(path), path, &text)?;
    note!("pose added: {}", path.display());
    Ok(())
}

/// The location errors of the spindle, from the axis with the head at home.
pub(super) fn write_model(args: &Args, found: &ToolAxis, files: &[PathBuf]) -> Result<()> {
    let Some(nominal_tip) = args.nominal_tip_mm else {
        return Err(usage!("--out needs --nominal-tip-mm: the tip as it should be"));
    };
    if (args.nominal_axis.normalize() - Vec3::z()).norm() > 1e-9 {
        return Err(usage!(
            "--out writes where the spindle lies, which needs the head at home (axis along z); elsewhere use --add-pose and volcomp identify ram"
        ));
    }
    let mut model = args.model.base(|| default_chain([AxisName::S]))?;
    if model.spec.tool_tip == Vec3::zeros() {
        model.spec.tool_tip = nominal_tip;
    }
    let axis = model.spec.axis_mut(AxisName::S);
    // the tip as it should be lies on the axis: about another point a tilt would move it along the axis, too
    if axis.point == Vec3::zeros() {
        axis.point = Vec3::new(nominal_tip.x, nominal_tip.y, 0.0);
    }
    let point = axis.point;
    let turn = found.direction_error;
    // loc + turn x (tip - point) is what the tip is off
    let shift = (found.tip - nominal_tip) - turn.cross(&(nominal_tip - point));
    let [shift_std, turn_std] = [found.tip_lateral_std()[1], found.direction_std()[1]];
    let sources = Sources::of(files);
    for (component, value, std) in [
        (Component::X, shift.x, shift_std),
        (Component::Y, shift.y, shift_std),
        (Component::A, turn.x, turn_std),
        (Component::B, turn.y, turn_std),
    ] {
        let function = ErrorFunction { std: Some(std), ..ErrorFunction::single(Curve::Constant(value)) };
        let symbol = ErrorSymbol::Location { component, axis: AxisName::S };
        model.put(symbol, function, sources.provenance());
    }
    let mut comment = sources.heading("identify circles");
    let off = um_from_mm((found.tip - nominal_tip).dot(&found.direction));
    comment.push(format!("tip along the axis off by {off:.2} um: tool length, not part of the model"));
    args.model.write(&model, &comment, files)
}
