//! The reasons of a decision in words: the only place where they become sentences.

use super::super::decision::{Assessed, Cost, Reason};

/// Why an effect is not declared; of one that is, which pairs say the same.
pub(super) fn remark(x: &Assessed) -> String {
    let pairs = || x.sums.iter().map(|[a, b]| format!("{a} with {b}")).collect::<Vec<_>>().join(", or ");
    match x.reason {
        Some(reason) => words(reason),
        None if x.sums.is_empty() => String::new(),
        None => format!("on this plan the same as {} together", pairs()),
    }
}

pub(super) fn words(reason: Reason) -> String {
    let text = match reason {
        Reason::HeldOut { with_um, without_um } => {
            return format!(
                "makes readings that were left out worse: {with_um:.2} µm with it, {without_um:.2} µm without it"
            );
        }
        Reason::Harms { with_um, without_um } => {
            return format!(
                "its correction makes the gap larger: {with_um:.2} µm with it, {without_um:.2} µm without it; drift takes back what it says"
            );
        }
        Reason::Little { shrink } => {
            return format!(
                "the gap is within the noise, and correcting it would take out {:.0} % of it at most",
                100.0 * shrink.max(0.0)
            );
        }
        Reason::Worse => "fits readings that were left out worse than no effect at all",
        Reason::Improbable { probability, group, cost } => {
            let of_group =
                if group > probability { format!(", of its group {group:.2}") } else { String::new() };
            return format!("posterior probability {probability:.2}{of_group}{}", costs(cost));
        }
    };
    text.to_owned()
}

fn costs(cost: Cost) -> String {
    match cost {
        Cost::Evidence => String::new(),
        Cost::Between(share) => {
            format!(": differs between programs, places or runs by {:.0} % of itself", 100.0 * share)
        }
        Cost::OneProgram => {
            ": one program alone shows it; another one that does decides whether it is the same there"
                .to_owned()
        }
        Cost::Misform(share) => format!(
            ": differs by {:.0} % of itself with the position of other axes, speed, temperature, time or tool",
            100.0 * share
        ),
        Cost::Company(share) => format!(
            ": the effects chosen in this session deviate by {:.0} % of themselves in the mean, so an effect outside the library may be at work",
            100.0 * share
        ),
        Cost::Discrepancy(um) => format!(
            ": no effect of the library explains {um:.2} µm RMS of the gap beside it, and it may be a part of that"
        ),
        Cost::TakesBack => ": takes back what the other effects say".to_owned(),
    }
}
