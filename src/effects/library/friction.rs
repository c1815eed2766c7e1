//! Friction: peaks at reversals, and what a following error keeps of it.

use crate::prelude::*;

/// Decay times of the peaks, s, and shares of them in which they rise.
const FALLS: [f64; 8] = [0.005, 0.01, 0.02, 0.04, 0.08, 0.15, 0.3, 0.6];
const RISES: [f64; 3] = [0.0, 0.1, 0.4];
/// Shortest rise, s.
const RISE_MIN_S: f64 = 1e-5;
/// Longest decay of a peak, s: a longer one is lost motion under another name.
const FALL_MAX_S: f64 = 0.8;
/// Longest rise of a peak, as a share of its decay.
const RISE_SHARE: f64 = 0.6;
/// Decay times after which a twentieth of a peak is left.
const SEEN_FALLS: f64 = 3.0;
/// Time after a reversal that is drawn, in fall times.
const DRAWN: f64 = 6.0;
/// Shortest peak that offsets of 1 ms can follow, s.
const PEAK_MIN_S: f64 = 0.005;
/// Speed from which kinetic friction has about its full size, mm/s.
const CREEP_MM_PER_S: f64 = 0.1;

/// Variants of `reversal-spike`.
pub(super) fn reversal_spike(data: &Data, of: &Subject) -> Variants {
    let axis = of.axis;
    if data.moved(axis)?.is_none() {
        return Ok(Vec::new());
    }
    if !data.reverses[axis.slot()] {
        return Err("the axis is measured in one direction only".into());
    }
    if !data.moves[axis.slot()] {
        return Err("no readings while the axis moves".into());
    }
    let grid = FALLS.into_iter().flat_map(|fall_s| RISES.map(|share| (fall_s, share * fall_s)));
    let soonest_s = data.soonest_s[axis.slot()];
    let shape = |(fall_s, rise_s): (f64, f64)| Spike {
        axis,
        rise_s: rise_s.max(RISE_MIN_S),
        fall_s,
        slope: false,
        soonest_s,
    };
    // a following error keeps what friction costs for as long as the axis moves
    let kept = data.encoders_only.then(|| Friction { axis }.into());
    let peaks = grid.map(shape).filter(Spike::is_itself).map(Shape::from);
    Ok(peaks.chain(kept).collect())
}

/// `d_a = h dir (exp(-t/fall) - exp(-t/rise))` while the axis moves.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct Spike {
    pub axis: Axis,
    pub rise_s: f64,
    pub fall_s: f64,
    pub slope: bool,
    /// When after a reversal it was read first, s: of a peak that is over by then nobody knows the height.
    #[serde(skip)]
    pub soonest_s: f64,
}

impl Form for Spike {
    fn parameters(&self) -> Vec<String> {
        plain(&["height_um", "height_slope_um_per_m"][..self.width()])
    }

    fn width(&self) -> usize {
        1 + usize::from(self.slope)
    }

    fn evaluate(&self, m: &MachineState, _: &Read<'_>, out: &mut [Vec3]) {
        let i = self.axis.slot();
        let moving = f64::from(u8::from(m.velocity[i].abs() > STILL));
        let since = m.since_s[i];
        let h = if since.is_finite() && m.direction[i] != 0.0 {
            moving * m.direction[i] * ((-since / self.fall_s).exp() - (-since / self.rise_s).exp())
        } else {
            0.0
        };
        out[0] = unit(self.axis.direction()) * h;
        if self.slope {
            out[1] = unit(self.axis.direction()) * (h * m.position[i] * 1e-3);
        }
    }

    fn columns(&self) -> Vec<String> {
        let a = self.axis;
        vec![format!("dir_{a}"), a.velocity_column(), format!("since_reversal_{a}_s")]
    }

    fn drawing(&self) -> Drawing {
        let over = Over::TimeSinceReversal(self.axis, DRAWN * self.fall_s);
        Drawing::from(over).by(Branch::Direction(self.axis))
    }

    fn becomes(&self, model: &Extended, entry: &Entry) -> Becomes {
        if self.rise_s.max(self.fall_s) < PEAK_MIN_S {
            return Err("it lasts less than 5 ms: the friction compensation of the drive takes it out");
        }
        let (axis, slope) = (self.axis, self.slope);
        let law = Law::FrictionPeak { rise_s: self.rise_s, fall_s: self.fall_s };
        let symbol = shift(axis, axis);
        terms(model, entry, [Term { axis, symbol, law, most: 1.0, at: 0, slope, unit: mm_from_um(1.0) }])
    }

    fn fixed(&self) -> Vec<(String, f64)> {
        named(&[("rise_time_s", self.rise_s), ("fall_time_s", self.fall_s)])
    }

    fn peak(&self) -> Option<f64> {
        let (rise_s, fall_s) = (self.rise_s, self.fall_s);
        let at_s = (fall_s / rise_s).ln() * rise_s * fall_s / (fall_s - rise_s);
        Some((-at_s / fall_s).exp() - (-at_s / rise_s).exp()).filter(|peak| peak.is_finite())
    }

    fn is_valid(&self) -> bool {
        self.rise_s > 0.0 && self.fall_s > 0.0
    }

    fn changed(&self, f: f64) -> Vec<Shape> {
        vec![with(self, |s| s.fall_s *= f), with(self, |s| s.rise_s *= f)]
    }

    fn is_itself(&self) -> bool {
        (self.soonest_s / SEEN_FALLS..=FALL_MAX_S).contains(&self.fall_s)
            && self.rise_s <= RISE_SHARE * self.fall_s
    }

    fn traits(&self) -> Traits {
        Traits { acts_along: Some(self.axis), is_of_drive: true, ..Traits::default() }
    }

    fn builds_up(&self) -> (f64, f64) {
        (f64::INFINITY, self.fall_s)
    }
}

/// Friction that the servo lags behind by while the axis moves: `d_a = -h tanh(v/v0)`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Friction {
    pub axis: Axis,
}

impl Form for Friction {
    fn parameters(&self) -> Vec<String> {
        plain(&["friction_um"])
    }

    fn evaluate(&self, m: &MachineState, _: &Read<'_>, out: &mut [Vec3]) {
        out[0] = unit(self.axis.direction()) * -(m.velocity[self.axis.slot()] / CREEP_MM_PER_S).tanh();
    }

    fn drawing(&self) -> Drawing {
        Over::Velocity(self.axis).into()
    }

    fn becomes(&self, model: &Extended, entry: &Entry) -> Becomes {
        let (axis, law) = (self.axis, Law::Friction { speed: CREEP_MM_PER_S });
        let symbol = shift(axis, axis);
        terms(
            model,
            entry,
            [Term { axis, symbol, law, most: 1.0, at: 0, slope: false, unit: mm_from_um(1.0) }],
        )
    }

    fn traits(&self) -> Traits {
        Traits { acts_along: Some(self.axis), is_of_drive: true, ..Traits::default() }
    }
}
