//! Text and JSON of `model assemble`.

use super::input::Loaded;
use crate::model::gauge;
use crate::prelude::*;
use volcomp_identify::assemble::{Assembled, Check, Dropped, How, Origin};
use volcomp_model::gauge::Part;

/// The result with its inputs.
pub(super) struct Report<'a> {
    pub(super) loaded: &'a [Loaded],
    pub(super) done: &'a Assembled,
    pub(super) significance: f64,
}

impl Report<'_> {
    fn name(&self, source: usize) -> &str {
        &self.loaded[source].source.name
    }

    pub(super) fn lines(&self) -> Vec<String> {
        let spec = &self.done.spec;
        let mut out = vec![format!("model of {}, chain {}", spec.machine, spec.chain), "sources".to_owned()];
        for l in self.loaded {
            let kind = if l.is_table { "table of motions" } else { "model" };
            out.push(format!("  {:<28} {kind}, blake3 {}", l.source.name, &l.hash[..16]));
        }
        out.push("errors".to_owned());
        out.extend(
            self.done.errors.iter().map(|o| format!("  {:<5} {}", o.symbol.to_string(), self.origin(o))),
        );
        if !self.done.checks.is_empty() {
            out.push("overlaps".to_owned());
            out.extend(self.done.checks.iter().map(|c| format!("  {}", self.check(c))));
        }
        if !self.done.dropped.is_empty() {
            out.push("removed, because it is the set-up of the instrument".to_owned());
            out.extend(self.done.dropped.iter().map(|d| format!("  {}", self.dropped(d))));
        }
        out.extend(gauge::lines(spec, true));
        out
    }

    fn origin(&self, o: &Origin) -> String {
        let shares = || {
            let list = o.from.iter().map(|(i, share)| format!("{} {:.0} %", self.name(*i), 100.0 * share));
            list.joined(", ")
        };
        let names = || o.from.iter().map(|(i, _)| self.name(*i)).joined(", ");
        match o.how {
            How::Only => names(),
            How::Same => format!("the same in {}", names()),
            How::Mean => format!("mean of {}", shares()),
            How::Joined => format!("ranges joined of {}", shares()),
            How::Preferred => format!("{}, preferred", names()),
        }
    }

    fn check(&self, c: &Check) -> String {
        let axis = c.symbol.axis();
        let over = c.over.map_or(String::new(), |o| {
            let [low, high] = o.map(|q| (position_out(axis, q) * 1e3).round() / 1e3);
            format!(" over {low} to {high} {}", position_unit(axis))
        });
        let unit = error_unit(c.symbol);
        let out = |v: f64| error_out(c.symbol, v);
        let tested = match (c.p, c.std) {
            (Some(p), Some(std)) => {
                let verdict = if p < self.significance { "they do not agree" } else { "they agree" };
                let (std, chi, dof) = (out(std), c.chi_square.unwrap_or(0.0), c.dof);
                format!(", u (k=1) of a difference {std:.3}, chi2 {chi:.1} for {dof}, p = {p:.2}: {verdict}")
            }
            _ if c.is_identical() => ": the same".to_owned(),
            _ => ": not tested, no uncertainty is stated".to_owned(),
        };
        let ([a, b], [largest, rms]) = (c.sources.map(|s| self.name(s)), [c.largest.abs(), c.rms].map(out));
        let symbol = c.symbol;
        format!("{symbol} {a} and {b}{over}: largest difference {largest:.3}, rms {rms:.3} {unit}{tested}")
    }

    fn dropped(&self, d: &Dropped) -> String {
        let what = match d.part {
            Part::Slope { .. } => format!("slope {:.2} arcsec", arcsec_from_rad(d.amount)),
            Part::Value { .. } => {
                format!("constant {:.2} {}", error_out(d.symbol, d.amount), error_unit(d.symbol))
            }
        };
        let lost = d.unstated.iter().map(|s| s.to_string().to_lowercase()).joined(", ");
        format!("{} {what} in {}, which does not state {lost}", d.symbol, self.name(d.source))
    }

    pub(super) fn as_json(&self) -> Value {
        let sources = self.loaded.iter();
        let sources = sources.map(|l| json!({"name": l.source.name, "blake3": l.hash, "table": l.is_table}));
        json!({
            "machine": self.done.spec.machine,
            "chain": self.done.spec.chain.to_string(),
            "sources": sources.collect::<Value>(),
            "errors": self.done.errors.iter().map(|o| self.origin_json(o)).collect::<Value>(),
            "checks": self.done.checks.iter().map(|c| self.check_json(c)).collect::<Value>(),
            "dropped": self.done.dropped.iter().map(|d| self.dropped_json(d)).collect::<Value>(),
            "gauge": gauge::as_json(&self.done.spec),
        })
    }

    fn origin_json(&self, o: &Origin) -> Value {
        let how = match o.how {
            How::Only => "only",
            How::Same => "same",
            How::Mean => "mean",
            How::Joined => "joined",
            How::Preferred => "preferred",
        };
        let from = o.from.iter().map(|(i, share)| json!({"source": self.name(*i), "share": rounded(*share)}));
        json!({"symbol": key(o.symbol), "how": how, "from": from.collect::<Value>()})
    }

    fn check_json(&self, c: &Check) -> Value {
        let unit = error_unit(c.symbol);
        let axis = c.symbol.axis();
        fields!(c; places, chi_square, dof;
            "symbol": key(c.symbol),
            "sources": c.sources.map(|i| self.name(i)),
            format!("over_{}", position_unit(axis)): c.over.map(|o| o.map(|q| position_out(axis, q))),
            format!("largest_{unit}"): rounded(error_out(c.symbol, c.largest)),
            format!("rms_{unit}"): rounded(error_out(c.symbol, c.rms)),
            format!("std_{unit}"): c.std.map(|s| rounded(error_out(c.symbol, s))),
            "p_value": c.p,
            "agree": c.p.map(|p| p >= self.significance).or(c.is_identical().then_some(true)),
        )
    }

    fn dropped_json(&self, d: &Dropped) -> Value {
        let (part, amount, unit) = match d.part {
            Part::Slope { .. } => ("slope", arcsec_from_rad(d.amount), "arcsec"),
            Part::Value { .. } => ("value", error_out(d.symbol, d.amount), error_unit(d.symbol)),
        };
        json!({
            "source": self.name(d.source),
            "symbol": key(d.symbol),
            "part": part,
            format!("amount_{unit}"): rounded(amount),
            "unstated": d.unstated.iter().map(|s| key(*s)).collect::<Vec<_>>(),
        })
    }
}
