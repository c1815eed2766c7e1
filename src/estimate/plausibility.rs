//! Whether what a sensor says can be: silent, too old, frozen, jumping, out of range, too fast, with a clock that steps.
//!
//! A sensor that does any of that is excluded by name and cause; single readings that jump or cannot be are outliers and
//! only left out. It comes back by rule: when it has said something
//! plausible for [`Plausibility::return_s`], in at least [`RETURN_READINGS`] readings; outliers do not count, and do not
//! make it begin anew. A sensor that jumped comes
//! back at its new level; whether that level is right is for the comparison with the map to say
//! ([`super::sensor_initialisation`]), not for plausibility.

use volcomp_model::units::MonoTime;

/// Numbers of a reading that are looked at.
pub const VALUES_MAX: usize = 16;
/// Fewest plausible readings before a sensor comes back.
pub const RETURN_READINGS: u32 = 5;
/// Readings on end that jump, race or are out of range before a sensor counts as doing that; fewer are outliers.
pub const SUSPECT_READINGS: u32 = 3;
/// Time from the start to the first reading after which a sensor that was never heard is silent, s; its age limit where
/// that is longer. Sensors connect anew when the daemon starts.
pub const FIRST_READING_S: f64 = 10.0;
/// Equal readings that make a frozen sensor, beside the time.
const FROZEN_READINGS: u32 = 5;

/// What is plausible. Infinite: not looked at.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plausibility {
    /// Age at which a reading is too old, and silence at which the sensor is silent, s.
    pub age_limit_s: f64,
    /// Largest absolute value of each number.
    pub range: [f64; VALUES_MAX],
    /// Largest change from one reading to the next.
    pub jump: [f64; VALUES_MAX],
    /// Largest rate of change, per second.
    pub rate: [f64; VALUES_MAX],
    /// Time for which all numbers may stay exactly the same, s.
    pub frozen_s: f64,
    /// Lowest quality that is believed, 0 to 1.
    pub quality_min: f64,
    /// Time for which an excluded sensor must be plausible before it is believed again, s.
    pub return_s: f64,
}

/// What is wrong with a sensor.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum SensorFault {
    /// Nothing came for the age limit.
    Silent,
    /// Its readings come, but too late.
    Late,
    /// All numbers stay the same.
    Frozen,
    /// A number jumped.
    Jump,
    /// A number is too large, or none.
    Range,
    /// A number changes too fast.
    Rate,
    /// Its clock stepped.
    Clock,
    /// It says itself that it cannot be believed.
    Quality,
    /// It contradicts the map again and again.
    Disagrees,
    /// The tool's direction points the other way.
    Reversed,
    /// It says something of another kind or unit than its own.
    Kind,
}

impl SensorFault {
    /// Its name in status, log and documentation.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Silent => "silent",
            Self::Late => "late",
            Self::Frozen => "frozen",
            Self::Jump => "jump",
            Self::Range => "range",
            Self::Rate => "rate",
            Self::Clock => "clock",
            Self::Quality => "quality",
            Self::Disagrees => "disagrees",
            Self::Reversed => "reversed",
            Self::Kind => "kind",
        }
    }
}

/// How a sensor stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SensorStatus {
    /// It has not said anything yet.
    Waiting,
    /// Believed.
    Good,
    /// Not believed.
    Excluded(SensorFault),
}

/// What is looked at of a reading.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Said<'a> {
    /// When it was taken.
    pub at: MonoTime,
    /// The sensor's clock has stepped.
    pub stepped: bool,
    /// Quality, 0 to 1.
    pub quality: f64,
    /// Numbers to judge by range, jump and rate.
    pub values: &'a [f64],
    /// Numbers as the sensor gave them: where they stay the same it is frozen.
    pub raw: &'a [f64],
}

/// Watches one sensor.
#[derive(Debug, Clone, PartialEq)]
pub struct Supervisor {
    rules: Plausibility,
    status: SensorStatus,
    /// When the standing changed.
    since: MonoTime,
    heard: Option<MonoTime>,
    /// When it was waited for first.
    begun: Option<MonoTime>,
    /// Since when it is silent without ever having been heard.
    overdue: Option<MonoTime>,
    /// The newest plausible reading: when, its numbers.
    last: Option<(MonoTime, [f64; VALUES_MAX])>,
    /// The newest reading as it was given.
    raw: Option<[f64; VALUES_MAX]>,
    /// Readings on end that could be outliers.
    suspects: u32,
    /// Since when, and for how many readings, all numbers are the same.
    same: (MonoTime, u32),
    /// Since when, and for how many readings, an excluded sensor is plausible.
    plausible: Option<(MonoTime, u32)>,
}

impl Supervisor {
    /// A sensor that has not said anything yet.
    #[must_use]
    pub const fn new(rules: Plausibility) -> Self {
        Self {
            rules,
            status: SensorStatus::Waiting,
            since: MonoTime::ZERO,
            heard: None,
            begun: None,
            overdue: None,
            last: None,
            raw: None,
            suspects: 0,
            same: (MonoTime::ZERO, 0),
            plausible: None,
        }
    }

    /// How it stands.
    #[must_use]
    pub const fn status(&self) -> SensorStatus {
        self.status
    }

    /// How it stands and since when, for people: one that was never heard is silent after [`FIRST_READING_S`]. Its first
    /// plausible reading is believed all the same.
    #[must_use]
    pub fn reported(&self) -> (SensorStatus, MonoTime) {
        let overdue = self.overdue.map(|since| (SensorStatus::Excluded(SensorFault::Silent), since));
        overdue.unwrap_or((self.status, self.since))
    }

    /// Since when.
    #[must_use]
    pub const fn since(&self) -> MonoTime {
        self.since
    }

    /// When it was heard last.
    #[must_use]
    pub const fn heard(&self) -> Option<MonoTime> {
        self.heard
    }

    /// Time has passed.
    pub fn tick(&mut self, now: MonoTime) {
        let silent = self.heard.is_some_and(|at| now.seconds_since(at) > self.rules.age_limit_s);
        if silent && self.status != SensorStatus::Excluded(SensorFault::Silent) {
            self.exclude(now, SensorFault::Silent);
            (self.last, self.raw) = (None, None);
        }
        let begun = *self.begun.get_or_insert(now);
        let limit = self.rules.age_limit_s.max(FIRST_READING_S);
        if self.heard.is_none() && self.overdue.is_none() && now.seconds_since(begun) > limit {
            self.overdue = Some(now);
        }
    }

    /// It was heard, but what it said could not be judged.
    pub fn hear(&mut self, now: MonoTime) {
        self.tick(now);
        (self.heard, self.overdue) = (Some(now), None);
    }

    /// A reading that arrived at `now`; true where it may be believed.
    pub fn accept(&mut self, now: MonoTime, said: &Said<'_>) -> bool {
        self.hear(now);
        let (numbers, raw) = (array(said.values), array(said.raw));
        let fault = self.fault(now, said, &numbers, &raw);
        self.raw = Some(raw);
        if let Some(fault) = fault {
            let outlier = matches!(fault, SensorFault::Jump | SensorFault::Rate | SensorFault::Range);
            self.suspects += 1;
            if outlier && self.suspects < SUSPECT_READINGS && self.status != SensorStatus::Waiting {
                return false;
            }
            self.last = Some((said.at, numbers));
            self.exclude(now, fault);
            return false;
        }
        self.suspects = 0;
        self.last = Some((said.at, numbers));
        match self.status {
            SensorStatus::Good => true,
            SensorStatus::Waiting => {
                self.stand(now, SensorStatus::Good);
                true
            }
            // what contradicts the map is plausible: somebody else decides about its return
            SensorStatus::Excluded(SensorFault::Disagrees) => true,
            SensorStatus::Excluded(_) => {
                let (since, count) = self.plausible.unwrap_or((now, 0));
                self.plausible = Some((since, count + 1));
                let back = now.seconds_since(since) >= self.rules.return_s && count + 1 >= RETURN_READINGS;
                if back {
                    self.stand(now, SensorStatus::Good);
                }
                back
            }
        }
    }

    fn fault(
        &mut self,
        now: MonoTime,
        said: &Said<'_>,
        numbers: &[f64; VALUES_MAX],
        raw: &[f64; VALUES_MAX],
    ) -> Option<SensorFault> {
        let rules = &self.rules;
        let frozen = match &self.raw {
            Some(before) if before == raw => {
                self.same.1 += 1;
                now.seconds_since(self.same.0) > rules.frozen_s && self.same.1 > FROZEN_READINGS
            }
            _ => {
                self.same = (now, 1);
                false
            }
        };
        if frozen {
            return Some(SensorFault::Frozen);
        }
        if !numbers.iter().zip(&rules.range).all(|(v, range)| v.abs() <= *range && v.is_finite()) {
            return Some(SensorFault::Range);
        }
        if said.stepped {
            return Some(SensorFault::Clock);
        }
        if now.seconds_since(said.at) > rules.age_limit_s {
            return Some(SensorFault::Late);
        }
        if said.quality.is_nan() || said.quality < rules.quality_min {
            return Some(SensorFault::Quality);
        }
        let (before, last) = self.last.as_ref()?;
        let change = |k: usize| (numbers[k] - last[k]).abs();
        if (0..VALUES_MAX).any(|k| change(k) > rules.jump[k]) {
            return Some(SensorFault::Jump);
        }
        let dt = said.at.seconds_since(*before);
        if dt > 0.0 && (0..VALUES_MAX).any(|k| change(k) > rules.rate[k] * dt) {
            return Some(SensorFault::Rate);
        }
        None
    }

    /// It is not believed any more.
    pub fn exclude(&mut self, now: MonoTime, fault: SensorFault) {
        self.plausible = None;
        self.stand(now, SensorStatus::Excluded(fault));
    }

    /// Believed again: for a sensor that disagreed and agrees now.
    pub fn reinstate(&mut self, now: MonoTime) {
        self.stand(now, SensorStatus::Good);
    }

    fn stand(&mut self, now: MonoTime, status: SensorStatus) {
        if self.status != status {
            self.status = status;
            self.since = now;
        }
    }
}

fn array(values: &[f64]) -> [f64; VALUES_MAX] {
    let mut out = [0.0; VALUES_MAX];
    out.iter_mut().zip(values).for_each(|(slot, value)| *slot = *value);
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    const RULES: Plausibility = Plausibility {
        age_limit_s: 0.5,
        range: [1.0; VALUES_MAX],
        jump: [0.2; VALUES_MAX],
        rate: [f64::INFINITY; VALUES_MAX],
        frozen_s: 0.3,
        quality_min: 0.5,
        return_s: 1.0,
    };

    /// Readings every 0.1 s; `value(k)` is what it says, `None` nothing. Gives the standing after each step.
    fn watch(
        rules: Plausibility,
        steps: i64,
        value: impl Fn(i64) -> Option<(f64, f64)>,
    ) -> Vec<SensorStatus> {
        let mut s = Supervisor::new(rules);
        (0..steps)
            .map(|k| {
                let now = MonoTime::from_ns(k * 100_000_000);
                s.tick(now);
                if let Some((v, quality)) = value(k) {
                    let wobble = (k as f64 * 1.7).sin() * 0.01;
                    // a number that is exactly zero stays so
                    let v = if v == 0.0 { 0.5 } else { v + wobble };
                    let values = [v, wobble * f64::from(u8::from(v != 0.5))];
                    s.accept(now, &said(now, false, quality, &values));
                }
                s.status()
            })
            .collect()
    }

    fn said(at: MonoTime, stepped: bool, quality: f64, values: &[f64]) -> Said<'_> {
        Said { at, stepped, quality, values, raw: values }
    }

    fn excluded(statuses: &[SensorStatus], fault: SensorFault) -> (usize, usize) {
        let is = |s: &SensorStatus| *s == SensorStatus::Excluded(fault);
        let first = statuses.iter().position(is).unwrap_or(usize::MAX);
        let last = statuses.iter().rposition(is).unwrap_or(usize::MAX);
        (first, last)
    }

    #[test]
    fn every_trouble_excludes_by_name_and_the_sensor_comes_back_by_rule() {
        let s = watch(RULES, 60, |k| (!(20..30).contains(&k)).then_some((0.1, 1.0)));
        assert_eq!(
            excluded(&s, SensorFault::Silent),
            (25, 39),
            "silent: heard again at 30, back a second later"
        );
        assert_eq!(s[59], SensorStatus::Good);

        let s = watch(RULES, 60, |k| Some((if (20..23).contains(&k) { 5.0 } else { 0.1 }, 1.0)));
        assert_eq!(excluded(&s, SensorFault::Range).0, 22);
        assert_eq!(s[59], SensorStatus::Good);

        let s = watch(RULES, 60, |k| Some((if k >= 20 { 0.6 } else { 0.1 }, 1.0)));
        assert_eq!(excluded(&s, SensorFault::Jump), (22, 32), "at the new level it is plausible again");
        let s = watch(RULES, 60, |k| Some((if k % 10 == 5 { 0.7 } else { 0.1 }, 1.0)));
        assert!(s[1..].iter().all(|s| *s == SensorStatus::Good), "outliers are left out: {s:?}");

        let s = watch(RULES, 60, |k| Some((if (20..40).contains(&k) { 0.0 } else { 0.45 }, 1.0)));
        assert_eq!(excluded(&s, SensorFault::Frozen).0, 25);
        assert_eq!(s[59], SensorStatus::Good);

        let s = watch(RULES, 60, |k| Some((0.1, if k == 20 { 0.1 } else { 1.0 })));
        assert_eq!(excluded(&s, SensorFault::Quality).0, 20);

        let s = watch(RULES, 60, |k| Some((if (20..23).contains(&k) { f64::NAN } else { 0.1 }, 1.0)));
        assert_eq!(excluded(&s, SensorFault::Range).0, 22);

        let slow = Plausibility { rate: [0.5; VALUES_MAX], jump: [f64::INFINITY; VALUES_MAX], ..RULES };
        let s = watch(slow, 60, |k| Some((0.1 + if k > 20 { 0.1 * (k - 20) as f64 } else { 0.0 }, 1.0)));
        assert_eq!(excluded(&s, SensorFault::Rate).0, 23);
    }

    #[test]
    fn an_outlier_on_the_way_back_does_not_begin_it_anew() {
        // silent until 30; then every fourth reading is off by half a millimetre
        let s = watch(RULES, 60, |k| {
            let outlier = if k % 4 == 1 { 0.6 } else { 0.0 };
            (!(20..30).contains(&k)).then_some((0.1 + outlier, 1.0))
        });
        assert_eq!(excluded(&s, SensorFault::Silent), (25, 39), "{s:?}");
        assert_eq!(s[59], SensorStatus::Good);
        // three on end do
        let s = watch(RULES, 80, |k| {
            let off = if (35..38).contains(&k) { 0.6 } else { 0.0 };
            (!(20..30).contains(&k)).then_some((0.1 + off, 1.0))
        });
        assert_eq!(excluded(&s, SensorFault::Jump).0, 37, "{s:?}");
        assert!(s[45] != SensorStatus::Good && s[79] == SensorStatus::Good, "{s:?}");
    }

    #[test]
    fn one_that_was_never_heard_is_reported_silent_and_believed_from_its_first_reading() {
        let at = |s: i64| MonoTime::from_ns(s * 1_000_000_000);
        let silent = SensorStatus::Excluded(SensorFault::Silent);
        for (age_limit_s, limit) in [(0.5, 10), (60.0, 60)] {
            let mut s = Supervisor::new(Plausibility { age_limit_s, ..RULES });
            // another model has been loaded long after the start
            (1000..=1000 + limit).for_each(|k| s.tick(at(k)));
            assert_eq!(s.reported().0, SensorStatus::Waiting);
            (1001 + limit..1100).for_each(|k| s.tick(at(k)));
            assert_eq!(s.reported(), (silent, at(1001 + limit)));
            assert_eq!(s.status(), SensorStatus::Waiting);
            assert!(s.accept(at(1100), &said(at(1100), false, 1.0, &[0.1])));
            assert_eq!(s.reported(), (SensorStatus::Good, at(1100)));
            s.tick(at(1200));
            assert_eq!(s.reported(), (silent, at(1200)));
        }
    }

    #[test]
    fn clocks_and_lateness_count() {
        let mut s = Supervisor::new(RULES);
        let at = |ms: i64| MonoTime::from_ns(ms * 1_000_000);
        assert_eq!(s.status(), SensorStatus::Waiting);
        assert!(s.accept(at(0), &said(at(0), false, 1.0, &[0.1])));
        assert!(!s.accept(at(100), &said(at(100), true, 1.0, &[0.11])));
        assert_eq!(s.status(), SensorStatus::Excluded(SensorFault::Clock));
        assert!(!s.accept(at(200), &said(at(-400), false, 1.0, &[0.12])));
        assert_eq!(s.status(), SensorStatus::Excluded(SensorFault::Late));
        assert_eq!(s.since(), at(200));
    }

    #[test]
    fn one_that_disagrees_stays_out_until_somebody_reinstates_it() {
        let mut s = Supervisor::new(RULES);
        for k in 0..100 {
            let now = MonoTime::from_ns(k * 100_000_000);
            if k == 10 {
                s.exclude(now, SensorFault::Disagrees);
            }
            let plausible = s.accept(now, &said(now, false, 1.0, &[(k as f64 * 1.1).sin() * 0.05]));
            assert!(plausible, "it may be looked at");
            if k == 60 {
                s.reinstate(now);
            }
            let wanted = if (10..60).contains(&k) {
                SensorStatus::Excluded(SensorFault::Disagrees)
            } else {
                SensorStatus::Good
            };
            assert_eq!(s.status(), wanted, "{k}");
        }
    }
}
