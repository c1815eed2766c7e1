//! Whether a model with an effect in it says what the addition says.

use super::terms::largest;
use super::{Candidate, curves};
use crate::addition::{Addition, Entry, Evaluator, FORMAT};
use crate::machine_state::{Axis, MachineState, SLOTS, Source};
use crate::prediction::{deviation_with_live_um, machine_of};
use volcomp_estimate::ThermalState;
use volcomp_model::geometry::Vec3;
use volcomp_model::{Model, ModelError, ModelSpec};
use volcomp_units::rad_from_deg;

/// Places that are compared.
const PLACES: u32 = 64;
/// Largest difference, as a share of the largest effect, and at least, um.
const SHARE: f64 = 0.02;
const LEAST_UM: f64 = 0.01;
/// Steps of an additive sequence over the axes: fractional powers of the plastic number's kin fill boxes evenly.
const STEPS: [f64; SLOTS] = [0.847_4, 0.718_1, 0.608_5, 0.515_7, 0.437_0, 0.370_3];
/// Parts whose signs are tried.
const PARTS_MAX: usize = 6;
/// Long enough for every lag to have settled, s.
const SETTLED_S: f64 = 1e9;

/// One place and what the addition says there.
struct Place {
    moment: MachineState,
    sources: Vec<f64>,
    said_um: Vec3,
}

/// The candidate with the signs that say what the addition says; `None` where no choice of signs does.
///
/// # Errors
/// The model breaks a rule with it.
pub(super) fn signed(
    spec: &ModelSpec,
    entry: &Entry,
    candidate: &Candidate,
) -> Result<Option<Candidate>, ModelError> {
    // a datum takes a constant off, which says nothing about the effect
    let without_datum = ModelSpec { datum: Vec::new(), ..spec.clone() };
    let before = Model::new(&without_datum)?;
    let is_of_tool = entry.shape.form().columns().iter().any(|column| column == "tool_length_mm");
    let places = places(spec, &before, entry, candidate.tool.is_some() || is_of_tool);
    let parts = candidate.parts.len();
    for choice in 0..1_u32 << parts.min(PARTS_MAX) {
        let sign = |k: usize| if choice >> k & 1 == 0 { 1.0 } else { -1.0 };
        let signs: Vec<f64> = (0..parts).map(sign).collect();
        let Some(signed) = candidate.signed(&signs) else { continue };
        let after = Model::new(&signed.added_to(&without_datum))?;
        if says_the_same(&before, &after, &signed, &places) {
            return Ok(Some(signed));
        }
    }
    Ok(None)
}

fn says_the_same(before: &Model, after: &Model, candidate: &Candidate, places: &[Place]) -> bool {
    let added = |place: &Place| {
        let live = |model: &Model| {
            let value = |channel: &String| growth(candidate, channel, &place.sources);
            model.sensors().iter().map(value).collect::<Vec<f64>>()
        };
        let at = |model: &Model| deviation_with_live_um(model, &place.moment, &live(model));
        at(after) - at(before)
    };
    let Some(first) = places.first() else { return false };
    // an effect is known up to a constant: the first place is the reference of both
    let (zero, said_zero) = (added(first), first.said_um);
    let largest = places.iter().map(|p| (p.said_um - said_zero).norm()).fold(0.0, f64::max);
    let allowed = (SHARE * largest).max(LEAST_UM);
    largest > 0.0 && places.iter().all(|p| (added(p) - zero - (p.said_um - said_zero)).norm() <= allowed)
}

/// What a thermal displacement of the candidate tells for these readings once all lags have settled, mm or strain.
fn growth(candidate: &Candidate, channel: &str, sources: &[f64]) -> f64 {
    let Some(thermal) = candidate.thermal.iter().find(|t| t.name == channel) else { return 0.0 };
    let mut state = ThermalState::new(thermal);
    // one reading per input, in the order of the signals
    let readings: Vec<f64> = sources.iter().copied().take(thermal.inputs.len()).collect();
    for _ in 0..2 {
        state.advance(thermal, SETTLED_S, &readings);
    }
    state.growth(thermal).value
}

/// Gives every axis a velocity in its direction of travel, an acceleration, and a distance and time since its reversal.
fn set_in_motion(state: &mut MachineState, entry: &Entry, chain: &[Axis], share: &dyn Fn(usize) -> f64) {
    let (length_mm, time_s) = entry.shape.form().builds_up();
    let most = |column: String| largest(entry, &column).unwrap_or(1.0);
    let speed = |axis: Axis| {
        let most = most(axis.velocity_column());
        if axis.is_linear() { most } else { rad_from_deg(most) }
    };
    for (k, axis) in chain.iter().enumerate() {
        let slot = axis.slot();
        state.velocity[slot] = state.direction[slot] * share(k + 1) * speed(*axis);
        state.acceleration[slot] = (2.0 * share(k + 2) - 1.0) * most(axis.acceleration_column());
        state.since_mm[slot] = 3.0 * share(k + 3) * length_mm;
        state.since_s[slot] = 3.0 * share(k + 3) * time_s;
    }
}

/// Places all over the volume, to and fro, warm and cold, with tools of several lengths for effects `of_tool`; the first one is where all stands at the reference.
fn places(spec: &ModelSpec, model: &Model, entry: &Entry, of_tool: bool) -> Vec<Place> {
    let addition = Addition {
        format: FORMAT.to_owned(),
        machine: spec.machine.clone(),
        sense: String::new(),
        base: None,
        effects: vec![entry.clone()],
    };
    let machine = machine_of(spec, model);
    let chain: Vec<Axis> = model.axes().filter_map(|a| Axis::from_name(a.name)).collect();
    let place = |n: u32| {
        let share = |k: usize| (0.5 + STEPS[k % SLOTS] * f64::from(n)).fract();
        let mut moment = MachineState {
            since_mm: [f64::INFINITY; SLOTS],
            direction: [1.0; SLOTS],
            ..MachineState::default()
        };
        for axis in &chain {
            let slot = axis.slot();
            let [low, high] = curves::travel(spec, entry, *axis).unwrap_or([-1.0, 1.0]);
            // inside of the data, where curves are not held
            let inside =
                curves::seen(entry, *axis).map_or([low, high], |seen| [seen[0].max(low), seen[1].min(high)]);
            moment.position[slot] = inside[0] + share(slot) * (inside[1] - inside[0]).max(0.0);
            moment.direction[slot] = if n >> (slot % 4) & 1 == 0 { 1.0 } else { -1.0 };
        }
        if let Some(gauge) = spec.gauge_point {
            moment.tool_length_mm = gauge.z - spec.tool_tip.z;
            if of_tool {
                moment.tool_length_mm *= 0.5 + share(1);
            }
        }
        set_in_motion(&mut moment, entry, &chain, &share);
        moment.head = machine.head(&moment.position);
        let mut evaluator = Evaluator::new([&addition]);
        let sources = evaluator.sources();
        let valid = |source: &Source| entry.valid.get(&source.to_string()).copied().unwrap_or([0.0, 1.0]);
        let said: Vec<f64> = sources
            .iter()
            .enumerate()
            .map(|(k, source)| {
                let [low, high] = valid(source);
                low + share(k + 3) * (high - low)
            })
            .collect();
        // the addition counts the spindle in 1000 per minute, sensors tell it per minute
        let per = |(source, value): (&Source, &f64)| {
            if *source == Source::Spindle { value / 1000.0 } else { *value }
        };
        let scaled: Vec<f64> = sources.iter().zip(&said).map(per).collect();
        let said_um = evaluator.next(&mut moment, &scaled);
        Place { moment, sources: said, said_um }
    };
    (0..PLACES).map(place).collect()
}
