//! Curves in the other sense, scaled, and at another reference point: exact for every kind where the lever is constant.

use crate::prelude::*;

use volcomp_model::DynamicTerm;
use volcomp_model::curve::{Chebyshev, ErrorFunction, Fourier, Grid, HalfRange};
use volcomp_model::spec::{ReferenceBody, ReferencePoint};

/// Places of a product of curve and coordinate, which no kind of curve holds exactly.
const PLACES: usize = 401;

/// `g(x) = -f(-x)` with the directions of travel exchanged: from the carriage's own sense to the relative one and back
/// (equations 1.4).
pub(super) fn mirrored(f: &ErrorFunction, axis: AxisName) -> ErrorFunction {
    ErrorFunction {
        curves: f.curves.iter().map(mirrored_curve).collect(),
        grids: f.grids.iter().map(|g| mirrored_grid(g, axis)).collect(),
        // a sensor tells the same body's motion: only its sign would change, which its owner has to say
        live: f.live.clone(),
        // signals are odd, as the error is, so that only the slope changes its sign
        dynamics: f.dynamics.iter().map(|d| DynamicTerm { growth: -d.growth, ..*d }).collect(),
        std: f.std,
    }
}

/// A curve in the other sense: `E_carriage(x) = -E_relative(-x)`; travel towards plus of one is towards minus of the other.
#[must_use]
pub fn mirrored_curve(curve: &Curve) -> Curve {
    let mirrored = match curve {
        Curve::Constant(v) => Some(Curve::Constant(-v)),
        Curve::Table(t) => {
            let (x, forward, reverse) = t.columns();
            let back = |v: &[f64]| v.iter().rev().map(|v| -v).collect::<Vec<f64>>();
            let (new_forward, new_reverse) = match reverse {
                Some(reverse) => (back(reverse), Some(back(forward))),
                None => (back(forward), None),
            };
            Table::new(back(x), new_forward, new_reverse, t.interpolation()).ok().map(Curve::Table)
        }
        Curve::Fourier(f) => {
            let (mean, linear) = f.mean_and_linear();
            let [low, _] = f.range();
            let turn = |k: usize| (TAU / f.period() * f.span() * (k + 1) as f64).sin_cos();
            let pairs = f.harmonics().iter().enumerate().map(|(k, [c, s])| {
                let (sin, cos) = turn(k);
                (-(c * cos + s * sin), -(c * sin - s * cos))
            });
            let (cos, sin): (Vec<f64>, Vec<f64>) = pairs.unzip();
            Fourier::new(-(low + f.span()), f.span(), f.period(), -mean, linear, &cos, &sin)
                .ok()
                .map(Curve::Fourier)
        }
        Curve::HalfRange(h) => {
            let (mean, linear, sines) = h.coefficients();
            let [low, high] = h.range();
            // sin(k pi (1 - u)) = -(-1)^k sin(k pi u)
            let sines: Vec<f64> = sines.enumerate().map(|(k, s)| if k % 2 == 0 { -s } else { s }).collect();
            HalfRange::new(-high, -low, -mean, linear, &sines).ok().map(Curve::HalfRange)
        }
        Curve::Chebyshev(c) => {
            let [low, high] = c.range();
            // T_k(-s) = (-1)^k T_k(s)
            let list = c.coefficients().iter().enumerate().map(|(k, v)| if k % 2 == 0 { -v } else { *v });
            Chebyshev::new(-high, -low, list.collect()).ok().map(Curve::Chebyshev)
        }
    };
    // every part is finite and in order, because the curve was
    mirrored.unwrap_or_else(|| curve.clone())
}

fn mirrored_grid(grid: &Grid, axis: AxisName) -> Grid {
    let names: Vec<AxisName> = grid.axes().collect();
    let sizes: Vec<usize> = (0..names.len()).map(|i| grid.positions(i).len()).collect();
    let axes = names.iter().enumerate().map(|(i, name)| {
        let p = grid.positions(i);
        (*name, if *name == axis { p.iter().rev().map(|v| -v).collect() } else { p.to_vec() })
    });
    let own = names.iter().position(|n| *n == axis);
    let values = (0..grid.values().len()).map(|index| {
        // the same place with the own axis counted from the other end
        let mut rest = index;
        let mut from = 0;
        let mut step = 1;
        for (i, size) in sizes.iter().enumerate().rev() {
            let place = rest % size;
            rest /= size;
            from += step * if own == Some(i) { size - 1 - place } else { place };
            step *= size;
        }
        -grid.values()[from]
    });
    Grid::new(axes.collect(), values.collect()).unwrap_or_else(|_| grid.clone())
}

/// A curve times a number.
fn scaled(curve: &Curve, k: f64) -> Curve {
    let by = |v: &[f64]| v.iter().map(|v| v * k).collect::<Vec<f64>>();
    let out = match curve {
        Curve::Constant(v) => Some(Curve::Constant(v * k)),
        Curve::Table(t) => {
            let (x, forward, reverse) = t.columns();
            Table::new(x.to_vec(), by(forward), reverse.map(by), t.interpolation()).ok().map(Curve::Table)
        }
        Curve::Fourier(f) => {
            let (mean, linear) = f.mean_and_linear();
            let (cos, sin): (Vec<f64>, Vec<f64>) = f.harmonics().iter().map(|[c, s]| (c * k, s * k)).unzip();
            Fourier::new(f.range()[0], f.span(), f.period(), mean * k, linear * k, &cos, &sin)
                .ok()
                .map(Curve::Fourier)
        }
        Curve::HalfRange(h) => {
            let (mean, linear, sines) = h.coefficients();
            let [low, high] = h.range();
            HalfRange::new(low, high, mean * k, linear * k, &sines.map(|s| s * k).collect::<Vec<_>>())
                .ok()
                .map(Curve::HalfRange)
        }
        Curve::Chebyshev(c) => {
            let [low, high] = c.range();
            Chebyshev::new(low, high, by(c.coefficients())).ok().map(Curve::Chebyshev)
        }
    };
    out.unwrap_or_else(|| curve.clone())
}

/// The curve times the coordinate, over its range: a fine table.
fn times_coordinate(curve: &Curve, k: f64) -> Option<Curve> {
    let [low, high] = curve.range()?;
    let mut x: Vec<f64> = (0..PLACES).map(|i| low + (high - low) * i as f64 / (PLACES - 1) as f64).collect();
    let mut directed = false;
    if let Curve::Table(t) = curve {
        x.extend(t.columns().0);
        directed = t.columns().2.is_some();
        x.sort_by(f64::total_cmp);
        x.dedup_by(|b, a| *b - *a <= 1e-9 * (high - low));
    }
    let values = |travel: Travel| x.iter().map(|q| k * q * curve.value(*q, travel)).collect::<Vec<f64>>();
    let reverse = directed.then(|| values(Travel::Reverse));
    Table::new(x.clone(), values(Travel::Forward), reverse, Interpolation::Linear).ok().map(Curve::Table)
}

/// A linear component at another reference point: `E_i + [eps x (r_to - r_from)]_i` (equations 1.5), relative sense.
/// `angle` gives an angular error motion; an angle that is needed but missing is returned with its lever.
pub(super) fn transferred(
    function: &ErrorFunction,
    symbol: ErrorSymbol,
    from: &ReferencePoint,
    to: &ReferencePoint,
    primed: bool,
    angle: impl Fn(ErrorSymbol) -> Option<ErrorFunction>,
) -> Result<ErrorFunction, (ErrorSymbol, f64)> {
    let mut out = function.clone();
    if from == to {
        return Ok(out);
    }
    let (i, axis) = (symbol.component().index(), symbol.axis());
    let lever = to.point - from.point;
    // a point that stays with the bed moves in carriage coordinates
    let sigma = if primed { 1.0 } else { -1.0 };
    let with_bed = |r: &ReferencePoint| f64::from(u8::from(r.body == ReferenceBody::Bed));
    let own = sigma * (with_bed(to) - with_bed(from));
    let mut variance = out.std.map(|s| s * s);
    // [eps x lever]_i = eps_j lever_k - eps_k lever_j
    let (j, k) = ((i + 1) % 3, (i + 2) % 3);
    for (turn, arm, sign) in [(j, k, 1.0), (k, j, -1.0)] {
        let constant = sign * lever[arm];
        let growing = if arm == axis.direction() { sign * own } else { 0.0 };
        if constant == 0.0 && growing == 0.0 {
            continue;
        }
        let needed = ErrorSymbol::Motion { component: Component::ALL[3 + turn], axis };
        let Some(eps) = angle(needed) else { return Err((needed, constant.abs().max(growing.abs()))) };
        for curve in &eps.curves {
            if constant != 0.0 {
                out.curves.push(scaled(curve, constant));
            }
            if growing != 0.0 {
                out.curves.extend(times_coordinate(curve, growing));
            }
        }
        variance = variance.zip(Some(eps.std.unwrap_or(0.0))).map(|(v, s)| v + (constant * s).powi(2));
    }
    out.std = variance.map(f64::sqrt);
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn all_kinds() -> Vec<Curve> {
        let table = |rule| {
            Table::new(vec![-3.0, 1.0, 7.0], vec![0.1, -0.2, 0.4], Some(vec![0.0, 0.3, -0.1]), rule).unwrap()
        };
        vec![
            Curve::Constant(0.3),
            Curve::Table(table(Interpolation::Linear)),
            Curve::Table(table(Interpolation::MonotoneCubic)),
            Curve::Fourier(Fourier::new(-3.0, 10.0, 4.3, 0.1, 0.2, &[0.3, 0.0, 0.1], &[-0.4, 0.2]).unwrap()),
            Curve::HalfRange(HalfRange::new(-3.0, 7.0, 0.2, -0.1, &[0.3, 0.5, -0.2]).unwrap()),
            Curve::Chebyshev(Chebyshev::new(-3.0, 7.0, vec![0.1, 0.2, -0.3, 0.05]).unwrap()),
        ]
    }

    #[test]
    fn every_kind_is_mirrored_and_scaled_exactly() {
        for curve in all_kinds() {
            let (m, s) = (mirrored_curve(&curve), scaled(&curve, -2.5));
            for i in 0..=60 {
                let x = -4.0 + 0.2 * f64::from(i);
                for travel in [Travel::Forward, Travel::Reverse] {
                    let want = -curve.value(-x, travel.reversed());
                    assert!((m.value(x, travel) - want).abs() < 1e-14, "{curve:?} at {x}");
                    assert!(
                        (s.value(x, travel) + 2.5 * curve.value(x, travel)).abs() < 1e-14,
                        "{curve:?} at {x}"
                    );
                    assert!((mirrored_curve(&m).value(x, travel) - curve.value(x, travel)).abs() < 1e-13);
                }
            }
        }
    }

    #[test]
    fn grids_are_mirrored_along_their_own_axis() {
        let axes = vec![(AxisName::Y, vec![0.0, 1.0, 3.0]), (AxisName::X, vec![-2.0, 5.0])];
        let grid = Grid::new(axes, vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0]).unwrap();
        let m = mirrored_grid(&grid, AxisName::X);
        for (y, x) in [(0.0, 1.0), (0.5, -4.0), (2.0, 2.0), (3.0, -1.0)] {
            assert!((m.value(&[y, x]).0 + grid.value(&[y, -x]).0).abs() < 1e-14);
        }
        let m = mirrored_grid(&grid, AxisName::Y);
        assert!((m.value(&[-2.0, 1.0]).0 + grid.value(&[2.0, 1.0]).0).abs() < 1e-14);
    }

    #[test]
    fn levers_are_those_of_the_cross_product() {
        let symbol = |t: &str| ErrorSymbol::parse(t).unwrap();
        let e = ErrorFunction { std: Some(3e-4), ..ErrorFunction::single(Curve::Constant(0.01)) };
        let at = |x: f64, y: f64, z: f64, body| ReferencePoint {
            point: volcomp_model::geometry::Vec3::new(x, y, z),
            body,
        };
        let from = at(0.0, 0.0, 0.0, ReferenceBody::Carriage);
        let to = at(10.0, 20.0, 30.0, ReferenceBody::Carriage);
        let eps = |s: ErrorSymbol| {
            let v = [1e-5, 2e-5, 3e-5][s.component().index() - 3];
            Some(ErrorFunction { std: Some(2e-5), ..ErrorFunction::single(Curve::Constant(v)) })
        };
        // eps x r with eps = (1, 2, 3)e-5, r = (10, 20, 30): (2*30 - 3*20, 3*10 - 1*30, 1*20 - 2*10)e-5 = 0, so take one arm
        let only = |s: ErrorSymbol| if s == symbol("ebx") { eps(s) } else { Some(ErrorFunction::default()) };
        let moved = transferred(&e, symbol("exx"), &from, &to, false, only).unwrap();
        assert!((moved.value(0.0, Travel::Forward) - (0.01 + 2e-5 * 30.0)).abs() < 1e-15);
        assert!((moved.std.unwrap() - (9e-8f64 + (30.0f64 * 2e-5).powi(2)).sqrt()).abs() < 1e-12);
        let missing = transferred(&e, symbol("eyx"), &from, &to, false, |_| None).unwrap_err();
        assert_eq!(missing, (symbol("ecx"), 10.0));
        // on the bed of an unprimed axis the point falls behind: lever -q along x, EYX gets ECX * (-q)
        let bed = at(0.0, 0.0, 0.0, ReferenceBody::Bed);
        let slope =
            ErrorFunction::single(Curve::Chebyshev(Chebyshev::new(0.0, 100.0, vec![0.0, 1e-5]).unwrap()));
        let moved = transferred(&ErrorFunction::default(), symbol("eyx"), &from, &bed, false, |_| {
            Some(slope.clone())
        });
        assert!((moved.unwrap().value(80.0, Travel::Forward) + 80.0 * 0.6e-5).abs() < 1e-15);
    }
}
