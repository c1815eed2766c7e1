//! Squareness and location from several sources, each transferred to the lines of the result.

use super::{AssembleError, Assembly, Candidate, Check, How, Origin, curves, result_error};
use crate::prelude::*;
use volcomp_model::gauge::normalise;
use volcomp_model::statistics::normal_two_sided;

/// A constant as a source states it, transferred.
struct Value {
    source: usize,
    value: f64,
    std: Option<f64>,
}

impl Assembly<'_> {
    /// All constants of the result, for its `motions` in normal form.
    pub(super) fn constants(
        &mut self,
        motions: &ModelSpec,
    ) -> Result<Vec<(ErrorSymbol, ErrorFunction)>, AssembleError> {
        let mut symbols: Vec<ErrorSymbol> = self
            .ready
            .iter()
            .flat_map(|r| r.spec.errors.iter().map(|(s, _)| *s))
            .filter(|s| s.is_constant())
            .collect();
        symbols.sort_unstable();
        symbols.dedup();
        let mut out = Vec::new();
        for symbol in symbols {
            let candidates = self.stating(symbol);
            let preferred = self.preferred(symbol, &candidates);
            let mut values = Vec::with_capacity(candidates.len());
            for c in &candidates {
                let value = c.function.value(0.0, Travel::Forward) - self.amount(motions, c, symbol)?;
                values.push(Value { source: c.source, value, std: self.std(symbol, &c.function) });
            }
            let (value, std) = self.one_value(symbol, &values, preferred)?;
            out.push((symbol, ErrorFunction { std, ..ErrorFunction::single(Curve::Constant(value)) }));
        }
        Ok(out)
    }

    /// What the gauge adds to a constant where the motions of the result are looked at over the range, from the
    /// reference points and at the reference pose of a source: the constant of the source is that of the result plus
    /// this.
    fn amount(&self, motions: &ModelSpec, c: &Candidate, symbol: ErrorSymbol) -> Result<f64, AssembleError> {
        let ready = &self.ready[c.source];
        let mut layout = motions.clone();
        layout.tool_tip = ready.spec.tool_tip;
        layout.workpiece_origin = ready.spec.workpiece_origin;
        for axis in motions.chain.axes() {
            let own = ready.spec.axis(axis.name);
            let Some(entry) = layout.axes.iter_mut().find(|a| a.name == axis.name) else { continue };
            if let Some((_, range)) = ready.travel.iter().find(|(name, _)| *name == axis.name) {
                entry.travel = Some(*range);
            }
            // a file with an entry for an axis says where its lines are; without one they are those of the result
            let stated = ready.spec.axes.iter().any(|a| a.name == axis.name);
            if axis.kind() == AxisKind::Rotary || !stated {
                continue;
            }
            for (i, to) in own.reference_points.iter().enumerate() {
                let motion = ErrorSymbol::Motion { component: Component::ALL[i], axis: axis.name };
                let from = entry.reference_points[i];
                entry.reference_points[i] = *to;
                let Some((_, function)) = layout.errors.iter_mut().find(|(s, _)| *s == motion) else {
                    continue;
                };
                let angle = |wanted: ErrorSymbol| {
                    // an angle that nothing was measured is zero in the result, too
                    Some(motions.error(wanted).cloned().unwrap_or_default())
                };
                let primed = motions.is_workpiece_side(axis.name);
                if let Ok(moved) = curves::transferred(function, motion, &from, to, primed, angle) {
                    *function = moved;
                }
            }
        }
        let total = normalise(&layout).map_err(result_error)?.total;
        Ok(total.errors.iter().find(|(s, _)| *s == symbol).map_or(0.0, |(_, amount)| *amount))
    }

    fn one_value(
        &mut self,
        symbol: ErrorSymbol,
        values: &[Value],
        preferred: Option<usize>,
    ) -> Result<(f64, Option<f64>), AssembleError> {
        let mut checks = Vec::new();
        for (i, b) in values.iter().enumerate() {
            checks.extend(values[..i].iter().map(|a| check(symbol, a, b)));
        }
        self.checks.extend(checks.iter().cloned());
        let chosen = values.iter().find(|v| Some(v.source) == preferred).or(match values {
            [only] => Some(only),
            _ => None,
        });
        if let Some(v) = chosen {
            let how = if values.len() > 1 { How::Preferred } else { How::Only };
            self.errors.push(Origin { symbol, how, from: vec![(v.source, 1.0)] });
            return Ok((v.value, v.std));
        }
        // the same number is the same measurement: it does not become more certain
        if checks.iter().all(Check::is_identical) {
            let from = values.iter().map(|v| (v.source, 1.0 / values.len() as f64)).collect();
            self.errors.push(Origin { symbol, how: How::Same, from });
            return Ok((values[0].value, values[0].std));
        }
        let birge = self.judge(symbol, &checks)?;
        let known = values.iter().all(|v| v.std.is_some());
        let weight = |v: &Value| if known { v.std.map_or(1.0, |s| 1.0 / (s * s)) } else { 1.0 };
        let total: f64 = values.iter().map(weight).sum();
        let mean = values.iter().map(|v| weight(v) / total * v.value).sum();
        let from = values.iter().map(|v| (v.source, weight(v) / total)).collect();
        self.errors.push(Origin { symbol, how: How::Mean, from });
        Ok((mean, known.then(|| birge * (1.0 / total).sqrt())))
    }
}

fn check(symbol: ErrorSymbol, a: &Value, b: &Value) -> Check {
    let largest = b.value - a.value;
    let std = a.std.zip(b.std).map(|(x, y)| x.hypot(y));
    Check {
        symbol,
        sources: [a.source, b.source],
        over: None,
        places: 1,
        constant: 0.0,
        slope: 0.0,
        largest,
        at: 0.0,
        rms: largest.abs(),
        std,
        chi_square: std.map(|s| (largest / s).powi(2)),
        dof: 1,
        p: std.map(|s| normal_two_sided(largest / s)),
    }
}
