//! What nothing explains: whether it is there, where it lies, what it looks like.

use super::super::Analysis;
use super::super::constants::{LARGE_DRIFT, LITTLE, SIGNIFICANT};
use super::super::decision::Assessed;
use super::super::library::Kind;
use super::super::localise::localise;
use super::super::noise::Cycle;
use super::super::report::{Cause, Place, Unexplained, Value};
use super::super::residual_structure::Structure;
use super::super::search::LowRank;
use super::super::session::Session;
use super::rejection_text::remark;
use super::structured::{PROXY, rough_names};
use super::white_rms;

/// Least structured variance that is called unexplained: in units of the noise, and as a share of what was there.
const LEFT_VARIANCE: (f64, f64) = (0.02, 0.012);

pub(super) fn unexplained(
    session: &Session,
    a: &Analysis,
    assessed: &[Assessed],
    (left, named): (&[f64], &[&LowRank]),
    (total, leftover, rough_um): (&Structure, &Structure, Option<f64>),
    (before_um, after_um): (f64, f64),
) -> Unexplained {
    let white = white_rms(session, a);
    let of_machine = a.bar_length.as_ref().map(|bar| bar.explained_beside);
    let explained = of_machine.unwrap_or_else(|| a.problem.given(&a.selection.chosen).explained);
    let explained = explained / a.problem.len() as f64;
    let whole = total.variance.max(explained).max(1e-9);
    let structured = (leftover.z > SIGNIFICANT
        && leftover.variance > LEFT_VARIANCE.0
        && leftover.variance > LEFT_VARIANCE.1 * whole)
        || (leftover.local_z > SIGNIFICANT && leftover.variance > LEFT_VARIANCE.1 * whole);
    let drifting = drifting(a);
    let proxies: Vec<&Assessed> = assessed.iter().filter(|x| !x.is_declared()).collect();
    let proxy = proxies.iter().map(|x| x.found.gain).sum::<f64>() / a.problem.len() as f64;
    let by_proxy = proxy.sqrt() > PROXY;
    let is_structured = structured || by_proxy || rough_um.is_some();
    let significant = is_structured || !drifting.is_empty();
    let whiten = |data: &mut [f64], width: usize| {
        a.filter.apply(data, width);
        named.iter().for_each(|noise| noise.turn(data, false));
    };
    let mut places = if is_structured { localise(session, &a.problem, &whiten, left) } else { Vec::new() };
    let of_roughness = rough_um.map_or(0.0, |rough_um| (rough_um / white).powi(2));
    let variance = leftover.variance.max(if by_proxy { proxy } else { 0.0 }).max(of_roughness);
    let drift = drifting.iter().map(|c| a.noise[*c].drift_um).fold(0.0, f64::max);
    // a drift that wanders further than its setups last shows less than its size: no more is left than there is
    let beyond_noise = |rms_um: f64| (rms_um * rms_um - white * white).max(0.0);
    let there = beyond_noise(before_um.min(after_um));
    let rms_um = (variance * white * white).min(there).sqrt();
    let drift_share = (drift * drift).min(there) / beyond_noise(before_um).max(1e-12);
    if !drifting.is_empty() && drift_share > 0.0 {
        let names: Vec<&str> = drifting.iter().map(|c| session.instruments[*c].as_str()).collect();
        let (share, detail) = (drift_share.min(1.0), format!("slow drift of {}", names.join(", ")));
        places.push(Place { by: "time", of: String::new(), share, detail });
        places.sort_by(|a, b| b.share.total_cmp(&a.share));
    }
    let share = if significant { (variance / whole).max(drift_share).clamp(0.0, 1.0) } else { 0.0 };
    Unexplained {
        significant,
        rms_um,
        share,
        z: leftover.z,
        looks_like: looks_like(session, a, (&places, rough_um), &proxies, &drifting, significant),
        places,
        is_pointwise: false,
    }
}

impl Unexplained {
    /// Adds a cycle in time of readings at one place, where it is not small beside the gap, um; returns its mean square, um^2.
    /// Neighbours in time do not know it from noise.
    pub(super) fn add_cycle(&mut self, session: &Session, cycle: Option<Cycle>, gap_um: f64) -> f64 {
        let share = |c: &Cycle| (c.mean_square_um2 / gap_um.powi(2).max(1e-18)).min(1.0);
        let Some(cycle) = cycle.filter(|c| share(c) > LITTLE) else { return 0.0 };
        let period = session.span(cycle.period_s);
        if !self.significant {
            self.looks_like.clear();
        }
        let before = if self.looks_like.is_empty() { "" } else { "; " };
        self.looks_like += &format!(
            "{before}a cycle of {period} with an amplitude of {:.2} µm that no effect follows: look for what switches with that period, such as a cooling unit or an air conditioner, and log it",
            cycle.amplitude_um
        );
        self.significant = true;
        self.share = self.share.max(share(&cycle));
        self.rms_um = self.rms_um.hypot(cycle.mean_square_um2.sqrt());
        let detail = format!("a cycle of {period}");
        self.places.push(Place { by: "time", of: String::new(), share: share(&cycle), detail });
        self.places.sort_by(|a, b| b.share.total_cmp(&a.share));
        cycle.mean_square_um2
    }
}

/// Instrument classes whose drift is too large to pass unmentioned.
pub(super) fn drifting(a: &Analysis) -> Vec<usize> {
    (0..a.noise.len()).filter(|c| a.noise[*c].drift_um > LARGE_DRIFT * a.noise[*c].white_um).collect()
}

/// Probability of a drift of the structure where no temperature tells it from a drift of the instrument: 3 of 525 that were
/// shown in blind cases were one.
const DRIFT_PROBABILITY: f64 = 0.01;

/// Slow drift that nothing logged can be blamed for: named, never declared.
pub(super) fn drift(session: &Session, a: &Analysis) -> Option<Cause> {
    const NAME: &str = "ambient-drift";
    let class =
        drifting(a).into_iter().max_by(|x, y| a.noise[*x].drift_um.total_cmp(&a.noise[*y].drift_um))?;
    let noise = a.noise[class];
    let value = |value: f64, std: f64| Value { value, std };
    Some(Cause {
        effect: NAME.to_owned(),
        subject: String::new(),
        kind: Kind::Machine,
        probability: DRIFT_PROBABILITY,
        declared: false,
        confounded_with: Vec::new(),
        group_probability: None,
        re_expression_of: Vec::new(),
        sources: Vec::new(),
        parameters: [
            ("drift_um".to_owned(), value(noise.drift_um, 0.0)),
            ("correlation_time_s".to_owned(), value(noise.drift_s, 0.0)),
        ]
        .into(),
        shrink: 0.0,
        remark: format!(
            "readings of {} drift slowly; without a correlated temperature, machine and instrument are not distinguishable",
            session.instruments[class]
        ),
        tests: None,
    })
}

fn looks_like(
    session: &Session,
    a: &Analysis,
    (places, rough_um): (&[Place], Option<f64>),
    proxies: &[&Assessed],
    drifting: &[usize],
    significant: bool,
) -> String {
    if !significant {
        let rough = rough_names(a).map(|curves| format!(" but the roughness of {curves}"));
        return format!("nothing above the noise{}", rough.unwrap_or_default());
    }
    let mut words = Vec::new();
    let factors: Vec<String> = places
        .iter()
        .filter(|p| !["axis", "instrument", "setup"].contains(&p.by))
        .take(3)
        .map(|p| format!("{} ({:.0} %)", p.detail, 100.0 * p.share))
        .collect();
    if !factors.is_empty() {
        words.push(format!("it goes with {}", factors.join(", with ")));
    }
    if let Some(rough_um) = rough_um {
        let curves = rough_names(a).unwrap_or_default();
        words
            .push(format!("{rough_um:.2} µm RMS of roughness: {curves}, as far as no polynomial follows it"));
    }
    for x in proxies {
        words.push(format!("resembles {}, but {}", x.label, remark(x)));
    }
    for c in drifting {
        let n = a.noise[*c];
        words.push(format!(
            "slow drift of {}: {:.2} µm over {:.0} s, {:.1} times the noise; compare with the instrument's own",
            session.instruments[*c],
            n.drift_um,
            n.drift_s,
            n.drift_um / n.white_um
        ));
    }
    if words.is_empty() {
        "repeats, but goes with nothing that was logged".to_owned()
    } else {
        words.join("; ")
    }
}
