//! What the search chose beside a cause and nobody stands by: parts of something that the library lacks come together, and
//! what looks most like a cause among them is one of them.

use super::super::Analysis;
use super::super::assess::{Assessed, DECLARED};
use super::super::moment::Axis;

/// Weighs every effect by its doubtful company: what others, which are not declared, are likely to explain wrongly in its
/// direction, as a multiple of what it explains itself.
pub(super) fn weigh(a: &Analysis, assessed: &mut [Assessed]) {
    let doubtful: Vec<(Option<Axis>, f64)> = assessed
        .iter()
        .map(|x| {
            // a group may be at work of which no member has a name
            let stands = x.declared || (x.remark.is_empty() && x.group_probability >= DECLARED);
            let wrong = if stands || x.is_one_pass() { 0.0 } else { 1.0 - x.group_probability };
            // beside all the others: what they explain as well says nothing about them
            let gain = x.found.gain / a.problem.len().max(1) as f64;
            (a.library.variants[x.variant].shape.acts_along(), wrong * gain)
        })
        .collect();
    for (place, x) in assessed.iter_mut().enumerate() {
        x.gates.company = company(&doubtful, place) / x.gates.gain_per_reading().max(1e-12);
    }
    assessed.iter_mut().for_each(Assessed::settle);
}

/// The sum over all but one that act in its direction; `None` acts in several.
fn company(doubtful: &[(Option<Axis>, f64)], place: usize) -> f64 {
    let own = doubtful[place].0;
    let others = doubtful.iter().enumerate().filter(|(i, _)| *i != place);
    others
        .filter(|(_, (along, _))| own.is_none() || along.is_none() || *along == own)
        .map(|(_, (_, g))| g)
        .sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_acts_elsewhere_is_no_company() {
        let all = [(Some(Axis::X), 3.0), (Some(Axis::Y), 5.0), (None, 7.0), (Some(Axis::X), 11.0)];
        assert!((company(&all, 0) - 18.0).abs() < 1e-12);
        assert!((company(&all, 1) - 7.0).abs() < 1e-12);
        assert!((company(&all, 2) - 19.0).abs() < 1e-12);
    }
}
