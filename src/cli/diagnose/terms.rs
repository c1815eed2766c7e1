//! Names, values and sentences of the diagnosis as a metrologist reads them, for the page and for the text on stdout.

use crate::prelude::*;
use volcomp_diagnose::Diagnosis;
use volcomp_diagnose::library::{Effect, Kind};
use volcomp_diagnose::report::{Cause, Value, Verdict};
use volcomp_effects::extend::{Fate, extend};
use volcomp_effects::{squareness_symbol, unit_of};

/// Coverage factor of all uncertainties shown.
pub(super) const COVERAGE: f64 = 2.0;
/// An effect of at most this share of the gap, both RMS, needs no remedy.
const NEGLIGIBLE: f64 = 0.05;

/// Name of an effect with its subject: `reversal error (backlash) of X`.
pub(super) fn name(effect: &str, subject: &str) -> String {
    let letters = subject.to_uppercase();
    let subject = match letters.as_bytes() {
        [a, b] => format!("{} to {}", *a as char, *b as char),
        _ => letters,
    };
    Effect::find(effect)
        .map_or_else(|| format!("{effect} {subject}").trim().to_owned(), |e| e.title.replace("{}", &subject))
}

/// The same from a label `effect:subject`.
pub(super) fn name_of_label(label: &str) -> String {
    let (effect, subject) = label.split_once(':').unwrap_or((label, ""));
    name(effect, subject)
}

/// A number with so many decimals and the sign of mathematics; never minus zero.
pub(super) fn number(v: f64, decimals: usize) -> String {
    let text = format!("{v:.decimals$}");
    if text.bytes().all(|b| matches!(b, b'-' | b'0' | b'.')) {
        text.trim_start_matches('-').to_owned()
    } else {
        text.replace('-', "\u{2212}")
    }
}

/// A length in um: two decimals below 10, one below 100, none above.
pub(super) fn um(v: f64) -> String {
    let decimals = if v.abs() < 9.995 { 2 } else { usize::from(v.abs() < 99.95) };
    number(v, decimals)
}

/// A share as percent without decimals; `< 1 %` where it rounds to nothing.
pub(super) fn percent(share: f64) -> String {
    if share > 0.0 && share < 0.005 { "< 1 %".to_owned() } else { format!("{} %", number(100.0 * share, 0)) }
}

/// A value and its expanded uncertainty (k = 2) with two significant figures.
pub(super) fn with_uncertainty(v: Value) -> String {
    let expanded = COVERAGE * v.std;
    if !(expanded.is_finite() && expanded > 0.0) {
        let decimals = (2.0 - v.value.abs().max(1e-9).log10().floor()).clamp(0.0, 6.0) as usize;
        let text = number(v.value, decimals);
        return if text.contains('.') {
            text.trim_end_matches('0').trim_end_matches('.').to_owned()
        } else {
            text
        };
    }
    let decimals = (1.0 - expanded.log10().floor()).clamp(0.0, 6.0) as usize;
    format!("{} ± {}", number(v.value, decimals), number(expanded, decimals))
}

/// True for coefficients of a series, which say nothing without the curve.
fn is_coefficient(name: &str) -> bool {
    let stem = name.strip_prefix("reversal_").unwrap_or(name);
    ["p", "e", "cos", "sin"].iter().any(|start| {
        stem.strip_prefix(start)
            .is_some_and(|rest| rest.starts_with(|c: char| c.is_ascii_digit() || c == '_'))
    })
}

/// Physical parameters of a cause with unit and expanded uncertainty (k = 2), the angle of a pair with the symbol and the sign of
/// ISO 230-1; coefficients of series are left out.
pub(super) fn parameters(found: &Diagnosis, cause: &Cause) -> Vec<String> {
    // what neither has a value nor an uncertainty was not seen
    let seen = |v: &Value| v.value != 0.0 || v.std > 0.0;
    // a height under two exponentials is no height: the peak is
    let peaks = cause.parameters.contains_key("peak_um");
    // the names of lagged coefficients hold their time constants
    let lagged = cause.parameters.keys().any(|name| name.contains("_after_"));
    let told = |name: &str| {
        !(is_coefficient(name)
            || (peaks && name == "height_um")
            || (lagged && name.starts_with("time_constant_")))
    };
    let physical = cause.parameters.iter().filter(|(name, v)| told(name) && seen(v));
    let turns = matches!(cause.subject.as_str(), "a" | "b" | "c");
    let in_the_middle = found.width_in_the_middle(cause);
    physical
        .map(|(name, v)| {
            if let ("width_um", Some((place, width))) = (name.as_str(), in_the_middle) {
                let (width, axis) = (with_uncertainty(width), cause.subject.to_uppercase());
                return format!("width {width} µm at {axis} {place:.0} mm");
            }
            let (stem, unit) = match unit_of(name).unwrap_or((name, "")) {
                (stem, "µm/m") if turns => (stem, "µrad/rad"),
                other => other,
            };
            let symbol = squareness_symbol(&cause.subject).filter(|_| cause.effect == "squareness");
            let (what, sign) = symbol.map_or_else(|| (words_of(stem), 1.0), |(s, k)| (s.into(), k));
            let v = Value { value: sign * v.value, std: v.std };
            let mut text = format!("{what} {} {unit}", with_uncertainty(v));
            if unit == "″" {
                // 1 arcsec is 4.848 um/m
                let um_per_m = Value { value: 4.848_136_8 * v.value, std: 4.848_136_8 * v.std };
                let unit = if turns { "µrad" } else { "µm/m" };
                text = format!("{text} ({} {unit})", with_uncertainty(um_per_m));
            }
            text.trim().to_owned()
        })
        .chain(cause.sources.iter().map(|source| format!("by {source}")))
        .collect()
}

/// Words of the name of a parameter, its unit left out: `growth_x_after_2400s` is `growth x after 2400 s`.
fn words_of(stem: &str) -> String {
    let word = |word: &str| match word.strip_suffix('s') {
        Some(time) if !time.is_empty() && time.bytes().all(|b| b.is_ascii_digit()) => format!("{time} s"),
        _ => word.to_owned(),
    };
    stem.trim_end_matches("_1").split('_').map(word).joined(" ")
}

/// Peak to valley of the fitted curves of a cause, with its uncertainty, rotations and angular readings as angles; the largest where there
/// are several.
pub(super) fn peak_to_valley(found: &Diagnosis, label: &str) -> Option<String> {
    let curves = found.curves.iter().filter(|c| c.label == label && !c.lines.is_empty());
    let curve = curves.max_by(|a, b| a.range.value.total_cmp(&b.range.value))?;
    let (scale, unit) = match found.radius_mm.filter(|_| curve.unit == "µm") {
        Some(radius) => (arcsec_from_rad(mm_from_um(1.0) / radius), "″"),
        None => (1.0, curve.unit),
    };
    let range = Value { value: scale * curve.range.value, std: scale * curve.range.std };
    Some(format!("peak to valley {} {unit}", with_uncertainty(range)))
}

/// Text of the diagnosis with names in the place of labels, and the unit as it is written.
pub(super) fn with_names(text: &str) -> String {
    let word = |word: &str| {
        let bare = word.trim_matches([',', ';', '.', '(', ')']);
        let effect = bare.split(':').next().unwrap_or(bare);
        let is_label = (bare.contains(':') || bare.contains('-'))
            && Effect::find(effect).is_some_and(|e| e.name == effect);
        match bare {
            "um" => word.replace("um", "µm"),
            _ if is_label => word.replace(bare, &name_of_label(bare)),
            _ => word.to_owned(),
        }
    };
    text.split(' ').map(word).joined(" ")
}

/// What volcompd does with each cause declared.
pub(super) struct Compensable {
    fates: BTreeMap<String, Fate>,
    /// No model was given: a chain of three linear axes is assumed.
    pub(super) is_assumed: bool,
}

impl Compensable {
    /// Asks the model, or a chain of three linear axes without one.
    pub(super) fn of(found: &Diagnosis, spec: Option<&ModelSpec>) -> Self {
        let plain =
            || Chain::parse("[w b X Y Z t]").ok().map(|chain| ModelSpec::new(&found.addition.machine, chain));
        let of = spec.cloned().or_else(plain);
        let extended = of.and_then(|spec| extend(&spec, &[], &found.addition).ok());
        let fates = extended.map(|e| e.fates.into_iter().collect()).unwrap_or_default();
        Self { fates, is_assumed: spec.is_none() }
    }

    /// In words; a correction that does harm is not advised.
    pub(super) fn words(&self, cause: &Cause, found: &Diagnosis) -> String {
        match self.fates.get(&cause.label()) {
            Some(Fate::Taken(_)) if found.budget.does_harm(&cause.label()) => {
                "not advised: take it out of the addition".to_owned()
            }
            Some(fate @ Fate::Taken(_)) => {
                // a straight line of a straightness error: the field calls it by the angle
                let angle = squareness_symbol(&cause.subject).filter(|_| cause.effect == "squareness");
                let angle =
                    angle.map_or_else(String::new, |(symbol, _)| format!(", the squareness {symbol}"));
                format!("yes, as {}{angle}", fate.symbols().join(" "))
            }
            Some(Fate::Left(why)) => format!("no: {why}"),
            None if cause.kind == Kind::Machine => "no".to_owned(),
            None => "no: not an error of the machine".to_owned(),
        }
    }
}

/// What to do about a cause, empty where the catalogue has nothing; nothing is asked for where its correction does harm or the
/// effect is a twentieth of the gap or less.
pub(super) fn remedy(cause: &Cause, found: &Diagnosis) -> &'static str {
    let b = &found.budget;
    if b.does_harm(&cause.label()) {
        return "none: beside the other causes its correction makes readings held out worse";
    }
    if b.correction(&cause.label()).is_some_and(|x| x.size_um.value <= NEGLIGIBLE * b.before.rms_um) {
        return "significant, but negligible in this gap";
    }
    Effect::find(&cause.effect).map_or("", |e| e.remedy)
}

fn listed(names: &[String]) -> String {
    match names {
        [] => String::new(),
        [one] => one.clone(),
        [first @ .., last] => format!("{} and {last}", first.join(", ")),
    }
}

/// The verdict in one sentence.
pub(super) fn headline(found: &Diagnosis) -> String {
    let r = &found.report;
    let repeating = |c: &&Cause| c.declared && c.kind != Kind::Stochastic;
    let causes = found.budget.sorted(r.causes.iter().filter(repeating));
    let names: Vec<String> = causes.into_iter().map(|c| name(&c.effect, &c.subject)).collect();
    let (gap, noise) = (um(r.gap.rms_um), um(r.gap.noise_um));
    let s = &r.shrink;
    let (verb, them) = if names.len() == 1 { ("explains", "it") } else { ("explain", "them") };
    let [less, low, high] = [s.fraction, s.ci90[0], s.ci90[1]].map(|share| number(100.0 * share, 0));
    let after = format!(
        "correcting {them} is expected to leave {} µm RMS ({less} % less, 90 % interval {low} to {high} %)",
        um(s.rms_after_um)
    );
    match r.verdict {
        Verdict::NoGap => {
            format!("No significant gap: {gap} µm RMS, with a measurement noise of {noise} µm.")
        }
        Verdict::Unexplained if !names.is_empty() => format!(
            "The gap of {gap} µm RMS exceeds the noise of {noise} µm. Established: {}; correcting {them} takes out only {} % of it, \
             the rest is unexplained.",
            listed(&names),
            number((100.0 * s.fraction).max(0.0), 0)
        ),
        Verdict::Unexplained => {
            format!("The gap of {gap} µm RMS exceeds the noise of {noise} µm, and no cause is established.")
        }
        Verdict::Explained => {
            capital(&format!("{} {verb} the gap of {gap} µm RMS; {after}.", listed(&names)))
        }
        Verdict::PartlyExplained => {
            let (causes, rest) = (listed(&names), unexplained(found));
            capital(&format!("{causes} {verb} part of the gap of {gap} µm RMS; {after}, of which {rest}."))
        }
    }
}

/// The larger part of what no cause explains: a drift counts where the comparison of few readings says that it is one.
fn unexplained(found: &Diagnosis) -> String {
    let (r, b) = (&found.report, &found.budget);
    if r.is_compared && b.drift_um > b.unexplained_um && r.unexplained.rms_um >= b.drift_um {
        format!("{} µm is slow drift of unknown source", um(b.drift_um))
    } else {
        format!("{} µm is unexplained", um(b.unexplained_um))
    }
}

/// With a capital letter at the beginning.
pub(super) fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or_else(String::new, |c| c.to_uppercase().chain(letters).collect())
}

/// That it is a declared cause or one of those that are not separable from it.
pub(super) fn of_group(c: &Cause) -> String {
    let stated = c.group_probability.filter(|_| c.declared);
    stated.map_or_else(String::new, |p| format!("; probability of the group {}", number(p, 2)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_parameters_become_words() {
        for (stem, words) in [
            ("growth_x_after_2400s", "growth x after 2400 s"),
            ("compliance_1", "compliance"),
            ("sag_of_own_weight", "sag of own weight"),
        ] {
            assert_eq!(words_of(stem), words);
        }
    }

    #[test]
    fn numbers_are_never_minus_zero_and_keep_their_figures() {
        for (v, text) in
            [(-0.001, "0.00"), (-1.5, "\u{2212}1.50"), (12.34, "12.3"), (123.4, "123"), (9.999, "10.0")]
        {
            assert_eq!(um(v), text);
        }
        assert_eq!(percent(-0.001), "0 %");
        assert_eq!(percent(0.001), "< 1 %");
    }

    #[test]
    fn uncertainties_have_two_figures_and_values_as_many_decimals() {
        let value = |value: f64, std: f64| Value { value, std };
        assert_eq!(with_uncertainty(value(55.1234, 1.61)), "55.1 ± 3.2");
        assert_eq!(with_uncertainty(value(-0.001, 0.06)), "0.00 ± 0.12");
        assert_eq!(with_uncertainty(value(1234.0, 40.0)), "1234 ± 80");
        assert_eq!(with_uncertainty(value(5.0, 0.0)), "5");
    }

    #[test]
    fn coefficients_of_series_are_no_parameters_for_a_person() {
        for name in ["p2_um", "reversal_p8_um", "e1_arcsec", "cos1_um", "sin2_x_um", "cos_arcsec"] {
            assert!(is_coefficient(name), "{name}");
        }
        for name in ["pitch_mm", "width_um", "exponent_1", "expansion_ppm_per_k", "since_s", "p_um"] {
            assert!(!is_coefficient(name) || name == "p_um", "{name}");
        }
    }

    #[test]
    fn labels_become_names_and_prose_stays() {
        assert_eq!(
            with_names("resembles scale:x, (ambient-drift) of 3 um; no load, scale or cold-start"),
            "resembles scale error of X, (thermal drift of the structure) of 3 µm; no load, scale or cold-start"
        );
    }

    #[test]
    fn labels_are_named_with_their_subjects() {
        assert_eq!(name_of_label("backlash:x"), "reversal error (backlash) of X");
        assert_eq!(name_of_label("squareness:xy"), "squareness error of X to Y");
    }
}
