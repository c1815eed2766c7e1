//! Readings with a covariance to rows of unit variance that are independent of each other.
//!
//! With `C = L L^T` the rows `L^-1 H x = L^-1 z` have the identity as covariance, so that a filter of scalar updates
//! may take them one after the other (equations 5.8; a batch of scalar updates is the vector update).

use nalgebra::{DMatrix, DVector};

use super::filter::COMPONENTS_MAX;
use super::map::Row;

/// Numbers that rows at one place can say something about: the components of a map and a delay.
const UNKNOWNS: usize = COMPONENTS_MAX + 1;

/// Rows of unit variance from rows with a covariance (row, column, value; what is not named is zero); `None` where it is
/// none. Each row keeps its kind: what is left of it once everything that stands before it is known.
///
/// Many rows of one kind at one place say the same as seven of them: an orthogonal transformation leaves the
/// noise as it is and puts all that they know into these.
#[must_use]
pub fn whiten(rows: &[Row], covariance: &[(usize, usize, f64)]) -> Option<Vec<Row>> {
    let n = rows.len();
    if n == 0 || covariance.iter().any(|(i, j, v)| *i >= n || *j >= n || !v.is_finite()) {
        return None;
    }
    let white = if covariance.iter().all(|(i, j, v)| i == j || *v == 0.0) {
        let mut variance = vec![0.0; n];
        covariance.iter().for_each(|(i, _, v)| variance[*i] += v);
        scaled(rows, &variance)?
    } else {
        solved(rows, covariance)?
    };
    let one_kind = white.iter().all(|row| row.kind == white[0].kind);
    Some(if n > UNKNOWNS && one_kind { condensed(&white) } else { white })
}

fn scaled(rows: &[Row], variance: &[f64]) -> Option<Vec<Row>> {
    let row = |(row, variance): (&Row, &f64)| {
        let by = 1.0 / variance.sqrt();
        let weights = row.weights.map(|w| w * by);
        (*variance > 0.0).then_some(Row { weights, value: row.value * by, delay: row.delay * by, ..*row })
    };
    rows.iter().zip(variance).map(row).collect()
}

fn condensed(rows: &[Row]) -> Vec<Row> {
    let matrix = DMatrix::from_fn(rows.len(), UNKNOWNS + 1, |i, j| match j {
        j if j < COMPONENTS_MAX => rows[i].weights[j],
        COMPONENTS_MAX => rows[i].delay,
        _ => rows[i].value,
    });
    let r = matrix.qr().r();
    let row = |i: usize| {
        // the sign is free: the same every time
        let sign = if r[(i, i)] < 0.0 { -1.0 } else { 1.0 };
        Row {
            weights: core::array::from_fn(|j| sign * r[(i, j)]),
            delay: sign * r[(i, COMPONENTS_MAX)],
            value: sign * r[(i, UNKNOWNS)],
            kind: rows[i].kind,
        }
    };
    (0..UNKNOWNS).map(row).collect()
}

fn solved(rows: &[Row], covariance: &[(usize, usize, f64)]) -> Option<Vec<Row>> {
    let n = rows.len();
    let mut full = DMatrix::zeros(n, n);
    covariance.iter().for_each(|(i, j, v)| full[(*i, *j)] += v);
    let l = full.cholesky()?.l();
    let h = l.solve_lower_triangular(&DMatrix::from_fn(n, COMPONENTS_MAX, |i, j| rows[i].weights[j]))?;
    let z = l.solve_lower_triangular(&DVector::from_fn(n, |i, _| rows[i].value))?;
    let late = l.solve_lower_triangular(&DVector::from_fn(n, |i, _| rows[i].delay))?;
    let row = |(i, of): (usize, &Row)| Row {
        weights: core::array::from_fn(|j| h[(i, j)]),
        value: z[i],
        delay: late[i],
        kind: of.kind,
    };
    Some(rows.iter().enumerate().map(row).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Kind;

    #[test]
    fn rows_carry_the_information_of_the_covariance() {
        let c = DMatrix::from_row_slice(2, 2, &[4.0, 1.0, 1.0, 9.0]);
        let mut weights = [[0.0; COMPONENTS_MAX]; 2];
        weights[0][0] = 1.0;
        weights[1][0] = 0.5;
        weights[1][3] = 2.0;
        let with = |values: [f64; 2]| {
            let row =
                |k: usize| Row { weights: weights[k], value: values[k], delay: 0.0, kind: Kind::ALL[k] };
            [row(0), row(1)]
        };
        let of = |c: &DMatrix<f64>| -> Vec<(usize, usize, f64)> {
            (0..4).map(|k| (k / 2, k % 2, c[(k / 2, k % 2)])).collect()
        };
        let rows = whiten(&with([3.0, -1.0]), &of(&c)).unwrap();
        assert_eq!(rows[1].kind, Kind::Angle);
        // H^T C^-1 H and H^T C^-1 z are what a filter learns
        let inverse = c.clone().try_inverse().unwrap();
        for a in [0, 3] {
            for b in [0, 3] {
                let found: f64 = rows.iter().map(|r| r.weights[a] * r.weights[b]).sum();
                let wanted: f64 =
                    (0..4).map(|k| weights[k / 2][a] * inverse[(k / 2, k % 2)] * weights[k % 2][b]).sum();
                assert!((found - wanted).abs() < 1e-14, "{a} {b}");
            }
            let found: f64 = rows.iter().map(|r| r.weights[a] * r.value).sum();
            let z = [3.0, -1.0];
            let wanted: f64 = (0..4).map(|k| weights[k / 2][a] * inverse[(k / 2, k % 2)] * z[k % 2]).sum();
            assert!((found - wanted).abs() < 1e-14);
        }
        let singular = DMatrix::from_row_slice(2, 2, &[1.0, 1.0, 1.0, 1.0]);
        let rows = with([1.0, 1.0]);
        assert!(whiten(&rows, &of(&singular)).is_none());
        assert!(whiten(&rows[..1], &of(&c)).is_none() && whiten(&[], &[]).is_none());
        assert!(whiten(&rows, &[(0, 0, 1.0)]).is_none(), "a row without variance");
        assert!(whiten(&rows, &of(&DMatrix::from_element(2, 2, f64::NAN))).is_none());
        let plain = whiten(&rows, &[(0, 0, 4.0), (1, 1, 9.0)]).unwrap();
        assert_eq!((plain[0].value, plain[1].weights[3]), (0.5, 2.0 / 3.0));
    }

    #[test]
    fn many_rows_are_condensed_and_say_the_same() {
        let f = |k: usize| ((k * k) as f64 * 0.37).sin();
        let rows: Vec<Row> = (0..300)
            .map(|k| Row {
                weights: core::array::from_fn(|c| f(7 * k + c)),
                value: f(7 * k + 6),
                delay: f(k + 5),
                kind: Kind::Length,
            })
            .collect();
        let diagonal: Vec<_> = (0..300).map(|k| (k, k, 1.0 + f(k).abs())).collect();
        let few = whiten(&rows, &diagonal).unwrap();
        assert_eq!(few.len(), UNKNOWNS);
        let all = scaled(&rows, &diagonal.iter().map(|(.., v)| *v).collect::<Vec<_>>()).unwrap();
        for a in 0..COMPONENTS_MAX {
            let of =
                |rows: &[Row], g: &dyn Fn(&Row) -> f64| rows.iter().map(|r| r.weights[a] * g(r)).sum::<f64>();
            assert!((of(&few, &|r| r.value) - of(&all, &|r| r.value)).abs() < 1e-9);
            assert!((of(&few, &|r| r.delay) - of(&all, &|r| r.delay)).abs() < 1e-9);
            for b in 0..COMPONENTS_MAX {
                assert!((of(&few, &|r| r.weights[b]) - of(&all, &|r| r.weights[b])).abs() < 1e-9);
            }
        }
    }
}
