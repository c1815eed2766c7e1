//! Poses of a robot as a tracker measured them: three reflectors and the joint angles per line, without a header.

/// Poses of three reflectors on a robot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReflectorPoses {
    /// Number of poses.
    pub count: usize,
    /// Mean and standard deviation of each side, mm.
    pub sides: [[f64; 2]; 3],
}

/// Share of a side by which it may vary in a rigid body.
const RIGID: f64 = 1e-3;
/// Fewest poses.
const POSES_MIN: usize = 6;

/// Three points of a rigid body per line, in nine leading columns without a header; `None` for anything else.
#[must_use]
pub fn recognise(start: &str) -> Option<ReflectorPoses> {
    let mut lines: Vec<&str> = start.lines().map(str::trim).filter(|l| !l.is_empty()).collect();
    // the head may end within a line
    if lines.len() > POSES_MIN && !start.ends_with('\n') {
        lines.pop();
    }
    let row = |line: &&str| -> Option<Vec<f64>> {
        let fields =
            line.split(|c: char| c.is_whitespace() || c == ',' || c == ';').filter(|f| !f.is_empty());
        fields.map(|f| f.parse::<f64>().ok().filter(|v| v.is_finite())).collect()
    };
    let rows: Vec<Vec<f64>> = lines.iter().map(row).collect::<Option<_>>()?;
    let width = rows.first().map(Vec::len)?;
    if rows.len() < POSES_MIN || width < 12 || rows.iter().any(|r| r.len() != width) {
        return None;
    }
    let side = |r: &[f64], a: usize, b: usize| {
        (0..3).map(|k| (r[3 * a + k] - r[3 * b + k]).powi(2)).sum::<f64>().sqrt()
    };
    let of = |a: usize, b: usize| {
        let values: Vec<f64> = rows.iter().map(|r| side(r, a, b)).collect();
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        [mean, (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0)).sqrt()]
    };
    let sides = [of(0, 1), of(1, 2), of(2, 0)];
    let rigid = sides.iter().all(|[mean, std]| *mean > 1.0 && std < &(RIGID * mean));
    rigid.then_some(ReflectorPoses { count: rows.len(), sides })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn three_reflectors_of_a_rigid_body_are_told_from_other_tables() {
        let mut text = String::new();
        for k in 0..8 {
            let (s, c) = (f64::from(k) * 0.7).sin_cos();
            let at = |x: f64, y: f64| {
                format!("{} {} {}", 100.0 + x * c - y * s, x * s + y * c, 5.0 * f64::from(k))
            };
            text += &format!("{} {} {} {} 0 0 0\n", at(0.0, 0.0), at(200.0, 0.0), at(0.0, 150.0), k);
        }
        let poses = recognise(&text).unwrap();
        assert_eq!(poses.count, 8);
        assert!((poses.sides[0][0] - 200.0).abs() < 1e-9 && (poses.sides[1][0] - 250.0).abs() < 1e-9);
        let bent = text.replace("100 0 0 ", "101 0 0 ");
        assert!(recognise(&bent).is_none(), "not rigid");
        assert!(recognise("1 2 3\n4 5 6\n").is_none());
        assert!(recognise("a,b\n1,2\n").is_none());
    }
}
