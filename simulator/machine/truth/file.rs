//! The truth file, `volcomp-truth/1`: TOML text to the parts of a machine.
//!
//! Lengths of errors in um or arcsec, coordinates in mm or deg, each key ends in its unit; unknown keys are refused.
//! Error motions are lists of shapes: `exx = [{ slope = { rise-um = 12 } }, { wave = { .. } }]`.

use std::collections::BTreeMap;

use serde::Deserialize;
use volcomp_units::axes::{AxisKind, AxisName, MAX_AXES};
use volcomp_units::{mm_from_um, rad_from_arcsec};

use super::chain::{Chain, Side};
use super::drive::DriveSpec;
use super::error::{Place, TruthError};
use super::kinematics::{Joint, Kinematics, Sense, Squareness};
use super::params::Params;
use super::shape::{Curve, Reference, Shape};
use super::structure::StructureSpec;
use super::tool::ToolTruth;

/// A machine as its file describes it.
#[derive(Debug, Clone)]
pub(super) struct Plan {
    pub(super) machine: String,
    pub(super) chain: Chain,
    pub(super) seed: u64,
    pub(super) kinematics: Kinematics,
    pub(super) tool: ToolTruth,
    pub(super) axes: Vec<AxisPlan>,
}

/// One axis, in wire order.
#[derive(Debug, Clone)]
pub(super) struct AxisPlan {
    pub(super) name: AxisName,
    /// Index of its joint in the chain.
    pub(super) joint: usize,
    /// mm or deg.
    pub(super) travel: [f64; 2],
    pub(super) drive: DriveSpec,
    /// EX EY EZ in um, EA EB EC in arcsec, over mm or deg.
    pub(super) curves: [Curve; 6],
    /// -1 where the curves run over the displacement of the carriage (carriage sense, primed), else +1.
    pub(super) curve_sign: f64,
}

/// Largest error motion that is believed, um (5 mm).
const LENGTH_UM_MAX: f64 = 5e3;
/// Largest angular error motion that is believed, arcsec (10 mrad).
const ANGLE_ARCSEC_MAX: f64 = 2062.6;

type ShapeTable = BTreeMap<String, toml::Table>;
type ErrorTable = BTreeMap<String, toml::Spanned<Vec<ShapeTable>>>;

#[derive(Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
struct FileWire {
    format: String,
    machine: String,
    chain: String,
    #[serde(default)]
    seed: u64,
    #[serde(default)]
    frame: FrameWire,
    #[serde(default)]
    squareness: SquarenessWire,
    #[serde(default)]
    tool: ToolWire,
    #[serde(default)]
    location: toml::Table,
    axes: Vec<AxisWire>,
    #[serde(default)]
    errors: ErrorTable,
}

#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
struct FrameWire {
    #[serde(default)]
    workpiece_origin_mm: [f64; 3],
    #[serde(default)]
    tool_tip_mm: [f64; 3],
}

#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields, rename_all = "kebab-case", default)]
struct ToolWire {
    gauge_point_mm: [f64; 3],
    length_error_um_per_m: f64,
    lean_arcsec: [f64; 2],
}

#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
struct SquarenessWire {
    #[serde(default)]
    ec0y_arcsec: f64,
    #[serde(default)]
    eb0z_arcsec: f64,
    #[serde(default)]
    ea0z_arcsec: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
struct AxisWire {
    name: String,
    travel_mm: Option<[f64; 2]>,
    travel_deg: Option<[f64; 2]>,
    point_mm: Option<[f64; 3]>,
    #[serde(default)]
    sense: SenseWire,
    reference_points_mm: Option<ReferenceWire>,
    #[serde(default)]
    servo: ServoWire,
    encoder_step_um: Option<f64>,
    encoder_step_arcsec: Option<f64>,
    encoder_noise_um: Option<f64>,
    encoder_noise_arcsec: Option<f64>,
    backlash_um: Option<f64>,
    backlash_arcsec: Option<f64>,
    repeatability_um: Option<f64>,
    repeatability_arcsec: Option<f64>,
    repeatability_s: Option<f64>,
    #[serde(default)]
    structure: StructureWire,
}

#[derive(Deserialize, Default, Clone, Copy)]
#[serde(rename_all = "kebab-case")]
enum SenseWire {
    #[default]
    Relative,
    Carriage,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ReferenceWire {
    x: [f64; 3],
    y: [f64; 3],
    z: [f64; 3],
}

#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
struct ServoWire {
    #[serde(default)]
    lag_ms: f64,
    #[serde(default)]
    feed_forward: f64,
    #[serde(default)]
    delay_ms: f64,
}

#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields, rename_all = "kebab-case", default)]
struct StructureWire {
    wind_up_um: f64,
    wind_up_length_mm: f64,
    lateral_um: [f64; 3],
    peak_um: f64,
    rise_ms: Option<f64>,
    fall_ms: Option<f64>,
    compliance_um_per_m_per_s2: f64,
    tilt_arcsec_per_m_per_s2: [f64; 3],
    frequency_hz: Option<f64>,
    damping: Option<f64>,
}

impl Plan {
    /// Reads and checks a truth file.
    pub(super) fn read(text: &str) -> Result<Self, TruthError> {
        let wire: FileWire = toml::from_str(text)?;
        if wire.format != "volcomp-truth/1" {
            return Err(TruthError::Format { found: wire.format });
        }
        let chain = Chain::parse(&wire.chain)?;
        let entries = named_axes(&wire.axes, &chain)?;
        for link in chain.links() {
            let spindle_at_rest = link.axis == AxisName::S;
            if !spindle_at_rest && !entries.iter().any(|(axis, _)| *axis == link.axis) {
                return Err(TruthError::AxisMissing { axis: link.axis });
            }
        }
        // A spindle without an entry is a body at rest: it adds nothing to the chain.
        let links: Vec<_> =
            chain.links().iter().filter(|l| entries.iter().any(|(axis, _)| *axis == l.axis)).collect();
        let mut joints = Vec::with_capacity(links.len());
        for link in &links {
            let entry = entries.iter().find(|(axis, _)| *axis == link.axis).map(|(_, wire)| *wire);
            let entry = entry.ok_or(TruthError::AxisMissing { axis: link.axis })?;
            joints.push(joint(link.axis, link.side, entry, &wire.location)?);
        }
        check_locations(&wire.location, &joints)?;
        let mut errors = wire.errors;
        let mut axes = Vec::with_capacity(entries.len());
        for (axis, entry) in &entries {
            let joint = links.iter().position(|l| l.axis == *axis);
            let joint = joint.ok_or(TruthError::AxisMissing { axis: *axis })?;
            axes.push(axis_plan(*axis, entry, joint, &joints[joint], &mut errors, wire.seed, text)?);
        }
        if let Some((symbol, shapes)) = errors.into_iter().next() {
            let line = line_of(text, shapes.span().start);
            return Err(TruthError::Symbol { place: Place::Symbol { symbol, line } });
        }
        finite(Place::Table("frame"), "workpiece-origin-mm", &wire.frame.workpiece_origin_mm)?;
        finite(Place::Table("frame"), "tool-tip-mm", &wire.frame.tool_tip_mm)?;
        let kinematics = Kinematics {
            joints,
            squareness: squareness(&wire.squareness)?,
            workpiece_origin_mm: wire.frame.workpiece_origin_mm,
            tool_tip_mm: wire.frame.tool_tip_mm,
        };
        let tool = tool(&wire.tool)?;
        Ok(Self { machine: wire.machine, chain, seed: wire.seed, kinematics, tool, axes })
    }
}

fn named_axes<'a>(wires: &'a [AxisWire], chain: &Chain) -> Result<Vec<(AxisName, &'a AxisWire)>, TruthError> {
    if wires.len() > MAX_AXES {
        return Err(TruthError::TooManyAxes { count: wires.len() });
    }
    let mut named: Vec<(AxisName, &AxisWire)> = Vec::with_capacity(wires.len());
    for wire in wires {
        let mut letters = wire.name.chars();
        let axis = match (letters.next(), letters.next()) {
            (Some(letter), None) => AxisName::from_letter(letter),
            _ => None,
        }
        .ok_or_else(|| TruthError::AxisName { name: wire.name.clone() })?;
        if named.iter().any(|(other, _)| *other == axis) {
            return Err(TruthError::AxisTwice { axis });
        }
        if !chain.links().iter().any(|l| l.axis == axis) {
            return Err(TruthError::AxisNotInChain { axis, chain: chain.text().to_owned() });
        }
        named.push((axis, wire));
    }
    Ok(named)
}

fn joint(axis: AxisName, side: Side, wire: &AxisWire, location: &toml::Table) -> Result<Joint, TruthError> {
    let place = || Place::Axis(axis);
    let point_mm = match (axis.kind(), wire.point_mm) {
        (AxisKind::Rotary, None) => {
            return Err(TruthError::Missing { place: place(), key: "point-mm".to_owned() });
        }
        (AxisKind::Linear, Some(_)) => {
            let expected = "point-mm on rotary axes only".to_owned();
            return Err(TruthError::UnknownKey { place: place(), key: "point-mm".to_owned(), expected });
        }
        (_, point) => point.unwrap_or_default(),
    };
    finite(place(), "point-mm", &point_mm)?;
    let reference_mm = wire.reference_points_mm.as_ref().map_or([point_mm; 3], |r| [r.x, r.y, r.z]);
    finite(place(), "reference-points-mm", reference_mm.as_flattened())?;
    let sense = match wire.sense {
        SenseWire::Relative => Sense::Relative,
        SenseWire::Carriage => Sense::Carriage,
    };
    let mut found = [0.0; 6];
    if axis.kind() == AxisKind::Rotary {
        for (component, value) in found.iter_mut().enumerate() {
            let Some(number) = location.get(&location_key(axis, component)) else { continue };
            let key = location_key(axis, component);
            let number = number.as_float().or_else(|| number.as_integer().map(|i| i as f64));
            let place = || Place::Table("location");
            let number = number.filter(|n| n.is_finite()).ok_or_else(|| TruthError::NotANumber {
                place: place(),
                key: key.clone(),
                wanted: "a finite number",
            })?;
            let is_angle = component >= 3;
            let limit = if is_angle { ANGLE_ARCSEC_MAX } else { LENGTH_UM_MAX };
            within(place(), &key, number, number.abs() <= limit, "within 5 mm or 10 mrad")?;
            *value = if is_angle { rad_from_arcsec(number) } else { mm_from_um(number) };
        }
    }
    Ok(Joint { axis, side, point_mm, reference_mm, sense, location: found })
}

/// `ex0c-um` .. `ec0c-arcsec`.
fn location_key(axis: AxisName, component: usize) -> String {
    let letter = ['x', 'y', 'z', 'a', 'b', 'c'][component];
    let unit = if component < 3 { "um" } else { "arcsec" };
    format!("e{letter}0{}-{unit}", axis.lower())
}

fn check_locations(location: &toml::Table, joints: &[Joint]) -> Result<(), TruthError> {
    // A shift along its own axis moves no rotary axis.
    let allowed: Vec<String> = joints
        .iter()
        .filter(|j| j.axis.kind() == AxisKind::Rotary)
        .flat_map(|j| (0..6).filter(|c| *c != j.axis.direction()).map(|c| location_key(j.axis, c)))
        .collect();
    match location.keys().find(|key| !allowed.contains(key)) {
        Some(key) => Err(TruthError::UnknownKey {
            place: Place::Table("location"),
            key: key.clone(),
            expected: if allowed.is_empty() {
                "none, the machine has no rotary axis".to_owned()
            } else {
                allowed.join(", ")
            },
        }),
        None => Ok(()),
    }
}

fn tool(wire: &ToolWire) -> Result<ToolTruth, TruthError> {
    let place = || Place::Table("tool");
    finite(place(), "gauge-point-mm", &wire.gauge_point_mm)?;
    let length = wire.length_error_um_per_m;
    within(place(), "length-error-um-per-m", length, length.abs() <= 10_000.0, "within 10000")?;
    for lean in wire.lean_arcsec {
        within(
            place(),
            "lean-arcsec",
            lean,
            lean.abs() <= ANGLE_ARCSEC_MAX,
            "within 2062.6 arcsec (10 mrad)",
        )?;
    }
    Ok(ToolTruth {
        gauge_point_mm: wire.gauge_point_mm,
        length_error: length * 1e-6,
        lean_rad: wire.lean_arcsec.map(rad_from_arcsec),
    })
}

fn squareness(wire: &SquarenessWire) -> Result<Squareness, TruthError> {
    let rad = |key: &'static str, arcsec: f64| {
        let believable = arcsec.abs() <= ANGLE_ARCSEC_MAX;
        within(Place::Table("squareness"), key, arcsec, believable, "within 2062.6 arcsec (10 mrad)")?;
        Ok::<f64, TruthError>(rad_from_arcsec(arcsec))
    };
    Ok(Squareness {
        c0y_rad: rad("ec0y-arcsec", wire.ec0y_arcsec)?,
        b0z_rad: rad("eb0z-arcsec", wire.eb0z_arcsec)?,
        a0z_rad: rad("ea0z-arcsec", wire.ea0z_arcsec)?,
    })
}

fn axis_plan(
    axis: AxisName,
    wire: &AxisWire,
    joint_index: usize,
    joint: &Joint,
    errors: &mut ErrorTable,
    seed: u64,
    text: &str,
) -> Result<AxisPlan, TruthError> {
    let place = || Place::Axis(axis);
    let (key, travel) = match axis.kind() {
        AxisKind::Linear => {
            ("travel-mm", one_of(axis, "travel", wire.travel_mm, wire.travel_deg, ["mm", "deg"])?)
        }
        AxisKind::Rotary => {
            ("travel-deg", one_of(axis, "travel", wire.travel_deg, wire.travel_mm, ["deg", "mm"])?)
        }
    };
    let travel = travel.ok_or_else(|| TruthError::Missing { place: place(), key: key.to_owned() })?;
    finite(place(), key, &travel)?;
    within(place(), key, travel[1], travel[0] < travel[1], "above the lower end")?;
    let home_inside = travel[0] <= 0.0 && travel[1] >= 0.0;
    within(
        place(),
        key,
        travel[0],
        home_inside,
        "a travel with home (0) in it: errors are referenced to home",
    )?;

    let runs_backwards = joint.sense == Sense::Carriage && joint.side == Side::Workpiece;
    let range = if runs_backwards { [-travel[1], -travel[0]] } else { travel };
    let mut curves: [Curve; 6] = std::array::from_fn(|_| Curve::default());
    for (component, curve) in curves.iter_mut().enumerate() {
        let symbol = format!("e{}{}", ['x', 'y', 'z', 'a', 'b', 'c'][component], axis.lower());
        let Some(spanned) = errors.remove(&symbol) else { continue };
        let line = line_of(text, spanned.span().start);
        *curve = read_curve(axis, component, symbol, line, spanned.into_inner(), range, seed)?;
    }
    let curve_sign = if runs_backwards { -1.0 } else { 1.0 };
    Ok(AxisPlan { name: axis, joint: joint_index, travel, drive: drive(axis, wire)?, curves, curve_sign })
}

fn drive(axis: AxisName, wire: &AxisWire) -> Result<DriveSpec, TruthError> {
    let size = |key: &'static str, um: Option<f64>, arcsec: Option<f64>| {
        let (value, to_axis_unit) = match axis.kind() {
            AxisKind::Linear => (one_of(axis, key, um, arcsec, ["um", "arcsec"])?, 1e-3),
            AxisKind::Rotary => (one_of(axis, key, arcsec, um, ["arcsec", "um"])?, 1.0 / 3600.0),
        };
        let value = value.unwrap_or(0.0);
        within(Place::Axis(axis), key, value, (0.0..=1000.0).contains(&value), "0 to 1000")?;
        Ok::<f64, TruthError>(value * to_axis_unit)
    };
    let place = || Place::Axis(axis);
    let (lag_ms, share) = (wire.servo.lag_ms, wire.servo.feed_forward);
    within(place(), "servo.lag-ms", lag_ms, (0.0..=1000.0).contains(&lag_ms), "0 to 1000")?;
    within(place(), "servo.feed-forward", share, (0.0..=1.0).contains(&share), "0 to 1")?;
    let repeatability_s = wire.repeatability_s.unwrap_or(DriveSpec::IDEAL.repeatability_s);
    let lasting = repeatability_s > 0.0 && repeatability_s <= 1e6;
    within(place(), "repeatability-s", repeatability_s, lasting, "above 0, at most 1e6")?;
    Ok(DriveSpec {
        lag_s: lag_ms / 1e3,
        feed_forward: share,
        backlash: size("backlash", wire.backlash_um, wire.backlash_arcsec)?,
        reversal: DriveSpec::IDEAL.reversal,
        repeatability: size("repeatability", wire.repeatability_um, wire.repeatability_arcsec)?,
        repeatability_s,
        encoder_step: size("encoder-step", wire.encoder_step_um, wire.encoder_step_arcsec)?,
        encoder_noise: size("encoder-noise", wire.encoder_noise_um, wire.encoder_noise_arcsec)?,
        structure: structure(axis, wire)?,
    })
}

fn structure(axis: AxisName, wire: &AxisWire) -> Result<StructureSpec, TruthError> {
    let (own, rigid) = (&wire.structure, StructureSpec::RIGID);
    let checked = |key: &'static str, value: f64, low: f64, high: f64, limit: &'static str| {
        within(Place::Axis(axis), key, value, (low..=high).contains(&value), limit)
    };
    for (key, um) in [
        ("structure.wind-up-um", own.wind_up_um),
        ("structure.peak-um", own.peak_um),
        ("structure.compliance-um-per-m-per-s2", own.compliance_um_per_m_per_s2),
    ] {
        checked(key, um, -1000.0, 1000.0, "within 1000")?;
    }
    for um in own.lateral_um {
        checked("structure.lateral-um", um, -1000.0, 1000.0, "within 1000")?;
    }
    for arcsec in own.tilt_arcsec_per_m_per_s2 {
        checked("structure.tilt-arcsec-per-m-per-s2", arcsec, -1000.0, 1000.0, "within 1000")?;
    }
    checked("structure.wind-up-length-mm", own.wind_up_length_mm, 0.0, 100.0, "0 to 100")?;
    checked("servo.delay-ms", wire.servo.delay_ms, 0.0, 1000.0, "0 to 1000")?;
    let positive = |key: &'static str, value: Option<f64>, default: f64, high: f64, limit: &'static str| {
        let value = value.unwrap_or(default);
        checked(key, value, f64::MIN_POSITIVE, high, limit).map(|()| value)
    };
    Ok(StructureSpec {
        delay_s: wire.servo.delay_ms / 1e3,
        wind_up: mm_from_um(own.wind_up_um),
        wind_up_length: own.wind_up_length_mm,
        lateral_mm: own.lateral_um.map(mm_from_um),
        peak: mm_from_um(own.peak_um),
        rise_s: positive("structure.rise-ms", own.rise_ms, 1e3 * rigid.rise_s, 1e4, "above 0, at most 1e4")?
            / 1e3,
        fall_s: positive("structure.fall-ms", own.fall_ms, 1e3 * rigid.fall_s, 1e4, "above 0, at most 1e4")?
            / 1e3,
        // um per m/s^2 are 1e-6 mm per mm/s^2
        compliance_s2: own.compliance_um_per_m_per_s2 * 1e-6,
        tilt: own.tilt_arcsec_per_m_per_s2.map(|v| rad_from_arcsec(v) * 1e-3),
        frequency_hz: positive(
            "structure.frequency-hz",
            own.frequency_hz,
            rigid.frequency_hz,
            1e4,
            "above 0, at most 1e4",
        )?,
        damping: positive("structure.damping", own.damping, rigid.damping, 10.0, "above 0, at most 10")?,
    })
}

fn read_curve(
    axis: AxisName,
    component: usize,
    symbol: String,
    line: usize,
    tables: Vec<ShapeTable>,
    range: [f64; 2],
    seed: u64,
) -> Result<Curve, TruthError> {
    let (value_unit, limit) =
        if component < 3 { ("um", LENGTH_UM_MAX) } else { ("arcsec", ANGLE_ARCSEC_MAX) };
    let linear = axis.kind() == AxisKind::Linear;
    let is_straightness = linear && component < 3 && component != axis.direction();
    let mut shapes = Vec::with_capacity(tables.len());
    for (index, table) in tables.into_iter().enumerate() {
        for (kind, keys) in table {
            let place = Place::Shape { symbol: symbol.clone(), line, number: index + 1, kind: kind.clone() };
            if is_straightness && kind == "slope" {
                return Err(TruthError::StraightnessSlope { place });
            }
            let coordinate_unit = if linear { "mm" } else { "deg" };
            let mut params = Params::new(place, keys, coordinate_unit, value_unit);
            let stream = (axis as u64 * 6 + component as u64) * 64 + index as u64;
            shapes.push(read_shape(&kind, &mut params, range, seed, stream)?);
            params.finish()?;
        }
    }
    let reference = if is_straightness { Reference::HomeAndEndPointLine } else { Reference::Home };
    let curve = Curve::new(shapes, range, reference);
    let value = curve.largest();
    if value > limit {
        let place = Place::Symbol { symbol, line };
        return Err(TruthError::TooLarge { place, value, limit, unit: value_unit });
    }
    Ok(curve)
}

fn read_shape(
    kind: &str,
    params: &mut Params,
    range: [f64; 2],
    seed: u64,
    stream: u64,
) -> Result<Shape, TruthError> {
    Ok(match kind {
        "slope" => Shape::Slope { rise: params.value("rise")? },
        "bow" => Shape::Bow { height: params.value("height")? },
        "wave" => Shape::Wave {
            amplitude: params.value("amplitude")?,
            period: params.length("period")?,
            phase_deg: params.plain_or("phase-deg", 0.0)?,
        },
        "pitch" => Shape::Pitch {
            pitch: params.length("pitch")?,
            first: params.value("first")?,
            second: params.value_or("second", 0.0)?,
        },
        "bump" => Shape::Bump {
            height: params.value("height")?,
            at: params.coordinate("at")?,
            width: params.length("width")?,
        },
        "step" => Shape::Step {
            height: params.value("height")?,
            at: params.coordinate("at")?,
            width: params.length("width")?,
        },
        "samples" => {
            let at = params.rising("at")?;
            let forward = params.values("value", at.len())?.unwrap_or_default();
            let reverse = params.values("reverse", at.len())?;
            if forward.is_empty() {
                return Err(params.missing("value"));
            }
            Shape::samples(at, &forward, reverse.as_deref().unwrap_or(&forward))
        }
        "waviness" => Shape::waviness(params.value("rms")?, params.length("shortest")?, range, seed, stream),
        _ => return Err(params.unknown_kind()),
    })
}

/// The value with the unit that fits the axis; the other unit is a mistake.
fn one_of<T>(
    axis: AxisName,
    key: &str,
    fitting: Option<T>,
    other: Option<T>,
    units: [&str; 2],
) -> Result<Option<T>, TruthError> {
    if other.is_some() {
        return Err(TruthError::UnknownKey {
            place: Place::Axis(axis),
            key: format!("{key}-{}", units[1]),
            expected: format!("{key}-{}", units[0]),
        });
    }
    Ok(fitting)
}

fn finite(place: Place, key: &str, values: &[f64]) -> Result<(), TruthError> {
    if values.iter().all(|v| v.is_finite()) {
        return Ok(());
    }
    Err(TruthError::NotANumber { place, key: key.to_owned(), wanted: "finite numbers" })
}

fn within(place: Place, key: &str, value: f64, ok: bool, limit: &'static str) -> Result<(), TruthError> {
    if ok { Ok(()) } else { Err(TruthError::Range { place, key: key.to_owned(), value, limit }) }
}

fn line_of(text: &str, offset: usize) -> usize {
    text.bytes().take(offset).filter(|b| *b == b'\n').count() + 1
}
